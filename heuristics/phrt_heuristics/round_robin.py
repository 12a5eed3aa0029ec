"""round_robin: everybody in turn.

The item that has waited longest is next; one that costs more than what is left is passed over and keeps its place in the
line. Over some frames every item that fits into the budget is traced equally often, so every object flickers equally.

Options: none.
Source: the round-robin rule of schedulers, Kleinrock 1964.

Example::

    phrt render scenes/atrium.yaml -o walk.mp4 --heuristic round_robin --budget 200000rays
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.registry import Options
from phrt_heuristics.queue import Queue


class RoundRobin(Heuristic):
    """By the turn in which an item was last traced, the longest ago first."""

    def __init__(self, options: Options) -> None:
        self._queue: Queue | None = None
        self._turn = 0
        self._last_traced = np.zeros(0, np.int64)
        self._keys = np.zeros(0, np.int64)

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self._keys = candidates.keys()
        missing = int(self._keys.max(initial=-1)) + 1 - len(self._last_traced)
        self._last_traced = np.pad(self._last_traced, (0, max(missing, 0)))
        self._queue = Queue(candidates, self._last_traced[self._keys])

    def next(self, remaining: float) -> int | None:
        taken = self.take(remaining, 0.0)
        return int(taken[0]) if len(taken) else None

    def take(self, remaining: float, enough: float) -> np.ndarray:
        if self._queue is None:
            return np.zeros(0, np.int32)
        items = self._queue.take(remaining, enough)
        self._last_traced[self._keys[items]] = np.arange(self._turn + 1, self._turn + 1 + len(items))
        self._turn += len(items)
        return items
