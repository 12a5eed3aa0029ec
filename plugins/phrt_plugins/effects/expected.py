"""How many shadow rays a point of a scene is likely to take: what an effect expects before it has traced anything."""

from __future__ import annotations

from typing import cast

import numpy as np

from phrt.lights import DIRECTIONAL, RECT, SPOT
from phrt.world import World

MOST_POINTS = 4096
LEAST_SHARE = 0.01
"""A light that reaches none of the points looked at is still expected at this share of them."""


def light_shares(world: World) -> np.ndarray:
    """(2, L) float64: at which share of the scene's points each light is asked for, as they are within its range and its cone; and
    in the second row, as it is in front of them, too. The points are vertices, evenly spread over the list of them, so that what
    is detailed counts for more.

    Where a scene has many lamps that each light only what is near, far fewer than all are asked for at a point; an expectation
    of all of them would be so high that rules that take what fits would never begin.

    Of a world it is found once, so that every run in it begins with the same expectation, wherever things have moved to.
    """
    if "light shares" not in world.kept:
        world.kept["light shares"] = _shares(world)
    return cast(np.ndarray, world.kept["light shares"])


def shadow_rays(world: World, samples: int = 1) -> float:
    """Expected shadow rays of a point that is seen: one to each light within whose range it may be, `samples` to those that have an
    extent. What is seen is mostly what is lit, so that more lights may be in front of it than of any point."""
    lights = world.lights
    extended = (lights["radius"] > 0) | (lights["kind"] == RECT) | (lights["tan_half_angle"] > 0)
    return float((light_shares(world)[0] * np.where(extended, max(samples, 1), 1)).sum())


def shadow_rays_of_hit(world: World) -> float:
    """Expected shadow rays of a point that a ray meets, anywhere: one to each light in front of it."""
    return float(light_shares(world)[1].sum())


def _shares(world: World) -> np.ndarray:
    step = max(-(-len(world.positions) // MOST_POINTS), 1)
    points, normals = world.positions[::step].astype(np.float64), world.normals[::step].astype(np.float64)
    shares = np.ones((2, len(world.lights)))
    for column, light in enumerate(world.lights if len(points) else ()):
        reached, in_front = _reached(light, points, normals)
        shares[:, column] = reached.mean(), (reached & in_front).mean()
    return np.maximum(shares, LEAST_SHARE)


def _reached(light: np.void, points: np.ndarray, normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(p,) bool each: are `points` (p, 3) within range and cone of `light`, and is it in front of them, whose normals are `normals`
    (p, 3)?"""
    shines = light["direction"].astype(np.float64)
    if light["kind"] == DIRECTIONAL:
        return np.ones(len(points), bool), normals @ shines < 0
    way = points - light["position"]
    distance = np.sqrt((way * way).sum(axis=1))
    reached = distance * float(light["inverse_range"]) < 1
    if light["kind"] == SPOT:
        reached &= way @ shines > float(light["cos_outer"]) * distance
    if light["kind"] == RECT:
        reached &= way @ shines > 0
    return reached, (way * normals).sum(axis=1) < 0
