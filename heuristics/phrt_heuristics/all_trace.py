"""all_trace: trace everything.

Every item is traced, mandatory ones first, the others object by object. This is the picture that the scene's effects can
give at full price: the yardstick that every selecting heuristic is measured against.

Options: none.
Budget: with one, items are taken in the order of the scene's objects, those that fit: a selection without any thought.
Source: the all-ray-traced side of the comparisons in Andrade et al. 2014, section 5.

Example::

    phrt render scenes/atrium.yaml -o atrium.png --heuristic all_trace
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.registry import Options
from phrt_heuristics.queue import Queue


class AllTrace(Heuristic):
    """Yields every candidate once."""

    traces_everything = True

    def __init__(self, options: Options) -> None:
        self._queue: Queue | None = None

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self._queue = Queue(candidates)

    def next(self, remaining: float) -> int | None:
        return self._queue.next(remaining) if self._queue else None

    def take(self, remaining: float, enough: float) -> np.ndarray | None:
        return self._queue.take(remaining, enough) if self._queue else None
