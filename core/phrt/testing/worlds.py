"""Small worlds made by hand: meshes, where they stand, and views of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from phrt.camera import CameraView, look_at
from phrt.model import Image, Light, Material, Mesh
from phrt.scene import Dome, Scene, SceneLight, SceneNode, SceneObject
from phrt.world import World

QUAD_UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
SIZE = 64
"""Width and height of `front_view`: 32 pixels a metre at z = 0."""


# Meshes


def mesh_of(
    positions: np.ndarray | Sequence[object], triangles: np.ndarray | Sequence[object], material: int = 0
) -> Mesh:
    """A mesh of positions (V, 3) and triangles (T, 3), all of one material."""
    faces = np.asarray(triangles, np.int32).reshape(-1, 3)
    corners = np.asarray(positions, np.float32).reshape(-1, 3)
    return Mesh("mesh", corners, faces, np.full(len(faces), material, np.int32))


def triangle(z: float = 0.0, material: int = 0) -> Mesh:
    """Corners (0, 0, z), (1, 0, z) and (0, 1, z), facing +Z."""
    return mesh_of([[0, 0, z], [1, 0, z], [0, 1, z]], [[0, 1, 2]], material)


def quad(material: int = 0, *, half: float = 1.0, tangents: bool = False, **attributes: np.ndarray) -> Mesh:
    """A square of side 2 * half in the plane z = 0, facing +Z; uv (0, 0) at its top left corner, v down."""
    positions = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32) * np.float32(half)
    return Mesh(
        "quad",
        positions,
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        np.full(2, material, np.int32),
        normals=np.tile(np.array([0, 0, 1], np.float32), (4, 1)),
        tangents=np.tile(np.array([1, 0, 0, 1], np.float32), (4, 1)) if tangents else None,
        uv0=attributes.get("uv0", QUAD_UV),
        uv1=attributes.get("uv1"),
        colors=attributes.get("colors"),
    )


def box(half: float = 0.5, material: int = 0) -> Mesh:
    """An axis-aligned cube around the origin, 12 triangles that face outwards."""
    corners = [[x, y, z] for x in (-half, half) for y in (-half, half) for z in (-half, half)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return mesh_of(corners, [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], material)


def sphere(rings: int = 24, radius: float = 0.6, material: int = 0) -> Mesh:
    """A latitude-longitude sphere with smooth normals, uv and tangents."""
    theta = np.linspace(0, np.pi, rings + 1)
    phi = np.linspace(0, 2 * np.pi, 2 * rings + 1)
    t, p = np.meshgrid(theta, phi, indexing="ij")
    normals = np.stack([np.sin(t) * np.cos(p), np.cos(t), -np.sin(t) * np.sin(p)], -1).reshape(-1, 3).astype(np.float32)
    uv = np.stack([p / (2 * np.pi), t / np.pi], -1).reshape(-1, 2).astype(np.float32)
    along = np.stack([-np.sin(p), np.zeros_like(p), -np.cos(p), np.ones_like(p)], -1).reshape(-1, 4).astype(np.float32)
    a = (np.arange(rings)[:, None] * (2 * rings + 1) + np.arange(2 * rings)[None]).reshape(-1)
    b = a + 2 * rings + 1
    triangles = np.concatenate([np.stack([a, b, b + 1], -1), np.stack([a, b + 1, a + 1], -1)]).astype(np.int32)
    corners = (normals * np.float32(radius))[triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    triangles = triangles[area > 1e-9]
    materials = np.full(len(triangles), material, np.int32)
    return Mesh("sphere", normals * np.float32(radius), triangles, materials, normals, along, uv)


def soup(count: int, seed: int, size: float = 0.3) -> Mesh:
    """Random triangles around the cube [-1, 1]."""
    random = np.random.default_rng(seed)
    corners = random.uniform(-1, 1, (count, 1, 3)) + random.normal(0, size, (count, 3, 3))
    return mesh_of(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


# Textures


def four_colors() -> Image:
    """2 x 2 texels: red green / blue white, row 0 at the top."""
    pixels = np.array([[[255, 0, 0, 255], [0, 255, 0, 255]], [[0, 0, 255, 255], [255, 255, 255, 255]]], np.uint8)
    return Image("four", pixels)


def half_covered() -> Image:
    """2 x 1 texels: an opaque left one and an empty right one."""
    return Image("half", np.array([[[255, 255, 255, 255], [255, 255, 255, 0]]], np.uint8))


# Places and views


def at(
    x: float = 0.0, y: float = 0.0, z: float = 0.0, scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
) -> np.ndarray:
    """(4, 4) float64: scale, then move."""
    matrix = np.diag([*scale, 1.0])
    matrix[:3, 3] = (x, y, z)
    return matrix


def world_of(
    placed: Sequence[tuple[Mesh, np.ndarray]],
    materials: Sequence[Material] | None = None,
    images: Sequence[Image] = (),
    *,
    casts: Sequence[bool] | None = None,
    lights: Sequence[tuple[Light, np.ndarray]] = (),
    dome: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> World:
    """A world with one object per (mesh, matrix). casts: which of them cast a shadow; by default all."""
    casting = [True] * len(placed) if casts is None else casts
    nodes = [SceneNode(f"/n{i}", -1, matrix) for i, (_, matrix) in enumerate(placed)]
    lamps = [SceneNode(f"/l{i}", -1, matrix) for i, (_, matrix) in enumerate(lights)]
    return World(
        Scene(
            "test",
            nodes=nodes + lamps,
            objects=[SceneObject(f"/n{i}", i, i, casts_shadow=cast) for i, cast in enumerate(casting)],
            meshes=[mesh for mesh, _ in placed],
            materials=list(materials or [Material()]),
            images=list(images),
            lights=[SceneLight(f"/l{i}", len(nodes) + i, light) for i, (light, _) in enumerate(lights)],
            dome=Dome(dome),
        )
    )


def front_view(**changes: object) -> CameraView:
    """From (0, 0, 2) down -Z with a 53 degree field: x, y in -1..1 at z = 0 fill the picture exactly."""
    values: dict[str, Any] = {
        "width": SIZE,
        "height": SIZE,
        "tan_half": (0.5, 0.5),
        "world_from_view": look_at((0, 0, 2), (0, 0, 0)),
    }
    return CameraView(**(values | changes))
