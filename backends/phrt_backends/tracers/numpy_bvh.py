"""The `numpy` tracer: a bounding volume hierarchy and Möller-Trumbore in plain numpy, slow and obvious.

It is the oracle of the other tracers and the first thing to read before writing one: `build`, `closest_hit`,
`occluded` and nothing else. All arithmetic is float64. Options: `phrt_backends.options.NumpyOptions`.

Source: T. Möller, B. Trumbore, "Fast, Minimum Storage Ray/Triangle Intersection", Journal of Graphics Tools 2(1), 1997.

Example: `tracer = NumpyTracer(NumpyOptions()); tracer.build(world); hits = tracer.closest_hit(rays)`
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from phrt.conventions import NO_PRIMITIVE
from phrt.errors import PhrtError
from phrt.interfaces.tracer import Tracer, TracerCapabilities
from phrt.rays import HitBatch, RayBatch
from phrt_backends.options import NumpyOptions
from phrt_backends.tracers.ray_checks import usable_rays

if TYPE_CHECKING:
    from phrt.world import Changes, World

_BOX_PADDING = 1e-7
"""Boxes grow by this share of the largest coordinate, so that rounding never culls a triangle that is hit."""

_TINY = 1e-200
"""Stands for a zero component of a direction: its reciprocal is huge but finite."""


@dataclass
class Node:
    """A box around triangles: a leaf holds them, an inner node has two children. lower, upper: (3,) metres."""

    lower: np.ndarray
    upper: np.ndarray
    triangles: np.ndarray | None = None
    children: tuple[Node, Node] | None = None


@dataclass
class Hierarchy:
    """corners (T, 3, 3) float64 world space; root None when there is nothing to hit."""

    corners: np.ndarray
    root: Node | None


class NumpyTracer(Tracer):
    """Rebuilds on every update; its queries hold the GIL."""

    def __init__(self, options: NumpyOptions) -> None:
        self.options = options
        self.capabilities = TracerCapabilities(description="a BVH in plain numpy, slow: for tests and small scenes")
        self._all: Hierarchy | None = None
        self._casters: Hierarchy | None = None

    def build(self, world: World) -> None:
        corners = np.asarray(world.positions, np.float64)[world.triangles].reshape(-1, 3, 3)
        casts = np.asarray(world.object_casts_shadow)[world.triangle_object]
        self._all = build_hierarchy(corners, np.arange(len(corners)), self.options.leaf_size)
        self._casters = (
            self._all if casts.all() else build_hierarchy(corners, np.flatnonzero(casts), self.options.leaf_size)
        )

    def update(self, world: World, changes: Changes) -> None:
        if changes.objects:
            self.build(world)

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        return trace(self._built(self._all), rays)

    def occluded(self, rays: RayBatch) -> np.ndarray:
        return np.isfinite(trace(self._built(self._casters), rays).distance)

    def close(self) -> None:
        self._all = self._casters = None

    def _built(self, hierarchy: Hierarchy | None) -> Hierarchy:
        if hierarchy is None:
            raise PhrtError("the tracer has no scene: call build first, and nothing after close")
        return hierarchy


def build_hierarchy(corners: np.ndarray, members: np.ndarray, leaf_size: int) -> Hierarchy:
    """Split triangles `members` at the median of their centres along the longest axis until a leaf holds them.

    Triangles with a corner that is not finite cannot be hit and are left out.
    """
    members = members[np.isfinite(corners[members]).all(axis=(1, 2))]
    lower, upper, centre = corners.min(axis=1), corners.max(axis=1), corners.mean(axis=1)
    padding = _BOX_PADDING * float(np.abs(corners[members]).max(initial=0.0))

    def split(part: np.ndarray) -> Node:
        node = Node(lower[part].min(axis=0) - padding, upper[part].max(axis=0) + padding)
        if len(part) <= leaf_size:
            node.triangles = part
            return node
        axis = int(np.argmax(np.ptp(centre[part], axis=0)))
        middle = len(part) // 2
        part = part[np.argpartition(centre[part, axis], middle)]
        node.children = (split(part[:middle]), split(part[middle:]))
        return node

    return Hierarchy(corners, split(members) if len(members) else None)


def trace(hierarchy: Hierarchy, rays: RayBatch) -> HitBatch:
    """Nearest hit with 0 <= t < t_max: all rays walk the tree together, each node keeps those that meet its box."""
    origin, direction = rays.origin.astype(np.float64), rays.direction.astype(np.float64)
    best = rays.t_max.astype(np.float64)  # a hit has to be nearer than this
    primitive = np.full(len(rays), NO_PRIMITIVE, np.uint32)
    barycentric = np.zeros((len(rays), 2), np.float32)
    inverse = 1.0 / np.where(direction == 0.0, _TINY, direction)
    stack = [(hierarchy.root, np.flatnonzero(usable_rays(rays)))] if hierarchy.root else []
    while stack:
        node, active = stack.pop()
        active = active[meets_box(node, origin[active], inverse[active], best[active])]
        if not len(active):
            continue
        if node.children:
            stack.extend((child, active) for child in node.children)
            continue
        assert node.triangles is not None
        t, u, v = intersect(origin[active], direction[active], hierarchy.corners[node.triangles])
        nearest = np.argmin(t, axis=1)
        rows = np.arange(len(active))
        nearer = t[rows, nearest] < best[active]
        rows, nearest, hit = rows[nearer], nearest[nearer], active[nearer]
        best[hit] = t[rows, nearest]
        primitive[hit] = node.triangles[nearest]
        barycentric[hit, 0], barycentric[hit, 1] = u[rows, nearest], v[rows, nearest]
    distance = np.where(primitive == NO_PRIMITIVE, np.inf, best).astype(np.float32)
    return HitBatch(distance, primitive, barycentric)


def meets_box(node: Node, origin: np.ndarray, inverse: np.ndarray, best: np.ndarray) -> np.ndarray:
    """(n,) bool: does the ray pass through the box at 0 <= t <= best? inverse (n, 3): one over the direction."""
    with np.errstate(over="ignore"):
        to_lower, to_upper = (node.lower - origin) * inverse, (node.upper - origin) * inverse
    enter = np.minimum(to_lower, to_upper).max(axis=1)
    leave = np.maximum(to_lower, to_upper).min(axis=1)
    return (leave >= np.maximum(enter, 0.0)) & (enter <= best)


def intersect(origin: np.ndarray, direction: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, ...]:
    """Möller-Trumbore, n rays against m triangles (m, 3, 3), both sides.

    Returns t, u, v, each (n, m): metres along the ray (+inf for a miss), weights of the second and third corner.
    """
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = np.cross(direction[:, None], edge2[None])
    determinant = np.einsum("nmk,mk->nm", p, edge1)
    s = origin[:, None] - corners[None, :, 0]
    q = np.cross(s, edge1[None])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        u = np.einsum("nmk,nmk->nm", s, p) / determinant
        v = np.einsum("nk,nmk->nm", direction, q) / determinant
        t = np.einsum("mk,nmk->nm", edge2, q) / determinant
        hit = (determinant != 0.0) & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t >= 0.0)
    return np.where(hit, t, np.inf), u, v
