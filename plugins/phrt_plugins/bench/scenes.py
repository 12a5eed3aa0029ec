"""Scenes as a benchmark has them, and renderers of setups."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from phrt.clock import Clock, RayClock, WallClock
from phrt.loading import load_scene
from phrt.renderer import Renderer
from phrt.scene import Scene
from phrt_plugins.bench.plan import Setup


def open_scene(file: str | Path, variant: str | None, overrides: Mapping[str, Any], simplify: float | None) -> Scene:
    """The scene in `file`; simplify: the share of its triangles that every mesh keeps. Raises InputError as `load_scene`."""
    scene = load_scene(file, variant=variant, overrides=overrides)
    if simplify is not None:
        from phrt_plugins.loaders.simplify import simplified

        scene = simplified(scene, simplify)
    return scene


def open_renderer(setup: Setup, *, base: bool = False, threads: int | None = None) -> Renderer:
    """A renderer of `setup`; base: with the effects of its reference; threads: where the setup does not say.

    It is the caller's to close. Raises InputError as loading and `Renderer` do.
    """
    scene = open_scene(setup.file, setup.variant, setup.overrides, setup.simplify)
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
