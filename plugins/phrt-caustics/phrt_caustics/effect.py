"""caustics: light that glass and mirrors gather on what is behind or beside them.

Photons from every light that casts shadows go to glass and mirrors, are mirrored and bent (Fresnel, total reflection,
Beer-Lambert), and land on diffuse surfaces; there each is spread over a disc as wide as it has become. The layer is irradiance,
which the composition adds.
The photons serve all pixels and are kept while nothing moves: the pixels traced first pay for them, the others only look.
Options: photons_per_pixel, max_depth, roughness_cutoff, smoothing, max_radius, fallback (none, coarse), history.
Source: Jensen 1996, Jensen 2001 (photon maps, projection maps); McGuire and Luebke 2009 (splatting into a G-buffer); Schjoth et al.
2007 (photon differentials).
Example: `phrt render scenes/spheres.yaml -o out.png --effect caustics.photons_per_pixel=1`
"""

from __future__ import annotations

import numpy as np

from phrt.frame import Frame
from phrt.interfaces.effect import EffectResult, HistoryRule, LayerSpec, RayEffect
from phrt.workers import chunks
from phrt.world import World
from phrt_caustics.casters import has_casters, receiver_materials
from phrt_caustics.emission import Aims
from phrt_caustics.keeping import PhotonKeeper, finished, photon_count
from phrt_caustics.kernels.splat import Splats
from phrt_caustics.options import CausticsOptions
from phrt_caustics.photons import trace_photons
from phrt_caustics.splat import irradiance

RAYS_PER_PHOTON = 4.0
"""To glass, into it, out of it, and some that are mirrored on the way. Measured: 2 for mirrors, 4 to 5 for glass."""
COARSE = 1.0 / 16.0
"""Share of the photons that the fallback `coarse` is made of."""
CHUNK = 8192


class Caustics(RayEffect):
    name = "caustics"
    reads = ("position_world", "normal_geometric_world", "object_id", "material_id")
    writes = LayerSpec("caustics", 3, 0.0, "light that glass and mirrors throw on the surface", adds="irradiance")

    def __init__(self, options: CausticsOptions) -> None:
        self._options = options
        self._aims = Aims(options.roughness_cutoff)
        self._photons = PhotonKeeper(options, self._aims)
        self._coarse: Splats | None = None
        if options.history:
            self.history = HistoryRule(movers="any", lights=True)

    def applies_to(self, world: World) -> np.ndarray:
        return receiver_materials(world) & has_casters(world, self._options.roughness_cutoff)

    def rays_per_pixel(self, world: World) -> float:
        return self._options.photons_per_pixel * RAYS_PER_PHOTON

    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        splats, rays = self._photons.splats(frame)
        return EffectResult(irradiance(splats, frame.surfaces, pixels), rays, shared_rays=rays)

    def begin_run(self) -> None:
        self._photons.forget()

    def prepare_fallback(self, frame: Frame) -> None:
        if self._options.fallback == "coarse":
            depth, cutoff = self._options.max_depth, self._options.roughness_cutoff
            made = self._aims.batches(frame.world, photon_count(self._options, frame, COARSE))
            parts = frame.workers.map(lambda batch: trace_photons(frame, batch, depth, cutoff)[0], made)
            self._coarse = finished(parts, frame.world, self._options)

    def fallback(self, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        if self._coarse is None:
            return None
        splats, pieces = self._coarse, chunks(len(pixels), CHUNK, frame.workers.threads)
        parts = frame.workers.map(lambda piece: irradiance(splats, frame.surfaces, pixels[piece]), pieces)
        return np.concatenate(parts) if parts else np.zeros((0, 3), np.float32)
