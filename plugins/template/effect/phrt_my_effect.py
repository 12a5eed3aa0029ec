"""my_effect: under things it is darker.

One ray straight up from every pixel's point. Where it meets something within `height` metres, ambient light is less by `strength`.
It writes the layer that the composition takes for ambient occlusion, so the effect `ambient_occlusion` must stay off beside it.

Options: height, strength. Example: phrt render SCENE -o out.png --effect my_effect.height=2
"""

from typing import TYPE_CHECKING

import numpy as np
from phrt.interfaces.effect import EffectResult, LayerSpec, RayEffect
from phrt.rays import RayBatch
from phrt.registry import EffectPlugin, Options, hookimpl
from pydantic import Field

if TYPE_CHECKING:
    from phrt.frame import Frame
    from phrt.world import World

BIAS = 1e-3
"""Metres: how far off the surface a ray begins, so that it does not meet the surface itself."""


class MyEffectOptions(Options):
    height: float = Field(
        default=5.0, gt=0.0, json_schema_extra={"unit": "metres"}, description="How far up something still darkens."
    )
    strength: float = Field(default=0.7, ge=0.0, le=1.0, description="Share of the ambient light that it takes away.")


class MyEffect(RayEffect):
    name = "my_effect"
    reads = ("position_world", "normal_geometric_world", "material_id")
    writes = LayerSpec("ambient_occlusion", 1, 1.0, "share of the ambient light that arrives from above")

    def __init__(self, options: MyEffectOptions) -> None:
        self.options = options

    def applies_to(self, world: "World") -> np.ndarray:
        return np.asarray(world.materials["unlit"] == 0)

    def rays_per_pixel(self, world: "World") -> float:
        return 1.0

    def trace(self, frame: "Frame", pixels: np.ndarray) -> EffectResult:
        from phrt.tracing import (
            blocked,  # not above: it compiles, and listing plugins should not
        )

        points, count = frame.surfaces, len(pixels)
        origin = points.position[pixels] + np.float32(BIAS) * points.geometric_normal[pixels]
        up = np.tile(np.array([0, 1, 0], np.float32), (count, 1))
        rays = RayBatch(origin, up, np.full(count, self.options.height, np.float32))
        values = np.where(blocked(frame, rays), 1.0 - self.options.strength, 1.0)
        return EffectResult(values.astype(np.float32).reshape(count, 1), rays=count)

    def fallback(self, frame: "Frame", pixels: np.ndarray) -> np.ndarray | None:
        return None  # the layer's clear value: nothing is darkened where nothing was traced


@hookimpl
def phrt_effects() -> list[EffectPlugin]:
    factory = f"{__name__}:MyEffect"
    return [EffectPlugin("my_effect", "Darker under things: one ray straight up.", factory, MyEffectOptions)]
