"""Controls: what steers the choice while a program runs - budget, situation, attention, and how much speed and habit count.

Three voices, the strongest first: what the caller says (`Renderer.control`, the command line), the scene's track at the frame's
time, the defaults. Each field is one value: an `attention` that is given replaces the one before as a whole.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any

from phrt.budget import UNLIMITED, Budget, parse_budget
from phrt.errors import OptionError, PhrtWarning, did_you_mean

if TYPE_CHECKING:
    from phrt.scene import Scene

DEFAULT_PERSISTENCE = 0.0001
"""I. V of an object that covers 0.2 % of the picture, halfway to its border and 10 m away, is 0.0001, which is the median of the
reference scene: an item that was traced counts as if such an object were added to it."""


LARGEST = 1e18
"""Of every number here: what is made of them must fit single precision."""


@dataclass(frozen=True)
class Controls:
    """What somebody asks for; None in a field leaves it to the next weaker voice.

    budget      : as `phrt.budget.parse_budget` reads it
    persistence : I of the paper, 0 or more
    situation   : which values of the importance maps hold
    attention   : factor on K by tag, 0 or more; 1 is indifferent
    view_speed  : how much motion in the picture lowers V, 0 (not at all) or more
    parameters  : whatever a host program wants heuristics to know; reaches them as `FrameContext.parameters`
    """

    budget: Budget | str | None = None
    persistence: float | None = None
    situation: str | None = None
    attention: Mapping[str, float] | None = None
    view_speed: float | None = None
    parameters: Mapping[str, object] | None = None


@dataclass(frozen=True)
class Conditions:
    """What holds in a frame: `Controls` with every field settled, the scene's situation apart."""

    budget: Budget = UNLIMITED
    persistence: float = DEFAULT_PERSISTENCE
    situation: str = "default"
    attention: Mapping[str, float] = field(default_factory=dict)
    view_speed: float = 0.0
    parameters: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True)
class ControlKey:
    """A key of a scene's track: what its controls say holds from `time` seconds on, until a later key says otherwise."""

    time: float
    controls: Controls


FIELDS = tuple(entry.name for entry in fields(Controls))


def changed(controls: Controls, changes: Mapping[str, object], scene: Scene) -> Controls:
    """`controls` with `changes` to its fields, checked for `scene`; None takes a field back.

    Raises OptionError that names the field, what was given and what is allowed; a tag of `attention` that no object has is
    a PhrtWarning, because objects may come and go between scenes while a host's list of tags stays.
    """
    for name in changes:
        if name not in FIELDS:
            raise OptionError(f"no control '{name}'; there are {', '.join(FIELDS)}.{did_you_mean(name, list(FIELDS))}")
    checked: dict[str, Any] = {name: _checked(name, value, scene) for name, value in changes.items()}
    return replace(controls, **checked)


def _checked(name: str, value: object, scene: Scene) -> object:
    """`value` of field `name`, copied where it could change under us."""
    if value is None:
        return None
    match name:
        case "budget":
            return parse_budget(value)
        case "persistence" | "view_speed":
            return not_negative(name, value)
        case "situation":
            return checked_situation(value, known_situations(scene))
        case "attention":
            attention = checked_attention(value)
            for message in unknown_tags(attention, scene):
                warnings.warn(message, PhrtWarning, stacklevel=4)
            return attention
        case _:
            if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
                raise OptionError(f"parameters is {value!r}, expected values by name, as in {{'hurry': 0.5}}")
            return dict(value)


def not_negative(name: str, value: object) -> float:
    """`value` as a number of 0 or more. Raises OptionError that calls it `name`."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0 <= value <= LARGEST:
        raise OptionError(f"{name} is {value!r}; it must be 0 or more, and at most {LARGEST:g}")
    return float(value)


def checked_situation(value: object, known: Sequence[str]) -> str:
    """`value`, one of `known`. Raises OptionError."""
    if value not in known:
        hint = did_you_mean(value, list(known)) if isinstance(value, str) else ""
        raise OptionError(f"there is no situation {value!r}; the scene has {', '.join(known)}.{hint}")
    return str(value)


def checked_attention(value: object, name: str = "attention") -> dict[str, float]:
    """`value` as factors by tag. Raises OptionError that calls it `name`."""
    if not isinstance(value, Mapping) or not all(isinstance(tag, str) for tag in value):
        raise OptionError(f"{name} is {value!r}, expected factors by tag, as in {{'gold': 3}}")
    return {tag: not_negative(f"{name} for '{tag}'", factor) for tag, factor in value.items()}


def unknown_tags(attention: Iterable[str], scene: Scene) -> list[str]:
    """What to tell of tags that no object of `scene` has: attention to them changes nothing."""
    known = sorted({tag for entry in scene.objects for tag in entry.tags})
    has = f"there are {', '.join(known[:20])}" if known else "no object has a tag"
    return [
        f"attention: no object has the tag '{tag}'; {has}.{did_you_mean(tag, known)}"
        for tag in attention
        if tag not in known
    ]


def known_situations(scene: Scene) -> list[str]:
    """`default`, the scene's variants, and every situation that an importance map names."""
    named = [situation for entry in scene.objects for situation in entry.importance]
    return list(dict.fromkeys(["default", *scene.situations, scene.situation, *named]))


def in_force(given: Controls, track: Sequence[ControlKey], time: float, scene: Scene) -> Conditions:
    """What holds at `time` seconds: each field from `given`, else from the last key of `track` (rising times) that has come
    and says something of it, else the default, which is the loaded variant for the situation."""
    settled: dict[str, Any] = {"situation": scene.situation}
    for controls in (*(key.controls for key in track if key.time <= time), given):
        settled |= {name: value for name in FIELDS if (value := getattr(controls, name)) is not None}
    settled["budget"] = parse_budget(settled.get("budget"))
    return Conditions(**settled)
