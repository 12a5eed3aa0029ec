"""A pool of threads that run kernels: everything they call releases the GIL."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def usable_cores() -> int:
    """How many processors this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class Workers:
    """`threads` threads; with one, everything runs in the caller's own."""

    def __init__(self, threads: int | None = None) -> None:
        self.threads = max(1, threads or usable_cores())
        self._pool = ThreadPoolExecutor(self.threads, thread_name_prefix="phrt") if self.threads > 1 else None

    def map(self, function: Callable[[T], R], items: Iterable[T]) -> list[R]:
        """`function` of every item, in order; waits for all. The first exception is raised."""
        if self._pool is None:
            return [function(item) for item in items]
        return list(self._pool.map(function, items))

    def close(self) -> None:
        if self._pool is not None:
            self._pool.shutdown()


def chunks(count: int, size: int, parts: int = 1) -> Sequence[slice]:
    """0..count cut into slices of about `size`, their number a multiple of `parts` so that threads end together."""
    if count == 0:
        return []
    pieces = max(1, -(-count // size))
    pieces = min(-(-pieces // parts) * parts, count)
    edges = [count * k // pieces for k in range(pieces + 1)]
    return [slice(a, b) for a, b in pairwise(edges)]
