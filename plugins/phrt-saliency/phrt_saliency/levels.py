"""Levels: items traced at a density that grows with what they are worth, and not whole or not at all."""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import PASSES, Candidates, Request
from phrt_heuristics.queue import Queue
from phrt_saliency.kernels import take_steps

STEPS = np.array([1, 1, 2])
"""Passes of each step of an item,"""
SMALL_PIXELS = 64
"""but one with fewer pixels has a single step: parts of it would not be worth the trouble of asking."""

ERROR_LEFT = np.array([1.0, 0.42, 0.25, 0.0])
"""Share of an item's error that filled gaps leave after each step: what a straight edge leaves, as the heuristic `gain` has it."""
STALE = 0.1
"""Where a value of an earlier frame stands in, the error is taken to be this share of what it is without one."""


class Levels:
    """Mandatory items whole, then steps of the others by falling worth taken per predicted cost.

    A step's worth is the item's times the error that it takes away. A step that does not fit is passed over with those that
    follow it of the same item.
    """

    def __init__(self, candidates: Candidates, worth: np.ndarray) -> None:
        self._mandatory: Queue | None = Queue(candidates, -worth, mandatory_only=True)
        item, passes, cost, value = steps_of(candidates, worth)
        order = falling(value)
        self._item, self._passes, self._cost = item[order], passes[order], cost[order]
        # By item: was a step of it passed over, and in which answer was it last named?
        self._over, self._named = np.zeros(len(candidates), np.uint8), np.zeros(len(candidates), np.int64)
        self._state = np.zeros(2, np.int64)

    def next(self, remaining: float) -> Request | None:
        """The next step that costs no more than `remaining`."""
        taken = self.take(remaining, 0.0)
        return Request(int(taken[0, 0]), int(taken[0, 1])) if len(taken) else None

    def take(self, remaining: float, enough: float) -> np.ndarray:
        """(k, 2) int64 items and passes, the next steps that fit one after the other, until they cost `enough` together, or an item
        would come twice."""
        if self._mandatory is not None:
            if len(items := self._mandatory.take(remaining, enough)):
                return np.stack([items, np.full_like(items, PASSES)], axis=1).astype(np.int64)
            self._mandatory = None
        taken = np.empty((len(self._over), 2), np.int64)
        count = take_steps(
            self._item, self._passes, self._cost, self._over, self._named, self._state, remaining, max(enough, 1e-300), taken
        )  # fmt: skip
        return taken[:count]


def steps_of(candidates: Candidates, worth: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The steps of all items that are not mandatory, item by item in the order of their keys: item, passes (m,) int64, predicted
    cost (m,) float64, and worth per cost (m,) float64, which never rises within an item."""
    rows = np.argsort(candidates.keys(), kind="stable")
    rows = rows[~candidates.mandatory[rows]]
    shares = np.cumsum(candidates.pass_shares()[rows].astype(np.float64), axis=1)
    ends = shares[:, np.cumsum(STEPS) - 1]
    cost = np.diff(ends, axis=1, prepend=0.0) * candidates.predicted_cost[rows, None]
    error = errors_left(candidates.history_share[rows].astype(np.float64), ends)
    value = -np.diff(error, axis=1) * worth[rows, None] / np.maximum(cost, 1e-9)
    value = np.maximum.accumulate(value[:, ::-1], axis=1)[:, ::-1]
    passes = np.tile(STEPS, (len(rows), 1))
    small = candidates.pixel_count[rows] < SMALL_PIXELS
    passes[small] = PASSES, 0, 0
    cost[small, 0] = candidates.predicted_cost[rows[small]]
    value[small, 0] = error[small, 0] * worth[rows[small]] / cost[small, 0]
    kept = passes > 0
    return np.repeat(rows, kept.sum(axis=1)), passes[kept], cost[kept], value[kept]


def falling(value: np.ndarray) -> np.ndarray:
    """(m,) int64 places by falling value (m,) of 0 and more, of equals the earlier one first: a stable sort in half of the time.

    Bits of floats count up with their size; with the place they make one number of 64 bits, and such numbers sort fast.
    """
    bits = value.astype(np.float32).view(np.uint32)
    numbers = (~bits).astype(np.uint64) << np.uint64(32) | np.arange(len(value), dtype=np.uint64)
    numbers.sort()
    return (numbers & np.uint64(0xFFFFFFFF)).astype(np.int64)


def errors_left(held: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(k, 4) float64, error of items, as a share of that without rays and earlier frames, before their first step and after
    each. held (k,): share of their pixels with a value of an earlier frame; ends (k, 3): share of their pixels after each step."""
    fresh = np.tile(ERROR_LEFT, (len(held), 1))
    # The first pass is all that is missing where anything is held; the others are of what is.
    left = np.concatenate([np.ones((len(held), 1)), (1 - ends) / np.maximum(held[:, None], 1e-9)], axis=1)
    missing = np.zeros_like(fresh)
    missing[:, 0] = 1
    kept = (1 - held[:, None]) * missing + held[:, None] * STALE * np.minimum(left, 1.0)
    return np.where(held[:, None] > 0, kept, fresh)
