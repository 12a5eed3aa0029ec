"""gain: what tracing an item changes in the picture, for its price.

Ours. Earlier frames measured, on a sparse sample of pixels, what tracing an item changed in the displayed picture: against what
the effect shows without rays (`measured_change`), against a value of an earlier frame (`measured_drift`), and against its traced
neighbours (`measured_detail`), which is what gaps are filled with. From these follows how wrong an item's pixels are after each of
its four interleaved passes. Every pass is worth the error it takes away, times the item's pixels and importance K, and passes are
taken by falling worth per predicted cost. So most items get a quarter of their pixels before any gets all, and those whose gaps
are filled badly (mirrors, edges of shadows) get more. Mandatory items come first.

What was not measured is expected to change more than the mean of its effect, and what was traced long ago is forgotten towards
that: everything is tried again some time. Passes that were traced in the previous frame have a small advantage, so that choices
do not flip from frame to frame.

Options: power, optimism, forget_frames, damping.
Source: ours. Levels of detail by benefit and cost: Funkhouser and Sequin 1993, section 4; optimism about what is not known: Lai and
Robbins 1985.

Example::

    phrt render scenes/atrium.yaml -o walk.mp4 --heuristic gain --budget 200000rays
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import PASSES, Candidates, FrameContext, Heuristic, Request
from phrt_heuristics.kernels import take_steps
from phrt_heuristics.options import GainOptions

STEPS = np.array([1, 1, 2])
"""An item is asked for in three steps: one pass, one more, the other two;"""

SMALL_PIXELS = 64
"""but one with fewer pixels is asked for whole: parts of it would not be worth the trouble of asking."""

ERROR_LEFT = np.array([0.42, 0.25, 0.0])
"""Error of filled gaps after each step, over all pixels, as a share of `measured_detail`: what a straight edge leaves, on average
over its directions (the tests simulate it)."""

FIRST_GUESS = 0.1
"""What tracing is expected to change where nothing of the effect was measured yet."""


class Gain(Heuristic):
    """Steps of items by falling error taken away per predicted cost."""

    wants_change = True

    def __init__(self, options: GainOptions) -> None:
        self._options = options
        self._means: dict[tuple[str, str], float] = {}
        self._last_passes = np.zeros(0, np.int32)
        self._keys = np.zeros(0, np.int64)
        self._given = np.zeros(0, np.int32)
        self._steps = _Steps(np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros(0), 0)

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self._keys = candidates.keys()
        missing = int(self._keys.max(initial=-1)) + 1 - len(self._last_passes)
        self._last_passes = np.pad(self._last_passes, (0, max(missing, 0)))
        self._given = np.zeros(len(candidates), np.int32)
        passes = np.where((candidates.pixel_count < SMALL_PIXELS)[:, None], [PASSES, 0, 0], STEPS)
        worth = self._worth(candidates, passes)
        worth *= 1.0 + self._options.damping * (self._last_passes[self._keys][:, None] >= np.cumsum(passes, axis=1))
        self._steps = _Steps.sorted(candidates, passes, worth, self._keys)

    def next(self, remaining: float) -> Request | None:
        taken = self.take(remaining, 0.0)
        return Request(int(taken[0, 0]), int(taken[0, 1])) if len(taken) else None

    def take(self, remaining: float, enough: float) -> np.ndarray:
        taken = self._steps.take(remaining, enough)
        self._given[taken[:, 0]] += taken[:, 1]
        return taken

    def end_frame(self) -> None:
        self._last_passes[:] = 0
        self._last_passes[self._keys] = self._given

    def _worth(self, candidates: Candidates, passes: np.ndarray) -> np.ndarray:
        """(n, 3) float64, error that each step of `passes` (n, 3) takes away, summed over the item's pixels, times K."""
        change = self._expected(candidates, "measured_change", FIRST_GUESS, self._options.optimism)
        detail = np.minimum(self._expected(candidates, "measured_detail", FIRST_GUESS, self._options.optimism), change)
        drift = self._expected(candidates, "measured_drift", FIRST_GUESS / PASSES, 1.0)
        strength = self._expected(candidates, "measured_strength", FIRST_GUESS, 1.0)
        # Values of earlier frames stay where a pass does not come; elsewhere gaps are filled, also between such values.
        share = candidates.history_share.astype(np.float64)
        aged = share * np.minimum(drift * candidates.history_age, change)
        untraced = 1.0 - np.cumsum(passes, axis=1) / PASSES
        error = np.empty((len(candidates), len(STEPS) + 1))
        error[:, 0] = aged + (1.0 - share) * np.where(share >= 0.5, detail, change)
        error[:, 1:] = aged[:, None] * untraced
        error[:, 1:] += np.where(untraced > 0, ((1.0 - share) * detail)[:, None] * ERROR_LEFT, 0.0)
        # The same mean is worth more where it is few large changes, by a power of their size.
        weight = candidates.importance_factor * candidates.pixel_count * strength ** (self._options.power - 1.0)
        per_pass = np.maximum(error[:, :-1] - error[:, 1:], 0.0) / np.maximum(passes, 1)
        # No step may be worth more for its price than the one before it, or it would be asked for first.
        return np.asarray(weight[:, None] * np.minimum.accumulate(per_pass, axis=1) * passes)

    def _expected(self, candidates: Candidates, column: str, first_guess: float, optimism: float) -> np.ndarray:
        """(n,) float64, what was measured, or what to expect where that is unknown or long ago."""
        measured = getattr(candidates, column).astype(np.float64)
        known = np.isfinite(measured)
        value = np.where(known, measured, 0.0)
        pixels = np.where(known, candidates.pixel_count, 0).astype(np.float64)
        names = candidates.effect_names
        total = np.bincount(candidates.effect, weights=pixels, minlength=len(names))
        sums = np.bincount(candidates.effect, weights=pixels * value, minlength=len(names))
        self._means |= {(column, names[k]): float(sums[k] / total[k]) for k in np.flatnonzero(total > 0).tolist()}
        means = np.array([self._means.get((column, name), first_guess) for name in names])
        hoped = optimism * means[candidates.effect]
        waited = np.minimum(candidates.frames_since_traced - 1, 100 * self._options.forget_frames)
        forgotten = 1.0 - 0.5 ** (waited / self._options.forget_frames)
        return np.where(known, value + np.maximum(hoped - value, 0.0) * forgotten, hoped)


class _Steps:
    """Steps in the order they are handed out in; one that does not fit when its turn has come is passed over.

    item, passes (s,) int32, cost (s,) float64; items: how many there are.
    """

    def __init__(self, item: np.ndarray, passes: np.ndarray, cost: np.ndarray, items: int) -> None:
        self._item, self._passes, self._cost = item, passes, cost
        self._place = np.zeros(1, np.int64)
        self._row_of_item = np.full(items, -1, np.int32)

    @classmethod
    def sorted(cls, candidates: Candidates, passes: np.ndarray, worth: np.ndarray, keys: np.ndarray) -> _Steps:
        """By falling worth (n, 3) per cost; mandatory items' first; of equals by key and step."""
        by_key = np.argsort(keys, kind="stable")
        cost = candidates.predicted_cost.astype(np.float64)[:, None] * (passes / PASSES)
        price = np.where(candidates.mandatory[:, None], -np.inf, -worth / np.maximum(cost, 1e-300))
        steps = np.flatnonzero(passes[by_key].ravel())
        order = steps[np.argsort(price[by_key].ravel()[steps], kind="stable")]
        item, step = by_key[order // len(STEPS)], order % len(STEPS)
        return cls(item.astype(np.int32), passes[item, step].astype(np.int32), cost[item, step], len(candidates))

    def take(self, remaining: float, enough: float) -> np.ndarray:
        """(k, 2) int32 items and passes: the first steps that fit one after the other, until they cost `enough` together; at least
        one, if there is one. Steps of the same item are one row."""
        taken = np.empty((min(len(self._item) - int(self._place[0]), len(self._row_of_item)), 2), np.int32)
        count = take_steps(
            self._item, self._passes, self._cost, self._place, remaining, max(enough, 1e-300), self._row_of_item, taken
        )
        return taken[:count]
