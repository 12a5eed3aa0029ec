"""uniform: a little of everything.

Every item gets one of its interleaved passes (one pixel of each 2x2 block) before any gets a second one, and so on: all
effects are there at the same lower density. Mandatory items are traced whole, first. Where the budget ends within a pass, the
more relevant items have it.

Options: none.
Source: levels of detail under a budget, Funkhouser and Sequin 1993, with all objects at the same level.

Example::

    phrt render scenes/atrium.yaml -o atrium.png --heuristic uniform --budget 200000rays
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import PASSES, Candidates, FrameContext, Heuristic, Request
from phrt.registry import Options
from phrt_heuristics.queue import Queue


class Uniform(Heuristic):
    """Pass by pass over all items; one whose pass did not fit gets no later one."""

    def __init__(self, options: Options) -> None:
        self._mandatory: Queue | None = None
        self._line: list[int] = []
        self._place = 0
        self._passed: list[int] = []
        self._passes = 0
        self._pass_cost: list[float] = []
        self._requests: list[Request] = []

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self._mandatory = Queue(candidates, -candidates.relevance, mandatory_only=True)
        others = np.flatnonzero(~candidates.mandatory)
        by = (candidates.keys()[others], -candidates.relevance[others])
        self._line = others[np.lexsort(by)].tolist()
        self._place, self._passed, self._passes = 0, [], 0
        self._pass_cost = (candidates.predicted_cost.astype(np.float64) / PASSES).tolist()
        self._requests += [Request(item, 1) for item in range(len(self._requests), len(candidates))]

    def next(self, remaining: float) -> int | Request | None:
        if self._mandatory is not None:
            if (whole := self._mandatory.next(remaining)) is not None:
                return whole
            self._mandatory = None
        while self._line and self._passes < PASSES:
            while self._place < len(self._line):
                item = self._line[self._place]
                self._place += 1
                if self._pass_cost[item] <= remaining:
                    self._passed.append(item)
                    return self._requests[item]
            # The next pass is of those that had this one.
            self._line, self._place, self._passed = self._passed, 0, []
            self._passes += 1
        return None
