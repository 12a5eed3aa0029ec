"""Geometry that is described instead of read: icospheres, planes, boxes and inline meshes."""

from __future__ import annotations

import numpy as np

from phrt.description.prims import MeshPrim
from phrt.model import Mesh


def icosphere(name: str, radius: float, subdivision: int) -> Mesh:
    """A sphere of 20 * 4^subdivision triangles around the origin, its normals exact, uv by longitude and latitude.

    Vertices are doubled along the seam and at the poles, so that no triangle's uv runs backwards.
    """
    golden = (1 + 5**0.5) / 2
    corners = np.array([[s * 1.0, t * golden, 0.0] for t in (1, -1) for s in (-1, 1)])
    points = np.concatenate([corners, np.roll(corners, 1, axis=1), np.roll(corners, 2, axis=1)])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    triangles = _hull_faces(points)
    for _ in range(subdivision):
        points, triangles = _subdivided(points, triangles)
    points, triangles, uv = _unwrapped(points, triangles)
    normals = points.astype(np.float32)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Mesh(
        name=name,
        positions=(points * radius).astype(np.float32),
        triangles=triangles.astype(np.int32),
        triangle_material=np.full(len(triangles), -1, np.int32),
        normals=normals,
        uv0=uv.astype(np.float32),
    )


def _hull_faces(points: np.ndarray) -> np.ndarray:
    """(20, 3) faces of the icosahedron with vertices (12, 3): triples at edge length, counter-clockwise outside."""
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    near = (distance > 0) & (distance < distance[distance > 0].min() * 1.01)
    faces = [
        (a, b, c) if np.linalg.det(points[[a, b, c]]) > 0 else (a, c, b)
        for a in range(12)
        for b in range(a + 1, 12)
        for c in range(b + 1, 12)
        if near[a, b] and near[b, c] and near[a, c]
    ]
    return np.array(faces)


def _subdivided(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Every triangle in four, the new vertices on the unit sphere."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, index = np.unique(edges, axis=0, return_inverse=True)
    middle = points[unique].sum(axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    ab, bc, ca = (index.reshape(-1, 3) + len(points)).T
    a, b, c = triangles.T
    faces = np.concatenate([np.stack(rows, axis=1) for rows in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    return np.concatenate([points, middle]), faces


def _unwrapped(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, triangles and uv with vertices doubled where the longitude jumps; u turns about +Y, v runs down."""
    corners = points[triangles]
    u = np.arctan2(-corners[..., 2], corners[..., 0]) / (2 * np.pi) + 0.5
    v = np.arccos(np.clip(corners[..., 1], -1, 1)) / np.pi
    u = np.where((u.max(axis=1, keepdims=True) - u) > 0.5, u + 1, u)
    pole = (np.abs(corners[..., 1]) > 1 - 1e-9) & np.ones_like(u, dtype=bool)
    others = np.where(pole, 0.0, u).sum(axis=1, keepdims=True) / np.maximum((~pole).sum(axis=1, keepdims=True), 1)
    u = np.where(pole, others, u)
    rows = np.stack([triangles.astype(np.float64), np.round(u, 9), np.round(v, 9)], axis=2).reshape(-1, 3)
    unique, first, index = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    uv = np.stack([u.reshape(-1)[first], v.reshape(-1)[first]], axis=1)
    return points[unique[:, 0].astype(np.int64)], index.reshape(-1, 3), uv


def plane(name: str, size: tuple[float, float]) -> Mesh:
    """A rectangle in X and Z facing +Y; u along +X, v along +Z."""
    x, z = size[0] / 2, size[1] / 2
    return Mesh(
        name=name,
        positions=np.array([[-x, 0, -z], [-x, 0, z], [x, 0, z], [x, 0, -z]], np.float32),
        triangles=np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        triangle_material=np.full(2, -1, np.int32),
        normals=np.tile(np.array([0, 1, 0], np.float32), (4, 1)),
        uv0=np.array([[0, 0], [0, 1], [1, 1], [1, 0]], np.float32),
    )


def box(name: str, size: tuple[float, float, float]) -> Mesh:
    """A box around the origin, every face with its own four vertices and uv 0..1."""
    face = plane(name, (1.0, 1.0))
    flat, up = face.positions.astype(np.float64), np.array([0.0, 0.5, 0.0])
    # Turns that carry the +Y face onto each of the six sides.
    turns = [
        np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1]]),
        np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1]]),
        np.array([[0, 1, 0], [0, 0, -1], [-1, 0, 0]]),
        np.array([[0, -1, 0], [0, 0, -1], [1, 0, 0]]),
        np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
        np.array([[-1, 0, 0], [0, 0, -1], [0, -1, 0]]),
    ]
    positions = np.concatenate([(flat + up) @ turn.T for turn in turns]) * np.array(size)
    normals = np.concatenate([np.tile(turn @ np.array([0, 1, 0]), (4, 1)) for turn in turns])
    return Mesh(
        name=name,
        positions=positions.astype(np.float32),
        triangles=np.concatenate([face.triangles + 4 * side for side in range(6)]).astype(np.int32),
        triangle_material=np.full(12, -1, np.int32),
        normals=normals.astype(np.float32),
        uv0=np.tile(np.asarray(face.uv0), (6, 1)).astype(np.float32),
    )


def inline_mesh(name: str, prim: MeshPrim) -> Mesh:
    """The points and faces of a Mesh prim; polygons become fans of triangles."""
    triangles = [(face[0], face[k], face[k + 1]) for face in prim.faces or [] for k in range(1, len(face) - 1)]
    normals = None
    if prim.normals is not None:
        normals = np.array(prim.normals, np.float32).reshape(-1, 3)
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        normals = np.where(length > 0, normals / np.maximum(length, 1e-20), np.array([0, 1, 0], np.float32)).astype(
            np.float32
        )
    return Mesh(
        name=name,
        positions=np.array(prim.points or [], np.float32).reshape(-1, 3),
        triangles=np.array(triangles, np.int32).reshape(-1, 3),
        triangle_material=np.full(len(triangles), -1, np.int32),
        normals=normals,
        uv0=None if prim.uv is None else np.array(prim.uv, np.float32).reshape(-1, 2),
        smooth=prim.smooth,
    )
