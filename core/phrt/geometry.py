"""Flat geometry: every object's triangles in shared arrays, and moving an object's rows in place."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from phrt.model import Mesh
from phrt.scene import Scene


@dataclass
class FlatGeometry:
    """The arrays `World` documents, and what is needed to move objects. `object_node` (N + 1,) int32; row 0 is the background.

    mirrored (N + 1,) bool: whose triangles are turned, so that they still face outwards where their matrix mirrors.
    """

    positions: np.ndarray
    normals: np.ndarray
    tangents: np.ndarray
    uv0: np.ndarray
    uv1: np.ndarray
    colors: np.ndarray
    local_positions: np.ndarray
    local_normals: np.ndarray
    local_tangents: np.ndarray
    triangles: np.ndarray
    triangle_object: np.ndarray
    triangle_material: np.ndarray
    triangle_lod: np.ndarray
    first_vertex: np.ndarray
    vertex_count: np.ndarray
    first_triangle: np.ndarray
    triangle_count: np.ndarray
    object_node: np.ndarray
    object_matrix: np.ndarray
    mirrored: np.ndarray

    def move(self, node_matrix: np.ndarray, overrides: dict[int, np.ndarray]) -> tuple[list[int], list[int]]:
        """Bring every object to its node's matrix, or its override.

        Returns the 1-based ids of those that moved, and of those among them whose triangles were turned round in place.
        """
        matrix = node_matrix[self.object_node] if len(node_matrix) else self.object_matrix.copy()
        matrix[0] = np.eye(4)
        for object_id, override in overrides.items():
            matrix[object_id] = override
        moved = np.flatnonzero((matrix != self.object_matrix).any(axis=(1, 2)))
        self.object_matrix = matrix
        ids = [int(row) for row in moved]
        for row in ids:
            self._place(row)
        turned = [int(row) for row in np.flatnonzero(mirrors(matrix) != self.mirrored)]
        for row in turned:
            faces = self.triangles[self.first_triangle[row] :][: self.triangle_count[row]]
            faces[:, 1:] = faces[:, :0:-1].copy()
            self.mirrored[row] ^= True
        return ids, turned

    def _place(self, object_id: int) -> None:
        """Write object `object_id`'s world-space vertices from its local ones."""
        first, count = self.first_vertex[object_id], self.vertex_count[object_id]
        rows = slice(first, first + count)
        matrix = self.object_matrix[object_id]
        linear = matrix[:3, :3].astype(np.float32)
        self.positions[rows] = self.local_positions[rows] @ linear.T + matrix[:3, 3].astype(np.float32)
        self.normals[rows] = _unit(self.local_normals[rows] @ _normal_matrix(matrix).T)
        if len(self.tangents):
            self.tangents[rows, :3] = _unit(self.local_tangents[rows, :3] @ linear.T)
            flip = np.float32(-1.0 if np.linalg.det(matrix[:3, :3]) < 0 else 1.0)
            self.tangents[rows, 3] = self.local_tangents[rows, 3] * flip

    def object_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(N + 1, 3) float32 smallest and largest world-space corners; zero for the background and for empty objects."""
        low = np.zeros((len(self.first_vertex), 3), np.float32)
        high = np.zeros_like(low)
        filled = np.flatnonzero(self.vertex_count)
        if len(filled):
            low[filled] = np.minimum.reduceat(self.positions, self.first_vertex[filled])
            high[filled] = np.maximum.reduceat(self.positions, self.first_vertex[filled])
        return low, high


def flatten(scene: Scene, node_matrix: np.ndarray) -> FlatGeometry:
    """All objects of `scene` at node matrices (nodes, 4, 4), one after the other; mirrored objects get their winding turned."""
    prepared: dict[int, Mesh] = {}
    for entry in scene.objects:
        if entry.mesh not in prepared:
            prepared[entry.mesh] = with_normals(scene.meshes[entry.mesh])
    meshes = [prepared[entry.mesh] for entry in scene.objects]
    vertex_count = np.array([0, *(len(mesh.positions) for mesh in meshes)], dtype=np.int32)
    triangle_count = np.array([0, *(len(mesh.triangles) for mesh in meshes)], dtype=np.int32)
    first_vertex = (np.cumsum(vertex_count) - vertex_count).astype(np.int32)
    first_triangle = (np.cumsum(triangle_count) - triangle_count).astype(np.int32)
    object_node = np.array([0, *(entry.node for entry in scene.objects)], dtype=np.int32)
    object_matrix = node_matrix[object_node] if len(node_matrix) else np.eye(4)[None].repeat(len(object_node), axis=0)
    object_matrix[0] = np.eye(4)

    vertices, triangles = int(vertex_count.sum()), int(triangle_count.sum())
    uses_uv1 = any(mesh.uv1 is not None for mesh in meshes)
    uses_colors = any(mesh.colors is not None for mesh in meshes)
    uses_tangents = any(mesh.tangents is not None for mesh in meshes)
    geometry = FlatGeometry(
        positions=np.empty((vertices, 3), np.float32),
        normals=np.empty((vertices, 3), np.float32),
        tangents=np.zeros((vertices if uses_tangents else 0, 4), np.float32),
        uv0=np.zeros((vertices, 2), np.float32),
        uv1=np.zeros((vertices if uses_uv1 else 0, 2), np.float32),
        colors=np.ones((vertices if uses_colors else 0, 4), np.float32),
        local_positions=np.empty((vertices, 3), np.float32),
        local_normals=np.empty((vertices, 3), np.float32),
        local_tangents=np.zeros((vertices if uses_tangents else 0, 4), np.float32),
        triangles=np.empty((triangles, 3), np.int32),
        triangle_object=np.repeat(np.arange(len(vertex_count), dtype=np.int32), triangle_count),
        triangle_material=np.empty(triangles, np.int32),
        triangle_lod=np.empty(triangles, np.float32),
        first_vertex=first_vertex,
        vertex_count=vertex_count,
        first_triangle=first_triangle,
        triangle_count=triangle_count,
        object_node=object_node,
        object_matrix=object_matrix,
        mirrored=mirrors(object_matrix),
    )
    for object_id, mesh in enumerate(meshes, start=1):
        _copy_object(geometry, object_id, mesh)
    geometry.triangle_lod[:] = texture_density(geometry.positions, geometry.uv0, geometry.triangles)
    return geometry


def _copy_object(geometry: FlatGeometry, object_id: int, mesh: Mesh) -> None:
    """Fill the rows of one object, and place it."""
    first, count = geometry.first_vertex[object_id], geometry.vertex_count[object_id]
    rows = slice(first, first + count)
    geometry.local_positions[rows] = mesh.positions
    geometry.local_normals[rows] = mesh.normals
    for name, values in (
        ("uv0", mesh.uv0),
        ("uv1", mesh.uv1),
        ("colors", mesh.colors),
        ("local_tangents", mesh.tangents),
    ):
        if values is not None:
            getattr(geometry, name)[rows] = values
    faces = slice(
        geometry.first_triangle[object_id], geometry.first_triangle[object_id] + geometry.triangle_count[object_id]
    )
    geometry.triangles[faces] = mesh.triangles[:, [0, 2, 1]] if geometry.mirrored[object_id] else mesh.triangles
    geometry.triangles[faces] += first
    geometry.triangle_material[faces] = mesh.triangle_material + 1
    geometry._place(object_id)


def with_normals(mesh: Mesh) -> Mesh:
    """`mesh` with unit normals: its own, else smooth (area-weighted) or flat ones, for which corners are unshared."""
    if mesh.normals is not None:
        return mesh
    corners = mesh.positions[mesh.triangles]
    area_normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if mesh.smooth:
        normals = np.zeros(mesh.positions.shape, np.float64)
        for corner in range(3):
            index = mesh.triangles[:, corner]
            for axis in range(3):
                normals[:, axis] += np.bincount(index, area_normal[:, axis], minlength=len(normals))
        return replace(mesh, normals=_unit(normals.astype(np.float32)))
    order = mesh.triangles.reshape(-1)
    return replace(
        mesh,
        positions=mesh.positions[order],
        normals=np.repeat(_unit(area_normal.astype(np.float32)), 3, axis=0),
        tangents=None if mesh.tangents is None else mesh.tangents[order],
        uv0=None if mesh.uv0 is None else mesh.uv0[order],
        uv1=None if mesh.uv1 is None else mesh.uv1[order],
        colors=None if mesh.colors is None else mesh.colors[order],
        triangles=np.arange(len(order), dtype=np.int32).reshape(-1, 3),
    )


def texture_density(positions: np.ndarray, uv: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(T,) float32, 0.5 * log2(texture area / world area) of every triangle: the constant of its texture level of detail.

    Akenine-Moller et al. 2021, "Improved Shader and Texture Level of Detail Using Ray Cones", eq. (3), with texture
    space 0..1 instead of texels, so that one constant serves textures of every size.
    """
    p = positions[triangles]
    # Squares of areas of large scenes do not fit into float32.
    world = np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]).astype(np.float64), axis=1)
    t = uv[triangles]
    a, b = t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]
    texture = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    return (0.5 * np.log2(np.maximum(texture, 1e-20) / np.maximum(world, 1e-20))).astype(np.float32)


def mirrors(matrix: np.ndarray) -> np.ndarray:
    """(n,) bool: which of `matrix` (n, 4, 4) turn right-handed into left-handed."""
    return np.asarray(np.linalg.det(matrix[:, :3, :3]) < 0)


def _normal_matrix(matrix: np.ndarray) -> np.ndarray:
    """(3, 3) float32 cofactor matrix: carries normals through any linear map, singular ones too, outwards."""
    m = matrix[:3, :3]
    cofactor = np.stack([np.cross(m[1], m[2]), np.cross(m[2], m[0]), np.cross(m[0], m[1])])
    sign = -1.0 if np.linalg.det(m) < 0 else 1.0
    return (cofactor * sign).astype(np.float32)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Rows of `vectors` at unit length; a zero row becomes +Y."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    result = vectors / np.maximum(length, np.float32(1e-20))
    result[length[:, 0] < 1e-20] = (0.0, 1.0, 0.0)
    return result
