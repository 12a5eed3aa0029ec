"""Where statues and spheres stand in the atrium."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from phrt_plugins.loaders.atrium_plan import BAY, STEP, Plan
from phrt_plugins.loaders.shapes import Array, translation, turn_y


def place_statues(plan: Plan, count: int) -> list[Array]:
    """(4, 4) of `count` plinths: round the fountain first, then against the gallery walls, facing the courtyard."""
    x, z = plan.half_x / 9.0, plan.half_z / 6.0
    spots = [
        translation(3.9 * x, 0, -2.4 * z) @ turn_y(0.1),
        translation(-2.0 * x, 0, -3.4 * z) @ turn_y(0.5),
        translation(-4.6 * x, 0, 2.6 * z) @ turn_y(1.2),
        translation(-6.6 * x, 0, -3.4 * z) @ turn_y(0.4),
    ]
    gallery = [
        plan.bay_frame(side, bay, STEP) @ translation(0, 0, -BAY + 0.62)
        for bay in range(max(plan.bays_x, plan.bays_z))
        for side in (0, 2, 1, 3)
        if bay < plan.bays(side) and (bay + side) % 4 == 0
    ]
    return [*spots, *gallery][:count]


def place_spheres(plan: Plan, count: int) -> list[tuple[Array, float]]:
    """(4, 4) of the floor under `count` spheres, and their radii: a group in the courtyard, then further round."""
    return [(frame, radius) for _, (frame, radius) in zip(range(count), sphere_spots(plan), strict=False)]


def sphere_spots(plan: Plan) -> Iterator[tuple[Array, float]]:
    """Endless: chosen places first, then a spiral over the courtyard."""
    x, z = plan.half_x / 9.0, plan.half_z / 6.0
    for place_x, place_z, radius in (
        (2.2, 2.6, 0.55),
        (2.9, 1.1, 0.42),
        (5.2, -1.9, 0.45),
        (3.4, 2.3, 0.34),
        (0.2, 3.6, 0.4),
        (-1.6, 2.6, 0.45),
        (-3.6, 0.8, 0.5),
        (-2.9, -1.6, 0.38),
    ):
        yield translation(place_x * x, 0, place_z * z), radius
    for side, along in ((0, 0.8), (0, -1.1)):
        yield plan.side_frame(side) @ translation(along * BAY, STEP, -BAY + 0.7), 0.42
    for step in range(1_000_000):
        angle, away = step * 2.39996, 0.45 + 0.4 * ((step * 0.618) % 1.0)
        yield translation(plan.half_x * away * np.cos(angle), 0, plan.half_z * away * np.sin(angle)), 0.35
