"""Rays with meaning: hits that see through holes, visibility of lights, and the light that comes back along a ray."""

from __future__ import annotations

import numpy as np

from phrt.conventions import NO_PRIMITIVE
from phrt.frame import Frame
from phrt.kernels.arrays import SurfaceArrays, empty_surfaces
from phrt.kernels.bounce import shade_and_spawn
from phrt.kernels.cutout import holes
from phrt.kernels.light import direct_light
from phrt.kernels.onward import continued
from phrt.kernels.shadow import apply_occlusion, shadow_rays
from phrt.kernels.surface import surface
from phrt.rays import HitBatch, RayBatch

MAX_LAYERS = 64
"""Holes a ray may pass before it counts as a miss."""
DROP_WEIGHT = np.float32(1.0 / 256.0)
"""Rays that carry less than this share of a pixel, one step of an 8-bit picture, are not followed."""

_NOWHERE = np.zeros(3, np.float32)


def nearest(frame: Frame, rays: RayBatch) -> HitBatch:
    """Closest hits, holes of alpha-masked surfaces passed."""
    hits = frame.tracer.closest_hit(rays)
    if frame.world.has_cutouts:
        pass_holes(frame, rays, hits, shadow=False)
    return hits


def blocked(frame: Frame, rays: RayBatch) -> np.ndarray:
    """(n,) bool: does a shadow caster lie on the ray? Holes of masked surfaces, and blended ones below half, let it pass."""
    if not frame.world.has_cutouts:
        return frame.tracer.occluded(rays)
    hits = frame.tracer.closest_hit(rays)
    pass_holes(frame, rays, hits, shadow=True)
    return hits.primitive != NO_PRIMITIVE


def pass_holes(frame: Frame, rays: RayBatch, hits: HitBatch, *, shadow: bool) -> None:
    """Trace on behind `hits` on holes, in place, until none is left; those of shadow rays also behind what casts none."""
    active = np.arange(len(rays), dtype=np.int32)
    casts = frame.world.object_casts_shadow
    for _ in range(MAX_LAYERS):
        open_ = np.zeros(len(active), np.uint8)
        found = HitBatch(hits.distance[active], hits.primitive[active], hits.barycentric[active])
        if not holes(found.primitive, found.barycentric, frame.geometry, frame.materials, casts, shadow, open_):
            return
        active = active[open_ != 0]
        onward, travelled = continued(rays, hits.distance, active)
        behind = frame.tracer.closest_hit(onward)
        hits.distance[active] = behind.distance + travelled
        hits.primitive[active] = behind.primitive
        hits.barycentric[active] = behind.barycentric
    hits.distance[active] = np.inf
    hits.primitive[active] = NO_PRIMITIVE


def light_visibility(
    frame: Frame,
    surfaces: SurfaceArrays,
    rows: np.ndarray,
    seeds: np.ndarray,
    direct: np.ndarray,
    samples: int,
    coherent: bool = False,
    only_light: int | None = None,
) -> tuple[np.ndarray, int]:
    """(n, L) float32 share of every light that reaches points `rows` (n,) int32 of `surfaces`, and the rays it took.

    samples: rays to each light that has an extent; 0 aims one at its centre (hard shadows). Lights that `direct`
    (rows, L, 3) says bring nothing get 1. coherent: the points are neighbours, in tile order (see `RayBatch`).
    only_light: number of the one light that is asked for.
    """
    lights = frame.world.lights
    if only_light is not None:
        lights = lights.copy()
        lights["casts_shadow"][np.arange(len(lights)) != only_light] = 0
    visibility = np.ones((len(rows), len(lights)), np.float32)
    capacity = len(rows) * (len(lights) if only_light is None else 1) * max(samples, 1)
    if capacity == 0:
        return visibility, 0
    origin, direction = np.empty((capacity, 3), np.float32), np.empty((capacity, 3), np.float32)
    t_max = np.empty(capacity, np.float32)
    ray_row, ray_light = np.empty(capacity, np.int32), np.empty(capacity, np.int32)
    count = shadow_rays(
        rows, seeds, surfaces, direct, lights, samples, frame.seed, origin, direction, t_max, ray_row, ray_light
    )
    if count:
        answer = blocked(frame, RayBatch(origin[:count], direction[:count], t_max[:count], coherent))
        apply_occlusion(answer, ray_row[:count], ray_light[:count], lights, samples, visibility)
    return visibility, count


def gather(
    frame: Frame,
    origin: np.ndarray,
    direction: np.ndarray,
    weight: np.ndarray,
    target: np.ndarray,
    medium: np.ndarray,
    path_length: np.ndarray,
    targets: int,
    max_depth: int,
) -> tuple[np.ndarray, int]:
    """Light (targets, 3) that comes back along n rays, and the rays it took: Whitted's recursion, one depth at a time.

    origin, direction, weight (n, 3); target (n,) int32, which sum a ray adds to; medium (n,) int32, material row it travels
    in or 0; path_length (n,) metres from the eye. max_depth: bounces after the first hit. Hits are lit with shadows.
    """
    radiance = np.zeros((targets, 3), np.float32)
    hidden = np.zeros(frame.world.object_count + 1, np.uint8)
    lights = frame.world.lights
    total = 0
    for depth in range(max_depth + 1):
        count = len(target)
        if count == 0:
            break
        coherent = depth == 0
        hits = nearest(frame, RayBatch(origin, direction, np.full(count, np.inf, np.float32), coherent))
        total += count
        path_length = path_length + hits.distance
        points = empty_surfaces(count)
        rows = np.arange(count, dtype=np.int32)
        # An orthographic view's rays are as wide everywhere as its pixels.
        spread = frame.view.pixel_spread
        cone = np.array([spread, 0.0] if frame.view.orthographic else [0.0, spread], np.float32)
        surface(
            direction, path_length, hits.primitive, hits.barycentric, frame.geometry, frame.materials,
            _NOWHERE, _NOWHERE, cone, hidden, False, rows, rows, points, np.empty(count, np.uint8),
        )  # fmt: skip
        direct = np.empty((count, len(lights), 3), np.float32)
        direct_light(0, count, points, frame.materials.materials, lights, direction, False, direct)
        visibility, shadow_count = light_visibility(frame, points, rows, target.astype(np.uint32), direct, 0)
        total += shadow_count
        capacity = 3 * count  # each hit may be passed, reflected and refracted
        onward = [np.empty((capacity, 3), np.float32) for _ in range(3)]
        next_path = np.empty(capacity, np.float32)
        next_target, next_medium = np.empty(capacity, np.int32), np.empty(capacity, np.int32)
        spawned = shade_and_spawn(
            direction, hits.distance, path_length, weight, target, medium, points, direct, visibility, frame.geometry,
            frame.materials.materials, frame.environment, depth == max_depth, DROP_WEIGHT,
            onward[0], onward[1], next_path, onward[2], next_target, next_medium, radiance,
        )  # fmt: skip
        origin, direction, weight = (array[:spawned] for array in onward)
        path_length, target, medium = next_path[:spawned], next_target[:spawned], next_medium[:spawned]
    return radiance, total
