"""The selection graph: nodes by falling cost, pointers to more relevant nodes that cost no more."""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import Candidates
from phrt_heuristics.kernels import link_nodes, select_nodes
from phrt_heuristics.order import ordered


class Graph:
    """The candidates that are not mandatory, as nodes; node k is the k-th dearest (of equals the more relevant first).

    kept_pointers: how many pointers each node keeps from the beginning of the frame; None refreshes them at every selection.
    Selecting everything, one by one, takes O(n log n) (times the pointers kept): every node is passed once.
    """

    def __init__(self, candidates: Candidates, kept_pointers: int | None) -> None:
        mandatory = np.count_nonzero(candidates.mandatory)
        order = ordered(candidates, -candidates.relevance, -candidates.predicted_cost)[mandatory:]
        relevance = candidates.relevance[order]
        self._items = order
        self._cost = candidates.predicted_cost[order].astype(np.float64)
        self._traced = np.zeros(len(order), np.uint8)
        place = np.empty(len(candidates), np.int32)
        place[order] = np.arange(len(order), dtype=np.int32)
        # Of equals the dearer one, as in the order of the nodes.
        by_relevance = ordered(candidates, -candidates.predicted_cost, -candidates.relevance)[mandatory:]
        self._by_relevance = place[by_relevance]
        pointers = 0 if kept_pointers is None else min(kept_pointers, max(len(order), 1))
        self._pointers = np.full((len(order), pointers), -1, np.int32)
        if pointers:
            link_nodes(self._cost, relevance, self._pointers)
        # The head, before which nodes are traced or have moved to the graph of the next frame, and a place in `by_relevance`.
        self._state = np.zeros(2, np.int64)

    @property
    def moved(self) -> list[int]:
        """The items that moved to the graph of the next frame so far, in the order they moved."""
        head = int(self._state[0])
        return self._items[:head][self._traced[:head] == 0].tolist()

    def __len__(self) -> int:
        """Nodes that are left."""
        return int((self._traced[int(self._state[0]) :] == 0).sum())

    def take(self, remaining: float, enough: float) -> np.ndarray:
        """(k,) int32, the items of the nodes to trace next, taken out of the graph, until they cost `enough` together; at
        least one, unless nothing fits and all nodes have moved."""
        taken = np.empty(len(self._items), np.int64)
        count = select_nodes(
            self._cost,
            self._by_relevance,
            self._pointers,
            self._traced,
            self._state,
            remaining,
            max(enough, 1e-300),
            taken,
        )
        return self._items[taken[:count]]

    def select(self, remaining: float) -> int | None:
        """The item of the node to trace next, taken out of the graph; None when nothing fits, and all nodes have moved."""
        taken = self.take(remaining, 0.0)
        return int(taken[0]) if len(taken) else None

    def move_all(self) -> None:
        """Every node left goes to the graph of the next frame."""
        self._state[0] = len(self._items)
