"""ambient_occlusion: how much of the dome's diffuse light is kept away by what is near.

`samples` cosine-weighted rays within `radius` metres. Fallbacks: `constant` (`fallback_value`),
`screen_space` (what the G-buffer itself knows of what is near).
Source: Zhukov et al. 1998; Landis 2002; Jimenez et al. 2016 (screen space).
Example: `phrt render scenes/atrium.yaml -o out.png --effect ambient_occlusion.samples=16`
"""

from __future__ import annotations

import numpy as np

from phrt.frame import Frame
from phrt.interfaces.effect import EffectResult, HistoryRule, LayerSpec, RayEffect
from phrt.kernels.shadow import hemisphere_rays, open_share
from phrt.rays import RayBatch
from phrt.tracing import blocked
from phrt.world import World
from phrt_plugins.effects.options import AmbientOcclusionOptions
from phrt_plugins.effects.screen_space import screen_occlusion


class AmbientOcclusion(RayEffect):
    name = "ambient_occlusion"
    reads = ("position_world", "normal_world", "normal_geometric_world", "object_id", "material_id")
    writes = LayerSpec("ambient_occlusion", 1, 1.0, "unoccluded share of the hemisphere")

    def __init__(self, options: AmbientOcclusionOptions) -> None:
        self._options = options
        if options.history:
            self.history = HistoryRule(movers="near", lights=False, radius=options.radius)

    def applies_to(self, world: World) -> np.ndarray:
        materials = world.materials
        bare = (materials["metallic"] < 1) | (materials["metallic_roughness_texture"] >= 0)
        dome = bool(world.environment.irradiance.any())
        return (materials["unlit"] == 0) & bare & (materials["transmission"] < 1) & dome

    def rays_per_pixel(self, world: World) -> float:
        return float(self._options.samples)

    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        samples, count = self._options.samples, len(pixels) * self._options.samples
        rays = RayBatch(np.empty((count, 3), np.float32), np.empty((count, 3), np.float32), np.empty(count, np.float32))
        radius = np.float32(self._options.radius)
        seeds = pixels.astype(np.uint32)
        hemisphere_rays(
            pixels, seeds, frame.surfaces, samples, frame.seed, radius, rays.origin, rays.direction, rays.t_max
        )
        values = np.empty((len(pixels), 1), np.float32)
        open_share(blocked(frame, rays), samples, values)
        return EffectResult(values, count)

    def fallback(self, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        if self._options.fallback == "screen_space":
            return screen_occlusion(frame, pixels, self._options.radius)
        if self._options.fallback_value == self.writes.clear:
            return None
        return np.full((len(pixels), 1), self._options.fallback_value, np.float32)
