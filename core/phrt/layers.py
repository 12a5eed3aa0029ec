"""Layers under construction, and what stands in where nothing was traced."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from phrt.buffers import BufferPool
from phrt.candidates import WorkItems
from phrt.faults import Faults
from phrt.frame import MASK_FALLBACK, MASK_FILLED, MASK_HISTORY, MASK_NONE, MASK_TRACED, Decisions, Frame
from phrt.interfaces.effect import RayEffect
from phrt.kernels.layers import fill_gaps, scatter
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
    """

    arrays: dict[str, np.ndarray]
    masks: dict[str, np.ndarray]
    rays: dict[str, int] = field(default_factory=dict)
    ages: dict[str, np.ndarray] = field(default_factory=dict)


def clear_layers(effects: list[RayEffect], world: World, count: int, buffers: BufferPool, workers: Workers) -> LayerSet:
    """Every layer the composition reads, and those of further effects, at its clear value; `count` pixels each."""
    wanted = {
        "visibility": (len(world.lights), 1.0),
        "ambient_occlusion": (1, 1.0),
        "reflection": (3, 0.0),
        "refraction": (3, 0.0),
    }
    one_light = [effect for effect in effects if isinstance(effect, OneLight)]
    for effect in effects:
        if not isinstance(effect, OneLight):
            wanted.setdefault(effect.writes.name, (effect.writes.width(world), effect.writes.clear))
    layers = LayerSet({}, {})
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
    """Partly traced items, and those for which values of earlier frames stand in at most pixels, have their gaps filled; what is
    still missing, and what was not traced, takes the fallback."""
    traced, units = decisions.traced_pixels, work.units
    untraced, partial = traced == 0, (traced > 0) & (traced < decisions.candidates.pixel_count)
    mostly_held = 2 * units.held >= units.count
    for index, effect in enumerate(effects):
        mine = units.effect == index
        stale = mine & untraced[units.item] & mostly_held & (not faults.is_off(effect))
        gone = merged(work, index, np.flatnonzero(mine & untraced[units.item] & ~stale))
        begun = merged(work, index, np.flatnonzero(mine & partial[units.item] | stale))
        missing = _fill(frame, effect, _concerned(frame, effect, begun, faults), layers)
        left = [_concerned(frame, effect, _missing(gone, layers, effect, faults), faults), *missing]
        pixels = np.concatenate(left)
        if len(pixels):
            _fall_back(frame, effect, np.ascontiguousarray(pixels), layers, faults)


def _missing(pixels: np.ndarray, layers: LayerSet, effect: RayEffect, faults: Faults) -> np.ndarray:
    """Those of `pixels` that hold no value of an earlier frame; all of an effect that is switched off."""
    if faults.is_off(effect) or effect.writes.name not in layers.ages:
        return pixels
    return pixels[layers.masks[effect.writes.name][pixels] != MASK_HISTORY]


def _concerned(frame: Frame, effect: RayEffect, pixels: np.ndarray, faults: Faults) -> np.ndarray:
    """Those of `pixels` at which the effect would give a value."""
    if len(pixels) == 0:
        return pixels
    applies = faults.applies_at(effect, frame, pixels)
    return pixels if applies is None else pixels[applies]


def _fill(frame: Frame, effect: RayEffect, pixels: np.ndarray, layers: LayerSet) -> list[np.ndarray]:
    """Fill the gaps among `pixels` from neighbours that hold a value, of this frame or an earlier one; returns the pixels that
    have none."""
    name = effect.writes.name
    layer, mask = layers.arrays[name], layers.masks[name]
    object_id, width, height = frame.surfaces.object_id, frame.view.width, frame.view.height

    def fill(pixels: np.ndarray) -> np.ndarray:
        if fill_gaps(pixels, object_id, mask, width, height, MASK_TRACED, MASK_HISTORY, MASK_FILLED, layer):
            return pixels[mask[pixels] == MASK_NONE]
        return pixels[:0]

    return frame.workers.map(fill, [pixels[piece] for piece in chunks(len(pixels), CHUNK, frame.workers.threads)])


def _fall_back(frame: Frame, effect: RayEffect, pixels: np.ndarray, layers: LayerSet, faults: Faults) -> None:
    """The effect's fallback at `pixels`; also over what an effect traced there before it was switched off."""
    name = effect.writes.name
    layer, mask = layers.arrays[name], layers.masks[name]
    values, code = faults.fallback(effect, frame, pixels), MASK_FALLBACK
    if values is None:
        if not faults.is_off(effect) or not mask[pixels].any():
            return
        values, code = np.full((len(pixels), layer.shape[1]), effect.writes.clear, np.float32), MASK_NONE
    everywhere = np.ones(len(pixels), np.uint8)

    def put(piece: slice) -> None:
        scatter(pixels[piece], values[piece], everywhere[piece], np.uint8(code), layer, mask)

    frame.workers.map(put, chunks(len(pixels), CHUNK, frame.workers.threads))
