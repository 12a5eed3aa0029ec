"""Tangents for normal maps where a file has none, in the manner of MikkTSpace, in numpy.

As MikkTSpace does: vertices equal in position, normal and texture coordinates are one; a triangle counts by the angle
of its corner; vertices where mirrored and unmirrored texture space meet are split. Unlike it, triangles of one
handedness that share a vertex are always smoothed together, and triangles without area in texture space follow their
neighbours.
"""

from __future__ import annotations

import numpy as np


def make_tangents(
    positions: np.ndarray, normals: np.ndarray, uv: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tangents of V vertices and T triangles.

    positions, normals : (V, 3) float32; uv : (V, 2) float32, v downwards as in glTF; triangles : (T, 3).
    Returns source (V',) the vertex each new vertex is a copy of, tangents (V', 4) float32, and triangles (T, 3).
    """
    tangent, handedness, weight = triangle_tangents(positions.astype(np.float64), uv.astype(np.float64), triangles)
    welded = weld(positions, normals, uv)
    corners = triangles.reshape(-1)
    # One group per welded vertex and handedness.
    negative = corner_handedness(corners, welded, np.repeat(handedness, 3))
    group = welded[corners] * 2 + negative
    groups = 2 * (int(welded.max()) + 1) if len(welded) else 0
    amount = weight.reshape(-1)
    direction = np.repeat(tangent, 3, axis=0)
    normal = normals[corners].astype(np.float64)
    direction = unit(direction - normal * (normal * direction).sum(axis=1, keepdims=True)) * amount[:, None]
    total = np.stack([np.bincount(group, direction[:, axis], minlength=groups) for axis in range(3)], axis=1)

    # A vertex whose corners have both hands becomes two.
    keys, vertex_of_corner = np.unique(corners.astype(np.int64) * 2 + negative, return_inverse=True)
    used = np.zeros(len(positions), bool)
    used[corners] = True
    unused = np.flatnonzero(~used)
    source = np.concatenate([keys // 2, unused])
    hand = np.concatenate([keys % 2, np.zeros(len(unused), np.int64)])
    normal = normals[source].astype(np.float64)
    sums = total[welded[source] * 2 + hand] if groups else np.zeros((0, 3))
    result = np.empty((len(source), 4), np.float32)
    result[:, :3] = orthonormal(sums, normal)
    result[:, 3] = np.where(hand == 1, -1.0, 1.0)
    return source, result, vertex_of_corner.reshape(-1, 3).astype(triangles.dtype)


def triangle_tangents(
    positions: np.ndarray, uv: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Per triangle: d position / d u, unit (T, 3); handedness 1, -1 or, without area, 0 (T,); corner angles (T, 3)."""
    with np.errstate(all="ignore"):
        corner = positions[triangles]
        texture = uv[triangles]
        edge1, edge2 = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
        step1, step2 = texture[:, 1] - texture[:, 0], texture[:, 2] - texture[:, 0]
        area = step1[:, 0] * step2[:, 1] - step1[:, 1] * step2[:, 0]
        tangent = unit((edge1 * step2[:, 1:] - edge2 * step1[:, 1:]) * np.sign(area)[:, None])
        # v points down in glTF, so an unmirrored texture has negative area.
        handedness = -np.sign(area).astype(np.int64)
        angles = np.empty((len(triangles), 3))
        for i in range(3):
            a = unit(corner[:, (i + 1) % 3] - corner[:, i])
            b = unit(corner[:, (i + 2) % 3] - corner[:, i])
            angles[:, i] = np.arccos(np.clip((a * b).sum(axis=1), -1.0, 1.0))
    angles[handedness == 0] = 0.0
    return tangent, handedness, angles


def corner_handedness(corners: np.ndarray, welded: np.ndarray, handedness: np.ndarray) -> np.ndarray:
    """(C,) 1 for mirrored corners, else 0; those without handedness are as their vertex, 0 when that has both."""
    count = int(welded.max()) + 1 if len(welded) else 0
    plus = np.zeros(count, bool)
    minus = np.zeros(count, bool)
    plus[welded[corners[handedness > 0]]] = True
    minus[welded[corners[handedness < 0]]] = True
    follows = (minus & ~plus)[welded[corners]]
    return np.where(handedness == 0, follows, handedness < 0).astype(np.int64)


def weld(positions: np.ndarray, normals: np.ndarray, uv: np.ndarray) -> np.ndarray:
    """(V,) numbers, the same for vertices equal in position, normal and texture coordinates."""
    rows = np.ascontiguousarray(np.hstack([positions, normals, uv]).astype(np.float32) + np.float32(0.0))
    keys = rows.view(np.uint32).astype(np.uint64)
    mixed = np.full(len(rows), 0x9E3779B97F4A7C15, np.uint64)
    for column in range(keys.shape[1]):
        mixed = (mixed ^ keys[:, column]) * np.uint64(0x100000001B3)
        mixed ^= mixed >> np.uint64(29)
    return np.unique(mixed, return_inverse=True)[1].reshape(-1)


def unit(vectors: np.ndarray) -> np.ndarray:
    """Unit vectors (n, 3); zero stays zero."""
    length = np.linalg.norm(vectors.astype(np.float64), axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def orthonormal(vectors: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(n, 3) unit vectors near `vectors`, perpendicular to `normals`; any perpendicular one where a vector is zero."""
    result = unit(vectors - normals * (normals * vectors).sum(axis=1, keepdims=True))
    bad = (result * result).sum(axis=1) < 0.5
    if bad.any():
        axis = np.where(np.abs(normals[bad, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
        result[bad] = unit(axis - normals[bad] * (normals[bad] * axis).sum(axis=1, keepdims=True))
    return result
