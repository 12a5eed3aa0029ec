"""Domes: which way is which, and how much light they give."""

from __future__ import annotations

import numpy as np
import pytest
from scene_kit import Stage, ball

from phrt.environment import (
    Environment,
    harmonics,
    irradiance_harmonics,
    octahedral_directions,
    octahedral_from_equirectangular,
)
from phrt.model import Material
from phrt.scene import Dome

RED, GREEN, BLUE, WHITE = np.float32([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]])


def compass() -> np.ndarray:
    """(32, 64, 3): red ahead (-Z), green right (+X), blue behind (+Z), white left (-X), each a quarter wide."""
    picture = np.zeros((32, 64, 3), np.float32)
    picture[:, 24:40], picture[:, 40:56], picture[:, 8:24] = RED, GREEN, WHITE
    picture[:, 56:] = picture[:, :8] = BLUE
    return picture


def seen(dome: Dome, target: tuple[float, float, float]) -> np.ndarray:
    made = Stage().camera((0, 0, 0), target, fov_y=0.2)
    made.scene.dome = dome
    return made.render((3, 3)).image[1, 1]


@pytest.mark.parametrize(
    ("target", "color"), [((0, 0, -1), RED), ((1, 0, 0), GREEN), ((0, 0, 1), BLUE), ((-1, 0, 0), WHITE)]
)
def test_the_centre_column_is_ahead_and_the_right_half_is_to_the_right(
    target: tuple[float, float, float], color: np.ndarray
) -> None:
    np.testing.assert_allclose(seen(Dome((2.0, 2.0, 2.0), compass()), target), color * 2, atol=1e-5)


def test_the_top_row_is_up() -> None:
    picture = np.zeros((32, 64, 3), np.float32)
    picture[:16] = GREEN
    np.testing.assert_allclose(seen(Dome((1, 1, 1), picture), (0, 1, 0)), GREEN, atol=1e-5)
    np.testing.assert_allclose(seen(Dome((1, 1, 1), picture), (0, -1, 0)), 0, atol=1e-5)


def test_rotation_turns_the_dome_about_y() -> None:
    """Right-handed: a quarter turn takes what was ahead (-Z) to the left (-X)."""
    dome = Dome((1, 1, 1), compass(), rotation=np.pi / 2)
    np.testing.assert_allclose(seen(dome, (-1, 0, 0)), RED, atol=1e-5)
    np.testing.assert_allclose(seen(dome, (0, 0, -1)), GREEN, atol=1e-5)


def test_octahedral_directions_are_unit_and_cover_the_sphere_evenly() -> None:
    directions = octahedral_directions(64).reshape(-1, 3)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1)
    np.testing.assert_allclose(directions.mean(axis=0), 0, atol=1e-12)
    assert len(np.unique(directions.round(9), axis=0)) == 64 * 64


def test_a_mirror_ball_shows_the_dome_it_reflects() -> None:
    """In the middle of a mirror ball one sees what is behind the eye."""
    made = (
        Stage()
        .add("/ball", ball(0.5), Material(metallic=1.0, roughness=0.0))
        .camera((0, 0, 3), (0.001, 0.002, 0), fov_y=0.05)
    )
    made.scene.dome = Dome((1, 1, 1), compass())
    np.testing.assert_allclose(made.render((3, 3)).image[1, 1], BLUE, atol=1e-4)


def test_irradiance_of_a_constant_dome_is_its_radiance() -> None:
    coefficients = irradiance_harmonics(np.ones((64, 64, 3), np.float32) * [0.2, 0.5, 1.0])
    normals = octahedral_directions(8).reshape(-1, 3)
    found = harmonics(normals) @ coefficients
    np.testing.assert_allclose(found, np.broadcast_to([0.2, 0.5, 1.0], found.shape), rtol=2e-3)


def test_irradiance_of_a_picture_is_the_cosine_weighted_mean_of_its_light() -> None:
    # Ramamoorthi and Hanrahan: nine coefficients are within 1 % of the mean for smooth light.
    directions = octahedral_directions(128)
    picture = (1.5 + directions @ [0.5, 1.0, -0.7])[..., None] ** 2 * [1.0, 0.5, 0.2]
    coefficients = irradiance_harmonics(picture.astype(np.float32))
    rng = np.random.default_rng(1)
    light = rng.normal(size=(200000, 3))
    light /= np.linalg.norm(light, axis=1, keepdims=True)
    radiance = (1.5 + light @ [0.5, 1.0, -0.7]) ** 2
    for normal in ([0.0, 1.0, 0.0], [0.6, 0.0, -0.8], [0.0, -1.0, 0.0]):
        weight = np.maximum(light @ normal, 0)
        expected = (radiance * weight).sum() / weight.sum() * np.array([1.0, 0.5, 0.2])
        np.testing.assert_allclose((harmonics(np.array([normal])) @ coefficients)[0], expected, rtol=0.02)


def test_a_picture_of_one_pixel_is_constant() -> None:
    sharp = octahedral_from_equirectangular(np.full((1, 1, 3), 0.3, np.float32), 0.0)
    np.testing.assert_allclose(sharp, 0.3, rtol=1e-6)


def test_a_constant_dome_takes_no_maps() -> None:
    environment = Environment.from_dome(Dome((0.1, 0.2, 0.3), visible=False))
    assert environment.sharp.shape == (1, 1, 3)
    assert not environment.visible
