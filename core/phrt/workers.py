"""A pool of threads that run kernels: everything they call releases the GIL."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from itertools import pairwise
from typing import TypeVar

T = TypeVar("T")
R = TypeVar("R")


def usable_cores() -> int:
    """How many processors this process may run on."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


_on_a_worker = threading.local()


class Workers:
    """`threads` threads; with one, everything runs in the caller's own. What a worker maps runs in that worker."""

    def __init__(self, threads: int | None = None) -> None:
        self.threads = max(1, threads or usable_cores())
        self._pool = ThreadPoolExecutor(self.threads, thread_name_prefix="phrt") if self.threads > 1 else None

    def map(self, function: Callable[[T], R], items: Iterable[T]) -> list[R]:
        """`function` of every item, in order. When one raises, the first such exception is raised after all have ended."""
        if self._pool is None or getattr(_on_a_worker, "yes", False):
            return [function(item) for item in items]

        def work(item: T) -> R:
            _on_a_worker.yes = True
            return function(item)

        futures = [self._pool.submit(work, item) for item in items]
        wait(futures)
        return [future.result() for future in futures]

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
