"""Queue: items in an order of preference, of which the first that fits is taken."""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import Candidates


class Queue:
    """Mandatory items, then the others (unless `mandatory_only`); within both by `order_by`, the last array counting most as
    in `np.lexsort`.

    order_by: arrays (n,), smallest first; ties are broken by `Candidates.keys`. An item that does not fit when its turn has
    come is passed over for the frame, so that all calls of a frame together look at every item once.
    """

    def __init__(self, candidates: Candidates, *order_by: np.ndarray, mandatory_only: bool = False) -> None:
        kept = np.flatnonzero(candidates.mandatory) if mandatory_only else np.arange(len(candidates))
        by = (candidates.keys(), *order_by, ~candidates.mandatory)
        order = kept[np.lexsort([values[kept] for values in by])]
        self._items: list[int] = order.tolist()
        self._costs: list[float] = candidates.predicted_cost[order].astype(np.float64).tolist()
        self._place = 0

    def next(self, remaining: float) -> int | None:
        """The first item in order that costs no more than `remaining`."""
        while self._place < len(self._items):
            place = self._place
            self._place += 1
            if self._costs[place] <= remaining:
                return self._items[place]
        return None
