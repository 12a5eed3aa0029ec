"""From parts to a `Mesh`: smooth normals that stop at hard edges, box-projected UVs, shared vertices."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from phrt.model import Mesh
from phrt_plugins.loaders.shapes import Part

Array = np.ndarray

POSITION_STEP = 1e-5
HASH_PRIMES = np.array([73856093, 19349663, 83492791], dtype=np.int64)


def build_mesh(name: str, parts: Sequence[Part], material_row: Mapping[str, int]) -> Mesh:
    """One mesh of `parts`. Normals are smooth within a part across edges flatter than its crease angle."""
    corners = np.concatenate([part.positions[part.triangles] for part in parts])
    uv = np.concatenate([part_uv(part) for part in parts])
    counts = [len(part.triangles) for part in parts]
    material = np.repeat([material_row[part.material] for part in parts], counts).astype(np.int32)
    part_id = np.repeat(np.arange(len(parts)), counts)
    crease = np.repeat(np.cos(np.radians([part.crease_degrees for part in parts])), counts)
    exact = np.concatenate([exact_normals(part) for part in parts])

    # Triangles without area come from the poles of lathes.
    area_vector = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    solid = np.linalg.norm(area_vector, axis=1) > 1e-10
    corners, uv, material, exact = corners[solid], uv[solid], material[solid], exact[solid]

    place = position_ids(corners.reshape(-1, 3), np.repeat(part_id[solid], 3))
    normals = crease_normals(corners, area_vector[solid], place, np.repeat(crease[solid], 3))
    known = ~np.isnan(exact.reshape(-1, 3)[:, 0])
    normals[known] = exact.reshape(-1, 3)[known]
    first, vertex_of_corner = shared_vertices(place, normals, uv.reshape(-1, 2))
    return Mesh(
        name=name,
        positions=np.ascontiguousarray(corners.reshape(-1, 3)[first], dtype=np.float32),
        triangles=vertex_of_corner.reshape(-1, 3).astype(np.int32),
        triangle_material=material,
        normals=np.ascontiguousarray(normals[first], dtype=np.float32),
        uv0=np.ascontiguousarray(uv.reshape(-1, 2)[first], dtype=np.float32),
    )


def part_uv(part: Part) -> Array:
    """(T, 3, 2): the part's own, or the two coordinates across each triangle's dominant axis, v downwards."""
    if part.corner_uv is not None:
        return part.corner_uv
    corners = part.positions[part.triangles]
    axis = np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])).argmax(axis=1)
    u = np.where(axis == 0, 2, 0)
    v = np.where(axis == 1, 2, 1)
    rows = np.arange(len(corners))[:, None]
    sign = np.where(axis == 1, 1.0, -1.0)[:, None]
    return np.stack([corners[rows, [0, 1, 2], u[:, None]], sign * corners[rows, [0, 1, 2], v[:, None]]], axis=-1)


def exact_normals(part: Part) -> Array:
    """(T, 3, 3), NaN where the part leaves them to be computed."""
    if part.normals is None:
        return np.full((len(part.triangles), 3, 3), np.nan)
    return part.normals[part.triangles]


def position_ids(points: Array, part_id: Array) -> Array:
    """(n,) int64: equal for equal places of the same part."""
    key = (np.rint(points / POSITION_STEP).astype(np.int64) * HASH_PRIMES).sum(axis=1) * 1000003 + part_id
    return np.unique(key, return_inverse=True)[1].reshape(-1)


def crease_normals(corners: Array, area_vector: Array, place: Array, crease_cosine: Array) -> Array:
    """(3 T, 3): every corner's mean, weighted by angle, of the faces at its place that are within the crease angle."""
    face = np.repeat(area_vector / np.linalg.norm(area_vector, axis=1, keepdims=True), 3, axis=0)
    weighted = face * corner_angles(corners).reshape(-1, 1)

    # All pairs of corners that share a place, as two index lists.
    order = np.argsort(place, kind="stable")
    count = np.bincount(place)
    start = np.cumsum(count) - count
    sorted_place = place[order]
    pairs = count[sorted_place]
    offset = np.cumsum(pairs) - pairs
    within = np.arange(pairs.sum()) - np.repeat(offset, pairs)
    left = np.repeat(order, pairs)
    right = order[np.repeat(start[sorted_place], pairs) + within]

    near = np.einsum("ij,ij->i", face[left], face[right]) >= crease_cosine[left] - 1e-6
    total = np.add.reduceat(weighted[right] * near[:, None], offset, axis=0)
    normals = np.empty_like(total)
    normals[order] = total / np.linalg.norm(total, axis=1, keepdims=True)
    return normals


def corner_angles(corners: Array) -> Array:
    """(T, 3) radians."""
    ahead = np.roll(corners, -1, axis=1) - corners
    back = np.roll(corners, 1, axis=1) - corners
    cosine = (ahead * back).sum(axis=2) / (np.linalg.norm(ahead, axis=2) * np.linalg.norm(back, axis=2))
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def shared_vertices(place: Array, normals: Array, uv: Array) -> tuple[Array, Array]:
    """First corner of every vertex, and the vertex of every corner: one vertex per place, normal and UV."""
    key = place * 2654435761
    key = key + (np.rint(normals * 2000.0).astype(np.int64) * HASH_PRIMES).sum(axis=1) * 40503
    key = key + (np.rint(uv * 5000.0).astype(np.int64) * HASH_PRIMES[:2]).sum(axis=1) * 6700417
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return first, inverse.reshape(-1)
