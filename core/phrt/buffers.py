"""Arrays that are used again from frame to frame, so that no frame pays for fresh pages."""

from __future__ import annotations

import sys

import numpy as np

_HELD_BY_POOL_ONLY = 3
"""References to an array that nobody uses: the pool's list, the loop variable, and getrefcount's argument."""


_STAGGER = 1088
"""Bytes by which one array after the other is moved along: 17 cache lines. Arrays that all begin on a page begin in the
same sets of the cache, and a kernel that writes a row of fifteen of them has each throw the others out."""

_HUGE_PAGES_FROM = 1 << 20
_HUGE_PAGES_TAKE = 1 << 22
"""numpy asks for huge pages for 4 MiB and more; arrays from 1 MiB are made that large (address space, not memory)."""


class BufferPool:
    """Hands out uninitialised arrays, and takes one back as soon as nobody refers to it or to a view of it any more.

    A frame that a caller keeps is therefore never overwritten. Not thread-safe: one thread takes.
    """

    def __init__(self) -> None:
        self._blocks: dict[tuple[tuple[int, ...], str], list[np.ndarray]] = {}
        self._offset: dict[int, int] = {}

    def take(self, shape: tuple[int, ...], dtype: type[np.generic] = np.float32) -> np.ndarray:
        """A C-contiguous array of `shape` and `dtype` with arbitrary contents."""
        blocks = self._blocks.setdefault((shape, np.dtype(dtype).str), [])
        needed = int(np.prod(shape)) * np.dtype(dtype).itemsize
        for block in blocks:
            # Every array made of a block, and every view of one, has the block as its base.
            if sys.getrefcount(block) <= _HELD_BY_POOL_ONLY:
                break
        else:
            offset = _STAGGER * (len(self._offset) % 16)
            size = needed + offset
            block = np.empty(max(size, _HUGE_PAGES_TAKE) if needed >= _HUGE_PAGES_FROM else size, np.uint8)
            self._offset[id(block)] = offset
            blocks.append(block)
        first = self._offset[id(block)]
        return block[first : first + needed].view(dtype).reshape(shape)
