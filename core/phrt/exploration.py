"""Exploration data: what walking through the scene taught about every object and effect (Andrade et al. 2014, section 4.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phrt.interfaces.heuristic import NEVER_TRACED
from phrt.kernels.booking import forget_and_add

KEPT = 0.875
"""Share of a measurement that is left of it one frame later: after about eight frames it counts a third."""
LEAST_KEPT = 1e-6
"""At least so much, so that long pauses do not end in numbers that are too small to divide by."""


@dataclass(frozen=True)
class MeasuredChange:
    """Sums over the sampled pixels of every unit that were traced; (m,) float64 each.

    pixels: how many against the fallback; change, change_squared: what tracing changed there (0 to 1 each).
    neighboured_pixels, detail: how many had traced neighbours, and the change against the mean of those.
    aged_frames, drift: ages of the values of earlier frames, and the change against them.
    """

    pixels: np.ndarray
    change: np.ndarray
    change_squared: np.ndarray
    neighboured_pixels: np.ndarray
    detail: np.ndarray
    aged_frames: np.ndarray
    drift: np.ndarray


class _ForgettingMean:
    """sum / weight, both fading with every frame; arrays (N + 1, effects) float64. What was not measured again keeps its mean."""

    def __init__(self, shape: tuple[int, int]) -> None:
        self._sum, self._weight = np.zeros(shape), np.zeros(shape)
        self._frame = np.zeros(shape, np.int64)

    def add(self, where: tuple[np.ndarray, np.ndarray], frame: int, total: np.ndarray, weight: np.ndarray) -> None:
        """Take sums of a frame in; where nothing was measured (weight 0) nothing is forgotten."""
        forget_and_add(*where, frame, KEPT, LEAST_KEPT, total, weight, self._sum, self._weight, self._frame)

    def mean(self, where: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
        """(k,) float64, NaN where nothing was ever measured."""
        total, weight = self._sum[where], self._weight[where]
        return np.divide(total, weight, out=np.full(len(total), np.nan), where=weight > 0)


@dataclass(frozen=True)
class ItemExploration:
    """Columns of the same names of `phrt.interfaces.heuristic.Candidates`."""

    seen_frames: np.ndarray
    frames_since_traced: np.ndarray
    measured_change: np.ndarray
    measured_strength: np.ndarray
    measured_detail: np.ndarray
    measured_drift: np.ndarray
    measured_ms_per_pixel: np.ndarray


class Exploration:
    """Kept by (object, effect), arrays (N + 1, effects). Frames are counted by `end_frame`.

    seen_frames: int32, in how many frames it was a candidate, the present one not counted.
    """

    def __init__(self, object_count: int, effect_count: int) -> None:
        shape = (object_count + 1, effect_count)
        self.seen_frames = np.zeros(shape, np.int32)
        self._last_traced = np.full(shape, -1, np.int64)
        self._seen, self._traced = np.zeros(shape, bool), np.zeros(shape, bool)
        self._frame = 0
        self._change, self._squared, self._detail, self._drift, self._ms = (_ForgettingMean(shape) for _ in range(5))

    def note(self, object_id: np.ndarray, effect: np.ndarray, traced: np.ndarray) -> None:
        """(k,) pairs are candidates in this frame; traced (k,) bool, at least in part. May be called again in a frame."""
        self._seen[object_id, effect] = True
        self._traced[object_id[traced], effect[traced]] = True

    def learn_time(self, object_id: np.ndarray, effect: np.ndarray, pixels: np.ndarray, ms: np.ndarray) -> None:
        """What tracing `pixels` (k,) of each pair took, milliseconds."""
        self._ms.add((object_id, effect), self._frame, ms, pixels)

    def learn_change(self, object_id: np.ndarray, effect: np.ndarray, measured: MeasuredChange) -> None:
        """What was measured on a sample of the pixels of (k,) pairs."""
        where = object_id, effect
        self._change.add(where, self._frame, measured.change, measured.pixels)
        self._squared.add(where, self._frame, measured.change_squared, measured.pixels)
        self._detail.add(where, self._frame, measured.detail, measured.neighboured_pixels)
        self._drift.add(where, self._frame, measured.drift, measured.aged_frames)

    def end_frame(self) -> None:
        """The frame is finished."""
        self.seen_frames += self._seen
        self._last_traced[self._traced] = self._frame
        self._seen[:] = False
        self._traced[:] = False
        self._frame += 1

    def frames_since_traced(self, object_id: np.ndarray, effect: np.ndarray) -> np.ndarray:
        """(k,) int32, 1 when the pair was traced in the previous frame, NEVER_TRACED if never."""
        last = self._last_traced[object_id, effect]
        return np.where(last < 0, NEVER_TRACED, np.minimum(self._frame - last, NEVER_TRACED)).astype(np.int32)

    def change(self, object_id: np.ndarray, effect: np.ndarray) -> np.ndarray:
        """(k,) float64, mean change of a traced pixel against the effect's fallback; NaN if never measured."""
        return self._change.mean((object_id, effect))

    def strength(self, object_id: np.ndarray, effect: np.ndarray) -> np.ndarray:
        """(k,) float64, mean of the squared change over the mean change: how large a change is where there is one."""
        mean, squared = self.change(object_id, effect), self._squared.mean((object_id, effect))
        return np.divide(squared, mean, out=mean.copy(), where=mean > 0)

    def detail(self, object_id: np.ndarray, effect: np.ndarray) -> np.ndarray:
        """(k,) float64, mean change of a traced pixel against its neighbours; NaN if never measured."""
        return self._detail.mean((object_id, effect))

    def drift(self, object_id: np.ndarray, effect: np.ndarray) -> np.ndarray:
        """(k,) float64, mean change against the value of an earlier frame, per frame of its age; NaN if never measured."""
        return self._drift.mean((object_id, effect))

    def ms_per_pixel(self, object_id: np.ndarray, effect: np.ndarray) -> np.ndarray:
        """(k,) float64, milliseconds; NaN if never measured."""
        return self._ms.mean((object_id, effect))

    def of_items(
        self, item: np.ndarray, object_id: np.ndarray, effect: np.ndarray, pixels: np.ndarray
    ) -> ItemExploration:
        """What is known of items that are made of one or several (object, effect), k in all; item (k,) says of which, pixels (k,)
        how many each has. Items number from 0 and have one at least; means are by pixels."""
        count = int(item.max(initial=-1)) + 1
        seen, since = np.zeros(count, np.int32), np.full(count, NEVER_TRACED, np.int32)
        np.maximum.at(seen, item, self.seen_frames[object_id, effect])
        np.minimum.at(since, item, self.frames_since_traced(object_id, effect))

        def mean(values: np.ndarray) -> np.ndarray:
            known = ~np.isnan(values)
            weight = np.bincount(item, weights=pixels * known, minlength=count)
            total = np.bincount(item, weights=np.where(known, values, 0.0) * pixels, minlength=count)
            return np.divide(total, weight, out=np.full(count, np.nan), where=weight > 0).astype(np.float32)

        measured = (self.change, self.strength, self.detail, self.drift, self.ms_per_pixel)
        return ItemExploration(seen, since, *(mean(values(object_id, effect)) for values in measured))
