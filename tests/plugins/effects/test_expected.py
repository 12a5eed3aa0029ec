"""How many shadow rays are expected: to lights that are in front of what the scene is made of, in range, and shine that way."""

import numpy as np
import pytest
from scene_kit import Stage, at, ball, floor, turned

from phrt.world import World
from phrt_plugins.effects.expected import LEAST_SHARE, light_shares, shadow_rays, shadow_rays_of_hit

DOWN = turned("x", -90.0)


def stage() -> Stage:
    """A floor of 10 m around the origin, facing up: two triangles, six vertices, one of them at (5, 0, 5)."""
    made = Stage()
    made.add("/floor", floor())
    return made


@pytest.mark.parametrize(
    ("kind", "matrix", "values", "share"),
    [
        ("point", at(0, 3, 0), {}, 1.0),
        ("point", at(0, -3, 0), {}, LEAST_SHARE),
        ("point", at(0, 3, 0), {"range": 4.0}, LEAST_SHARE),
        ("point", at(5, 3, 5), {"range": 4.0}, 1 / 6),
        ("directional", DOWN, {}, 1.0),
        ("directional", turned("x", 90.0), {}, LEAST_SHARE),
        ("spot", at(5, 3, 5) @ DOWN, {"outer_angle": 0.5}, 1 / 6),
        ("rect", at(0, 3, 0) @ DOWN, {}, 1.0),
        ("rect", at(0, 3, 0) @ turned("x", 90.0), {}, LEAST_SHARE),
    ],
)
def test_a_light_is_expected_where_it_can_shine(kind: str, matrix: np.ndarray, values: dict, share: float) -> None:
    world = World(stage().light(kind, matrix, **values).scene)
    assert light_shares(world)[1].tolist() == pytest.approx([share])


def test_half_of_a_ball_faces_a_light_far_away() -> None:
    made = Stage()
    made.add("/ball", ball(0.5, 4))
    world = World(made.light("point", at(0, 1e4, 0)).scene)
    assert light_shares(world)[1, 0] == pytest.approx(0.5, abs=0.03)
    assert shadow_rays_of_hit(world) == pytest.approx(0.5, abs=0.03)


@pytest.mark.parametrize(
    ("kind", "matrix", "values", "share"),
    [
        ("point", at(0, -3, 0), {}, 1.0),
        ("point", at(5, -3, 5), {"range": 4.0}, 1 / 6),
        ("directional", turned("x", 90.0), {}, 1.0),
        ("rect", at(0, 3, 0) @ turned("x", 90.0), {}, LEAST_SHARE),
    ],
)
def test_what_is_seen_may_be_in_front_of_any_light_in_range(
    kind: str, matrix: np.ndarray, values: dict, share: float
) -> None:
    world = World(stage().light(kind, matrix, **values).scene)
    assert shadow_rays(world) == pytest.approx(share)


def test_lights_with_an_extent_take_their_samples() -> None:
    world = World(stage().light("sphere", at(0, 3, 0), radius=0.2).light("point", at(0, 4, 0)).scene)
    assert shadow_rays(world) == pytest.approx(2.0)
    assert shadow_rays(world, 8) == pytest.approx(9.0)


def test_a_scene_without_lights_expects_none() -> None:
    assert shadow_rays(World(stage().scene)) == 0.0
