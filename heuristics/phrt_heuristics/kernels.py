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


@kernel
def take_fitting(cost, place, remaining, enough, taken):
    """Walk on from place[0] through items of `cost` (n,) float64, taking each that fits what then remains, until those taken
    cost `enough` together. taken (n,) int64 gets their places; place[0] moves on. Returns how many were taken.
    """
    count, planned, k = 0, 0.0, place[0]
    while k < len(cost) and planned < enough:
        if cost[k] <= remaining - planned:
            planned += cost[k]
            taken[count] = k
            count += 1
        k += 1
    place[0] = k
    return count


@kernel
def take_passing(cost, number, line, state, remaining, enough, taken):
    """Pass `number` of a line of items, whose passes cost (n, PASSES) float64, as `take_fitting`; those that fit stay in the line
    for the next pass.

    line (n,) int64: the first state[0] entries are in the line; state[1]: the place it is at; state[2]: how many were kept.
    Returns how many were taken.
    """
    count, planned = 0, 0.0
    while state[1] < state[0] and planned < enough:
        item = line[state[1]]
        state[1] += 1
        if cost[item, number] <= remaining - planned:
            planned += cost[item, number]
            taken[count] = item
            count += 1
            line[state[2]] = item
            state[2] += 1
    return count


@kernel
def select_nodes(cost, by_relevance, pointers, traced, state, remaining, enough, taken):
    """Selections in the paper's graph, one after the other, until those selected cost `enough` together or none fits.

    Nodes are in order of falling `cost` (n,) float64. From the head (state[0]) walk to the first node that is left and fits;
    from there follow the pointers (n, N) int32, each to the first node that is still there, until there is none. With N = 0
    they are fresh: then the first one of every node leads to the most relevant node left, which is the first in
    `by_relevance` (n,) int32 from place state[1] on that is not before the head.
    traced (n,) uint8, state (2,) int64 are carried from call to call; taken (n,) int64 gets the nodes. Returns how many.
    """
    count, planned, nodes = 0, 0.0, len(cost)
    while planned < enough:
        head = state[0]
        while head < nodes and (traced[head] or cost[head] > remaining - planned):
            head += 1
        state[0] = head
        if head == nodes:
            break
        node = head
        if pointers.shape[1] == 0:
            place = state[1]
            while by_relevance[place] < head or traced[by_relevance[place]]:
                place += 1
            state[1] = place
            node = by_relevance[place]
        else:
            better = node
            while better >= 0:
                node, better = better, -1
                for k in range(pointers.shape[1]):
                    pointer = pointers[node, k]
                    if pointer >= 0 and not traced[pointer]:
                        better = pointer
                        break
        traced[node] = 1
        planned += cost[node]
        taken[count] = node
        count += 1
    return count
