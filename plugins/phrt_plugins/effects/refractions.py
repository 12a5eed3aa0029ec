"""refractions: what is seen through glass and through alpha-blended surfaces.

Dielectrics bend by Snell, split by Fresnel, reflect totally, absorb by Beer-Lambert, up to `max_depth`; thin walls (no
thickness) and blended surfaces let rays pass unbent. Fallbacks: `probe` (for round, solid glass a cube map captured at the
object, looked up as through a ball; `alpha` for the rest), `alpha` (what lies straight behind, shaded without rays),
`environment`, `none`.
Source: Whitted 1980; glTF KHR_materials_transmission, KHR_materials_volume.
Example: `phrt render scenes/spheres.yaml -o out.png --effect refractions.max_depth=8`
"""

from __future__ import annotations

import numpy as np

from phrt.frame import Frame
from phrt.interfaces.effect import EffectResult, HistoryRule, LayerSpec, RayEffect
from phrt.kernels.bounce import refraction_rays
from phrt.kernels.layers import mark_targets
from phrt.tracing import gather
from phrt.world import World
from phrt_plugins.effects.behind import behind, environment_through
from phrt_plugins.effects.expected import shadow_rays_of_hit
from phrt_plugins.effects.options import RefractionsOptions
from phrt_plugins.effects.probes import Probes, probes_of

PARALLAX, PARALLAX_FINE = 0.5, 0.25
"""Radians by which the eye may go round a point before its value is dropped. Measured in the atrium and in Sponza (glass balls),
mean error of the displayed refraction: 0.02 up to 0.05 rad, 0.03 to 0.06 at 0.15, 0.04 to 0.08 at 0.3. What lies straight behind
has 0.05 to 0.18, a probe 0.05 to 0.17."""
MAX_AGE = 250


class Refractions(RayEffect):
    name = "refractions"
    reads = (
        "position_world",
        "normal_world",
        "normal_geometric_world",
        "object_id",
        "material_id",
        "transmission",
        "alpha",
    )
    writes = LayerSpec("refraction", 3, 0.0, "light that comes through the surface")

    def __init__(self, options: RefractionsOptions) -> None:
        self._options = options
        if options.history:
            parallax = PARALLAX_FINE if options.fallback in ("alpha", "probe") else PARALLAX
            self.history = HistoryRule(movers="any", lights=True, parallax=parallax, max_age=MAX_AGE)
        self._probes: Probes | None = None

    def applies_to(self, world: World) -> np.ndarray:
        return world.material_lets_light_through()

    def rays_per_pixel(self, world: World) -> float:
        return 3.0 + shadow_rays_of_hit(world)

    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        count = len(pixels)
        origin, direction, weight = (np.empty((count, 3), np.float32) for _ in range(3))
        target, medium = np.empty(count, np.int32), np.empty(count, np.int32)
        view, is_point = frame.view_vectors(pixels)
        rays = refraction_rays(
            pixels, frame.surfaces, frame.geometry, frame.materials.materials, view, is_point,
            origin, direction, weight, target, medium,
        )  # fmt: skip
        traced = np.zeros(count, np.uint8)
        path_length = np.empty(rays, np.float32)
        mark_targets(target[:rays], pixels, frame.surfaces.position, view, is_point, traced, path_length)
        radiance, total = gather(
            frame, origin[:rays], direction[:rays], weight[:rays], target[:rays], medium[:rays], path_length,
            count, self._options.max_depth,
        )  # fmt: skip
        # Total reflection lets nothing through: that is a value too, so every pixel counts as traced.
        return EffectResult(radiance, total)

    def prepare_fallback(self, frame: Frame) -> None:
        if self._options.fallback == "probe":
            self._probes = probes_of(frame.world, self._options.probe_size)
            self._probes.prepare(frame, frame.world.object_has(self.applies_to(frame.world)))

    def begin_run(self) -> None:
        if self._probes is not None:
            self._probes.begin_run()

    def fallback(self, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        if self._options.fallback == "none":
            return None
        if self._options.fallback == "environment":
            return environment_through(frame, pixels)
        if self._probes is None:
            return behind(frame, pixels)
        # Thin walls, flat faces and blended surfaces do not bend the view: what lies straight behind them is all but right.
        bent = self._probes.is_round(frame, pixels)
        if bent.all():
            return self._probes.bent(frame, pixels)
        values = np.empty((len(pixels), 3), np.float32)
        values[bent] = self._probes.bent(frame, pixels[bent])
        values[~bent] = behind(frame, pixels[~bent])
        return values
