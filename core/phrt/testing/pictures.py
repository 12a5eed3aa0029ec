"""A picture made by hand, for heuristics that look at what was rasterized."""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import RasterPicture


class StripedPicture(RasterPicture):
    """Objects 1 to `objects` side by side, upright stripes of equal width, each with a colour of its own.

    colors: (objects, 3) float32, linear; by default any, the same every time.
    """

    def __init__(self, objects: int, colors: np.ndarray | None = None) -> None:
        self._objects = objects
        self._colors = np.random.default_rng(7).random((objects, 3), np.float32) if colors is None else colors

    def picture(self, width: int) -> np.ndarray:
        made = np.tile(self._colors[self._stripe(width)], (max(1, round(width * 9 / 16)), 1, 1))
        made.flags.writeable = False
        return made

    def object_means(self, values: np.ndarray) -> np.ndarray:
        stripe = self._stripe(values.shape[1])
        counts = np.bincount(stripe, minlength=self._objects)
        sums = np.bincount(stripe, weights=values.mean(axis=0), minlength=self._objects)
        return np.concatenate([[0.0], sums / np.maximum(counts, 1)]).astype(np.float32)

    def _stripe(self, width: int) -> np.ndarray:
        """(width,) int64, in which stripe every column is."""
        return np.arange(width) * self._objects // width
