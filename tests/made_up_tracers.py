"""Tracers that trace no ray, as a plugin file for configs of tests: `made_up` makes path-traced pictures up, `plain` makes none,
and `elsewhere` is not available here."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from phrt.camera import CameraView
from phrt.interfaces.tracer import Tracer, TracerCapabilities
from phrt.rays import HitBatch, RayBatch
from phrt.registry import Options, TracerPlugin, hookimpl
from phrt.world import World


class MadeUp(Tracer):
    """A picture is a ramp in x and y, and in blue the time and the number of samples. MADE_UP_IMAGE=nan in the environment
    spoils it."""

    capabilities = TracerCapabilities("traces no ray", path_tracer="made up 1")

    def __init__(self, options: Options) -> None:
        pass

    def build(self, world: World) -> None:
        raise AssertionError("path tracing needs no build")

    def update(self, world: World, changes: Any) -> None:
        raise AssertionError("path tracing needs no update")

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        raise AssertionError("path tracing asks for no ray")

    def occluded(self, rays: RayBatch) -> np.ndarray:
        raise AssertionError("path tracing asks for no ray")

    def render_paths(
        self, world: World, view: CameraView, *, samples: int, max_depth: int, seed: int = 0
    ) -> np.ndarray:
        y, x = np.mgrid[0 : view.height, 0 : view.width].astype(np.float32)
        blue = np.full_like(x, world.time + samples / 100)
        image = np.stack([x / view.width, y / view.height, blue], axis=-1)
        return image * np.float32(np.nan) if os.environ.get("MADE_UP_IMAGE") == "nan" else image


class Plain(MadeUp):
    """Cannot path trace."""

    capabilities = TracerCapabilities("traces no ray, and no path")


@hookimpl
def phrt_tracers() -> list[TracerPlugin]:
    return [
        TracerPlugin("made_up", "Makes pictures up.", f"{__name__}:MadeUp"),
        TracerPlugin("plain", "No pictures.", f"{__name__}:Plain"),
        TracerPlugin("elsewhere", "Not here.", f"{__name__}:MadeUp", unavailable_reason=lambda: "no such card"),
    ]
