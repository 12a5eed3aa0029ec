"""Layers under construction, and what stands in where nothing was traced."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from phrt.buffers import BufferPool
from phrt.candidates import WorkItems
from phrt.faults import Faults
from phrt.faults.declared import LAYERS
from phrt.frame import MASK_FALLBACK, MASK_FILLED, MASK_HISTORY, MASK_NONE, MASK_TRACED, Decisions, Frame
from phrt.interfaces.effect import Adds, RayEffect
from phrt.kernels.layers import FILLED, MISSING, fill_gaps, scatter
from phrt.lightwise import OneLight
from phrt.runs import merged
from phrt.workers import Workers, chunks
from phrt.world import World

CHUNK = 8192


@dataclass
class LayerSet:
    """The layers of one frame: arrays (P, C) float32 and masks (P,) uint8 by layer name; rays by effect name.

    ages: (P,) uint8 by layer name, how many frames ago the values that are MASK_HISTORY were traced, or stood last before the
    ray phase; layers that have none are left out. 255 stands for more.
    adds: what layers bring that the composition does not know by name, see `LayerSpec`; those that bring nothing are left out.
    """

    arrays: dict[str, np.ndarray]
    masks: dict[str, np.ndarray]
    rays: dict[str, int] = field(default_factory=dict)
    ages: dict[str, np.ndarray] = field(default_factory=dict)
    adds: dict[str, Adds] = field(default_factory=dict)


def clear_layers(effects: list[RayEffect], world: World, count: int, buffers: BufferPool, workers: Workers) -> LayerSet:
    """Every layer the composition reads, and those of further effects, at its clear value; `count` pixels each."""
    wanted = {name: (components or len(world.lights), clear) for name, (components, clear) in LAYERS.items()}
    one_light = [effect for effect in effects if isinstance(effect, OneLight)]
    for effect in effects:
        if not isinstance(effect, OneLight):
            wanted.setdefault(effect.writes.name, (effect.writes.width(world), effect.writes.clear))
    layers = LayerSet({}, {})
    layers.adds = {effect.writes.name: effect.writes.adds for effect in effects if effect.writes.adds}
    fills: list[tuple[np.ndarray, float]] = []
    for name, (components, clear) in wanted.items():
        layers.arrays[name] = buffers.take((count, components))
        fills.append((layers.arrays[name], clear))
    for part in one_light:
        layers.arrays[part.writes.name] = layers.arrays[part.layer][:, part.light : part.light + 1]
    for name in layers.arrays:
        layers.masks[name] = buffers.take((count,), np.uint8)
        fills.append((layers.masks[name], MASK_NONE))
    workers.map(lambda fill: fill[0].fill(fill[1]), fills)
    return layers


def apply_fallbacks(
    frame: Frame, effects: list[RayEffect], work: WorkItems, decisions: Decisions, layers: LayerSet, faults: Faults
) -> None:
    """Items that were not traced whole, and hold values of this frame or earlier ones, have their gaps filled; what is still
    missing, and what holds none, takes the fallback."""
    traced, units = decisions.traced_pixels, work.units
    part = (traced / np.maximum(decisions.candidates.pixel_count, 1))[units.item]
    few = units.held + part * units.count < 0.5 * units.count
    for index, effect in enumerate(effects):
        mine = (units.effect == index) & (part < 1)
        begun = mine & ((part > 0) | (units.held > 0) & (not faults.is_off(effect)))
        left = [_concerned(frame, effect, merged(work, index, np.flatnonzero(mine & ~begun)), faults)]
        for doubt in (False, True):
            pixels = merged(work, index, np.flatnonzero(begun & (few == doubt)))
            left += _fill(frame, effect, _concerned(frame, effect, pixels, faults), layers, doubt)
        pixels = np.concatenate(left)
        if len(pixels):
            _fall_back(frame, effect, np.ascontiguousarray(pixels), layers, faults)


def _concerned(frame: Frame, effect: RayEffect, pixels: np.ndarray, faults: Faults) -> np.ndarray:
    """Those of `pixels` at which the effect would give a value."""
    if len(pixels) == 0:
        return pixels
    applies = faults.applies_at(effect, frame, pixels)
    return pixels if applies is None else pixels[applies]


def _fill(frame: Frame, effect: RayEffect, pixels: np.ndarray, layers: LayerSet, doubt: bool) -> list[np.ndarray]:
    """Fill the gaps among `pixels` from neighbours that hold a value, of this frame or an earlier one; returns the pixels where
    there are too few. doubt: of earlier values, too."""
    name = effect.writes.name
    layer, mask = layers.arrays[name], layers.masks[name]
    object_id, width, height = frame.surfaces.object_id, frame.view.width, frame.view.height
    found = np.empty(len(pixels), np.uint8)

    def fill(piece: slice) -> np.ndarray:
        own = pixels[piece]
        left = fill_gaps(own, object_id, mask, width, height, MASK_TRACED, MASK_HISTORY, doubt, layer, found[piece])
        return own[found[piece] >= MISSING] if left else own[:0]

    pieces = chunks(len(pixels), CHUNK, frame.workers.threads)
    missing = frame.workers.map(fill, pieces)
    mask[pixels[found == FILLED]] = MASK_FILLED
    return missing


def _fall_back(frame: Frame, effect: RayEffect, pixels: np.ndarray, layers: LayerSet, faults: Faults) -> None:
    """The effect's fallback at `pixels`; also over what stands there: too few values of an earlier frame, or what an effect traced
    before it was switched off."""
    name = effect.writes.name
    layer, mask = layers.arrays[name], layers.masks[name]
    values, code = faults.fallback(effect, frame, pixels), MASK_FALLBACK
    if values is None:
        if not mask[pixels].any():
            return
        values, code = np.full((len(pixels), layer.shape[1]), effect.writes.clear, np.float32), MASK_NONE
    everywhere = np.ones(len(pixels), np.uint8)

    def put(piece: slice) -> None:
        scatter(pixels[piece], values[piece], everywhere[piece], np.uint8(code), layer, mask)

    frame.workers.map(put, chunks(len(pixels), CHUNK, frame.workers.threads))
