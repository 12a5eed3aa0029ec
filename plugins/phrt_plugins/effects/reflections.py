"""reflections: what a mirror or a glossy surface shows.

Mirrors take one ray a pixel, glossy surfaces up to `roughness_cutoff` take `samples` GGX-distributed ones; hits are shaded
with shadows and reflect and refract again up to `max_depth`. Fallbacks: `probe` (a cube map captured at the object,
parallax-corrected), `environment` (the dome), `none`.
Source: Whitted 1980; Heitz 2018 (visible normals); Lagarde and Zanuttini 2012 (parallax-corrected cube maps).
Example: `phrt render scenes/spheres.yaml -o out.png --effect reflections.max_depth=5`
"""

from __future__ import annotations

import numpy as np

from phrt.frame import Frame
from phrt.interfaces.effect import EffectResult, HistoryRule, LayerSpec, RayEffect
from phrt.kernels.bounce import MIRROR_RAY_ROUGHNESS, reflection_rays
from phrt.kernels.layers import mark_targets
from phrt.tracing import gather
from phrt.world import World
from phrt_plugins.effects.expected import shadow_rays_of_hit
from phrt_plugins.effects.options import ReflectionsOptions
from phrt_plugins.effects.probes import Probes, probes_of

PARALLAX, PARALLAX_PROBE = 0.5, 0.1
"""Radians by which the eye may go round a point before its value is dropped. Measured in the atrium and in Sponza (mirror balls):
mean error of the displayed reflection 0.04 up to 0.05 rad, 0.06 at 0.1, 0.08 at 0.3, 0.10 at 0.6. The dome has 0.5, a probe
0.04 to 0.07."""
MAX_AGE = 250


class Reflections(RayEffect):
    name = "reflections"
    reads = ("position_world", "normal_world", "normal_geometric_world", "object_id", "material_id", "roughness")
    writes = LayerSpec("reflection", 3, 0.0, "light from the mirror direction, before Fresnel's weight")

    def __init__(self, options: ReflectionsOptions) -> None:
        self._options = options
        if options.history:
            parallax = PARALLAX_PROBE if options.fallback == "probe" else PARALLAX
            self.history = HistoryRule(movers="any", lights=True, parallax=parallax, max_age=MAX_AGE)
        self._probes: Probes | None = None

    def applies_to(self, world: World) -> np.ndarray:
        materials = world.materials
        smooth = materials["roughness"] <= self._options.roughness_cutoff
        smooth |= materials["metallic_roughness_texture"] >= 0
        return smooth & (materials["unlit"] == 0) & ((materials["specular"] > 0) | (materials["metallic"] > 0))

    def rays_per_pixel(self, world: World) -> float:
        roughness = world.materials["roughness"][self.applies_to(world)]
        first = np.where(roughness < MIRROR_RAY_ROUGHNESS, 1.0, self._options.samples)
        return float(first.mean() if len(first) else 1.0) * (1.0 + shadow_rays_of_hit(world))

    def applies_at(self, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        return frame.surfaces.roughness[pixels] <= np.float32(self._options.roughness_cutoff)

    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        count = len(pixels)
        capacity = count * self._options.samples
        origin, direction, weight = (np.empty((capacity, 3), np.float32) for _ in range(3))
        target = np.empty(capacity, np.int32)
        view, is_point = frame.view_vectors(pixels)
        rays = reflection_rays(
            pixels, pixels.astype(np.uint32), frame.surfaces, frame.materials.materials, view, is_point,
            self.applies_to(frame.world), np.float32(self._options.roughness_cutoff), self._options.samples, frame.seed,
            origin, direction, weight, target,
        )  # fmt: skip
        traced = np.zeros(count, np.uint8)
        path_length = np.empty(rays, np.float32)
        mark_targets(target[:rays], pixels, frame.surfaces.position, view, is_point, traced, path_length)
        radiance, total = gather(
            frame, origin[:rays], direction[:rays], weight[:rays], target[:rays], np.zeros(rays, np.int32), path_length,
            count, self._options.max_depth,
        )  # fmt: skip
        return EffectResult(radiance, total, traced)

    def prepare_fallback(self, frame: Frame) -> None:
        if self._options.fallback == "probe":
            self._probes = probes_of(frame.world, self._options.probe_size)
            self._probes.prepare(frame, frame.world.object_has(self.applies_to(frame.world)))

    def begin_run(self) -> None:
        if self._probes is not None:
            self._probes.begin_run()

    def fallback(self, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        if self._options.fallback == "none":
            return np.zeros((len(pixels), 3), np.float32)
        return None if self._probes is None else self._probes.reflected(frame, pixels)
