"""greedy_relevance: the most relevant item that fits, whatever it costs.

Items are taken by falling relevance R; one that costs more than what is left is passed over. With refreshed pointers the
paper's selection graph chooses the same, so this is its yardstick, and the shortest way to write it.

Options: none.
Source: R of Andrade et al. 2014, eq. (3), without the graph.

Example::

    phrt render scenes/atrium.yaml -o atrium.png --heuristic greedy_relevance --budget 200000rays
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.registry import Options
from phrt_heuristics.queue import Queue


class GreedyRelevance(Heuristic):
    """By falling R; of equals the dearer one, as in the selection graph."""

    def __init__(self, options: Options) -> None:
        self._queue: Queue | None = None

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self._queue = Queue(candidates, -candidates.predicted_cost, -candidates.relevance)

    def next(self, remaining: float) -> int | None:
        return self._queue.next(remaining) if self._queue else None

    def take(self, remaining: float, enough: float) -> np.ndarray | None:
        return self._queue.take(remaining, enough) if self._queue else None
