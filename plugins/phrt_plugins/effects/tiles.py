"""Tiles of maps: which texels belong to one, and which of them a sphere falls into."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from phrt.camera import CameraView
from phrt_plugins.effects.cube_kernels import TILE


@lru_cache(maxsize=1)
def _offsets() -> tuple[np.ndarray, np.ndarray]:
    """Row and column of every texel of a tile with its border, 4x4 after 4x4, as ray packets like it."""
    rows, columns = np.divmod(np.arange((TILE + 1) ** 2), TILE + 1)
    order = np.lexsort((columns, rows, columns // 4, rows // 4))
    return rows[order], columns[order]


def tile_texels(place: int, across: int, size: int) -> np.ndarray:
    """(n,) int32 flat texels of tile `place` of a square picture, `across` tiles and `size` texels wide.

    With the next row and column of texels: who looks up between four texels then needs the tile of the first one only.
    """
    rows, columns = _offsets()
    rows, columns = rows + place // across * TILE, columns + place % across * TILE
    inside = (rows < size) & (columns < size)
    return (rows[inside] * size + columns[inside]).astype(np.int32)


def touched_tiles(spheres: np.ndarray, views: Sequence[CameraView]) -> np.ndarray:
    """(k, 5) int64 rectangles of tiles that `spheres` (m, 4), centre and radius, fall into: number of the view among `views`, first
    and last row, first and last column. The views are square, as large, and all orthographic or none."""
    first = views[0]
    matrices = np.array([view.view_from_world() for view in views])
    centres = np.einsum("vij,mj->vmi", matrices[:, :3, :3], spheres[:, :3]) + matrices[:, None, :3, 3]
    ahead, radius = -centres[:, :, 2], np.broadcast_to(spheres[:, 3], centres.shape[:2])
    seen, bounds = ahead + radius > first.near, []
    for aside, half in ((-centres[:, :, 1], first.tan_half[1]), (centres[:, :, 0], first.tan_half[0])):
        ends = (aside - radius, aside + radius) if first.orthographic else _span(aside, ahead, radius)
        low, high = ((end / half * 0.5 + 0.5) * first.width for end in ends)
        seen &= (high > 0) & (low < first.width)
        # A texel more on both sides: look-ups reach for the next one.
        bounds += [np.clip(texel, 0, first.width - 1) // TILE for texel in (low - 1, high + 1)]
    view, sphere = np.nonzero(seen)
    return np.column_stack([view, *(bound[view, sphere] for bound in bounds)]).astype(np.int64)


def _span(aside: np.ndarray, ahead: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest tangent to the forward axis of circles at (aside, ahead); infinite where they reach beside the eye."""
    distance = np.hypot(aside, ahead)
    around = distance <= radius
    half = np.arcsin(np.where(around, 1.0, radius / np.maximum(distance, 1e-30)))
    middle = np.arctan2(aside, ahead)
    low, high = middle - half, middle + half
    quarter = np.pi / 2 - 1e-6
    return (
        np.where(around | (low <= -quarter), -np.inf, np.tan(np.clip(low, -quarter, quarter))),
        np.where(around | (high >= quarter), np.inf, np.tan(np.clip(high, -quarter, quarter))),
    )
