"""Dome lookups and filtering, against plain numpy twins."""

from __future__ import annotations

from functools import cache

import numba
import numpy as np
import pytest
from kernel_kit import dome_radiance, octahedral_lookup, unit

from phrt.environment import ROUGHNESS_LEVELS, Environment, harmonics, octahedral_directions
from phrt.kernels.arrays import EnvironmentArrays
from phrt.kernels.environment import environment_radiance, irradiance, prefilter
from phrt.scene import Dome


@numba.njit
def radiance_of(sharp: np.ndarray, blurred: np.ndarray, d: np.ndarray, roughness: np.ndarray, out: np.ndarray) -> None:
    for i in range(len(d)):
        out[i] = np.array(environment_radiance(sharp, blurred, d[i, 0], d[i, 1], d[i, 2], roughness[i]))


@cache
def picture_dome() -> Environment:
    pixels = np.random.default_rng(3).uniform(0, 2, (24, 48, 3)).astype(np.float32)
    return Environment.from_dome(Dome((1.0, 0.5, 0.25), pixels))


def looked_up(dome: Environment, directions: np.ndarray, roughness: np.ndarray) -> np.ndarray:
    out = np.empty((len(directions), 3), np.float32)
    rows = np.ascontiguousarray(directions, np.float32)
    radiance_of(dome.sharp[None], dome.blurred, rows, roughness.astype(np.float32), out)
    return out


def test_lookups_are_what_their_twin_says_at_every_roughness() -> None:
    rng = np.random.default_rng(1)
    directions, roughness = unit(rng.normal(size=(2000, 3))), rng.uniform(0, 1, 2000)
    dome = picture_dome()
    arrays = EnvironmentArrays(dome.sharp[None], dome.blurred, dome.irradiance)
    # Next to 0.05, sharp and blurred differ on purpose: a float32 could fall on either side.
    roughness[np.abs(roughness - 0.05) < 1e-3] = 0.2
    np.testing.assert_allclose(
        looked_up(dome, directions, roughness), dome_radiance(arrays, directions, roughness), atol=2e-3
    )


def test_a_texels_centre_gives_the_texel() -> None:
    dome = picture_dome()
    directions = octahedral_directions(len(dome.sharp))[5::97, 3::89].reshape(-1, 3)
    found = looked_up(dome, directions, np.zeros(len(directions)))
    np.testing.assert_allclose(found, dome.sharp[5::97, 3::89].reshape(-1, 3), atol=5e-3)


def test_a_constant_dome_is_the_same_everywhere() -> None:
    dome = Environment.from_dome(Dome((0.2, 0.4, 0.8)))
    directions = unit(np.random.default_rng(1).normal(size=(20, 3)))
    expected = np.broadcast_to(np.float32([0.2, 0.4, 0.8]), (20, 3))
    np.testing.assert_array_equal(looked_up(dome, directions, np.linspace(0, 1, 20)), expected)


def test_irradiance_is_the_harmonics_sum_and_never_negative() -> None:
    coefficients = np.random.default_rng(2).normal(size=(9, 3)).astype(np.float32)
    normals = unit(np.random.default_rng(1).normal(size=(100, 3)))
    found = [irradiance(coefficients, *(np.float32(c) for c in n)) for n in normals]
    np.testing.assert_allclose(found, np.maximum(harmonics(normals) @ coefficients, 0), atol=1e-5)
    assert np.min(found) == 0


@pytest.mark.parametrize("roughness", [0.3, 1.0])
def test_prefilter_is_the_ggx_weighted_mean_around_the_normal(roughness: float) -> None:
    size, target_size = 32, 6
    source = np.random.default_rng(5).uniform(0, 1, (size, size, 3)).astype(np.float32)
    # Smooth the noise, so that a finite number of samples finds the mean.
    for _ in range(3):
        source = (source + np.roll(source, 1, 0) + np.roll(source, 1, 1) + np.roll(source, -1, 1)) / 4
    target = np.empty((1, target_size, target_size, 3), np.float32)
    prefilter(source[None].astype(np.float32), np.array([roughness], np.float32), target)

    rng = np.random.default_rng(6)
    u, phi = rng.random(20000), rng.random(20000) * 2 * np.pi
    cosine = np.sqrt((1 - u) / (1 + (roughness**4 - 1) * u))
    sine = np.sqrt(1 - cosine**2)
    local = np.stack([sine * np.cos(phi), sine * np.sin(phi), cosine], axis=1)
    for row, column in ((0, 0), (2, 3), (5, 1), (3, 3)):
        normal = octahedral_directions(target_size)[row, column]
        side = unit(np.cross(normal, [0.3, 0.5, 0.8]))
        half = local @ np.stack([side, np.cross(normal, side), normal])
        light = 2 * (half @ normal)[:, None] * half - normal
        weight = np.maximum(light @ normal, 0)[:, None]
        expected = (octahedral_lookup(source, light) * weight).sum(axis=0) / weight.sum()
        np.testing.assert_allclose(target[0, row, column], expected, atol=0.03)


def test_blurred_maps_get_smoother_with_roughness() -> None:
    spread = picture_dome().blurred.std(axis=(1, 2)).mean(axis=1)
    assert len(spread) == len(ROUGHNESS_LEVELS)
    assert np.all(np.diff(spread) < 0)
