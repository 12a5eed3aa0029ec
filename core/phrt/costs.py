"""Cost models: what an item will take, in milliseconds, before it is traced. Two of them, fitted online side by side.

`measured` knows rays: an effect's batch, which is what a wave traces of it, takes ms = a + b * rays. The first rays of a batch
are dear: caches hold nothing that they need, and threads have to be handed their work. `paper` knows the paper's cost alone: one ms
per unit of C. Both are fitted from the same waves and both predict every item of every frame, so that they can be compared;
budgets of time are held by one of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

CostModelName = Literal["measured", "paper"]
COST_MODELS: tuple[CostModelName, ...] = ("measured", "paper")

DEFAULT_MS_PER_RAY = 1e-4
"""Before anything was measured: ten million rays a second."""
DEFAULT_MS_PER_BATCH = 0.1
DEFAULT_MS_PER_WAVE = 0.1

LARGE_BATCH_RAYS = 25_000.0
"""A batch of so many rays is a large one. An item bears the share of a that it has in such a batch, or in the batches that there
are where these are larger; what smaller ones lack is planned for with the wave (`BudgetScheduler`). If items bore it, they would
seem dear where batches are small, less of them would be traced, and batches would stay small."""

FORGET = 0.99
"""Weight of a fit's past at every new wave: the last hundred waves, some twenty frames, are what counts."""
FORGET_WAVE = 0.9
"""The same for a wave's own time."""
SLOWEST = 10.0
"""What takes longer than so many times what was expected was interrupted, or compiled kernels: it counts as if it took that."""

EASE = 0.95
"""An effect of which a frame traced nothing is expected to take this much of what it was, down to the defaults: what was once found
too dear would never be traced again, and so never be found cheaper."""

_LIGHTEST = 1000.0
"""Rays below which a group does not weigh more: the times of tiny groups are noise."""
_PRIOR = 0.01
"""Weight of the coefficients a fit begins with, against a measurement's 1. It stays: where all batches are of one size, nothing
else tells a from b."""


@dataclass
class GroupCost:
    """What one effect's batch in a wave was made of, and took. cost_units: sum of the paper's C over it."""

    effect: int
    rays: float
    cost_units: float
    milliseconds: float


class LinearFit:
    """ms = a + b * rays by least squares that forgets; a and b are never negative.

    Every measurement weighs 1 / rays, so that what counts is nearly the relative error.
    """

    def __init__(self, per_batch: float = DEFAULT_MS_PER_BATCH, per_ray: float = DEFAULT_MS_PER_RAY) -> None:
        self.warm(per_batch, per_ray)

    def warm(self, per_batch: float, per_ray: float) -> None:
        """Begin anew, with coefficients of an earlier run."""
        self.per_batch, self.per_ray = per_batch, per_ray
        self._start = per_batch, per_ray
        # Sums over the measurements: weight, weight * rays, weight * rays^2; weight * ms, weight * rays * ms. As the weight is
        # 1 / rays, the second is how many batches there were, and the third their rays.
        self._sums = np.zeros(5)

    def ease(self) -> None:
        """Nothing was measured in a frame: expect a little less, but no less than the defaults."""
        usual = DEFAULT_MS_PER_BATCH + DEFAULT_MS_PER_RAY * LARGE_BATCH_RAYS
        if self.per_batch + self.per_ray * LARGE_BATCH_RAYS > usual:
            self.per_batch, self.per_ray = EASE * self.per_batch, EASE * self.per_ray
            self._start = EASE * self._start[0], EASE * self._start[1]
            self._sums[3:] *= EASE

    @property
    def per_ray_of_item(self) -> float:
        """b, and the share of a that a ray of an item bears."""
        batches, rays = self._sums[1], self._sums[2]
        return self.per_ray + self.per_batch / max(rays / max(batches, 1e-9), LARGE_BATCH_RAYS)

    def learn(self, rays: float, milliseconds: float) -> None:
        """A batch of `rays` took `milliseconds`."""
        milliseconds = min(milliseconds, SLOWEST * (self.per_batch + self.per_ray * rays))
        weight = 1.0 / max(rays, _LIGHTEST)
        measured = np.array([1.0, rays, rays * rays, milliseconds, rays * milliseconds])
        self._sums = FORGET * self._sums + weight * measured
        one, r, rr, m, rm = self._sums.tolist()
        (start_a, start_b), prior = self._start, _PRIOR / _LIGHTEST
        one, rr = one + prior, rr + prior * _LIGHTEST**2
        m, rm = m + prior * start_a, rm + prior * _LIGHTEST**2 * start_b
        determinant = one * rr - r * r
        a, b = (m * rr - r * rm) / determinant, (one * rm - r * m) / determinant
        if b < 0:
            a, b = m / one, 0.0
        elif a < 0:
            a, b = 0.0, rm / rr
        self.per_batch, self.per_ray = max(a, 0.0), max(b, 0.0)


class CostModels:
    """The fits of one renderer. Effects are known by name, so that coefficients outlive a run.

    wave_ms: what a wave takes besides its batches: asking, planning, booking.
    """

    def __init__(self, effect_names: Sequence[str]) -> None:
        self._names = tuple(effect_names)
        self._fits = [LinearFit() for _ in self._names]
        self._paper_ms, self._paper_rays, self._paper_units = 0.0, 0.0, 0.0
        self.wave_ms = 0.0
        self._measured: set[int] = set()

    def __len__(self) -> int:
        """How many effects."""
        return len(self._fits)

    def learn(self, groups: Sequence[GroupCost]) -> None:
        """A wave is done."""
        for group in groups:
            if group.milliseconds > 0 and group.rays > 0:
                self._fits[group.effect].learn(group.rays, group.milliseconds)
                self._measured.add(group.effect)
        self._paper_ms = FORGET * self._paper_ms + sum(group.milliseconds for group in groups)
        self._paper_rays = FORGET * self._paper_rays + sum(group.rays for group in groups)
        self._paper_units = FORGET * self._paper_units + sum(group.cost_units for group in groups)

    def end_frame(self) -> None:
        """The frame's ray phase is over."""
        for effect, fit in enumerate(self._fits):
            if effect not in self._measured:
                fit.ease()
        self._measured.clear()

    def learn_wave(self, milliseconds: float) -> None:
        """A wave took so much besides its batches."""
        likely = min(max(milliseconds, 0.0), SLOWEST * max(self.wave_ms, DEFAULT_MS_PER_WAVE))
        self.wave_ms = FORGET_WAVE * self.wave_ms + (1 - FORGET_WAVE) * likely

    def measured_ms(self, effect: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """(m,) float64 of units with predicted `rays` (m,) of their effect (m,) int: their share of a large batch."""
        if not self._fits:
            return np.zeros(len(effect))
        per_ray = np.array([fit.per_ray_of_item for fit in self._fits])
        return np.asarray(per_ray[effect] * rays)

    def batch_ms(self) -> np.ndarray:
        """(effects,) float64, what a batch of each effect takes before its first ray."""
        return np.array([fit.per_batch for fit in self._fits])

    def paper_ms(self, cost: np.ndarray, predicted_ms: np.ndarray) -> np.ndarray:
        """(n,) float64 of items with the paper's `cost` C (n,): one ms per unit of C (Andrade et al. 2014, eq. (2); that this
        is linear in time is how we read it). Until something was measured, the unit is what makes the sum equal that of
        `predicted_ms` (n,)."""
        return cost * self._per_unit(self._paper_ms, cost, predicted_ms)

    def paper_rays(self, cost: np.ndarray, predicted_rays: np.ndarray) -> np.ndarray:
        """(n,) float64: the same for budgets of rays."""
        return cost * self._per_unit(self._paper_rays, cost, predicted_rays)

    def _per_unit(self, amount: float, cost: np.ndarray, predicted: np.ndarray) -> float:
        if self._paper_units > 0:
            return amount / self._paper_units
        total = float(cost.sum(dtype=np.float64))
        return float(predicted.sum(dtype=np.float64)) / total if total > 0 else 0.0

    @property
    def learned(self) -> bool:
        """Was anything measured yet?"""
        return self._paper_units > 0

    def coefficients(self) -> dict[str, dict[str, float]]:
        """By effect name: ms_per_item (of all items of a batch together), ms_per_ray. What `warm` takes."""
        return {
            name: {"ms_per_item": fit.per_batch, "ms_per_ray": fit.per_ray}
            for name, fit in zip(self._names, self._fits, strict=True)
        }

    def warm(self, coefficients: Mapping[str, Mapping[str, float]]) -> None:
        """Start from coefficients of an earlier run; effects that are not named start as they are."""
        for name, fit in zip(self._names, self._fits, strict=True):
            if name in coefficients:
                known = coefficients[name]
                fit.warm(known["ms_per_item"], known["ms_per_ray"])
