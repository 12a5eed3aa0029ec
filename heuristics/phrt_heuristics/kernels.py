"""Kernels of heuristics: what must not be a Python loop over candidates."""

from __future__ import annotations

import numpy as np

from phrt.kernels.jit import kernel


@kernel
def link_nodes(cost, relevance, pointers):
    """pointers (n, N) int32: of every node the N most relevant ones that cost no more and are more relevant, most relevant
    first; entries that are not needed stay as they are. cost (n,) float64 falling, relevance (n,) float32.
    """
    count = pointers.shape[1]
    best = np.empty(count, np.int32)
    known = 0
    end = len(cost)
    while end > 0:
        # Nodes of equal cost see each other: all of them join the best first.
        start = end - 1
        while start > 0 and cost[start - 1] == cost[end - 1]:
            start -= 1
        for node in range(end - 1, start - 1, -1):
            place = 0
            while place < known and relevance[best[place]] > relevance[node]:
                place += 1
            if place < count:
                known = min(known + 1, count)
                for k in range(known - 1, place, -1):
                    best[k] = best[k - 1]
                best[place] = node
        for node in range(start, end):
            for k in range(known):
                if relevance[best[k]] <= relevance[node]:
                    break
                pointers[node, k] = best[k]
        end = start
