"""Runs: from parts of items to the pixels that are traced, and back from what tracing took to units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phrt.candidates import WorkItems
from phrt.costs import GroupCost
from phrt.kernels.layers import gather_ranges
from phrt.kernels.waves import gather_parts, share_out, unit_shares
from phrt.ledger import Ledger, Parts
from phrt.packing import sorted_places


@dataclass(frozen=True)
class UnitParts:
    """Parts of units, and the groups they are counted in: a large part alone, the small ones of an effect together.

    k parts, sorted by unit: unit, start, stop (k,): pixels start to stop - 1 of the unit in the order of its passes; rays, ms (k,)
    float64 predicted; group (k,). g groups: group_effect (g,); group_pixels, group_rays, group_ms (g,) float64, sums of their
    parts'.
    """

    unit: np.ndarray
    start: np.ndarray
    stop: np.ndarray
    rays: np.ndarray
    ms: np.ndarray
    group: np.ndarray
    group_effect: np.ndarray
    group_pixels: np.ndarray
    group_rays: np.ndarray
    group_ms: np.ndarray

    def pixels(self, work: WorkItems) -> list[np.ndarray]:
        """The pixels (p,) int32 of every group, in tile order, also across units and passes."""
        by_group = sorted_places(self.group)
        ends = np.cumsum(np.bincount(self.group, minlength=len(self.group_effect))).tolist()
        starts = [0, *ends[:-1]]
        return [
            self._of_group(work, effect, by_group[start:end])
            for effect, start, end in zip(self.group_effect.tolist(), starts, ends, strict=True)
        ]

    def _of_group(self, work: WorkItems, effect: int, rows: np.ndarray) -> np.ndarray:
        unit, start, stop = self.unit[rows], self.start[rows], self.stop[rows]
        first, count = work.units.first[unit], work.units.count[unit]
        part = stop - start < count
        if not part.any():
            return _gathered(work.pixels[effect], first, first + count)
        passes = work.passes
        passes.find(unit[part])
        out = np.empty(int((stop - start).sum()), np.int32)
        gather_parts(
            work.pixels[effect], passes.kinds[effect], first, count, passes.sizes[unit], start, stop, out
        )  # fmt: skip
        return out

    def spread(self, rays: np.ndarray, effect: int, shared: int) -> None:
        """Add `shared` rays, which served all groups of an effect, to rays (g,) int64: by pixels, in whole rays."""
        groups = np.flatnonzero(self.group_effect == effect)
        ends = np.cumsum(self.group_pixels[groups])
        rays[groups] += np.diff(np.rint(shared * (ends / ends[-1])).astype(np.int64), prepend=0)

    def book(self, ledger: Ledger, work: WorkItems, rays: np.ndarray, milliseconds: np.ndarray) -> list[GroupCost]:
        """Book what tracing the groups took, (g,) each; shared out as predicted. What it teaches, effect by effect."""
        share_out(
            self.unit, self.group, self.start, self.stop, self.rays, self.ms, self.group_rays, self.group_ms,
            rays.astype(np.float64), milliseconds, ledger.unit_pixels, ledger.unit_rays, ledger.unit_ms,
        )  # fmt: skip
        items, candidates = work.units.item[self.unit], work.candidates
        share = self.rays / np.maximum(candidates.predicted_rays[items], 1.0)
        effects = int(self.group_effect.max(initial=-1)) + 1
        units = np.bincount(self.group_effect[self.group], weights=candidates.cost[items] * share, minlength=effects)
        took = [np.bincount(self.group_effect, weights=values, minlength=effects) for values in (rays, milliseconds)]
        return [
            GroupCost(effect, float(took[0][effect]), float(units[effect]), float(took[1][effect]))
            for effect in np.flatnonzero(np.bincount(self.group_effect)).tolist()
        ]


def unit_parts(work: WorkItems, parts: Parts, large_rays: float) -> UnitParts:
    """The parts of units that `parts` of items stand for: a share of an item is the same share of all its units. A part of
    `large_rays` predicted rays is a group by itself."""
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
    order = sorted_places(unit)
    unit, own = unit[order], own[order]
    k = len(unit)
    kept, start, stop, group, group_effect = (np.empty(k, np.int64) for _ in range(5))
    rays, ms, group_pixels, group_rays, group_ms = (np.empty(k) for _ in range(5))
    count, groups = unit_shares(
        unit, work.candidates.pixel_count[parts.item[own]], parts.start[own], parts.stop[own],
        units.effect, units.count, units.rays, units.ms, large_rays, len(work.pixels),
        kept, start, stop, rays, ms, group, group_effect, group_pixels, group_rays, group_ms,
    )  # fmt: skip
    of_parts = (values[:count] for values in (kept, start, stop, rays, ms, group))
    return UnitParts(*of_parts, *(values[:groups] for values in (group_effect, group_pixels, group_rays, group_ms)))


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
