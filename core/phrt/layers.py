"""Layers under construction, and what stands in where nothing was traced."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from phrt.candidates import WorkItems
from phrt.faults import Faults
from phrt.frame import MASK_FALLBACK, MASK_FILLED, MASK_NONE, MASK_TRACED, Decisions, Frame
from phrt.interfaces.effect import RayEffect
from phrt.interfaces.heuristic import PASSES
from phrt.kernels.layers import fill_gaps, scatter
from phrt.ledger import merged
from phrt.workers import chunks

CHUNK = 8192


@dataclass
class LayerSet:
    """The layers of one frame: arrays (P, C) float32 and masks (P,) uint8 by layer name; rays by effect name."""

    arrays: dict[str, np.ndarray]
    masks: dict[str, np.ndarray]
    rays: dict[str, int] = field(default_factory=dict)


def apply_fallbacks(
    frame: Frame, effects: list[RayEffect], work: WorkItems, decisions: Decisions, layers: LayerSet, faults: Faults
) -> None:
    """Partly traced items have their gaps filled; what is still missing, and what was not traced, takes the fallback."""
    for index, effect in enumerate(effects):
        mine = work.candidates.effect == index
        untraced = merged(work, np.flatnonzero(mine & (decisions.passes == 0)))
        partial = merged(work, np.flatnonzero(mine & (decisions.passes > 0) & (decisions.passes < PASSES)))
        missing = _fill(frame, effect, _concerned(frame, effect, partial, faults), layers)
        left = [*_concerned(frame, effect, untraced, faults), *missing]
        if left:
            _fall_back(frame, effect, np.ascontiguousarray(np.concatenate(left)), layers, faults)


def _concerned(frame: Frame, effect: RayEffect, runs: list[np.ndarray], faults: Faults) -> list[np.ndarray]:
    """The pixels of `runs` at which the effect would give a value."""
    kept = []
    for pixels in runs:
        applies = faults.applies_at(effect, frame, pixels)
        kept.append(pixels if applies is None else pixels[applies])
    return [pixels for pixels in kept if len(pixels)]


def _fill(frame: Frame, effect: RayEffect, runs: list[np.ndarray], layers: LayerSet) -> list[np.ndarray]:
    """Fill the gaps of `runs` of pixels from traced neighbours; returns the pixels that have none."""
    name = effect.writes.name
    layer, mask = layers.arrays[name], layers.masks[name]
    object_id, width, height = frame.surfaces.object_id, frame.view.width, frame.view.height

    def fill(pixels: np.ndarray) -> np.ndarray:
        if fill_gaps(pixels, object_id, mask, width, height, MASK_TRACED, MASK_FILLED, layer):
            return pixels[mask[pixels] == MASK_NONE]
        return pixels[:0]

    pieces = [run[piece] for run in runs for piece in chunks(len(run), CHUNK, frame.workers.threads)]
    return [left for left in frame.workers.map(fill, pieces) if len(left)]


def _fall_back(frame: Frame, effect: RayEffect, pixels: np.ndarray, layers: LayerSet, faults: Faults) -> None:
    """The effect's fallback at `pixels`; also over what an effect traced there before it was switched off."""
    name = effect.writes.name
    layer, mask = layers.arrays[name], layers.masks[name]
    values, code = faults.fallback(effect, frame, pixels), MASK_FALLBACK
    if values is None:
        if not mask[pixels].any():
            return
        values, code = np.full((len(pixels), layer.shape[1]), effect.writes.clear, np.float32), MASK_NONE
    scatter(pixels, values, np.ones(len(pixels), np.uint8), np.uint8(code), layer, mask)
