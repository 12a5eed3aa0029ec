"""Candidates: what could be traced in a frame - every visible object with every effect that applies to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phrt.frame import Frame
from phrt.interfaces.effect import RayEffect
from phrt.interfaces.heuristic import Candidates
from phrt.kernels.layers import sort_by_object
from phrt.kernels.primary import tile_order
from phrt.world import World


@dataclass(frozen=True)
class EffectScope:
    """Where an effect may act in a scene. applies (materials,), allowed and mandatory (N + 1,) bool; rays_per_pixel: Q."""

    applies: np.ndarray
    allowed: np.ndarray
    mandatory: np.ndarray
    rays_per_pixel: float

    @classmethod
    def of(cls, effect: RayEffect, world: World) -> EffectScope:
        switches = ["never", *(entry.effects.get(effect.name, "auto") for entry in world.scene.objects)]
        return cls(
            applies=effect.applies_to(world),
            allowed=np.array([switch != "never" for switch in switches]),
            mandatory=np.array([switch == "always" for switch in switches]),
            rays_per_pixel=effect.rays_per_pixel(world),
        )


@dataclass(frozen=True)
class WorkItems:
    """The candidates and their pixels. Item i of effect e owns pixels[e][first[i]:first[i] + pixel_count[i]], in tile order."""

    candidates: Candidates
    pixels: list[np.ndarray]
    first: np.ndarray


def find_work(frame: Frame, effects: list[RayEffect], scopes: list[EffectScope]) -> WorkItems:
    """Every (object, effect) with visible pixels."""
    gbuffer, world = frame.gbuffer, frame.world
    order = tile_order(gbuffer.width, gbuffer.height)
    count = len(order)

    def sort(scope: EffectScope) -> tuple[np.ndarray, np.ndarray]:
        start = np.empty(world.object_count + 2, np.int64)
        pixels = np.empty(count, np.int32)
        if not scope.applies.any():
            return np.zeros_like(start), pixels[:0]
        placed = sort_by_object(
            order, frame.surfaces.object_id, frame.surfaces.material_id, scope.applies, scope.allowed, start, pixels
        )
        return start, pixels[:placed]

    sorted_pixels = frame.workers.map(sort, scopes)
    none = np.zeros(0, np.int32)
    columns = [(none, none, none, np.zeros(0, np.float32), np.zeros(0, bool), np.zeros(0, np.int64))]
    for index, ((start, _), scope) in enumerate(zip(sorted_pixels, scopes, strict=True)):
        counts = np.diff(start)
        objects = np.flatnonzero(counts).astype(np.int32)
        columns.append(
            (
                objects,
                np.full(len(objects), index, np.int32),
                counts[objects].astype(np.int32),
                np.full(len(objects), scope.rays_per_pixel, np.float32),
                scope.mandatory[objects],
                start[objects],
            )
        )
    object_id, effect, pixel_count, ray_estimate, mandatory, first = (
        np.concatenate(column) for column in zip(*columns, strict=True)
    )
    candidates = Candidates(
        effect_names=tuple(effect.name for effect in effects),
        object_id=object_id,
        effect=effect,
        pixel_count=pixel_count,
        ray_estimate=ray_estimate,
        mandatory=mandatory,
        area=(pixel_count / np.float32(count)).astype(np.float32),
    )
    return WorkItems(candidates, [pixels for _, pixels in sorted_pixels], first)
