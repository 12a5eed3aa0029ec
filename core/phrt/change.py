"""Measured change: what tracing an item changed in the displayed picture, on a sparse sample of its pixels.

Effects take turns, one in a frame. A sample of the pixels of its items is picked before the ray phase, while values of earlier
frames still stand in the layers, and measured after the composition: every sampled pixel that was traced is composed once more
with what would have stood there instead, all other effects as they are, and both colours are compared as a display shows them.
Three things may have stood there:

- the effect's own fallback: `change`;
- the value of an earlier frame, where there was one: `drift`, over its age in frames;
- what a gap is filled with, the mean of traced neighbours with the fallback's detail: `detail`. It says what a higher density of
  rays is good for.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phrt.candidates import EffectScope, WorkItems
from phrt.composite import compose
from phrt.exploration import MeasuredChange
from phrt.faults import Faults
from phrt.frame import MASK_FALLBACK, MASK_HISTORY, MASK_NONE, MASK_TRACED, Frame
from phrt.interfaces.effect import RayEffect
from phrt.kernels.arrays import empty_surfaces
from phrt.kernels.change import display_change, gather_surfaces, neighbour_values, pick_samples
from phrt.layers import LayerSet
from phrt.lightwise import OneLight

SAMPLES = 2048
"""Pixels looked at in a frame: half of them shared out equally among objects, half by how many pixels each has."""


@dataclass(frozen=True)
class ChangeSample:
    """The sampled pixels of one effect, s of them, as they were before the ray phase.

    effect: index; rows (s,) int32 pixels; unit (s,) int32, the unit of `WorkItems` that each belongs to; earlier (s, C) float32,
    age (s,) float32 frames: the value of an earlier frame and how old it is, 0 where there was none.
    """

    effect: int
    rows: np.ndarray
    unit: np.ndarray
    earlier: np.ndarray
    age: np.ndarray


def pick_sample(
    frame: Frame,
    effects: Sequence[RayEffect],
    scopes: Sequence[EffectScope],
    work: WorkItems,
    layers: LayerSet,
) -> ChangeSample | None:
    """A sample of the effect whose turn it is, other pixels in every frame, the same for the same frame; None without items."""
    units = work.units
    present = sorted(np.unique(units.effect).tolist(), key=lambda index: effects[index].name)
    if not present:
        return None
    index = present[frame.index % len(present)]
    effect = effects[index]
    mine = np.flatnonzero(units.effect == index)
    count = units.count[mine]
    quota = (SAMPLES / 2 * (1 / len(mine) + count / count.sum())).astype(np.float32)
    # A quota is rounded up at most once, and once more by float32.
    capacity = int(np.minimum(np.floor(quota) + 2, count).sum())
    rows, unit = np.empty(capacity, np.int32), np.empty(capacity, np.int32)
    found = pick_samples(
        work.pixels[index], units.first[mine], count, units.object_id[mine], quota, frame.surfaces.material_id,
        scopes[index].applies, frame.surfaces.object_id, frame.view.width, zlib.crc32(effect.name.encode()) & 0x7FFFFFFF,
        frame.seed, rows, unit,
    )  # fmt: skip
    rows, name = rows[:found], effect.writes.name
    age = np.zeros(found, np.float32)
    if name in layers.ages:
        age[:] = np.where(layers.masks[name][rows] == MASK_HISTORY, np.maximum(layers.ages[name][rows], 1), 0)
    return ChangeSample(index, rows, mine[unit[:found]].astype(np.int32), layers.arrays[name][rows], age)


def measure_change(
    frame: Frame,
    effect: RayEffect,
    sample: ChangeSample,
    traced_units: np.ndarray,
    layers: LayerSet,
    image: np.ndarray,
    exposure: float,
    faults: Faults,
) -> MeasuredChange:
    """What tracing `effect` changed in the finished picture.

    traced_units (m,) bool: those of which anything was traced. image (P, 3) float32: composed of `layers`, linear, exposure
    applied. The effect's fallback must be prepared.
    """
    count, name = len(traced_units), effect.writes.name
    traced = layers.masks[name][sample.rows] == MASK_TRACED
    rows, unit, age = sample.rows[traced], sample.unit[traced], sample.age[traced]
    other = _Recomposed(frame, effect, rows, layers, image, exposure)

    def total(weights: np.ndarray, where: np.ndarray) -> np.ndarray:
        """(m,) float64, sums of (s,) over the pixels `where` of each unit."""
        return np.bincount(unit[where], weights=weights[where], minlength=count).astype(np.float64)

    ones = np.ones(len(rows))
    stands, code = _fallback(frame, effect, rows, faults)
    change = other.change_against(stands, code)
    filled, neighboured = _filled(frame, effect, rows, layers, stands, faults)
    detail = other.change_against(filled, MASK_TRACED)
    drift = other.change_against(sample.earlier[traced], MASK_HISTORY) if age.any() else np.zeros(len(rows))
    fresh, aged = age == 0, age > 0
    # Where the effect does not apply, tracing the pixel changes nothing: that counts too.
    applies = faults.applies_at(effect, frame, sample.rows)
    idle = np.zeros(count)
    if applies is not None:
        idle += np.bincount(sample.unit[~applies & traced_units[sample.unit]], minlength=count)
    return MeasuredChange(
        pixels=total(ones, fresh) + idle,
        change=total(change, fresh),
        change_squared=total(change * change, fresh),
        neighboured_pixels=total(ones, neighboured) + idle,
        detail=total(detail, neighboured),
        aged_frames=total(age, aged),
        drift=total(drift, aged),
    )


class _Recomposed:
    """The picture at pixels rows (s,), with another value in one layer."""

    def __init__(
        self, frame: Frame, effect: RayEffect, rows: np.ndarray, layers: LayerSet, image: np.ndarray, exposure: float
    ) -> None:
        self._frame, self._effect, self._rows, self._image, self._exposure = frame, effect, rows, image, exposure
        self._surfaces = empty_surfaces(len(rows))
        self._direct = np.empty((len(rows), *frame.direct.shape[1:]), np.float32)
        gather_surfaces(rows, frame.surfaces, frame.direct, self._surfaces, self._direct)
        self._arrays = {name: array[rows] for name, array in layers.arrays.items()}
        self._masks = {name: mask[rows] for name, mask in layers.masks.items()}
        self._adds = layers.adds

    def change_against(self, values: np.ndarray, code: int) -> np.ndarray:
        """(s,) float32, 0 to 1, what the layer changes in the displayed picture against `values` (s, C); code: their mask."""
        frame, effect = self._frame, self._effect
        name = effect.writes.name
        if isinstance(effect, OneLight):
            name, one = effect.layer, values
            values = self._arrays[name].copy()
            values[:, effect.light] = one[:, 0]
        other, change = np.empty((len(self._rows), 3), np.float32), np.empty(len(self._rows), np.float32)
        compose(
            self._surfaces, frame.materials.materials, frame.environment, frame.world.environment.visible, frame.view,
            self._rows, self._direct, self._arrays | {name: values},
            self._masks | {name: np.full(len(self._rows), code, np.uint8)}, self._exposure, other, frame.workers, self._adds,
        )  # fmt: skip
        display_change(self._rows, self._image, other, change)
        return change


def _fallback(frame: Frame, effect: RayEffect, rows: np.ndarray, faults: Faults) -> tuple[np.ndarray, int]:
    """What stands at `rows` where nothing is traced, and its mask."""
    values = faults.fallback(effect, frame, rows) if len(rows) else None
    if values is None:
        width = effect.writes.width(frame.world)
        return np.full((len(rows), width), effect.writes.clear, np.float32), MASK_NONE
    return values, MASK_FALLBACK


def _filled(
    frame: Frame, effect: RayEffect, rows: np.ndarray, layers: LayerSet, stands: np.ndarray, faults: Faults
) -> tuple[np.ndarray, np.ndarray]:
    """What gaps at `rows` would be filled with, (s, C), and whether there are neighbours to fill them from, (s,) bool.

    That is the mean of traced pixels of the same object two pixels away, with the detail that the fallback, `stands` (s, C) at
    `rows`, has there (`refine_gaps`).
    """
    name, width, height = effect.writes.name, frame.view.width, frame.view.height
    layer, object_id = layers.arrays[name], frame.surfaces.object_id
    means, found = np.empty((len(rows), layer.shape[1]), np.float32), np.empty(len(rows), np.uint8)
    neighbour_values(rows, object_id, layers.masks[name], MASK_TRACED, width, height, layer, means, found)
    x, y = (rows % width)[:, None] + [2, -2, 0, 0], (rows // width)[:, None] + [0, 0, 2, -2]
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    around = np.where(inside, y * width + x, rows[:, None]).astype(np.int32)
    holds = inside & (layers.masks[name][around] == MASK_TRACED) & (object_id[around] == object_id[rows][:, None])
    values = _fallback(frame, effect, around[holds], faults)[0]
    there = np.zeros((*holds.shape, layer.shape[1]), np.float32)
    there[holds] = values
    number = np.maximum(holds.sum(axis=1), 1)[:, None]
    own = layer[around]
    low = np.where(holds[:, :, None], own, np.inf).min(axis=1)
    high = np.where(holds[:, :, None], own, -np.inf).max(axis=1)
    refined = means + stands - there.sum(axis=1) / number
    refined = np.clip(refined, np.minimum(low, stands), np.maximum(high, stands))
    return refined.astype(np.float32), found != 0
