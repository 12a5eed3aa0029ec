"""Embree through embreex's own Python binding: what the `embree` tracer falls back to.

Slower than packets, and limited: one ray a call inside, no ray masks (a second scene of shadow casters takes their
place), no update (both scenes are rebuilt). Traps of embreex 4.4 that this file keeps away from its callers: `run`
overwrites the distances it is given, answers an occlusion query with 0 for blocked and -1 for free, and reads past the
end when origins and directions differ in count.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from phrt.conventions import NO_PRIMITIVE
from phrt.errors import PhrtError
from phrt.interfaces.tracer import Tracer, TracerCapabilities
from phrt.rays import HitBatch, RayBatch
from phrt_backends.options import EmbreeOptions
from phrt_backends.tracers.ray_checks import just_below, usable_rays

if TYPE_CHECKING:
    from phrt.world import Changes, World


class EmbreexTracer(Tracer):
    """reason: why packets are not used; shown in `capabilities.description`."""

    def __init__(self, options: EmbreeOptions, reason: str = "asked for by the option 'binding'") -> None:
        self.options = options
        self.capabilities = TracerCapabilities(
            description=f"Embree through embreex's own `run`, one ray at a time: {reason}"
        )
        self._all: Any = None
        self._casters: Any = None

    def build(self, world: World) -> None:
        self._all = _scene(world.positions, world.triangles, self.options.robust)
        self._casters = self._all
        casts = np.asarray(world.object_casts_shadow)[world.triangle_object]
        if not casts.all():
            self._casters = _scene(world.positions, world.triangles[casts], self.options.robust)

    def update(self, world: World, changes: Changes) -> None:
        if changes.objects:
            self.build(world)

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        answer = _run(self._all, rays, query="INTERSECT", output=True)
        hit = (answer["primID"] >= 0) & usable_rays(rays)
        distance = np.where(hit, answer["tfar"], np.inf).astype(np.float32)
        primitive = np.where(hit, answer["primID"].astype(np.uint32), NO_PRIMITIVE).astype(np.uint32)
        barycentric = np.where(hit[:, None], np.stack((answer["u"], answer["v"]), axis=1), 0).astype(np.float32)
        return HitBatch(distance, primitive, barycentric)

    def occluded(self, rays: RayBatch) -> np.ndarray:
        return (_run(self._casters, rays, query="OCCLUDED") == 0) & usable_rays(rays)

    def close(self) -> None:
        self._all = self._casters = None


def _scene(positions: np.ndarray, triangles: np.ndarray, robust: bool) -> Any:
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene(robust=robust)
    if len(triangles):
        TriangleMesh(scene, np.ascontiguousarray(positions, np.float32), np.ascontiguousarray(triangles, np.int32))
    return scene


def _run(scene: Any, rays: RayBatch, **query: Any) -> Any:
    if scene is None:
        raise PhrtError("the tracer has no scene: call build first, and nothing after close")
    if not len(rays.origin) == len(rays.direction) == len(rays.t_max):
        raise ValueError("origins, directions and t_max differ in count")
    return scene.run(rays.origin, rays.direction, just_below(rays.t_max), **query)
