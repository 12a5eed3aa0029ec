"""shadows: is each light seen from the surface?

One ray per light and pixel for hard shadows, `samples` for lights with an extent (soft shadows). An item is the pixels *of*
an object: the receiver; `casts_shadow: false` on an object is the caster's side.
Options: samples, fallback (none, shadow_map), map_size.
Source: Whitted 1980 (shadow rays); Williams 1978 (shadow maps); Andrade et al. 2014, section 3.2.
Example: `phrt render scenes/spheres.yaml -o out.png --effect shadows.samples=16`
"""

from __future__ import annotations

import numpy as np

from phrt.frame import Frame
from phrt.interfaces.effect import EffectResult, HistoryRule, LayerSpec, RayEffect
from phrt.kernels.light import MIRROR_ROUGHNESS
from phrt.tracing import light_visibility
from phrt.world import World
from phrt_plugins.effects.expected import shadow_rays
from phrt_plugins.effects.options import ShadowsOptions
from phrt_plugins.effects.shadow_maps import ShadowMaps


class Shadows(RayEffect):
    name = "shadows"
    reads = ("position_world", "normal_world", "normal_geometric_world", "object_id", "material_id")
    writes = LayerSpec("visibility", 0, 1.0, "share of each light that reaches the surface")

    def __init__(self, options: ShadowsOptions) -> None:
        self._options = options
        self.history = HistoryRule(movers="to_lights", lights=True) if options.history else None
        self._maps = ShadowMaps(options.map_size) if options.fallback == "shadow_map" else None

    def applies_to(self, world: World) -> np.ndarray:
        materials = world.materials
        textured = materials["metallic_roughness_texture"] >= 0
        mirror = (materials["metallic"] >= 1) & (materials["roughness"] < MIRROR_ROUGHNESS)
        clear = (materials["transmission"] >= 1) & (materials["transmission_texture"] < 0)
        clear &= materials["roughness"] < MIRROR_ROUGHNESS
        return (materials["unlit"] == 0) & (textured | ~(mirror | clear)) & (len(world.lights) > 0)

    def rays_per_pixel(self, world: World) -> float:
        return shadow_rays(world, self._options.samples)

    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        values, rays = light_visibility(
            frame,
            frame.surfaces,
            pixels,
            pixels.astype(np.uint32),
            frame.direct,
            self._options.samples,
            coherent=self._options.samples <= 1,
            only_light=frame.only_light,
        )
        return EffectResult(values, rays)

    def prepare_fallback(self, frame: Frame) -> None:
        if self._maps is not None:
            self._maps.prepare(frame)

    def begin_run(self) -> None:
        if self._maps is not None:
            self._maps.begin_run()

    def fallback(self, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        return None if self._maps is None else self._maps.visibility(frame, pixels)
