"""Arrays that are used again from frame to frame, so that no frame pays for fresh pages."""

from __future__ import annotations

import sys

import numpy as np

_HELD_BY_POOL_ONLY = 3
"""References to an array that nobody uses: the pool's list, the loop variable, and getrefcount's argument."""


class BufferPool:
    """Hands out uninitialised arrays, and takes one back as soon as nobody refers to it or to a view of it any more.

    A frame that a caller keeps is therefore never overwritten. Not thread-safe: one thread takes.
    """

    def __init__(self) -> None:
        self._arrays: dict[tuple[tuple[int, ...], str], list[np.ndarray]] = {}

    def take(self, shape: tuple[int, ...], dtype: type[np.generic] = np.float32) -> np.ndarray:
        """An array of `shape` and `dtype` with arbitrary contents."""
        arrays = self._arrays.setdefault((shape, np.dtype(dtype).str), [])
        for array in arrays:
            if sys.getrefcount(array) <= _HELD_BY_POOL_ONLY:
                return array
        array = np.empty(shape, dtype)
        arrays.append(array)
        return array
