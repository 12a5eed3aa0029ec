"""Cost models: what an item will take, in milliseconds, before it is traced. Two of them, fitted online side by side.

`measured` knows rays: per effect ms = a * items + b * rays. `paper` knows the paper's cost alone: one ms per unit of C.
Both are fitted from the same waves and both predict every item of every frame, so that they can be compared; budgets of time
are held by one of them.
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
DEFAULT_MS_PER_ITEM = 0.01

FORGET = 0.99
"""Weight of a fit's past at every new wave: the last hundred waves, some twenty frames, are what counts."""

_LIGHTEST = 1000.0
"""Rays below which a group does not weigh more: the times of tiny groups are noise."""
_PRIOR = 1e-3
"""Weight of the coefficients a fit begins with, against a measurement's 1."""


@dataclass
class GroupCost:
    """What one effect's share of a wave was made of, and took. cost_units: sum of the paper's C over it."""

    effect: int
    items: float
    rays: float
    cost_units: float
    milliseconds: float


class LinearFit:
    """ms = a * items + b * rays by least squares that forgets; a and b are never negative.

    Every measurement weighs 1 / rays, so that what counts is nearly the relative error.
    """

    def __init__(self, per_item: float = DEFAULT_MS_PER_ITEM, per_ray: float = DEFAULT_MS_PER_RAY) -> None:
        self._start(per_item, per_ray)

    def _start(self, per_item: float, per_ray: float) -> None:
        self.per_item, self.per_ray = per_item, per_ray
        scale = np.array([1.0, _LIGHTEST])
        self._normal = np.diag(scale**2) * (_PRIOR / _LIGHTEST)
        self._moment = self._normal @ np.array([per_item, per_ray])

    def learn(self, items: float, rays: float, milliseconds: float) -> None:
        """One group of a wave: `items` parts of items with `rays` in all took `milliseconds`."""
        weight = 1.0 / max(rays, _LIGHTEST)
        row = np.array([items, rays])
        self._normal = FORGET * self._normal + weight * np.outer(row, row)
        self._moment = FORGET * self._moment + weight * row * milliseconds
        a, b = np.linalg.solve(self._normal + np.eye(2) * 1e-12, self._moment)
        if b < 0:
            a, b = max(self._moment[0] / self._normal[0, 0], 0.0), 0.0
        elif a < 0:
            a, b = 0.0, max(self._moment[1] / self._normal[1, 1], 0.0)
        self.per_item, self.per_ray = float(a), float(b)

    def warm(self, per_item: float, per_ray: float) -> None:
        """Begin anew, with coefficients of an earlier run."""
        self._start(per_item, per_ray)


class CostModels:
    """The fits of one renderer. Effects are known by name, so that coefficients outlive a run."""

    def __init__(self, effect_names: Sequence[str]) -> None:
        self._names = tuple(effect_names)
        self._fits = [LinearFit() for _ in self._names]
        self._paper_ms, self._paper_rays, self._paper_units = 0.0, 0.0, 0.0

    def learn(self, groups: Sequence[GroupCost]) -> None:
        """A wave is done."""
        for group in groups:
            if group.milliseconds > 0 and group.rays > 0:
                self._fits[group.effect].learn(group.items, group.rays, group.milliseconds)
        self._paper_ms = FORGET * self._paper_ms + sum(group.milliseconds for group in groups)
        self._paper_rays = FORGET * self._paper_rays + sum(group.rays for group in groups)
        self._paper_units = FORGET * self._paper_units + sum(group.cost_units for group in groups)

    def measured_ms(self, effect: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """(m,) float64 of units with predicted `rays` (m,): a + b * rays of their effect (m,) int."""
        per_item = np.array([fit.per_item for fit in self._fits])
        per_ray = np.array([fit.per_ray for fit in self._fits])
        return per_item[effect] + per_ray[effect] * rays if len(self._fits) else np.zeros(len(effect))

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
        """By effect name: ms_per_item, ms_per_ray. What `warm` takes."""
        return {
            name: {"ms_per_item": fit.per_item, "ms_per_ray": fit.per_ray}
            for name, fit in zip(self._names, self._fits, strict=True)
        }

    def warm(self, coefficients: Mapping[str, Mapping[str, float]]) -> None:
        """Start from coefficients of an earlier run; effects that are not named start as they are."""
        for name, fit in zip(self._names, self._fits, strict=True):
            if name in coefficients:
                known = coefficients[name]
                fit.warm(known["ms_per_item"], known["ms_per_ray"])
