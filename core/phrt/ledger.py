"""Ledger: what was traced of every work item in one frame, which pixels those are, and what it took."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from phrt.candidates import WorkItems
from phrt.frame import Decisions
from phrt.interfaces.heuristic import PASSES, Outcome, Request
from phrt.kernels.layers import interleaved


@dataclass(frozen=True)
class Part:
    """Passes first..last - 1 of an item."""

    item: int
    first: int
    last: int


class Ledger:
    """What has been traced of every item in this frame, and what it took."""

    def __init__(self, work: WorkItems) -> None:
        count = len(work.candidates)
        self._work = work
        self.passes = np.zeros(count, np.int32)
        self.pixels = np.zeros(count, np.int64)
        self.rays = np.zeros(count, np.int64)
        self.milliseconds = np.zeros(count, np.float64)

    def accept(self, request: Request) -> Part | None:
        """The part a request stands for, noted as traced; None where there is no such item or nothing left of it."""
        if not 0 <= request.item < len(self.passes) or request.passes < 1 or self.passes[request.item] >= PASSES:
            return None
        first = int(self.passes[request.item])
        last = min(first + request.passes, PASSES)
        self.passes[request.item] = last
        return Part(request.item, first, last)

    def withdraw(self, part: Part) -> None:
        """`part`, the last that was accepted of its item, will not be traced."""
        self.passes[part.item] = part.first

    def discard(self, items: np.ndarray) -> None:
        """What was traced of `items` (n,) bool does not count."""
        self.passes[items] = 0
        self.pixels[items] = 0

    def predicted(self, part: Part) -> float:
        """What the candidates say that tracing `part` will take, in the budget's unit."""
        return float(self._work.candidates.predicted_cost[part.item]) * (part.last - part.first) / PASSES

    def share_out(self, parts: list[Part], pixels: int, rays: int, milliseconds: float) -> None:
        """Book what tracing `parts` (`pixels` in all) together took, by their pixels."""
        sizes = np.array([self._work.candidates.pixel_count[p.item] * (p.last - p.first) / PASSES for p in parts])
        for part, share in zip(parts, sizes / sizes.sum(), strict=True):
            self.pixels[part.item] += round(pixels * share)
            self.rays[part.item] += round(rays * share)
            self.milliseconds[part.item] += milliseconds * share

    def outcome(self, part: Part) -> Outcome:
        """What is known of the item of `part` by now."""
        item = part.item
        return Outcome(
            pixels=int(self.pixels[item]),
            rays=int(self.rays[item]),
            milliseconds=float(self.milliseconds[item]),
            complete=bool(self.passes[item] == PASSES),
        )

    def decisions(self, budget: float) -> Decisions:
        """The frame's account, when it is finished."""
        return Decisions(
            candidates=self._work.candidates,
            chosen=self.passes > 0,
            passes=self.passes,
            traced_pixels=self.pixels,
            rays=self.rays,
            milliseconds=self.milliseconds,
            budget=budget,
            measured=math.isfinite(budget),
        )


def over_samples(decisions: Sequence[Decisions]) -> Decisions:
    """The last of several sub-pixel samples' decisions, with the rays and milliseconds its items took in all of them.

    Samples see slightly different pixels; an item that the last one does not see is left out.
    """
    last = decisions[-1]
    if len(decisions) == 1:
        return last
    order = np.argsort(_keys(last))
    keys = _keys(last)[order]
    rays, milliseconds = last.rays.copy(), last.milliseconds.copy()
    for earlier in decisions[:-1]:
        theirs = _keys(earlier)
        place = np.searchsorted(keys, theirs)
        seen = np.isin(theirs, keys)
        rows = order[place[seen]]
        rays[rows] += earlier.rays[seen]
        milliseconds[rows] += earlier.milliseconds[seen]
    return replace(last, rays=rays, milliseconds=milliseconds)


def _keys(decisions: Decisions) -> np.ndarray:
    """(n,) int64, one number for each object and effect."""
    candidates = decisions.candidates
    return candidates.object_id.astype(np.int64) * len(candidates.effect_names) + candidates.effect


def pixel_runs(work: WorkItems, parts: list[Part], width: int) -> list[np.ndarray]:
    """The pixels of `parts` (of one effect) as few runs: whole items merged, the interleaved pixels of the others in one."""
    whole = np.array([part.item for part in parts if part.last - part.first == PASSES], np.int64)
    runs = merged(work, whole)
    pieces = []
    for part in parts:
        if part.last - part.first < PASSES:
            (pixels,) = merged(work, np.array([part.item]))
            out = np.empty(len(pixels), np.int32)
            pieces.append(out[: interleaved(pixels, width, part.first, part.last, out)])
    return [*runs, np.concatenate(pieces)] if pieces else runs


def merged(work: WorkItems, items: np.ndarray) -> list[np.ndarray]:
    """The pixels of `items` (of one effect) as few runs: items that lie next to each other in the sorted pixels become one."""
    if len(items) == 0:
        return []
    pixels = work.pixels[int(work.candidates.effect[items[0]])]
    items = items[np.argsort(work.first[items])]
    first = work.first[items]
    end = first + work.candidates.pixel_count[items]
    breaks = np.flatnonzero(first[1:] != end[:-1]) + 1
    starts = first[np.concatenate([[0], breaks])]
    ends = end[np.concatenate([breaks - 1, [len(items) - 1]])]
    return [pixels[a:b] for a, b in zip(starts, ends, strict=True)]
