"""Queue: items in an order of preference, of which the first that fits is taken."""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import Candidates
from phrt_heuristics.kernels import take_fitting
from phrt_heuristics.order import ordered


class Queue:
    """Mandatory items, then the others (unless `mandatory_only`); within both by `order_by`, see `ordered`.

    An item that does not fit when its turn has come is passed over for the frame, so that all calls of a frame together look
    at every item once.
    """

    def __init__(self, candidates: Candidates, *order_by: np.ndarray, mandatory_only: bool = False) -> None:
        first = int(np.count_nonzero(candidates.mandatory)) if mandatory_only else len(candidates)
        self._items = ordered(candidates, *order_by)[:first] if first else np.zeros(0, np.int32)
        self._costs = candidates.predicted_cost[self._items].astype(np.float64)
        self._place = np.zeros(1, np.int64)

    def next(self, remaining: float) -> int | None:
        """The first item in order that costs no more than `remaining`."""
        taken = self.take(remaining, 0.0)
        return int(taken[0]) if len(taken) else None

    def take(self, remaining: float, enough: float) -> np.ndarray:
        """(k,) int32, the first items in order that fit one after the other, until they cost `enough` together; at least one,
        if there is one."""
        taken = np.empty(len(self._items) - int(self._place[0]), np.int64)
        count = take_fitting(self._costs, self._place, remaining, max(enough, 1e-300), taken)
        return self._items[taken[:count]]
