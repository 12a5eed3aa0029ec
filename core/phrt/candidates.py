"""Candidates: what could be traced in a frame - every visible object with every effect that applies to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phrt.experience import Experience
from phrt.frame import Frame
from phrt.interfaces.effect import RayEffect
from phrt.interfaces.heuristic import Candidates
from phrt.kernels.layers import count_objects, sort_by_object
from phrt.kernels.primary import tile_order
from phrt.relevance import ObjectLetters, ObjectSight, item_cost, item_relevance
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


def find_work(
    frame: Frame,
    effects: list[RayEffect],
    scopes: list[EffectScope],
    sight: ObjectSight,
    experience: Experience,
    persistence: float,
) -> WorkItems:
    """Every (object, effect) with visible pixels, and the letters that heuristics choose by."""
    world, surfaces = frame.world, frame.surfaces
    order = tile_order(frame.gbuffer.width, frame.gbuffer.height)
    count = len(order)

    def sort(scope: EffectScope) -> tuple[np.ndarray, np.ndarray]:
        start = np.zeros(world.object_count + 2, np.int64)
        pixels = np.empty(count, np.int32)
        if not scope.applies.any():
            return start, pixels[:0]
        placed = sort_by_object(
            order, surfaces.object_id, surfaces.material_id, scope.applies, scope.allowed, start, pixels
        )
        return start, pixels[:placed]

    visible_pixels = np.zeros(world.object_count + 1, np.int64)
    count_objects(surfaces.object_id, visible_pixels)
    sorted_pixels = frame.workers.map(sort, scopes)
    # The items: objects with pixels, effect by effect.
    starts = np.array([start for start, _ in sorted_pixels], np.int64).reshape(len(scopes), world.object_count + 2)
    counts = np.diff(starts, axis=1)
    effect, object_id = (index.astype(np.int32) for index in np.nonzero(counts))
    pixel_count = counts[effect, object_id].astype(np.int32)
    first = starts[effect, object_id]
    candidates = _with_letters(
        effects, scopes, object_id, effect, pixel_count,
        sight.letters(world, frame.view, visible_pixels), experience, persistence,
    )  # fmt: skip
    return WorkItems(candidates, [pixels for _, pixels in sorted_pixels], first)


def _with_letters(
    effects: list[RayEffect],
    scopes: list[EffectScope],
    object_id: np.ndarray,
    effect: np.ndarray,
    pixel_count: np.ndarray,
    objects: ObjectLetters,
    experience: Experience,
    persistence: float,
) -> Candidates:
    """The candidates: equations (1) to (3) of Andrade et al. 2014 for every item."""
    ray_estimate = np.array([scope.rays_per_pixel for scope in scopes], np.float32)[effect]
    was_selected = experience.was_selected[object_id, effect]
    visible, importance = objects.visibility[object_id], objects.importance_factor[object_id]
    mandatory = np.array([scope.mandatory for scope in scopes], bool).reshape(len(scopes), len(objects.area))
    return Candidates(
        effect_names=tuple(entry.name for entry in effects),
        object_id=object_id,
        effect=effect,
        pixel_count=pixel_count,
        mandatory=mandatory[effect, object_id],
        predicted_cost=experience.predict_rays(object_id, effect, pixel_count),
        ray_estimate=ray_estimate,
        area=objects.area[object_id],
        center_closeness=objects.center_closeness[object_id],
        distance=objects.distance[object_id],
        visibility=visible,
        cost=item_cost(visible, ray_estimate),
        importance_factor=importance,
        was_selected=was_selected,
        relevance=item_relevance(was_selected, persistence, visible, importance),
        persistence=persistence,
    )
