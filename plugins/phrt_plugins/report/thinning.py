"""Many frames in few marks: what a figure of ten thousand frames shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

COLUMNS = 600
"""Of a time line: about the pixels that it is wide."""


@dataclass(frozen=True)
class Band:
    """A series in at most COLUMNS bins. frame (b,): the first of the bin; low, middle, high (b,): of its values; size: frames of a
    bin."""

    frame: np.ndarray
    low: np.ndarray
    middle: np.ndarray
    high: np.ndarray
    size: int


def bin_size(count: int, columns: int = COLUMNS) -> int:
    """How many of `count` frames share a column."""
    return max(1, -(-count // columns))


def band(frames: np.ndarray, values: np.ndarray, size: int | None = None) -> Band:
    """Lowest, median and highest of every `size` frames (default: as many as leave at most COLUMNS bins). frames, values: (n,), in
    order; NaN are left out, a bin of nothing else is NaN."""
    size = size or bin_size(len(frames))
    if size == 1:
        return Band(frames, values, values, values, 1)
    bins = -(-len(frames) // size)
    filled = np.full(bins * size, np.nan)
    filled[: len(values)] = values
    rows = filled.reshape(bins, size)
    empty = np.isnan(rows).all(axis=1)
    rows[empty, 0] = 0.0
    low, middle, high = np.nanmin(rows, axis=1), np.nanmedian(rows, axis=1), np.nanmax(rows, axis=1)
    for each in (low, middle, high):
        each[empty] = np.nan
    return Band(frames[::size], low, middle, high, size)


def spread(count: int, most: int) -> np.ndarray:
    """At most `most` of `count` rows, evenly: (k,) int64, first and last among them."""
    if count <= most:
        return np.arange(count)
    return np.unique(np.linspace(0, count - 1, most).round().astype(np.int64))


def pareto(cost: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Rows (k,) of the front, by rising cost: no other point is as good in both and better in one. NaN are never on it."""
    front, best = [], np.inf
    for row in np.lexsort([error, cost]):
        if error[row] < best and np.isfinite(cost[row]):
            front.append(int(row))
            best = error[row]
    return np.array(front, np.int64)
