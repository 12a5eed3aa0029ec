"""Kernels against what numpy makes of the same formula."""

from __future__ import annotations

import numpy as np
import pytest
from phrt_saliency.kernels import add_contrasts, filter_oriented, halve, split_features, uniqueness
from phrt_saliency.model import _SLANTED_MEAN, _STRAIGHT_MEAN, _TAPS, LEAST, REACH_PIXELS, pyramid

RANDOM = np.random.default_rng(11)


def folded(picture: np.ndarray, kernel: np.ndarray) -> np.ndarray:
    """Correlation of (h, w) with a kernel of odd size, edges repeated; float64."""
    y, x = kernel.shape[0] // 2, kernel.shape[1] // 2
    padded = np.pad(picture.astype(np.float64), ((y, y), (x, x)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, kernel.shape)
    return np.einsum("yxij,ij->yx", windows, kernel)


def bilinear(values: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(h, w) of `values` at rows (h,) and columns (w,), edges repeated."""
    line = np.array([np.interp(columns, np.arange(values.shape[1]), row) for row in values])
    return np.array([np.interp(rows, np.arange(values.shape[0]), column) for column in line.T]).T


@pytest.mark.parametrize("shape", [(36, 64), (9, 5), (1, 7), (2, 1), (1, 1)])
def test_a_level_is_filtered_and_every_second_pixel_is_kept(shape: tuple[int, int]) -> None:
    picture = RANDOM.random(shape, np.float32)
    out = np.empty(((shape[0] + 1) // 2, (shape[1] + 1) // 2), np.float32)
    halve(picture, out)
    taps = np.array([1, 4, 6, 4, 1]) / 16
    np.testing.assert_allclose(out, folded(picture, np.outer(taps, taps))[::2, ::2], rtol=1e-5)


def test_a_pyramid_keeps_even_light_and_ends_in_one_pixel() -> None:
    levels = pyramid(np.full((36, 64), 0.375, np.float32))
    assert [level.shape for level in levels] == [(36, 64), (18, 32), (9, 16), (5, 8), (3, 4), (2, 2), (1, 1)]
    for level in levels:
        np.testing.assert_array_equal(level, np.float32(0.375))


def test_features_are_those_of_their_formulas() -> None:
    colors = [(1, 1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0.5, 0.25, 0.25), (0.09, 0, 0)]
    display = np.array([colors], np.float32)
    intensity, red_green, blue_yellow = (np.empty((1, len(colors)), np.float32) for _ in range(3))
    split_features(display, np.float32(0.25), intensity, red_green, blue_yellow)
    np.testing.assert_allclose(intensity[0], [1, 1 / 3, 1 / 3, 1 / 3, 2 / 3, 1 / 3, 0.03], rtol=1e-6)
    np.testing.assert_allclose(red_green[0], [0, 1, -1, 0, 0, 0.5, 0.36], atol=1e-7)
    np.testing.assert_allclose(blue_yellow[0], [0, 0, 0, 1, -1, 0, 0], atol=1e-7)


def oriented(picture: np.ndarray) -> np.ndarray:
    energy = np.empty((4, *picture.shape), np.float32)
    filter_oriented(picture, _TAPS, _STRAIGHT_MEAN, _SLANTED_MEAN, energy)
    return energy


def test_oriented_filters_are_complex_gabor_filters() -> None:
    picture = RANDOM.random((23, 31), np.float32)
    x = np.arange(-REACH_PIXELS, REACH_PIXELS + 1)
    envelope = np.exp(-0.5 * (x / (4 / 3)) ** 2)
    round_one = np.outer(envelope, envelope) / envelope.sum() ** 2
    directions = [(1, 0), (0, 1), (0.5**0.5, 0.5**0.5), (0.5**0.5, -(0.5**0.5))]
    for energy, (along_x, along_y) in zip(oriented(picture), directions, strict=True):
        phase = np.pi / 2 * (along_x * x[None, :] + along_y * x[:, None])
        even, odd = round_one * np.cos(phase), round_one * np.sin(phase)
        even -= round_one * even.sum()
        expected = 2 * np.hypot(folded(picture, even), folded(picture, odd))
        np.testing.assert_allclose(energy, expected, rtol=1e-3, atol=1e-5)


def test_a_grating_is_seen_by_the_filter_of_its_direction_with_its_amplitude() -> None:
    y, x = np.mgrid[0:40, 0:40]
    for number, (u, v) in enumerate([(1, 0), (0, 1), (0.5**0.5, 0.5**0.5), (0.5**0.5, -(0.5**0.5))]):
        grating = (0.5 + 0.3 * np.sin(np.pi / 2 * (u * x + v * y))).astype(np.float32)
        inside = oriented(grating)[:, 10:30, 10:30].mean(axis=(1, 2))
        assert inside.argmax() == number
        assert inside[number] == pytest.approx(0.3, rel=0.03)
        assert np.delete(inside, number).max() < 0.5 * inside[number]


def test_even_light_has_no_direction() -> None:
    assert oriented(np.full((20, 20), 0.7, np.float32)).max() < 1e-6


def test_what_stands_alone_is_raised_to_one_and_what_is_everywhere_to_nothing() -> None:
    alone, many = np.zeros((40, 60), np.float32), np.zeros((40, 60), np.float32)
    alone[20, 30] = 0.5
    many[5::10, 5::10] = 0.5
    assert uniqueness(alone, LEAST) * 0.5 == pytest.approx(1.0)
    assert uniqueness(many, LEAST) == 0.0
    two = alone.copy()
    two[5, 5] = 0.25
    assert uniqueness(two, LEAST) * 0.5 == pytest.approx(0.25), "(1 - 1/2)^2"
    two[5, 5] = 0.04
    assert uniqueness(two, LEAST) * 0.5 == pytest.approx(1.0), "what is below a tenth is no peak"


def test_what_is_faint_is_not_raised_to_one() -> None:
    faint = np.zeros((10, 10), np.float32)
    faint[5, 5] = LEAST / 4
    assert uniqueness(faint, LEAST) * faint.max() == pytest.approx(0.25)
    assert uniqueness(np.zeros((10, 10), np.float32), LEAST) == 0.0


def test_a_level_stretch_is_one_peak() -> None:
    values = np.zeros((12, 12), np.float32)
    values[2:5, 2:7] = 1.0
    assert uniqueness(values, LEAST) == pytest.approx(1.0)
    values[8:10, 8:10] = 0.5
    assert uniqueness(values, LEAST) == pytest.approx(0.25)


def test_contrasts_are_differences_of_levels_each_normalised_and_enlarged() -> None:
    levels = pyramid(RANDOM.random((36, 64), np.float32))
    total = np.zeros((36, 64), np.float32)
    add_contrasts(levels, 3, 3, 4, np.float32(1e-4), LEAST, total)
    expected = np.zeros((36, 64))
    for center in range(3):
        height, width = levels[center].shape
        for delta in (3, 4):
            rows, columns = np.arange(height) / 2**delta, np.arange(width) / 2**delta
            contrast = np.abs(levels[center] - bilinear(levels[center + delta], rows, columns)).astype(np.float32)
            contrast[contrast < 1e-4] = 0
            enlarged = bilinear(contrast, np.arange(36) / 2**center, np.arange(64) / 2**center)
            expected += enlarged * uniqueness(contrast, LEAST)
    np.testing.assert_allclose(total, expected, rtol=1e-3, atol=1e-5)
    assert expected.max() > 0.01
