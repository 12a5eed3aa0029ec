"""my_tracer: every ray against every triangle, in plain numpy.

Right and slow: a start for a tracer of your own, which would build a structure in `build` and refit it in `update`.

Options: chunk. Source: Moeller and Trumbore 1997.
Example: phrt render SCENE -o out.png --size 64x36 --tracer my_tracer
"""

from typing import TYPE_CHECKING

import numpy as np
from phrt.conventions import NO_PRIMITIVE
from phrt.interfaces.tracer import Tracer, TracerCapabilities
from phrt.rays import HitBatch, RayBatch
from phrt.registry import Options, TracerPlugin, hookimpl
from pydantic import Field

if TYPE_CHECKING:
    from phrt.world import Changes, World


class MyTracerOptions(Options):
    chunk: int = Field(
        default=500_000,
        ge=1,
        json_schema_extra={"unit": "pairs"},
        description="Of a ray and a triangle, looked at together.",
    )


class MyTracer(Tracer):
    capabilities = TracerCapabilities("every ray against every triangle, numpy")

    def __init__(self, options: MyTracerOptions) -> None:
        self.options = options

    def build(self, world: "World") -> None:
        corners = world.positions[world.triangles].astype(np.float64)
        self.corner = corners[:, 0]
        self.edges = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        self.casts = world.object_casts_shadow[world.triangle_object]

    def update(self, world: "World", changes: "Changes") -> None:
        self.build(world)

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        count = len(rays)
        distance, primitive = np.full(count, np.inf, np.float32), np.full(count, NO_PRIMITIVE, np.uint32)
        barycentric = np.zeros((count, 2), np.float32)
        for rows in self._chunks(count):
            t, u, v = self._meet(rays, rows)
            nearest = t.argmin(axis=1)
            found = np.flatnonzero(np.isfinite(t[np.arange(len(t)), nearest]))
            hit, triangle = rows.start + found, nearest[found]
            distance[hit], primitive[hit] = t[found, triangle], triangle
            barycentric[hit] = np.stack([u[found, triangle], v[found, triangle]], axis=1)
        return HitBatch(distance, primitive, barycentric)

    def occluded(self, rays: RayBatch) -> np.ndarray:
        blocked = np.zeros(len(rays), bool)
        for rows in self._chunks(len(rays)):
            blocked[rows] = np.isfinite(self._meet(rays, rows)[0][:, self.casts]).any(axis=1)
        return blocked

    def _chunks(self, count: int) -> list[slice]:
        """Rows of so many rays that they and all triangles fit into a chunk; none without triangles."""
        size = max(self.options.chunk // max(len(self.corner), 1), 1)
        return [slice(i, min(i + size, count)) for i in range(0, count, size)] if len(self.corner) else []

    def _meet(self, rays: RayBatch, rows: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(rays, triangles): t float32, +inf where they do not meet before t_max, and the barycentrics u, v."""
        direction = rays.direction[rows, None].astype(np.float64)
        edge1, edge2 = self.edges
        with np.errstate(all="ignore"):  # what is not a number compares as false
            across = np.cross(direction, edge2)
            determinant = (edge1 * across).sum(axis=2)
            start = rays.origin[rows, None] - self.corner
            u = (start * across).sum(axis=2) / determinant
            around = np.cross(start, edge1)
            v = (direction * around).sum(axis=2) / determinant
            t = ((edge2 * around).sum(axis=2) / determinant).astype(np.float32)
            met = (u >= 0) & (v >= 0) & (u + v <= 1) & (t >= 0) & (t < rays.t_max[rows, None])
        return np.where(met, t, np.float32(np.inf)), u, v


@hookimpl
def phrt_tracers() -> list[TracerPlugin]:
    factory = f"{__name__}:MyTracer"
    return [TracerPlugin("my_tracer", "Every ray against every triangle, in numpy.", factory, MyTracerOptions)]
