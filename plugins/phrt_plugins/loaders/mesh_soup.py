"""What the OBJ, PLY and STL readers hand over, checked, and its way into `phrt.model.Mesh`es."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from phrt.errors import AssetError
from phrt.model import Mesh
from phrt_plugins.loaders.mesh_normals import corner_normals
from phrt_plugins.loaders.options import MeshOptions


@dataclass
class Soup:
    """Triangles of one file, indexed per corner as in OBJ. V positions, T triangles.

    positions (V, 3) float64, metres; triangles (T, 3) int64 into it;
    uvs (N, 2) float64, v down, and uv_index (T, 3), -1 where a corner has none; normals (M, 3) and normal_index alike;
    colors (V, 4) float32 linear, or None; material (T,) int32, -1 for the default; part (T,) int32 into `part_names`;
    smoothing (T,) int32, corners of different groups are never smoothed together; 0 is flat.
    """

    positions: np.ndarray
    triangles: np.ndarray
    part_names: list[str]
    material: np.ndarray
    part: np.ndarray
    smoothing: np.ndarray
    uvs: np.ndarray | None = None
    uv_index: np.ndarray | None = None
    normals: np.ndarray | None = None
    normal_index: np.ndarray | None = None
    colors: np.ndarray | None = None


def simple_soup(positions: np.ndarray, triangles: np.ndarray, name: str) -> Soup:
    """A soup of one smooth part without materials."""
    count = len(triangles)
    return Soup(
        positions=np.asarray(positions, dtype=np.float64),
        triangles=np.asarray(triangles, dtype=np.int64),
        part_names=[name],
        material=np.full(count, -1, dtype=np.int32),
        part=np.zeros(count, dtype=np.int32),
        smoothing=np.ones(count, dtype=np.int32),
    )


def check(soup: Soup, place: str, warn: Callable[[str], None]) -> Soup:
    """`soup` without degenerate triangles. Raises AssetError, beginning with `place`, for what no picture can be made
    of: no triangles, an index past the end, positions that are not finite, no size."""
    if not len(soup.triangles):
        points = f", only {len(soup.positions)} points" if len(soup.positions) else ""
        raise AssetError(f"{place} has no triangles{points}")
    _check_index(soup.triangles, len(soup.positions), "vertex", place)
    if soup.uvs is not None and soup.uv_index is not None:
        _check_index(np.maximum(soup.uv_index, 0), max(len(soup.uvs), 1), "texture coordinate", place)
    if soup.normals is not None and soup.normal_index is not None:
        _check_index(np.maximum(soup.normal_index, 0), max(len(soup.normals), 1), "normal", place)
    used = np.unique(soup.triangles)
    bad = ~in_range(soup.positions[used])
    if bad.any():
        raise AssetError(
            f"{place}: position of vertex {used[np.argmax(bad)] + 1} is NaN, infinite or beyond 1e18 "
            f"({int(bad.sum())} of {len(used)} used vertices)"
        )
    if not np.ptp(soup.positions[used], axis=0).any():
        raise AssetError(f"{place} has zero size: all vertices are at one point")
    kept = drop_degenerate(soup, warn)
    if not len(kept.triangles):
        raise AssetError(f"{place}: none of its {len(soup.triangles)} triangles has an area")
    return kept


def in_range(rows: np.ndarray) -> np.ndarray:
    """(n,) bool: are all values of a row of (n, k) numbers up to 1e18, so that areas still fit into float32?"""
    return (np.abs(rows) <= 1e18).all(axis=1)


def _check_index(index: np.ndarray, count: int, what: str, place: str) -> None:
    outside = (index < 0) | (index >= count)
    if outside.any():
        raise AssetError(
            f"{place}: {what} index {int(index[outside][0]) + 1} is outside 1 to {count} "
            f"({int(outside.any(axis=1).sum())} of {len(index)} triangles)"
        )


def drop_degenerate(soup: Soup, warn: Callable[[str], None]) -> Soup:
    """`soup` without triangles of no area; warns when it was more than one in a hundred."""
    a, b, c = (soup.positions[soup.triangles[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    # Relative to the longest side: a sliver of a millimetre is as good as one of a kilometre.
    longest = np.maximum(np.maximum(_squared(b - a), _squared(c - b)), _squared(a - c))
    keep = area > 1e-12 * longest
    dropped = int(len(keep) - keep.sum())
    if not dropped:
        return soup
    if dropped > 0.01 * len(keep):
        warn(f"{dropped} of {len(keep)} triangles have no area and were left out")
    return replace(
        soup,
        triangles=soup.triangles[keep],
        material=soup.material[keep],
        part=soup.part[keep],
        smoothing=soup.smoothing[keep],
        uv_index=None if soup.uv_index is None else soup.uv_index[keep],
        normal_index=None if soup.normal_index is None else soup.normal_index[keep],
    )


def _squared(vectors: np.ndarray) -> np.ndarray:
    return np.einsum("ij,ij->i", vectors, vectors)


def build_meshes(soup: Soup, options: MeshOptions, warn: Callable[[str], None]) -> list[Mesh]:
    """One mesh per part that has triangles, vertices shared wherever all their attributes agree."""
    normals, normal_index = corner_normals(soup, options, warn)
    uv_index = soup.uv_index if soup.uvs is not None and len(soup.uvs) else None
    meshes = []
    order = np.argsort(soup.part, kind="stable")
    bounds = np.searchsorted(soup.part[order], np.arange(len(soup.part_names) + 1))
    for part, name in enumerate(soup.part_names):
        rows = order[bounds[part] : bounds[part + 1]]
        if not len(rows):
            continue
        uvs = None if uv_index is None else uv_index[rows]
        # A part none of whose corners has a texture coordinate has no uv set.
        uvs = None if uvs is None or (uvs < 0).all() else uvs
        meshes.append(_mesh(soup, name, rows, uvs, normals, normal_index[rows]))
    return meshes


def _mesh(
    soup: Soup,
    name: str,
    rows: np.ndarray,
    uv_index: np.ndarray | None,
    normals: np.ndarray,
    normal_index: np.ndarray,
) -> Mesh:
    """Triangles `rows` of `soup` with one index per vertex instead of one per attribute."""
    triangles = soup.triangles[rows]
    keys = [triangles.reshape(-1), normal_index.reshape(-1)]
    if uv_index is not None:
        keys.append(uv_index.reshape(-1) + 1)
    first, inverse = _unique_rows(keys)
    vertex, normal = keys[0][first], keys[1][first]
    mesh = Mesh(
        name=name,
        positions=soup.positions[vertex].astype(np.float32),
        triangles=inverse.reshape(-1, 3).astype(np.int32),
        triangle_material=soup.material[rows].astype(np.int32),
        normals=normals[normal].astype(np.float32),
    )
    if uv_index is not None and soup.uvs is not None:
        # Corners without a coordinate get (0, 0), as OBJ readers do.
        mesh.uv0 = np.vstack([np.zeros((1, 2)), soup.uvs])[keys[2][first]].astype(np.float32)
    if soup.colors is not None:
        mesh.colors = np.ascontiguousarray(soup.colors[vertex], dtype=np.float32)
    return mesh


def _unique_rows(columns: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Row of the first of every distinct combination of `columns` (n,) int64 >= 0, and (n,) which combination a row is.

    Vertices keep the order of their first column."""
    key = columns[0]
    for column in columns[1:]:
        width = int(column.max(initial=0)) + 1
        if (int(key.max(initial=0)) + 1) * width >= 2**62:
            key = np.unique(key, return_inverse=True)[1].reshape(-1)
        key = key * width + column
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return first, inverse.reshape(-1)


def upward_uvs(uvs: np.ndarray, warn: Callable[[str], None]) -> np.ndarray:
    """(n, 2) `uvs` whose v runs up, turned to run down; what is not finite becomes 0, with a warning."""
    good = in_range(uvs)
    if not good.all():
        warn(f"{int((~good).sum())} of {len(uvs)} texture coordinates are not finite and were set to 0")
    return np.where(good[:, None], np.column_stack([uvs[:, 0], 1.0 - uvs[:, 1]]), 0.0)


def linear_from_srgb(encoded: np.ndarray) -> np.ndarray:
    """Vertex colours are painted in sRGB: `encoded` 0..1 decoded, alike in shape."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
