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
from phrt.kernels.layers import FILLED, MISSING, fill_gaps, refine_gaps, scatter
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
    frame: Frame, effects: list[RayEffect], work: WorkItems, decisions: Decisions, layers: LayerSet, faults: Faults,
    *, detailed: bool = True,
) -> None:  # fmt: skip
    """Items that were not traced whole, and hold values of this frame or earlier ones, have their gaps filled; what is still
    missing, and what holds none, takes the fallback. detailed: gaps keep the fallback's detail. Looking it up everywhere takes
    time, which within a budget of time is time for rays."""
    traced, units = decisions.traced_pixels, work.units
    part = (traced / np.maximum(decisions.candidates.pixel_count, 1))[units.item]
    few = units.held + part * units.count < 0.5 * units.count
    for index, effect in enumerate(effects):
        mine = (units.effect == index) & (part < 1)
        begun = mine & ((part > 0) | (units.held > 0) & (not faults.is_off(effect)))
        gone = _concerned(frame, effect, merged(work, index, np.flatnonzero(mine & ~begun)), faults)
        if len(gone):
            _fall_back(frame, effect, gone, layers, faults)
        for doubt in (False, True):
            pixels = merged(work, index, np.flatnonzero(begun & (few == doubt)))
            _fill(frame, effect, _concerned(frame, effect, pixels, faults), layers, doubt, detailed, faults)


def _concerned(frame: Frame, effect: RayEffect, pixels: np.ndarray, faults: Faults) -> np.ndarray:
    """Those of `pixels` at which the effect would give a value."""
    if len(pixels) == 0:
        return pixels
    applies = faults.applies_at(effect, frame, pixels)
    return pixels if applies is None else pixels[applies]


def _fill(
    frame: Frame, effect: RayEffect, pixels: np.ndarray, layers: LayerSet, doubt: bool, detailed: bool, faults: Faults
) -> None:
    """Fill the gaps among `pixels` from neighbours that hold a value, of this frame or an earlier one; where there are too few, the
    fallback shows. doubt: over earlier values that stand alone, too. detailed: what the fallback knows of the difference between a
    gap and its neighbours is added to their mean."""
    name = effect.writes.name
    layer, mask = layers.arrays[name], layers.masks[name]
    object_id, width, height = frame.surfaces.object_id, frame.view.width, frame.view.height
    found, needed = np.empty(len(pixels), np.uint8), np.zeros(len(mask), np.uint8)
    pieces = chunks(len(pixels), CHUNK, frame.workers.threads)

    def fill(piece: slice) -> int:
        return int(
            fill_gaps(
                pixels[piece], object_id, mask, width, height, MASK_TRACED, MASK_HISTORY, doubt, layer, found[piece], needed
            )
        )  # fmt: skip

    if not any(frame.workers.map(fill, pieces)):
        return
    filled, missing = pixels[found == FILLED], np.ascontiguousarray(pixels[found >= MISSING])
    if not detailed:
        mask[filled] = MASK_FILLED
        _fall_back(frame, effect, missing, layers, faults)
        return
    looked_up = np.ascontiguousarray(pixels[needed[pixels] != 0])
    values = faults.fallback(effect, frame, looked_up)
    if values is None:
        mask[filled] = MASK_FILLED
        _clear(effect, missing, layers)
        return
    stands = np.empty(layer.shape, np.float32)
    _put(frame, looked_up, values, np.uint8(0), stands, needed)

    def refine(piece: slice) -> None:
        refine_gaps(
            pixels[piece], found[piece], object_id, mask, width, height, MASK_TRACED, MASK_HISTORY, stands, layer
        )  # fmt: skip

    frame.workers.map(refine, pieces)
    mask[filled] = MASK_FILLED
    _put(frame, missing, stands[missing], np.uint8(MASK_FALLBACK), layer, mask)


def _fall_back(frame: Frame, effect: RayEffect, pixels: np.ndarray, layers: LayerSet, faults: Faults) -> None:
    """The effect's fallback at `pixels`; also over what it traced there before it was switched off."""
    name = effect.writes.name
    values = faults.fallback(effect, frame, pixels)
    if values is None:
        _clear(effect, pixels, layers)
    else:
        _put(frame, pixels, values, np.uint8(MASK_FALLBACK), layers.arrays[name], layers.masks[name])


def _clear(effect: RayEffect, pixels: np.ndarray, layers: LayerSet) -> None:
    """The layer's clear value at `pixels`, where anything stands there."""
    name = effect.writes.name
    taken = pixels[layers.masks[name][pixels] != MASK_NONE]
    layers.arrays[name][taken], layers.masks[name][taken] = effect.writes.clear, MASK_NONE


def _put(
    frame: Frame, pixels: np.ndarray, values: np.ndarray, code: np.uint8, layer: np.ndarray, mask: np.ndarray
) -> None:
    """layer[pixels] = values, mask[pixels] = code."""
    everywhere = np.ones(len(pixels), np.uint8)

    def put(piece: slice) -> None:
        scatter(pixels[piece], values[piece], everywhere[piece], code, layer, mask)

    frame.workers.map(put, chunks(len(pixels), CHUNK, frame.workers.threads))
