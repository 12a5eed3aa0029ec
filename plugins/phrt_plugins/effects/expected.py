"""How many shadow rays a point of a scene is likely to take: what an effect expects before it has traced anything."""

from __future__ import annotations

from typing import cast

import numpy as np

from phrt.lights import DIRECTIONAL, RECT, SPOT
from phrt.world import World

MOST_POINTS = 4096
LEAST_SHARE = 0.01
"""A light that no point looked at faces is still expected at this share of them."""


def light_shares(world: World) -> np.ndarray:
    """(L,) float64: at which share of the scene's points each light is asked for, as it is in front of them, within its range
    and its cone. The points are vertices, evenly spread over the list of them, so that what is detailed counts for more.

    Where a scene has many lamps that each light only what is near, far fewer than all are asked for at a point; an expectation
    of all of them would be so high that rules that take what fits would never begin.

    Of a world it is found once, so that every run in it begins with the same expectation, wherever things have moved to.
    """
    if "light shares" not in world.kept:
        world.kept["light shares"] = _shares(world)
    return cast(np.ndarray, world.kept["light shares"])


def _shares(world: World) -> np.ndarray:
    step = max(-(-len(world.positions) // MOST_POINTS), 1)
    points, normals = world.positions[::step].astype(np.float64), world.normals[::step].astype(np.float64)
    if not len(points):
        return np.ones(len(world.lights))
    shares = [_faces(light, points, normals).mean() for light in world.lights]
    return np.maximum(np.array(shares, np.float64), LEAST_SHARE)


def shadow_rays(world: World, samples: int = 1) -> float:
    """Expected shadow rays of a point: one to each light it asks for, `samples` to those that have an extent."""
    lights = world.lights
    extended = (lights["radius"] > 0) | (lights["kind"] == RECT) | (lights["tan_half_angle"] > 0)
    return float((light_shares(world) * np.where(extended, max(samples, 1), 1)).sum())


def _faces(light: np.void, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(p,) bool: may `light` reach `points` (p, 3) whose normals are `normals` (p, 3)?"""
    shines = light["direction"].astype(np.float64)
    if light["kind"] == DIRECTIONAL:
        return normals @ shines < 0
    way = points - light["position"]
    distance = np.sqrt((way * way).sum(axis=1))
    reached = (way * normals).sum(axis=1) < 0
    if light["inverse_range"] > 0:
        reached &= distance * float(light["inverse_range"]) < 1
    if light["kind"] == SPOT:
        reached &= way @ shines > float(light["cos_outer"]) * distance
    if light["kind"] == RECT:
        reached &= way @ shines > 0
    return reached
