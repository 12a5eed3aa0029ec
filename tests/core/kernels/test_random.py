"""Seeded randomness: in range, even, and without ties between pixels, seeds, samples and dimensions."""

from __future__ import annotations

import numba
import numpy as np
import pytest
from kernel_kit import unit

from phrt.kernels.random import halton, orthonormal, pixel_sample


@numba.njit
def many(pixels: np.ndarray, seed: int, indices: np.ndarray, dimension: int, out: np.ndarray) -> None:
    for i in range(len(out)):
        out[i, 0], out[i, 1] = pixel_sample(np.uint32(pixels[i]), seed, indices[i], dimension)


def drawn(pixels: np.ndarray, seed: int = 0, indices: np.ndarray | int = 0, dimension: int = 0) -> np.ndarray:
    out = np.empty((len(pixels), 2))
    many(pixels, seed, np.broadcast_to(indices, len(pixels)).copy(), dimension, out)
    return out


PIXELS = np.arange(20000)


def test_numbers_are_even_over_the_unit_square() -> None:
    values = drawn(PIXELS)
    assert values.min() >= 0
    assert values.max() < 1
    counts, _, _ = np.histogram2d(*values.T, bins=10, range=[[0, 1], [0, 1]])
    assert np.abs(counts - 200).max() < 5 * np.sqrt(200)


@pytest.mark.parametrize("change", [{"seed": 1}, {"dimension": 1}, {"dimension": 100}])
def test_frames_and_dimensions_are_independent(change: dict[str, int]) -> None:
    one, other = drawn(PIXELS), drawn(PIXELS, **change)
    for a in one.T:
        for b in other.T:
            assert abs(np.corrcoef(a, b)[0, 1]) < 0.03


def test_neighbouring_pixels_are_independent() -> None:
    values = drawn(PIXELS)
    for step in (1, 640):
        assert abs(np.corrcoef(values[:-step, 0], values[step:, 0])[0, 1]) < 0.03


def test_the_samples_of_a_pixel_are_spread_better_than_chance() -> None:
    """Each quarter of the unit square holds nearly a quarter of 16 samples, whatever the pixel."""
    for pixel in range(50):
        u, v = drawn(np.full(16, pixel), indices=np.arange(16)).T
        quarters = np.bincount((u * 2).astype(int) * 2 + (v * 2).astype(int), minlength=4)
        assert quarters.min() >= 2
        assert quarters.max() <= 6


def test_the_same_question_has_the_same_answer() -> None:
    np.testing.assert_array_equal(drawn(PIXELS, seed=5), drawn(PIXELS, seed=5))


def test_halton_is_the_radical_inverse() -> None:
    assert [float(halton(i, 2)) for i in range(4)] == [0.5, 0.25, 0.75, 0.125]
    np.testing.assert_allclose([float(halton(i, 3)) for i in range(4)], [1 / 3, 2 / 3, 1 / 9, 4 / 9], rtol=1e-6)


def test_tangents_are_unit_and_at_right_angles_even_at_the_poles() -> None:
    normals = unit(np.random.default_rng(1).normal(size=(200, 3)))
    for n in [*normals, [0, 0, 1], [0, 0, -1], [0, 1, 0]]:
        frame = np.array([*np.reshape(orthonormal(*(np.float32(c) for c in n)), (2, 3)), n], float)
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-5)
