"""uniform: a little of everything.

Every item gets one of its passes (one pixel of each 2x2 block) before any gets a second one, and so on: all effects are there at
the same lower density. Of items that hold values of earlier frames the first pass is what is missing. Mandatory items are
traced whole, first. Where the budget ends within a pass, the more relevant items have it.

Options: none.
Source: levels of detail under a budget, Funkhouser and Sequin 1993, with all objects at the same level.

Example::

    phrt render scenes/atrium.yaml -o atrium.png --heuristic uniform --budget 200000rays
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import PASSES, Candidates, FrameContext, Heuristic, Request
from phrt.registry import Options
from phrt_heuristics.kernels import take_passing
from phrt_heuristics.order import ordered
from phrt_heuristics.queue import Queue


class Uniform(Heuristic):
    """Pass by pass over all items; one whose pass did not fit gets no later one."""

    def __init__(self, options: Options) -> None:
        self._mandatory: Queue | None = None
        self._line = np.zeros(0, np.int64)
        self._state = np.zeros(3, np.int64)
        self._passes = 0
        self._pass_cost = np.zeros((0, PASSES))

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self._mandatory = Queue(candidates, -candidates.relevance, mandatory_only=True)
        mandatory = np.count_nonzero(candidates.mandatory)
        self._line = ordered(candidates, -candidates.relevance)[mandatory:].astype(np.int64)
        # In the line, the place it is at, and how many of those so far keep their place in the next pass.
        self._state = np.array([len(self._line), 0, 0])
        self._passes = 0
        self._pass_cost = candidates.predicted_cost.astype(np.float64)[:, None] * candidates.pass_shares()

    def next(self, remaining: float) -> Request | None:
        taken = self.take(remaining, 0.0)
        return Request(int(taken[0, 0]), int(taken[0, 1])) if len(taken) else None

    def take(self, remaining: float, enough: float) -> np.ndarray:
        if self._mandatory is not None:
            if len(items := self._mandatory.take(remaining, enough)):
                return np.stack([items, np.full_like(items, PASSES)], axis=1)
            self._mandatory = None
        taken = np.empty(len(self._line), np.int64)
        while self._passes < PASSES:
            count = take_passing(
                self._pass_cost, self._passes, self._line, self._state, remaining, max(enough, 1e-300), taken
            )
            if count:
                answer = np.ones((count, 2), np.int64)
                answer[:, 0] = taken[:count]
                return answer
            # The next pass is of those that had this one.
            self._state[:] = self._state[2], 0, 0
            self._passes += 1
        return np.zeros((0, 2), np.int64)
