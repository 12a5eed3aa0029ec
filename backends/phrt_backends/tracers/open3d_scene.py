"""The `open3d` tracer: Open3D's RaycastingScene, Embree inside, with threads of its own.

Open3D takes one far distance a call and has neither masks nor an update. So occlusion rays are scaled to end at t = 1,
a second scene holds the shadow casters where some object casts none, and moving anything rebuilds both.
Options: `phrt_backends.options.Open3dOptions`. Needs `pip install 'phrt[open3d]'`.

Example: `tracer = Open3dTracer(Open3dOptions()); tracer.build(world); hits = tracer.closest_hit(rays)`
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from phrt.conventions import NO_PRIMITIVE
from phrt.errors import PhrtError
from phrt.interfaces.tracer import Tracer, TracerCapabilities
from phrt.rays import HitBatch, RayBatch
from phrt_backends.options import Open3dOptions
from phrt_backends.tracers.ray_checks import just_below, usable_rays

if TYPE_CHECKING:
    from phrt.world import Changes, World


class Open3dTracer(Tracer):
    """Imports Open3D when made, about a second."""

    def __init__(self, options: Open3dOptions) -> None:
        import open3d

        self._open3d: Any = open3d
        self.options = options
        self.capabilities = TracerCapabilities(description=f"Open3D {open3d.__version__}, RaycastingScene")
        self._built = False
        self._all: Any = None
        self._casters: Any = None

    def build(self, world: World) -> None:
        positions = np.ascontiguousarray(world.positions, np.float32)
        casts = np.asarray(world.object_casts_shadow)[world.triangle_object]
        self._all = self._scene(positions, world.triangles)
        self._casters = self._all if casts.all() else self._scene(positions, world.triangles[casts])
        self._centre, self._radius = _bounding_sphere(positions)
        self._built = True

    def update(self, world: World, changes: Changes) -> None:
        if changes.objects:
            self.build(world)

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        self._check_built()
        count = len(rays)
        if self._all is None or not count:
            return HitBatch(
                np.full(count, np.inf, np.float32), np.full(count, NO_PRIMITIVE), np.zeros((count, 2), np.float32)
            )
        answer = self._all.cast_rays(self._tensor(rays.origin, rays.direction), nthreads=self.options.threads)
        distance, primitive = answer["t_hit"].numpy(), answer["primitive_ids"].numpy()
        hit = (distance < just_below(rays.t_max)) & usable_rays(rays)
        return HitBatch(
            np.where(hit, distance, np.float32(np.inf)),
            np.where(hit, primitive, NO_PRIMITIVE),
            np.where(hit[:, None], answer["primitive_uvs"].numpy(), np.float32(0.0)),
        )

    def occluded(self, rays: RayBatch) -> np.ndarray:
        self._check_built()
        if self._casters is None or not len(rays):
            return np.zeros(len(rays), bool)
        with np.errstate(invalid="ignore", over="ignore"):
            tensor = self._tensor(rays.origin, rays.direction * self._reach(rays)[:, None])
        blocked = self._casters.test_occlusions(tensor, tnear=0.0, tfar=1.0, nthreads=self.options.threads)
        return blocked.numpy() & usable_rays(rays)

    def close(self) -> None:
        self._all = self._casters = None
        self._built = False

    def _reach(self, rays: RayBatch) -> np.ndarray:
        """(n,) float32 metres: t_max, but no further than the far side of the scene, so that no ray is infinite."""
        far_side = np.linalg.norm(rays.origin - self._centre, axis=1) + self._radius
        return np.minimum(just_below(rays.t_max), far_side * 1.001).astype(np.float32)

    def _scene(self, positions: np.ndarray, triangles: np.ndarray) -> Any:
        """A scene that is ready for queries from several threads, or None for no triangles."""
        if not len(triangles):
            return None
        to_tensor = self._open3d.core.Tensor
        scene = self._open3d.t.geometry.RaycastingScene()
        scene.add_triangles(to_tensor(positions), to_tensor(np.ascontiguousarray(triangles, np.uint32)))
        # The first query builds the BVH and is not thread-safe.
        scene.cast_rays(to_tensor(np.array([[0, 0, 0, 0, 0, 1]], np.float32)))
        return scene

    def _tensor(self, origin: np.ndarray, direction: np.ndarray) -> Any:
        """(n, 6) float32 tensor; rays that are not finite become zero, and are misses later."""
        both = np.concatenate((origin, direction), axis=1, dtype=np.float32)
        both[~np.isfinite(both).all(axis=1)] = 0.0
        return self._open3d.core.Tensor.from_numpy(both)

    def _check_built(self) -> None:
        if not self._built:
            raise PhrtError("the tracer has no scene: call build first, and nothing after close")


def _bounding_sphere(positions: np.ndarray) -> tuple[np.ndarray, float]:
    """Centre (3,) and radius of a sphere around all finite positions; zero where there are none."""
    finite = positions[np.isfinite(positions).all(axis=1)]
    if not len(finite):
        return np.zeros(3, np.float32), 0.0
    lower, upper = finite.min(axis=0), finite.max(axis=0)
    return (lower + upper) / 2, float(np.linalg.norm(upper - lower)) / 2
