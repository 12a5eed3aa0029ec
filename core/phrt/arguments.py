"""What callers of `Renderer` hand in, checked: sizes, places, effects and their options."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np

from phrt.candidates import EffectScope
from phrt.errors import OptionError, did_you_mean
from phrt.faults.declared import check_declared
from phrt.faults.making import make
from phrt.interfaces.effect import RayEffect
from phrt.interfaces.heuristic import Heuristic
from phrt.limits import MAX_PIXELS, MAX_SIDE
from phrt.registry.auto import DEFAULT_EFFECTS
from phrt.registry.manager import get_registry
from phrt.scene import Scene
from phrt.world import World


def checked_size(size: tuple[int, int]) -> tuple[int, int]:
    """`size` (width, height) in pixels. Raises OptionError where it is out of range."""
    width, height = size
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        raise OptionError(f"size is {width}x{height}; each side must be 1 to {MAX_SIDE} pixels")
    if width * height > MAX_PIXELS:
        raise OptionError(
            f"size is {width}x{height}, {width * height:,} pixels; it must have at most {MAX_PIXELS:,} (8192x8192)"
        )
    return int(width), int(height)


T = TypeVar("T", bound=str)


def one_of(name: str, given: T, allowed: Sequence[T]) -> T:
    """`given`, when it is among `allowed`. Raises OptionError that calls the option `name`."""
    if given not in allowed:
        raise OptionError(
            f"{name} is {given!r}, allowed: {', '.join(allowed)}.{did_you_mean(str(given), list(allowed))}"
        )
    return given


def checked_matrix(path: str, matrix: object) -> np.ndarray:
    """(4, 4) float64 of `matrix`, for object `path`. Raises OptionError unless it is finite and affine."""
    try:
        array = np.array(matrix, dtype=np.float64)
    except (TypeError, ValueError):
        array = None
    if array is None or array.shape != (4, 4):
        given = f"{type(matrix).__name__}" if array is None else f"of shape {array.shape}"
        raise OptionError(f"the matrix of '{path}' is {given}; it must be 4 x 4 numbers, world_from_local")
    if not np.isfinite(array).all():
        raise OptionError(f"the matrix of '{path}' holds NaN or infinity; every number must be finite")
    if not np.allclose(array[3], (0, 0, 0, 1), rtol=0, atol=1e-6):
        raise OptionError(
            f"the last row of the matrix of '{path}' is {array[3].tolist()}; it must be 0 0 0 1, "
            "with the translation in the last column"
        )
    return array


def camera_number(scene: Scene, given: int | str) -> int:
    """The number of the camera of `scene` that is `given` by number or path. Raises OptionError for one that is not there."""
    paths = [entry.path for entry in scene.cameras]
    if isinstance(given, str):
        if given not in paths:
            raise OptionError(
                f"no camera '{given}'; the scene has {', '.join(paths) or 'none'}.{did_you_mean(given, paths)}"
            )
        return paths.index(given)
    if not 0 <= given < len(paths):
        raise OptionError(f"no camera number {given}; the scene has {len(paths)}, counted from 0")
    return given


def make_heuristic(given: str | Heuristic, options: Mapping[str, object] | None) -> Heuristic:
    """`given`, or the plugin of that name with `options`."""
    if isinstance(given, str):
        made: Heuristic = make("heuristic", given, options)
        return made
    if not isinstance(given, Heuristic):
        raise OptionError(f"heuristic is {given!r:.80}; it must be a name or a phrt.interfaces.heuristic.Heuristic")
    if options:
        raise OptionError("heuristic_options are for a heuristic given by name; this one is made already")
    return given


def make_effects(scene: Scene, options: Mapping[str, Mapping[str, object]] | None) -> list[RayEffect]:
    """The default effects and those named by the scene or the caller, with the scene's options and then the caller's.

    `enabled: false` among an effect's options leaves it out. Raises PluginError for an unknown effect, OptionError for an
    option that is unknown or out of its range.
    """
    registry = get_registry()
    given: dict[str, dict[str, object]] = {name: {} for name in DEFAULT_EFFECTS}
    for source in (scene.settings.effects, options or {}):
        for name, values in source.items():
            registry.get("effect", name)
            given.setdefault(name, {}).update(values)
    wanted = {name for name, values in given.items() if _enabled(name, values.pop("enabled", True))}
    made: list[RayEffect] = [make("effect", name, given[name]) for name in registry.names("effect") if name in wanted]
    check_declared(made)
    return made


def _enabled(effect: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise OptionError(f"effect '{effect}': option 'enabled' is {value!r}, allowed: true or false")
    return value


def scopes_of(effects: list[RayEffect], world: World) -> list[EffectScope]:
    """Where each effect may act in `world`. Raises PluginError naming an effect that cannot say."""
    return [EffectScope.of(effect, world) for effect in effects]
