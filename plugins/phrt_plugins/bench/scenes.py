"""Scenes as a benchmark has them, and renderers of setups."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from phrt.clock import Clock, RayClock, WallClock
from phrt.errors import SceneError
from phrt.loading import load_scene
from phrt.renderer import Renderer
from phrt.scene import Scene
from phrt_plugins.bench.content import scene_digest
from phrt_plugins.bench.plan import Setup


def open_scene(file: str | Path, variant: str | None, overrides: Mapping[str, Any]) -> Scene:
    """The scene in `file`. Raises InputError as `load_scene`."""
    return load_scene(file, variant=variant, overrides=overrides)


def simplified_scene(scene: Scene, share: float | None) -> Scene:
    """`scene`, whose meshes keep `share` of their triangles; None for all. Raises OptionError where that cannot be done."""
    if share is None:
        return scene
    from phrt_plugins.loaders.simplify import simplified

    return simplified(scene, share)


def open_renderer(setup: Setup, *, base: bool = False, threads: int | None = None) -> Renderer:
    """A renderer of `setup`; base: with the effects of its reference; threads: where the setup does not say.

    It is the caller's to close. Raises InputError as loading and `Renderer` do, and where the scene is not the one that was
    planned with: it was edited since, or is another one on this machine.
    """
    scene = open_scene(setup.file, setup.variant, setup.overrides)
    if scene_digest(scene) != setup.content:
        raise SceneError(
            f"{setup.file}: the scene, or a file that it names, is not what it was when the benchmark began"
        )
    scene = simplified_scene(scene, setup.simplify)
    return Renderer(
        scene,
        size=setup.size,
        tracer=setup.tracer,
        gbuffer=setup.gbuffer,
        threads=setup.threads or threads,
        effects=setup.base_effects if base else setup.effects,
        clock=new_clock(setup),
        remember_costs=False,
        heuristic="raster_only",
    )


def new_clock(setup: Setup) -> Clock:
    """A clock that begins: real time, or a price per ray."""
    return WallClock() if setup.clock is None else RayClock(setup.clock)
