"""Splitting one huge mesh into several, so that objects stay selectable: by material, connected part or grid cell.

Triangles are never cut: every triangle lands in exactly one piece, with its attributes unchanged.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from phrt.model import Mesh

SplitMode = Literal["material", "components", "grid"]

VERTEX_ATTRIBUTES = ("positions", "normals", "tangents", "uv0", "uv1", "colors")
MAX_CELLS_PER_AXIS = 1 << 20


def split_mesh(
    mesh: Mesh, mode: SplitMode, *, cells: tuple[int, int, int] | None = None, size: float | None = None
) -> list[Mesh]:
    """Pieces of `mesh`, in a fixed order, each with only its own vertices; a mesh of one piece comes back as it is.

    material   : one piece per material index.
    components : one per set of triangles connected through vertices at exactly equal positions.
    grid       : one per occupied cell, by triangle centroid: `cells` along x, y, z of the bounds, or cubes of edge
                 `size` (mesh units), or, when neither is given, 4 cells along the longest side and near-cubes.
    """
    if len(mesh.triangles) == 0:
        return [mesh]
    if mode == "material":
        label = mesh.triangle_material
    elif mode == "components":
        label = connected_components(mesh.positions, mesh.triangles)
    else:
        label = grid_cells(mesh, cells, size)
    return pieces(mesh, label)


def pieces(mesh: Mesh, label: np.ndarray) -> list[Mesh]:
    """One mesh per distinct value of `label` (T,), in rising order of the value."""
    values, piece = np.unique(label, return_inverse=True)
    if len(values) == 1:
        return [mesh]
    order = np.argsort(piece, kind="stable")
    bounds = np.concatenate([[0], np.cumsum(np.bincount(piece, minlength=len(values)))])
    return [extract(mesh, order[bounds[k] : bounds[k + 1]], f"{mesh.name}_{k}") for k in range(len(values))]


def extract(mesh: Mesh, rows: np.ndarray, name: str) -> Mesh:
    """The triangles `rows` (n,) of `mesh` with the vertices they use, in their old order."""
    used, triangles = np.unique(mesh.triangles[rows], return_inverse=True)
    kept = {key: values[used] for key in VERTEX_ATTRIBUTES if (values := getattr(mesh, key)) is not None}
    return replace(
        mesh,
        name=name,
        triangles=triangles.reshape(-1, 3).astype(np.int32),
        triangle_material=mesh.triangle_material[rows],
        **kept,
    )


def weld(positions: np.ndarray) -> np.ndarray:
    """(V,) int64: for every vertex the number of its place; vertices at exactly equal positions (V, 3) share one."""
    # + 0 turns -0.0 into 0.0, so that equal numbers are equal bytes.
    rows = np.ascontiguousarray(positions.astype(np.float32) + np.float32(0))
    keys = rows.view(np.dtype((np.void, rows.dtype.itemsize * 3))).reshape(-1)
    return np.unique(keys, return_inverse=True)[1].reshape(-1)


def connected_components(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(T,) int64 component of every triangle, numbered by first appearance.

    Every place takes the smallest label among its triangles, and labels are followed to their roots, until nothing
    changes: a few rounds, as path lengths halve in each.
    """
    place = weld(positions)[triangles]
    label = np.arange(int(place.max()) + 1)
    while True:
        lowest = label[place].min(axis=1)
        lowered = label.copy()
        # Hook the root of each corner's label, not only the corner: whole trees join at once.
        for corner in range(3):
            np.minimum.at(lowered, label[place[:, corner]], lowest)
            np.minimum.at(lowered, place[:, corner], lowest)
        while not np.array_equal(jumped := lowered[lowered], lowered):
            lowered = jumped
        if np.array_equal(lowered, label):
            break
        label = lowered
    values, first, component = np.unique(label[place[:, 0]], return_index=True, return_inverse=True)
    rank = np.empty(len(values), np.int64)
    rank[np.argsort(first)] = np.arange(len(values))
    return rank[component.reshape(-1)]


def grid_cells(mesh: Mesh, cells: tuple[int, int, int] | None, size: float | None) -> np.ndarray:
    """(T,) int64 cell of every triangle's centroid, x fastest."""
    used = mesh.positions[np.unique(mesh.triangles)].astype(np.float64)
    low, extent = used.min(axis=0), np.ptp(used, axis=0)
    if cells is not None:
        counts = np.array(cells, dtype=np.int64)
    else:
        edge = size if size is not None else max(float(extent.max()) / 4, 1e-30)
        counts = np.clip(np.ceil(extent / edge), 1, MAX_CELLS_PER_AXIS).astype(np.int64)
    centroid = mesh.positions[mesh.triangles].astype(np.float64).mean(axis=1)
    share = (centroid - low) / np.where(extent > 0, extent, 1)
    index = np.clip((share * counts).astype(np.int64), 0, counts - 1)
    return index[:, 0] + counts[0] * (index[:, 1] + counts[1] * index[:, 2])
