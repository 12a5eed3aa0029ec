"""`load_scene`: a scene description, or a model file that is framed and lit, as a `Scene`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any

from phrt.description.assets import AssetRoots
from phrt.description.build import Builder
from phrt.description.framing import add_camera, add_lights
from phrt.description.inherited import prim_name
from phrt.description.layers import DESCRIPTOR_SUFFIXES, Composer, Stage, overridden, stage_of
from phrt.description.models import loader_name
from phrt.description.overrides import marked, parse_override
from phrt.description.problems import Mark, Problems
from phrt.description.seen import check_places
from phrt.description.values import Value, value_of
from phrt.errors import AssetError, OptionError
from phrt.limits import MOST_FRAMES
from phrt.scene import Scene

"""As of a RenderSettings prim."""

Overrides = Mapping[str, Any] | Iterable[str]


def load_scene(
    path: str | PathLike[str],
    *,
    search: Sequence[str | PathLike[str]] | None = None,
    overrides: Overrides | None = None,
    variant: str | None = None,
) -> Scene:
    """The scene described in `path` (.yaml, .yml, .json), or a model file, framed and lit where it is not.

    search    : folders to find assets in, after the scene's own and before those of PHRT_ASSETS.
    overrides : {"/World/Lamp.intensity": 3, "variant": "night"}, or texts "/World/Lamp.intensity=3".
    variant   : the variant to select; default the one the file names, else `default`.

    Raises SceneError with every problem of a description: file, line, prim, what was given and what is allowed;
    AssetError for a missing or broken model file; OptionError for a malformed override.
    """
    file = Path(path).expanduser()
    try:
        if not file.is_file():
            raise AssetError(f"{file}: {'is not a file' if file.exists() else 'there is no such file'}")
    except (OSError, ValueError) as error:
        # A name that is too long, or holds a zero byte; a folder that may not be looked into.
        raise AssetError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    changes = _as_mapping(overrides)
    variant = _variant(changes, variant)
    # A link to a scene may name what lies beside the link and what lies beside the scene.
    roots = AssetRoots(file.parent, [file.resolve().parent, *(Path(folder) for folder in search or ())])
    problems = Problems()
    if file.suffix.lower() in DESCRIPTOR_SUFFIXES:
        scene = _described(file, roots, changes, variant, problems)
    else:
        scene = _bare_model(file, roots, changes, variant, problems)
    check_places(scene)
    add_camera(scene)
    return scene


def _described(
    file: Path, roots: AssetRoots, overrides: Mapping[str, Any], variant: str | None, problems: Problems
) -> Scene:
    composer = Composer(roots, problems)
    resolved = file.resolve()
    name, opinions = composer.file(resolved, variant, str(file))
    overridden(opinions, marked(overrides), problems)
    stage = stage_of(name, opinions, composer.variants, problems)
    scene = Builder(stage, roots, file, problems).build()
    scene.situation = composer.variant
    return scene


def _bare_model(
    file: Path, roots: AssetRoots, overrides: Mapping[str, Any], variant: str | None, problems: Problems
) -> Scene:
    """A scene of one Reference to `file`, as long as its animation."""
    if variant not in (None, "default"):
        raise OptionError(f"{file}: a model file has no variant '{variant}'; variants belong to scene descriptions")
    loader_name(file)
    mark = Mark(str(file))
    name = prim_name(file.stem, "model")
    prim: Value = value_of({"type": "Reference", "asset": str(file.resolve())}, mark)
    opinions = Composer(roots, problems).opinions({f"/{name}": prim})
    overridden(opinions, marked(overrides), problems)
    stage: Stage = stage_of(file.stem, opinions, ["default"], problems)
    scene = Builder(stage, roots, file, problems, propagate=True).build()
    add_camera(scene)
    add_lights(scene)
    if "frames" not in overrides:
        scene.settings.frames = _frames(scene)
    return scene


def _frames(scene: Scene) -> int:
    """How many frames show all of the scene's animation, the moment of its last keyframe included."""
    # A duration of whole frames is rarely one in binary.
    return 1 + math.ceil(round(min(scene.duration * scene.settings.fps, MOST_FRAMES - 1), 3))


def _as_mapping(overrides: Overrides | None) -> dict[str, Any]:
    if overrides is None:
        return {}
    if isinstance(overrides, Mapping):
        return dict(overrides)
    return dict(parse_override(text) for text in overrides)


def _variant(overrides: dict[str, Any], variant: str | None) -> str | None:
    """The variant asked for, taken out of `overrides`."""
    asked = overrides.pop("variant", variant)
    if asked is not None and not isinstance(asked, str):
        raise OptionError(f"variant: given {asked!r}; wanted a name")
    return asked
