"""Triangles on the graphics side: vertex and index buffers, clusters to cull by, and the tables that codes look up.

Triangles are drawn in the order (material, object), so that a material is one run and an object's part of it is
contiguous. Runs are cut into clusters with a bounding box each: a software rasterizer is bound by vertices, and what is
outside the view is then never transformed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from phrt.conventions import NO_PRIMITIVE
from phrt.world import Changes, World
from phrt_backends.gbuffers.moderngl_provoking import own_corners

CLUSTER_TRIANGLES = 512
ATTRIBUTES = {
    "in_position": "positions",
    "in_normal": "normals",
    "in_tangent": "tangents",
    "in_uv0": "uv0",
    "in_uv1": "uv1",
    "in_color": "colors",
}
MOVING = ("in_position", "in_normal", "in_tangent")


@dataclass(frozen=True)
class Visible:
    """Clusters in view, in draw order, and the smallest and largest depth of their boxes' corners, metres."""

    clusters: np.ndarray
    nearest: float
    farthest: float


class DrawGeometry:
    """Buffers of a world with at least one triangle.

    order (T,) int32: scene triangle of every row. indices: triangles have a last corner of their own (`own_corners`),
    for programs that read `in_row`; shared_indices: fewer vertices, for the others. Clusters (C,): cluster_first,
    cluster_rows, cluster_material, cluster_object int32; cluster_low, cluster_high (C, 3) float32 world space.
    """

    def __init__(self, gl: Any, world: World) -> None:
        order = np.lexsort((world.triangle_object, world.triangle_material)).astype(np.int32)
        self.order = order
        self._triangles = world.triangles[order]
        row = np.empty_like(order)
        row[order] = np.arange(len(order), dtype=np.int32)
        provoking = own_corners(world.triangles, row, world.triangle_object, len(world.positions), world.object_count)
        self._copies, self._first_copy = provoking.copies, provoking.first_copy
        self.buffers: dict[str, Any] = {}
        for attribute, source in ATTRIBUTES.items():
            array = getattr(world, source)
            if len(array):
                self.buffers[attribute] = gl.buffer(np.concatenate([array, array[provoking.copies]]))
        self.formats = {name: f"{getattr(world, ATTRIBUTES[name]).shape[1]}f" for name in self.buffers}
        self.buffers["in_row"], self.formats["in_row"] = gl.buffer(provoking.vertex_row), "1u"
        self.indices = gl.buffer(provoking.triangles[order])
        self.shared_indices = gl.buffer(self._triangles)
        self._make_clusters(world)
        self._make_tables(world)
        self._measure(world, np.arange(len(self.cluster_first)))

    def update(self, world: World, changes: Changes) -> None:
        """Rewrite the vertices, cluster boxes and triangle normals of `changes.objects`, and turn the triangles of `turned`."""
        if changes.turned:
            self._turn(world, np.flatnonzero(np.isin(world.triangle_object[self.order], changes.turned)))
        for object_id in changes.objects:
            first, count = int(world.first_vertex[object_id]), int(world.vertex_count[object_id])
            copies = slice(int(self._first_copy[object_id]), int(self._first_copy[object_id + 1]))
            for attribute in MOVING:
                array = getattr(world, ATTRIBUTES[attribute])
                if not count or attribute not in self.buffers:
                    continue
                buffer, stride = self.buffers[attribute], array.strides[0]
                buffer.write(array[first : first + count], offset=first * stride)
                if copies.stop > copies.start:
                    buffer.write(array[self._copies[copies]], offset=(len(array) + copies.start) * stride)
        self._measure(world, np.flatnonzero(np.isin(self.cluster_object, changes.objects)))

    def visible(self, clip_from_world: np.ndarray, depth_row: np.ndarray, drawn: np.ndarray, cull: bool) -> Visible:
        """The clusters of `drawn` (C,) bool that touch the view volume; conservative: a box decides, not its triangles.

        clip_from_world (4, 4) float64; depth_row (4,) float64, whose product with a point is its depth.
        """
        corners = np.where(CORNERS[None], self.cluster_high[:, None], self.cluster_low[:, None]).astype(np.float64)
        clip = corners @ clip_from_world[:, :3].T + clip_from_world[:, 3]
        w = clip[..., 3]
        outside = np.zeros(len(clip), bool)
        for axis in range(3):
            outside |= (clip[..., axis] > w).all(axis=1) | (clip[..., axis] < -w).all(axis=1)
        depth = corners @ depth_row[:3] + depth_row[3]
        clusters = np.flatnonzero(drawn & ~outside) if cull else np.flatnonzero(drawn)
        if not len(clusters):
            return Visible(clusters, 0.0, 0.0)
        return Visible(clusters, float(depth[clusters].min()), float(depth[clusters].max()))

    def release(self) -> None:
        """Give the buffers back."""
        for buffer in (*self.buffers.values(), self.indices, self.shared_indices):
            buffer.release()

    def _turn(self, world: World, rows: np.ndarray) -> None:
        """Let the triangles of `rows` face the other way; each keeps its own corner last."""
        triangles = np.frombuffer(self.indices.read(), np.int32).reshape(-1, 3).copy()
        triangles[rows, :2] = triangles[rows, 1::-1]
        self.indices.write(triangles)
        self._triangles[rows] = world.triangles[self.order[rows]]
        self.shared_indices.write(self._triangles)

    def _make_clusters(self, world: World) -> None:
        material, owner = world.triangle_material[self.order], world.triangle_object[self.order]
        change = np.flatnonzero((np.diff(material) != 0) | (np.diff(owner) != 0)) + 1
        starts = np.concatenate([[0], change])
        ends = np.concatenate([change, [len(material)]])
        first = np.concatenate([np.arange(s, e, CLUSTER_TRIANGLES) for s, e in zip(starts, ends, strict=True)])
        self.cluster_first = first.astype(np.int32)
        self.cluster_rows = np.diff(np.append(first, len(material))).astype(np.int32)
        self.cluster_material, self.cluster_object = material[first], owner[first]
        self.cluster_low = np.zeros((len(first), 3), np.float32)
        self.cluster_high = np.zeros((len(first), 3), np.float32)

    def _make_tables(self, world: World) -> None:
        """What a code looks up: row 0 is the background; normals have a row for either side of a triangle."""
        rows = len(self.order) + 1
        self.row_primitive = np.full(rows, NO_PRIMITIVE, np.uint32)
        self.row_object, self.row_material = np.zeros(rows, np.uint32), np.zeros(rows, np.uint32)
        self.row_primitive[1:] = self.order
        self.row_object[1:] = world.triangle_object[self.order]
        self.row_material[1:] = world.triangle_material[self.order]
        self.code_normal = np.zeros((2 * rows, 3), np.float32)

    def _measure(self, world: World, clusters: np.ndarray) -> None:
        """Boxes and triangle normals of `clusters` from the present positions."""
        if not len(clusters):
            return
        counts = self.cluster_rows[clusters]
        offsets = np.cumsum(counts) - counts
        rows = np.repeat(self.cluster_first[clusters] - offsets, counts) + np.arange(counts.sum())
        corners = world.positions[self._triangles[rows]]
        self.cluster_low[clusters] = np.minimum.reduceat(corners.min(axis=1), offsets)
        self.cluster_high[clusters] = np.maximum.reduceat(corners.max(axis=1), offsets)
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        # By the largest part first: squares of the areas of large triangles do not fit into float32.
        normal /= np.abs(normal).max(axis=1, keepdims=True) + np.float32(1e-30)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True) + np.float32(1e-30)
        self.code_normal[2 * (rows + 1)] = normal
        self.code_normal[2 * (rows + 1) + 1] = -normal


CORNERS = np.array([[bool(corner & 1), bool(corner & 2), bool(corner & 4)] for corner in range(8)])
