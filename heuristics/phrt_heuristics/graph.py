"""The selection graph: nodes by falling cost, pointers to more relevant nodes that cost no more."""

from __future__ import annotations

from bisect import bisect_left

import numpy as np

from phrt.interfaces.heuristic import Candidates


class Graph:
    """The candidates that are not mandatory, as nodes; node k is the k-th dearest (of equals the more relevant first).

    kept_pointers: how many pointers each node keeps from the beginning of the frame; None refreshes them at every selection.
    Selecting everything, one by one, takes O(n log n) (times the pointers kept): every node is passed once.
    """

    def __init__(self, candidates: Candidates, kept_pointers: int | None) -> None:
        free = np.flatnonzero(~candidates.mandatory)
        falling = (candidates.keys(), -candidates.relevance, -candidates.predicted_cost)
        order = free[np.lexsort([values[free] for values in falling])]
        cost, relevance = candidates.predicted_cost[order].astype(np.float64), candidates.relevance[order]
        self._items: list[int] = order.tolist()
        self._rising: list[float] = (-cost).tolist()
        self._traced = bytearray(len(order))
        # Nodes before the head are traced, or have moved to the graph of the next frame.
        self._head = 0
        # With fresh pointers the first one of every node leads to the most relevant node left, and no further.
        self._by_relevance: list[int] = np.argsort(-relevance, kind="stable").tolist()
        self._most_relevant = 0
        self._pointers = None if kept_pointers is None else _linked(cost, relevance, kept_pointers)

    @property
    def moved(self) -> list[int]:
        """The items that moved to the graph of the next frame so far, in the order they moved."""
        return [self._items[node] for node in range(self._head) if not self._traced[node]]

    def select(self, remaining: float) -> int | None:
        """The item of the node to trace next, taken out of the graph; None when nothing fits, and all nodes have moved."""
        head, traced = self._head, self._traced
        # From the head to the first node that is left and fits; dearer ones move.
        if head < len(traced) and -self._rising[head] > remaining:
            head = bisect_left(self._rising, -remaining, lo=head)
        while head < len(traced) and traced[head]:
            head += 1
        self._head = head
        if head == len(traced):
            return None
        node = self._follow_fresh(head) if self._pointers is None else self._follow_kept(self._pointers, head)
        traced[node] = True
        return self._items[node]

    def move_all(self) -> None:
        """Every node left goes to the graph of the next frame."""
        self._head = len(self._items)

    def _follow_fresh(self, head: int) -> int:
        """The most relevant node left: none is dearer than the head."""
        place, by_relevance, traced = self._most_relevant, self._by_relevance, self._traced
        while (node := by_relevance[place]) < head or traced[node]:
            place += 1
        self._most_relevant = place
        return node

    def _follow_kept(self, pointers: list[list[int]], node: int) -> int:
        """From `node` along the first pointer to a node that is still there, until there is none."""
        better = node
        while better >= 0:
            node, better = better, -1
            for pointer in pointers[node]:
                if pointer >= 0 and not self._traced[pointer]:
                    better = pointer
                    break
        return node


def _linked(cost: np.ndarray, relevance: np.ndarray, count: int) -> list[list[int]]:
    """Every node's pointers, most relevant first, -1 where there are fewer than `count`."""
    from phrt_heuristics.kernels import link_nodes

    pointers = np.full((len(cost), min(count, max(len(cost), 1))), -1, np.int32)
    link_nodes(cost, relevance, pointers)
    return pointers.tolist()
