"""What prims hand down to those below them, and names for what model files bring along."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field

from phrt.description.prims import PrimBase
from phrt.description.problems import Mark
from phrt.description.values import Value
from phrt.errors import PhrtWarning, did_you_mean
from phrt.scene import EffectSwitch


@dataclass(frozen=True)
class Inherited:
    """What a prim hands down to those below it."""

    material: str | None = None
    material_mark: Mark | None = None
    importance: dict[str, float] = field(default_factory=dict)
    effects: dict[str, EffectSwitch] = field(default_factory=dict)
    tags: tuple[str, ...] = ()
    casts_shadow: bool = True

    def below(self, prim: PrimBase, value: Value) -> Inherited:
        """With the opinions of `prim`, described by `value`: the nearest wins, tags add up."""
        return Inherited(
            material=prim.material or self.material,
            material_mark=value.mark_of(("material",)) if prim.material else self.material_mark,
            importance=dict(prim.importance) if prim.importance is not None else self.importance,
            effects={**self.effects, **prim.effects},
            tags=tuple(dict.fromkeys((*self.tags, *prim.tags))),
            casts_shadow=self.casts_shadow if prim.casts_shadow is None else prim.casts_shadow,
        )


def prim_name(name: str, otherwise: str) -> str:
    """`name` from a model file as a prim's name: what paths and overrides use as separators becomes "_"."""
    cleaned = "".join(
        "_" if character in "/.:{}[],'\"*&#|>%@`=" or character.isspace() else character for character in name
    )
    return cleaned.strip("_") or otherwise


def unique(path: str, taken: set[str]) -> str:
    """`path`, with a number where it is taken; it is taken afterwards."""
    result, number = path, 1
    while result in taken:
        result, number = f"{path}_{number}", number + 1
    taken.add(result)
    return result


def warn_of_unknown_effects(prim: PrimBase, value: Value, path: str) -> None:
    """A switch for an effect that is not installed changes nothing, which may be meant, or a slip of the pen."""
    if not prim.effects:
        return
    from phrt.registry.manager import get_registry

    known = get_registry().names("effect")
    for name in prim.effects:
        if name not in known:
            mark = value.mark_of(("effects", name))
            message = f"{mark}: {path}: effects: there is no effect '{name}' here; known are {', '.join(known)}."
            warnings.warn(message + did_you_mean(name, known), PhrtWarning, stacklevel=2)
