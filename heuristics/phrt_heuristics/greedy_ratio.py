"""greedy_ratio: the most relevance for the price.

Items are taken by falling relevance / predicted cost; one that costs more than what is left is passed over. This is the classic
greedy rule for a knapsack, near the optimum of the sum of R where items are small against the budget.

The cost is what the item is predicted to take, in the budget's unit, and not the paper's C = V Q: with C the visibility
cancels, R / C = K / Q, and every object would be worth the same.

Options: none.
Source: Funkhouser and Sequin 1993, section 4: benefit / cost, with R of Andrade et al. 2014, eq. (3), as the benefit.

Example::

    phrt render scenes/atrium.yaml -o atrium.png --heuristic greedy_ratio --budget 200000rays
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.registry import Options
from phrt_heuristics.queue import Queue


class GreedyRatio(Heuristic):
    """By falling R / predicted cost; of equals the dearer one."""

    def __init__(self, options: Options) -> None:
        self._queue: Queue | None = None

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        price = candidates.predicted_cost.astype(np.float64)
        self._queue = Queue(candidates, -price, -(candidates.relevance / price))

    def next(self, remaining: float) -> int | None:
        return self._queue.next(remaining) if self._queue else None

    def take(self, remaining: float, enough: float) -> np.ndarray | None:
        return self._queue.take(remaining, enough) if self._queue else None
