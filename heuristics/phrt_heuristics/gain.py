"""gain: what tracing an item changes in the picture, for its price.

Ours. Earlier frames measured, on a sparse sample of pixels, what tracing an item changed in the displayed picture: against what
the effect shows without rays (`measured_change`), against a value of an earlier frame (`measured_drift`), and against its traced
neighbours (`measured_detail`), which is what gaps are filled with. From these follows how wrong an item's pixels are after each of
its four passes. Every pass is worth the error it takes away, times the item's pixels and importance K, and passes are
taken by falling worth per predicted cost. So most items get a quarter of their pixels before any gets all, and those whose gaps
are filled badly (mirrors, edges of shadows) get more. Mandatory items come first.

What was not measured is expected to change more than the mean of its effect, what was traced long ago is forgotten towards that,
and the longer an item waits, the more is hoped for: everything is tried again some time. Passes that were traced in the previous
frame have a small advantage, so that choices do not flip from frame to frame. Where the budget ends within a step, part of it is
traced.

Options: power, optimism, forget_frames, damping.
Source: ours. Levels of detail by benefit and cost: Funkhouser and Sequin 1993, section 4; optimism about what is not known:
Lai and Robbins 1985.

Example::

    phrt render scenes/atrium.yaml -o walk.mp4 --heuristic gain --budget 200000rays
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import NEVER_TRACED, PASSES, Candidates, FrameContext, Heuristic, Request
from phrt_heuristics.gain_kernels import effect_means, rank_steps, take_steps
from phrt_heuristics.options import GainOptions

STEPS = np.array([[1, 1, 2], [PASSES, 0, 0]])
"""An item is asked for in three steps: one pass, one more, the other two; a small one whole,"""

SMALL_PIXELS = 64
"""which is one with fewer pixels: parts of it would not be worth the trouble of asking."""

ERROR_LEFT = np.array([0.42, 0.25, 0.0])
"""Error of filled gaps after each step, over all pixels, as a share of `measured_detail`: what a straight edge leaves, on average
over its directions (the tests simulate it)."""

COLUMNS = ("measured_change", "measured_detail", "measured_drift", "measured_strength")
FIRST_GUESS = np.array([0.1, 0.1, 0.025, 0.1])
"""What is expected of each column where nothing of the effect was measured yet."""

LEAST_SHARE = 0.125
"""Of a step that does not fit, as much is asked for as does, if it is this share of it at least."""

LONGEST_WAIT = 100.0
"""Waiting counts up to so many times `forget_frames`."""


class Gain(Heuristic):
    """Steps of items by falling error taken away per predicted cost."""

    wants_change = True

    def __init__(self, options: GainOptions) -> None:
        self._options = options
        self._means: dict[str, np.ndarray] = {}
        self._last_passes = np.zeros(0, np.int32)
        self._begin(np.zeros(0, np.int64), np.zeros(0, np.int32), np.zeros(0, np.float32), np.zeros(0, np.float32))

    def _begin(self, keys: np.ndarray, pixel_count: np.ndarray, cost: np.ndarray, share: np.ndarray) -> None:
        self._keys, self._pixel_count, self._cost, self._share = keys, pixel_count, cost, share
        self._given, self._row_of_item = np.zeros(len(keys), np.int32), np.full(len(keys), -1, np.int32)
        missing = int(keys.max(initial=-1)) + 1 - len(self._last_passes)
        self._last_passes = np.pad(self._last_passes, (0, max(missing, 0)))
        self._row_of_key = np.empty(len(self._last_passes), np.int32)
        self._row_of_key[keys] = np.arange(len(keys))
        self._order, self._place = np.zeros(0, np.uint64), np.zeros(1, np.int64)

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self._begin(candidates.keys(), candidates.pixel_count, candidates.predicted_cost, candidates.history_share)
        measured = np.stack([getattr(candidates, name) for name in COLUMNS])
        means = np.stack([self._means.get(name, FIRST_GUESS) for name in candidates.effect_names], axis=1)
        effect_means(measured, candidates.pixel_count, candidates.effect, FIRST_GUESS, means)
        self._means |= dict(zip(candidates.effect_names, means.T, strict=True))
        options, order = self._options, np.empty(len(candidates) * STEPS.shape[1], np.uint64)
        count = rank_steps(
            candidates.effect, candidates.pixel_count, candidates.mandatory, candidates.predicted_cost,
            candidates.importance_factor, candidates.history_share, candidates.history_age,
            candidates.frames_since_traced, candidates.seen_frames, measured, means, self._keys, self._last_passes,
            NEVER_TRACED, options.optimism, options.forget_frames, LONGEST_WAIT, options.power, options.damping,
            SMALL_PIXELS, STEPS, ERROR_LEFT, order,
        )  # fmt: skip
        self._order = np.sort(order[:count])

    def next(self, remaining: float) -> Request | None:
        taken = self._take(remaining, 0.0)
        return Request(int(taken[0, 0]), int(taken[0, 1])) if len(taken) else self._part(remaining)

    def take(self, remaining: float, enough: float) -> np.ndarray | None:
        taken = self._take(remaining, enough)
        # What does not fit in whole steps, `next` says.
        return taken if len(taken) or self._place[0] == len(self._order) else None

    def _part(self, remaining: float) -> Request | None:
        """As much of the next step as fits."""
        if self._place[0] == len(self._order):
            return None
        number = int(self._order[self._place[0]]) & 0xFFFFFFFF
        self._place[0] += 1
        item = int(self._row_of_key[number >> 2])
        pixels = int(remaining * float(self._pixel_count[item]) / float(self._cost[item]))
        return Request(item, int(STEPS[0, number & 3]), pixels) if pixels >= 1 else None

    def _take(self, remaining: float, enough: float) -> np.ndarray:
        """(k, 2) int32 items and passes, the next steps that fit."""
        taken = np.empty((min(len(self._order) - int(self._place[0]), len(self._keys)), 2), np.int32)
        count = take_steps(
            self._order, self._place, self._row_of_key, self._pixel_count, self._cost, self._share,
            self._given, SMALL_PIXELS, STEPS, LEAST_SHARE, remaining,
            max(enough, 1e-300), self._row_of_item, taken,
        )  # fmt: skip
        return taken[:count]

    def end_frame(self) -> None:
        self._last_passes[:] = 0
        self._last_passes[self._keys] = self._given
