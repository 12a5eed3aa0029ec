"""Runs: from parts of items to the pixels that are traced, and back from what tracing took to units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phrt.candidates import WorkItems
from phrt.costs import GroupCost
from phrt.kernels.layers import gather_ranges
from phrt.ledger import Ledger, Parts


@dataclass(frozen=True)
class UnitParts:
    """Parts of units. k parts; unit, effect, start, stop (k,): pixels start to stop - 1 of the unit in the order of its
    passes; whole (k,) bool; rays, ms (k,) float64 predicted; count (k,) pixels."""

    unit: np.ndarray
    effect: np.ndarray
    start: np.ndarray
    stop: np.ndarray
    whole: np.ndarray
    rays: np.ndarray
    ms: np.ndarray

    @property
    def count(self) -> np.ndarray:
        return self.stop - self.start

    def pixels(self, work: WorkItems, rows: np.ndarray) -> np.ndarray:
        """(p,) int32, the pixels of parts `rows` of one effect. Whole units stay in tile order, also across units."""
        effect = int(self.effect[rows[0]])
        rows = rows[np.argsort(work.units.first[self.unit[rows]], kind="stable")]
        whole, part = rows[self.whole[rows]], rows[~self.whole[rows]]
        pieces = [_gathered(work.pixels[effect], *self._ranges(work, whole))]
        if len(part):
            work.passes.find(self.unit[part])
            pieces.append(_gathered(work.passes.pixels[effect], *self._ranges(work, part)))
        return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)

    def _ranges(self, work: WorkItems, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        first = work.units.first[self.unit[rows]]
        return first + self.start[rows], first + self.stop[rows]

    def book(
        self, ledger: Ledger, work: WorkItems, rows: np.ndarray, effect: int, rays: int, milliseconds: float
    ) -> GroupCost:
        """Book what tracing parts `rows` of `effect` together took: rays and time are shared out as predicted."""
        units, counts = self.unit[rows], self.count[rows].astype(np.float64)
        by_rays, by_ms = self.rays[rows] / self.rays[rows].sum(), self.ms[rows] / max(self.ms[rows].sum(), 1e-12)
        # A wave may hold several parts of a unit.
        np.add.at(ledger.unit_pixels, units, counts)
        np.add.at(ledger.unit_rays, units, rays * by_rays)
        np.add.at(ledger.unit_ms, units, milliseconds * by_ms)
        items = work.units.item[units]
        share = self.rays[rows] / np.maximum(work.candidates.predicted_rays[items], 1.0)
        cost_units = float((work.candidates.cost[items] * share).sum())
        shares = counts / work.units.count[units]
        return GroupCost(effect, float(shares.sum()), float(rays), cost_units, milliseconds)


def unit_parts(work: WorkItems, parts: Parts) -> UnitParts:
    """The parts of units that `parts` of items stand for: a share of an item is the same share of all its units."""
    units = work.units
    if len(units) == len(work.candidates):
        unit, own = parts.item, np.arange(len(parts))
    else:
        # Units by item, so that every part finds its own next to each other.
        by_item = np.argsort(units.item, kind="stable")
        first = np.searchsorted(units.item[by_item], parts.item)
        count = np.searchsorted(units.item[by_item], parts.item, side="right") - first
        own = np.repeat(np.arange(len(parts)), count)
        within = np.arange(len(own)) - np.repeat(np.cumsum(count) - count, count)
        unit = by_item[first[own] + within]
    size, whole_item = units.count[unit].astype(np.int64), work.candidates.pixel_count[parts.item[own]].astype(np.int64)
    start, stop = parts.start[own] * size // whole_item, parts.stop[own] * size // whole_item
    kept = stop > start
    unit, start, stop, size = unit[kept], start[kept], stop[kept], size[kept]
    share = (stop - start) / size
    return UnitParts(
        unit, units.effect[unit], start, stop, stop - start == size, units.rays[unit] * share, units.ms[unit] * share
    )


def _gathered(source: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """source[start[0]:stop[0]], source[start[1]:stop[1]], ... as one array; a view where they lie next to each other."""
    if len(start) == 0:
        return source[:0]
    if np.array_equal(start[1:], stop[:-1]):
        return source[start[0] : stop[-1]]
    out = np.empty(int((stop - start).sum()), source.dtype)
    gather_ranges(source, start, stop, out)
    return out


def merged(work: WorkItems, effect: int, units: np.ndarray) -> np.ndarray:
    """(p,) int32, all pixels of `units` (k,) of `effect`."""
    units = units[np.argsort(work.units.first[units], kind="stable")]
    first = work.units.first[units]
    return _gathered(work.pixels[effect], first, first + work.units.count[units])
