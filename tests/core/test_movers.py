"""Bounding spheres of what moved: they hold it, before and after, and stay few."""

from __future__ import annotations

import numpy as np
import pytest
from scene_kit import LAMBERT, Stage, at, ball, box, mesh_of, turned

from phrt.movers import MOST_SPHERES, BoundingSpheres, enclosing, merged
from phrt.world import World


def world_of_two() -> World:
    made = Stage().add("/box", box(1, 2, 3), LAMBERT, at(1, 0, 0)).add("/ball", ball(0.5, 2), LAMBERT)
    return World(made.add("/nothing", mesh_of(np.zeros((0, 3)), []), LAMBERT).scene)


def inside(points: np.ndarray, sphere: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(points - sphere[:3], axis=1) <= sphere[3])


def test_a_sphere_holds_its_object_wherever_it_stands() -> None:
    world = world_of_two()
    sheared = at(2, 1, 0) @ turned("x", 40) @ np.diag([3.0, 0.5, 1.0, 1.0]) @ turned("z", 30)
    for matrix in (np.eye(4), at(5, -2, 1), sheared, np.diag([-2.0, 1, 1, 1])):
        sphere = BoundingSpheres(world).of(1, matrix)
        rows = slice(world.first_vertex[1], world.first_vertex[1] + world.vertex_count[1])
        assert inside(world.local_positions[rows] @ matrix[:3, :3].T + matrix[:3, 3], sphere).all()
    np.testing.assert_allclose(BoundingSpheres(world).of(2, at(0, 4, 0)), [0, 4, 0, 0.5], rtol=1e-3)


def test_a_small_step_is_one_sphere_a_large_one_two_and_nothing_none() -> None:
    spheres, after = BoundingSpheres(world_of_two()), np.stack([np.eye(4)] * 4)
    before = after.copy()
    after[2] = at(0.1, 0, 0)
    (one,) = spheres.swept(np.array([2]), before, after)
    assert one[3] == pytest.approx(0.55, rel=1e-3)
    after[2] = at(4, 0, 0)
    assert len(spheres.swept(np.array([2]), before, after)) == 2
    assert spheres.swept(np.array([3]), before, after).shape == (0, 4)
    assert spheres.swept(np.array([], int), before, after).shape == (0, 4)


def test_many_spheres_are_merged_into_few_that_hold_them() -> None:
    rng = np.random.default_rng(3)
    many = np.concatenate([rng.uniform(-9, 9, (200, 3)), rng.uniform(0.1, 1.0, (200, 1))], axis=1)
    few = merged(many)
    assert len(few) == MOST_SPHERES
    for sphere in many:
        gap = np.linalg.norm(few[:, :3] - sphere[:3], axis=1) + sphere[3] - few[:, 3]
        assert gap.min() <= 1e-9
    np.testing.assert_array_equal(merged(many[:MOST_SPHERES]), many[:MOST_SPHERES])
    around = enclosing(many)
    assert (np.linalg.norm(many[:, :3] - around[:3], axis=1) + many[:, 3] <= around[3] + 1e-9).all()
