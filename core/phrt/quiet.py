"""Quiet: no garbage collection while a frame is made."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def garbage_waits() -> Iterator[None]:
    """Python's cycle collector waits until the block ends: a collection of a large heap takes longer than a wave. What is no
    cycle is freed at once all the same. Where it was off before, it stays off.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
