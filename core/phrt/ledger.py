"""Ledger: what was asked for and traced of every work item in one frame, and what it took."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from phrt.candidates import WorkItems
from phrt.experience import Experience
from phrt.frame import CUT, EFFECT_OFF, NO_FIT, NO_TIME, NOT_ASKED, REDUCED, SELECTED, Decisions
from phrt.interfaces.heuristic import PASSES, BudgetUnit, Outcome
from phrt.kernels.booking import are_requests, request_parts

ALL_PIXELS = np.iinfo(np.int64).max
"""What stands for no limit in requests."""


@dataclass(frozen=True)
class Parts:
    """Pixels `start` to `stop` - 1 of items, in the order of their interleaved passes. k parts, (k,) int64 each."""

    item: np.ndarray
    start: np.ndarray
    stop: np.ndarray

    def __len__(self) -> int:
        return len(self.item)

    def rows(self, rows: slice | np.ndarray) -> Parts:
        """Some of the parts."""
        return Parts(self.item[rows], self.start[rows], self.stop[rows])

    @classmethod
    def joined(cls, parts: Sequence[Parts]) -> Parts:
        """All of them in order."""
        return cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("item", "start", "stop")))


NO_PARTS = Parts(*(np.zeros(0, np.int64) for _ in range(3)))


class Ledger:
    """What has been asked for and traced of every item in this frame. n items, m units.

    effect (n,) int32; asked, traced (n,) int64 pixels; order (n,) int32, as in `Decisions`; unit_pixels, unit_rays, unit_ms (m,)
    float64: what tracing the units took.
    """

    def __init__(self, work: WorkItems) -> None:
        count, units = len(work.candidates), len(work.units)
        self._work = work
        self._size = work.candidates.pixel_count.astype(np.int64)
        self._price = work.candidates.predicted_cost / np.maximum(self._size, 1)
        self.effect = work.candidates.effect
        self._named = 0
        self._off = np.zeros(count, bool)
        self._passes = np.zeros(count, np.int64)
        self.asked = np.zeros(count, np.int64)
        self.traced = np.zeros(count, np.int64)
        self.order = np.full(count, -1, np.int32)
        self.unit_pixels, self.unit_rays, self.unit_ms = (np.zeros(units) for _ in range(3))

    def parts(self, items: np.ndarray, passes: np.ndarray, pixels: np.ndarray) -> Parts | None:
        """What requests for `items` (k,) stand for, none of them twice; None where there is no such item, or it was asked for
        whole before. passes, pixels (k,) int64: at most so many. Later passes of an item of few pixels may hold none: such
        parts are left out."""
        if not are_requests(items, passes, pixels, self._passes, PASSES):
            return None
        start, stop = np.empty(len(items), np.int64), np.empty(len(items), np.int64)
        ends = self._ends(items, passes, pixels)
        request_parts(items, passes, pixels, self._size, self.asked, self._passes, PASSES, ends, start, stop)
        parts = Parts(items, start, stop)
        return parts.rows(stop > start) if (stop <= start).any() else parts

    def _ends(self, items: np.ndarray, passes: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        """(n, PASSES) int64, how many pixels the first passes of items have; nearly, where an item has several units. Right for
        `items` (k,); (n, 1), their size, where all are asked for whole."""
        if len(items) and passes.min() >= PASSES and pixels.min() == ALL_PIXELS:
            return self._size[:, None]
        if len(self.unit_rays) == len(self._size):
            self._work.passes.find(items)
            return self._work.passes.ends
        return self._ends_by_share

    @cached_property
    def _ends_by_share(self) -> np.ndarray:
        shares = np.cumsum(self._work.candidates.pass_shares(), axis=1)
        ends = np.ceil(shares * self._size[:, None]).astype(np.int64)
        ends[:, -1] = self._size
        return ends

    def predicted(self, parts: Parts) -> np.ndarray:
        """(k,) float64, what the candidates say that tracing `parts` will take, in the budget's unit."""
        return self._price[parts.item] * (parts.stop - parts.start)

    def name(self, parts: Parts) -> None:
        """The heuristic named these, in this order."""
        new = parts.item[self.order[parts.item] < 0]
        self.order[new] = np.arange(self._named, self._named + len(new))
        self._named += len(new)

    def count(self, items: np.ndarray, passes: np.ndarray) -> None:
        """So many more `passes` of `items` (k,) were asked for."""
        self._passes[items] = np.minimum(self._passes[items] + passes, PASSES)

    def accept(self, parts: Parts) -> None:
        """`parts` will be traced, if there is time."""
        self.asked[parts.item] = parts.stop

    def book(self, parts: Parts) -> None:
        """`parts` are traced."""
        self.traced[parts.item] = parts.stop

    def discard(self, effect: int) -> None:
        """What was traced of `effect` does not count: it failed."""
        lost = self._work.units.effect == effect
        self.unit_pixels[lost] = 0
        kept = np.bincount(self._work.units.item, weights=~lost, minlength=len(self.traced)) > 0
        self._off[self._work.units.item[lost]] = True
        self.traced[~kept] = 0

    def teach(self, experience: Experience) -> None:
        """What tracing took, for the predictions of later frames."""
        units, traced = self._work.units, np.flatnonzero(self.unit_pixels > 0)
        experience.learn_rays(
            units.object_id[traced], units.effect[traced], self.unit_pixels[traced], self.unit_rays[traced]
        )
        experience.exploration.note(units.object_id, units.effect, self.unit_pixels > 0)
        experience.exploration.learn_time(
            units.object_id[traced], units.effect[traced], self.unit_pixels[traced], self.unit_ms[traced]
        )

    def outcome(self, item: int) -> Outcome:
        """What is known of `item` by now."""
        mine = self._work.units.item == item if len(self.unit_rays) != len(self.traced) else np.array([item])
        return Outcome(
            pixels=int(self.traced[item]),
            rays=round(float(self.unit_rays[mine].sum())),
            milliseconds=float(self.unit_ms[mine].sum()),
            complete=bool(self.traced[item] == self._size[item]),
        )

    def decisions(self, budget: float, unit: BudgetUnit, left: float, ray_ms: float, waves: int) -> Decisions:
        """The frame's account, when it is finished."""
        units, count = self._work.units, len(self.traced)
        return Decisions(
            candidates=self._work.candidates,
            chosen=self.traced > 0,
            reason=self._reasons(),
            order=self.order,
            passes=(-(-self.traced * PASSES // np.maximum(self._size, 1))).astype(np.int32),
            traced_pixels=self.traced,
            rays=np.rint(np.bincount(units.item, weights=self.unit_rays, minlength=count)).astype(np.int64),
            milliseconds=np.bincount(units.item, weights=self.unit_ms, minlength=count),
            budget=budget,
            budget_unit=unit,
            left=left,
            ray_ms=ray_ms,
            waves=waves,
        )

    def _reasons(self) -> np.ndarray:
        traced, asked = self.traced > 0, self.asked > 0
        reason = np.full(len(self.traced), NO_FIT, np.uint8)
        # What comes later counts more.
        reason[asked] = NO_TIME
        reason[traced] = REDUCED
        reason[traced & (self.traced < self.asked)] = CUT
        reason[self.traced >= self._size] = SELECTED
        reason[self.order < 0] = NOT_ASKED
        reason[self._off] = EFFECT_OFF
        return reason


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
