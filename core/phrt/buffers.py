"""Arrays that are used again from frame to frame, so that no frame pays for fresh pages."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

import numpy as np

_HELD_BY_POOL_ONLY = 2
"""References to memory that nobody uses: its block, and getrefcount's argument."""


_STAGGER = 1088
"""Bytes by which one array after the other is moved along: 17 cache lines. Arrays that all begin on a page begin in the
same sets of the cache, and a kernel that writes a row of fifteen of them has each throw the others out."""

_HUGE_PAGES_FROM = 1 << 20
_HUGE_PAGES_TAKE = 1 << 22
"""numpy asks for huge pages for 4 MiB and more; arrays from 1 MiB are made that large (address space, not memory)."""


_KEPT_FOR_TAKES = 256
"""A block that was not handed out in this many takes of any shape, some ten frames, is given back to the system."""


@dataclass(slots=True)
class _Block:
    """memory: bytes; the array handed out begins at `first`. used: number of the take it was last handed out in."""

    memory: np.ndarray
    first: int
    used: int

    def is_free(self) -> bool:
        # Every array made of a block, and every view of one, has the block's memory as its base.
        return sys.getrefcount(self.memory) <= _HELD_BY_POOL_ONLY


class BufferPool:
    """Hands out uninitialised arrays, and takes one back as soon as nobody refers to it or to a view of it any more.

    A frame that a caller keeps is therefore never overwritten; what a caller once kept and let go is given back to the
    system after a while. Not thread-safe: one thread takes.
    """

    def __init__(self) -> None:
        self._blocks: dict[tuple[tuple[int, ...], str], list[_Block]] = {}
        self._takes = 0
        self._made = 0

    def take(self, shape: tuple[int, ...], dtype: type[np.generic] = np.float32) -> np.ndarray:
        """A C-contiguous array of `shape` and `dtype` with arbitrary contents."""
        self._takes += 1
        if self._takes % _KEPT_FOR_TAKES == 0:
            self._give_back()
        blocks = self._blocks.setdefault((shape, np.dtype(dtype).str), [])
        needed = math.prod(shape) * np.dtype(dtype).itemsize
        block = next((block for block in blocks if block.is_free()), None)
        if block is None:
            block = self._make(needed)
            blocks.append(block)
        block.used = self._takes
        return block.memory[block.first : block.first + needed].view(dtype).reshape(shape)

    def _make(self, needed: int) -> _Block:
        first = _STAGGER * (self._made % 16)
        self._made += 1
        size = needed + first
        memory = np.empty(max(size, _HUGE_PAGES_TAKE) if needed >= _HUGE_PAGES_FROM else size, np.uint8)
        return _Block(memory, first, self._takes)

    def _give_back(self) -> None:
        """Drop the free blocks that were not needed lately. The first free one is always taken, so surplus ones go unused."""
        oldest = self._takes - _KEPT_FOR_TAKES
        for key, blocks in list(self._blocks.items()):
            kept = [block for block in blocks if block.used > oldest or not block.is_free()]
            if kept:
                self._blocks[key] = kept
            else:
                del self._blocks[key]
