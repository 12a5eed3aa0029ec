"""Gives every triangle a last corner of its own, so that a flat vertex attribute can carry which triangle it is.

`gl_PrimitiveID` would do the same, but llvmpipe then takes every triangle's vertices apart (measured, 150 k triangles
in view: 9 ms of processor time); half as many vertices more as there are triangles cost 2 ms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phrt.kernels.jit import kernel


@dataclass(frozen=True)
class Provoking:
    """triangles (T, 3) int32 in scene order, turned so that the last corner is the triangle's own; copies (K,) int32:
    the vertices that were doubled, in scene order of their triangles, numbered from V on; vertex_row (V + K,) uint32:
    the row of the triangle whose own corner a vertex is; first_copy (N + 2,) int32: where an object's copies begin."""

    triangles: np.ndarray
    copies: np.ndarray
    vertex_row: np.ndarray
    first_copy: np.ndarray


def own_corners(triangles: np.ndarray, row: np.ndarray, owner: np.ndarray, vertices: int, objects: int) -> Provoking:
    """triangles (T, 3) int32, row (T,) each one's row, owner (T,) its 1-based object, ascending."""
    turned = np.empty_like(triangles)
    copies, copy_owner = np.empty(len(triangles), np.int32), np.empty(len(triangles), np.int32)
    vertex_row = np.zeros(vertices + len(triangles), np.uint32)
    taken = np.zeros(vertices, np.bool_)
    count = _claim(triangles, row, owner, taken, turned, copies, copy_owner, vertex_row)
    first_copy = np.searchsorted(copy_owner[:count], np.arange(objects + 2)).astype(np.int32)
    return Provoking(turned, copies[:count].copy(), vertex_row[: vertices + count].copy(), first_copy)


@kernel
def _claim(triangles, row, owner, taken, turned, copies, copy_owner, vertex_row):
    """First come, first served; returns how many vertices had to be doubled."""
    count = 0
    for t in range(len(triangles)):
        own = -1
        for k in range(3):
            if own < 0 and not taken[triangles[t, k]]:
                own = k
        if own >= 0:
            vertex = triangles[t, own]
            taken[vertex] = True
        else:
            own = 2
            vertex = np.int32(len(taken) + count)
            copies[count] = triangles[t, 2]
            copy_owner[count] = owner[t]
            count += 1
        vertex_row[vertex] = row[t]
        turned[t, 0], turned[t, 1], turned[t, 2] = triangles[t, (own + 1) % 3], triangles[t, (own + 2) % 3], vertex
    return count
