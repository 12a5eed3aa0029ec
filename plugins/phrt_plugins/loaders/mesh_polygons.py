"""Polygons to triangles: fans where convex, the better diagonal of quads, ears where concave."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

MAX_EAR_CORNERS = 256
"""Concave polygons with more corners become fans: clipping ears takes the square of their number."""

MAX_EAR_WORK = 4_000_000
"""Squared corners of all concave polygons of a file together, after which they become fans."""


def triangulate(sizes: np.ndarray, points: np.ndarray, warn: Callable[[str], None]) -> tuple[np.ndarray, np.ndarray]:
    """Split polygons into triangles, winding kept.

    sizes : (F,) corners of each polygon; points : (C, 3) float64, the corners' positions, polygon after polygon.
    Returns (T, 3) int64 rows of `points` and (T,) int64 polygon of each triangle, in the polygons' order. Polygons of
    fewer than three corners give none, with a warning.
    """
    first = np.cumsum(sizes) - sizes
    few = int((sizes < 3).sum())
    if few:
        warn(f"{few} faces have fewer than three corners and were left out")
    if (sizes == 3).all():
        return first[:, None] + np.arange(3), np.arange(len(sizes))
    corners: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    work, fans = 0, 0
    for size in np.unique(sizes[sizes >= 3]):
        polygons = np.flatnonzero(sizes == size)
        rows = first[polygons, None] + np.arange(size)
        shift, convex = _best_fan(points[rows])
        fan = _fan(rows, shift)
        for index in np.flatnonzero(~convex):
            work += int(size) ** 2
            if size > MAX_EAR_CORNERS or work > MAX_EAR_WORK:
                fans += 1
            else:
                fan[index] = rows[index][_clip_ears(points[rows[index]])]
        corners.append(fan.reshape(-1, 3))
        faces.append(np.repeat(polygons, size - 2))
    if fans:
        warn(f"{fans} concave polygons are too large to be divided exactly and were cut as fans")
    if not corners:
        return np.zeros((0, 3), dtype=np.int64), np.zeros(0, dtype=np.int64)
    face = np.concatenate(faces)
    order = np.argsort(face, kind="stable")
    return np.concatenate(corners)[order], face[order]


def _fan(rows: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """(k, n - 2, 3): fans around corner `shift` (k,) of polygons `rows` (k, n)."""
    count = rows.shape[1]
    turned = np.take_along_axis(rows, (np.arange(count) + shift[:, None]) % count, axis=1)
    hub = np.broadcast_to(turned[:, :1], (len(rows), count - 2))
    return np.stack([hub, turned[:, 1:-1], turned[:, 2:]], axis=2)


def _best_fan(polygons: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For polygons (k, n, 3): the corner (k,) to fan around, and (k,) whether all triangles of that fan face one way.
    Fans around the first corner where that works; quads may also be cut along the other diagonal."""
    count = polygons.shape[1]
    best = np.zeros(len(polygons), dtype=np.int64)
    fits = np.zeros(len(polygons), dtype=bool)
    normal = np.cross(polygons, np.roll(polygons, -1, axis=1)).sum(axis=1)
    for shift in range(2 if count == 4 else 1):
        turned = np.roll(polygons, -shift, axis=1)
        sides = turned[:, 1:] - turned[:, :1]
        facing = np.einsum("ijk,ik->ij", np.cross(sides[:, :-1], sides[:, 1:]), normal)
        good = (facing >= 0).all(axis=1)
        best[good & ~fits] = shift
        fits |= good
    return best, fits


def _clip_ears(polygon: np.ndarray) -> np.ndarray:
    """(n - 2, 3) corners of triangles that tile simple `polygon` (n, 3); a self-crossing one ends as a fan."""
    count = len(polygon)
    normal = np.cross(polygon, np.roll(polygon, -1, axis=0)).sum(axis=0)
    # Seen along the normal's largest axis, turned so that it winds counter-clockwise.
    axis = int(np.argmax(np.abs(normal)))
    flat = polygon[:, [(axis + 1) % 3, (axis + 2) % 3]]
    if normal[axis] < 0:
        flat = flat[:, ::-1]
    left = list(range(count))
    triangles = []
    while len(left) > 3:
        ear = next((k for k in range(len(left)) if _is_ear(flat, left, k)), None)
        if ear is None:
            break
        triangles.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    triangles += [(left[0], left[k], left[k + 1]) for k in range(1, len(left) - 1)]
    return np.array(triangles, dtype=np.int64)


def _is_ear(flat: np.ndarray, left: list[int], k: int) -> bool:
    """Does the triangle at corner k of what is left turn left and hold none of the other corners?"""
    ids = (left[k - 1], left[k], left[(k + 1) % len(left)])
    a, b, c = flat[list(ids)]
    if _turn(a, b, c) <= 0:
        return False
    others = flat[[i for i in left if i not in ids]]
    inside = (_turn(a, b, others) >= 0) & (_turn(b, c, others) >= 0) & (_turn(c, a, others) >= 0)
    # A corner at the same place as one of the triangle's (a keyhole) does not count.
    for point in (a, b, c):
        inside &= (others != point).any(axis=1)
    return not bool(inside.any())


def _turn(a: np.ndarray, b: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Twice the signed area of a, b and each of `points` (..., 2)."""
    return (b[0] - a[0]) * (points[..., 1] - a[1]) - (b[1] - a[1]) * (points[..., 0] - a[0])
