"""History: what effects gave in the previous frame, found again where the same surface is seen, and nothing that moved can have
changed it.

Only references to the previous frame's arrays are kept; `BufferPool` leaves them alone as long. What was taken over is
itself taken over in the next frame, with its age and with the place where it was traced, so that it does not drift.
Source: Walter et al. 1999 (the render cache); Scherzer et al. 2012 (reverse reprojection).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from phrt.buffers import BufferPool
from phrt.camera import CameraView
from phrt.faults import Faults
from phrt.faults.declared import checked_applies
from phrt.frame import MASK_HISTORY, MASK_NONE, MASK_TRACED, Frame
from phrt.interfaces.effect import HistoryRule, RayEffect
from phrt.kernels.history import TILE, carry, choose_values, forget_crossed, match_pixels
from phrt.layers import LayerSet
from phrt.lights import DIRECTIONAL, RECT
from phrt.lightwise import OneLight
from phrt.movers import BoundingSpheres
from phrt.workers import chunks
from phrt.world import World

BAND_PIXELS = 32768
"""Pixels a thread takes at a time, in whole rows of tiles."""


@dataclass(frozen=True)
class _Trail:
    """Of one layer: age (P,) uint8 frames, and offset (P, 2) int8 of the places where the values were traced, see `carry`."""

    age: np.ndarray
    offset: np.ndarray


@dataclass(frozen=True)
class _Past:
    """What is kept of a frame: arrays (P, ...) by reference."""

    view: CameraView
    object_id: np.ndarray
    material_id: np.ndarray
    position: np.ndarray
    normal: np.ndarray
    direct: np.ndarray
    object_matrix: np.ndarray
    lights: bytes
    layers: LayerSet
    trails: dict[str, _Trail]


@dataclass(frozen=True)
class _Moves:
    """What moved since. moved (N + 1,) bool; lights: did any change?; casters (M, 4) float32 bounding spheres, before and after."""

    moved: np.ndarray
    lights: bool
    casters: np.ndarray


class History:
    """The previous frame's layers of `effects`, as far as they say how long their values hold (`RayEffect.history`)."""

    def __init__(self, world: World, effects: Sequence[RayEffect], buffers: BufferPool) -> None:
        self._effects = [effect for effect in effects if effect.history is not None]
        self._rules = {effect.writes.name: effect.history for effect in effects if effect.history is not None}
        self._first_light = {effect.writes.name: _first_light(effect) for effect in effects}
        self._one_light = {effect.writes.name for effect in effects if isinstance(effect, OneLight)}
        self._applies = {effect.writes.name: checked_applies(effect, world) for effect in effects}
        self._clear = {effect.writes.name: effect.writes.clear for effect in effects}
        self._spheres = BoundingSpheres(world)
        self._buffers = buffers
        self._past: _Past | None = None
        self._trails: dict[str, _Trail] = {}
        finite = [rule.max_age for rule in self._rules.values() if np.isfinite(rule.parallax)]
        self._eyes: deque[np.ndarray] = deque(maxlen=max(finite, default=0))

    def reproject(self, frame: Frame, layers: LayerSet, faults: Faults) -> dict[str, np.ndarray]:
        """Fill the cleared `layers` with what holds of the previous frame: there the mask becomes MASK_HISTORY.

        Returns by layer name (P,) uint8 how many frames ago those values were traced, 255 for more; elsewhere it is arbitrary.
        Layers without any are left out, as are those of effects that failed. Call `keep` when the frame is done.
        """
        self._trails = {}
        past = self._past
        if past is None:
            return {}
        moves = self._moves(past, frame.world)
        names = [
            effect.writes.name
            for effect in self._effects
            if _may_hold(self._rules[effect.writes.name], moves) and not faults.is_off(effect)
        ]
        if not names:
            return {}
        count = len(frame.surfaces.object_id)
        trails = {
            name: _Trail(self._buffers.take((count,), np.uint8), self._buffers.take((count, 2), np.int8))
            for name in names
        }
        taken = self._carry_all(frame, past, moves, layers, trails)
        self._trails = {name: trail for name, trail in trails.items() if taken[name]}
        return {name: trail.age for name, trail in self._trails.items()}

    def keep(self, frame: Frame, layers: LayerSet, *, holds: bool = True) -> None:
        """Remember `frame`, whose layers are done, in place of the one before. `reproject` need not have been called for it.

        holds: was anything traced in it, or taken over from earlier frames? Else there is nothing to take over from it.
        """
        surfaces, world = frame.surfaces, frame.world
        self._eyes.appendleft(eye_row(frame.view))
        trails, self._trails = self._trails, {}
        if not holds:
            self._past = None
            return
        self._past = _Past(
            view=frame.view,
            object_id=surfaces.object_id,
            material_id=surfaces.material_id,
            position=surfaces.position,
            normal=surfaces.geometric_normal,
            direct=frame.direct,
            object_matrix=world.object_matrix,
            lights=world.lights.tobytes(),
            layers=layers,
            trails=trails,
        )

    def _moves(self, past: _Past, world: World) -> _Moves:
        moved = (world.object_matrix != past.object_matrix).any(axis=(1, 2))
        casters = np.flatnonzero(moved & world.object_casts_shadow)
        return _Moves(
            moved=moved,
            lights=world.lights.tobytes() != past.lights,
            casters=self._spheres.swept(casters, past.object_matrix, world.object_matrix),
        )

    def _ends(self, name: str, lights: np.ndarray) -> np.ndarray:
        """`way_ends` of the lights that layer `name` is about."""
        first, only = self._first_light[name], name in self._one_light
        return way_ends(self._rules[name], lights[first : first + 1] if only else lights)

    def _carry_all(
        self, frame: Frame, past: _Past, moves: _Moves, layers: LayerSet, trails: dict[str, _Trail]
    ) -> dict[str, int]:
        """Reproject band by band, every layer in turn while the cache holds what they share. Pixels taken over, by layer."""
        here, view, width = frame.surfaces, frame.view, frame.view.width
        count = len(here.object_id)
        source, slip = self._buffers.take((count,), np.int32), self._buffers.take((count, 2))
        chosen = self._buffers.take((count,), np.int32)
        clip = past.view.clip_from_world().astype(np.float32)
        eyes = np.array([eye_row(view), *self._eyes], np.float32)
        spread = np.float32(view.pixel_spread)
        footprint = np.array([spread, 0.0] if view.orthographic else [0.0, spread], np.float32)
        moved = moves.moved.astype(np.uint8)
        ends = {name: self._ends(name, frame.world.lights) for name in trails}
        nothing = _Trail(np.empty(0, np.uint8), np.empty((0, 2), np.int8))

        def band(tiles: slice) -> list[int]:
            first, last = tiles.start * TILE * width, min(tiles.stop * TILE, view.height) * width
            match_pixels(
                first, last, here.object_id, here.material_id, here.position, here.geometric_normal, here.depth,
                past.object_id, past.material_id, past.position, past.normal, clip, past.view.width, past.view.height,
                footprint, eyes[0], moved, source, slip,
            )  # fmt: skip
            taken = []
            for name, trail in trails.items():
                rule, layer, mask = self._rules[name], layers.arrays[name], layers.masks[name]
                before = past.trails.get(name, nothing)
                choose_values(
                    first, last, source, slip, here.object_id, here.material_id, here.position, here.geometric_normal,
                    here.depth, past.object_id, past.material_id, past.position, past.normal, past.view.width,
                    footprint, self._applies[name], MASK_TRACED, MASK_HISTORY, past.layers.masks[name],
                    before.offset, chosen, trail.offset,
                )  # fmt: skip
                number = carry(
                    first, last, chosen, here.position, here.roughness, self._first_light[name], frame.direct, past.direct,
                    eyes, np.float32(rule.parallax), rule.max_age, MASK_TRACED, MASK_HISTORY, past.layers.arrays[name],
                    past.layers.masks[name], before.age, layer, mask, trail.age,
                )  # fmt: skip
                if number and len(moves.casters) and len(ends[name]):
                    number -= forget_crossed(
                        first, last, width, here.position, here.geometric_normal, here.depth, footprint,
                        eyes[0], ends[name], moves.casters, MASK_HISTORY, MASK_NONE, np.float32(self._clear[name]),
                        layer, mask,
                    )  # fmt: skip
                taken.append(number)
            return taken

        tiles = -(-view.height // TILE)
        pieces = chunks(tiles, max(BAND_PIXELS // (TILE * width), 1), frame.workers.threads)
        totals = np.sum(frame.workers.map(band, pieces), axis=0)
        return {name: int(total) for name, total in zip(trails, totals, strict=True)}


def _first_light(effect: RayEffect) -> int:
    """Which light the first component of its layer is about; -1 when it is about none."""
    if isinstance(effect, OneLight):
        return effect.light
    return -1 if effect.writes.components else 0


def _may_hold(rule: HistoryRule, moves: _Moves) -> bool:
    """Can any value be left after `moves`?"""
    if rule.lights and moves.lights:
        return False
    return rule.movers != "any" or not moves.moved.any()


def eye_row(view: CameraView) -> np.ndarray:
    """(4,) float32: the eye and 1, or the direction towards it and 0 when orthographic."""
    matrix = view.world_from_view
    row = [*matrix[:3, 2], 0.0] if view.orthographic else [*matrix[:3, 3], 1.0]
    return np.array(row, np.float32)


def way_ends(rule: HistoryRule, lights: np.ndarray) -> np.ndarray:
    """(K, 5) float32: where the rays of a value go to, as `crossed` takes it."""
    if rule.movers == "near":
        return np.array([[0.0, 0.0, 0.0, -1.0, rule.radius]], np.float32)
    if rule.movers == "any":
        return np.empty((0, 5), np.float32)
    casting = lights[lights["casts_shadow"] != 0]
    ends = np.empty((len(casting), 5), np.float32)
    ends[:, :3], ends[:, 3], ends[:, 4] = casting["position"], 1.0, casting["radius"]
    sun, area = casting["kind"] == DIRECTIONAL, casting["kind"] == RECT
    ends[sun, :3], ends[sun, 3], ends[sun, 4] = -casting["direction"][sun], 0.0, casting["tan_half_angle"][sun]
    sides = np.stack([casting["half_u"], casting["half_v"]], axis=1).astype(np.float64)
    ends[area, 4] = np.linalg.norm(np.linalg.norm(sides, axis=2), axis=1)[area]
    return ends
