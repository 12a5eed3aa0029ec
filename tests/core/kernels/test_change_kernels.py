"""Kernels of measured change against plain numpy: which pixels are sampled, what neighbours say, what a display shows."""

from __future__ import annotations

import numpy as np
import pytest

from phrt.kernels.change import display_change, neighbour_values, pick_samples

WIDTH, HEIGHT = 40, 30


def neutral_curve(color: np.ndarray) -> np.ndarray:
    """The Khronos specification's listing, in float64 numpy."""
    color = np.maximum(color.astype(np.float64), 0.0)
    darkest = color.min(axis=-1, keepdims=True)
    color = color - np.where(darkest < 0.08, darkest - 6.25 * darkest**2, 0.04)
    peak = color.max(axis=-1, keepdims=True)
    new_peak = 1.0 - 0.24**2 / (peak + 0.24 - 0.76)
    g = 1.0 - 1.0 / (0.15 * (peak - new_peak) + 1.0)
    return np.where(peak < 0.76, color, color * new_peak / np.maximum(peak, 1e-30) * (1 - g) + new_peak * g)


def test_change_is_the_mean_difference_of_what_a_display_shows() -> None:
    rng = np.random.default_rng(1)
    image, other = (10.0 ** rng.uniform(-3, 2, (50, 3)) for _ in range(2))
    row = rng.integers(0, 50, 20).astype(np.int32)
    change = np.empty(20, np.float32)
    display_change(row, image.astype(np.float32), other[:20].astype(np.float32), change)

    def shown(color: np.ndarray) -> np.ndarray:
        return np.sqrt(np.clip(neutral_curve(color), 0, 1))

    assert change == pytest.approx(np.abs(shown(image[row]) - shown(other[:20])).mean(axis=1), abs=1e-5)


def test_endless_light_is_white() -> None:
    image = np.full((1, 3), np.inf, np.float32)
    change = np.empty(1, np.float32)
    display_change(np.zeros(1, np.int32), image, np.zeros((1, 3), np.float32), change)
    assert change[0] == pytest.approx(1.0, abs=1e-3)


def test_neighbours_are_traced_of_the_same_object_and_two_pixels_away() -> None:
    rng = np.random.default_rng(2)
    objects = rng.integers(1, 3, WIDTH * HEIGHT).astype(np.uint32)
    mask = rng.integers(0, 3, WIDTH * HEIGHT).astype(np.uint8)
    layer = rng.random((WIDTH * HEIGHT, 2)).astype(np.float32)
    row = np.arange(WIDTH * HEIGHT, dtype=np.int32)
    values, found = np.empty((len(row), 2), np.float32), np.empty(len(row), np.uint8)
    neighbour_values(row, objects, mask, 2, WIDTH, HEIGHT, layer, values, found)
    for i in row.tolist():
        x, y = i % WIDTH, i // WIDTH
        near = [(x + 2, y), (x - 2, y), (x, y + 2), (x, y - 2)]
        kept = [v * WIDTH + u for u, v in near if 0 <= u < WIDTH and 0 <= v < HEIGHT]
        kept = [k for k in kept if mask[k] == 2 and objects[k] == objects[i]]
        assert bool(found[i]) == bool(kept)
        if kept:
            assert values[i] == pytest.approx(layer[kept].mean(axis=0), abs=1e-6)


def picked(quota: list[float], seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Samples of two objects, the left and the right half of the picture: rows, units, and the object of every pixel."""
    objects = np.where(np.arange(WIDTH * HEIGHT) % WIDTH < WIDTH // 2 - 1, 1, 2).astype(np.uint32)
    pixels = np.argsort(objects, kind="stable").astype(np.int32)
    count = np.bincount(objects)[1:].astype(np.int32)
    first = np.array([0, count[0]])
    row, unit = np.full(5000, -1, np.int32), np.full(5000, -1, np.int32)
    found = pick_samples(
        pixels, first, count, np.array([1, 2], np.int32), np.array(quota, np.float32),
        np.zeros(len(objects), np.uint32), np.ones(1, bool), objects, WIDTH, 123, seed, row, unit,
    )  # fmt: skip
    assert (row[found:] == -1).all()
    return row[:found], unit[:found], objects


def test_samples_belong_to_their_units_and_are_as_many_as_wanted() -> None:
    row, unit, objects = picked([30.0, 100.0])
    assert np.bincount(unit).tolist() == [30, 100]
    assert objects[row].tolist() == (unit + 1).tolist()


def test_fractions_of_samples_come_in_that_share_of_frames() -> None:
    counts = [np.bincount(picked([0.25, 1.0], seed)[1], minlength=2).tolist() for seed in range(400)]
    first, second = np.array(counts).sum(axis=0)
    assert 70 < first < 130
    assert second == 400


def test_every_pixel_is_sampled_where_enough_are_wanted() -> None:
    row, unit, _ = picked([1e4, 0.0])
    assert len(np.unique(row[unit == 0])) == (WIDTH // 2 - 1) * HEIGHT


def test_samples_move_from_frame_to_frame_and_spread_over_the_unit() -> None:
    one, other = picked([0.0, 60.0], 1)[0], picked([0.0, 60.0], 2)[0]
    assert one.tolist() == picked([0.0, 60.0], 1)[0].tolist()
    assert len(np.intersect1d(one, other)) < 45
    rows_of_picture = one // WIDTH
    assert np.bincount(rows_of_picture // 10, minlength=3).min() >= 15


def test_samples_are_at_places_of_the_first_pass_where_these_belong_to_the_unit() -> None:
    row, unit, objects = picked([100.0, 100.0])
    x, y = row % WIDTH, row // WIDTH
    first = (x % 2 == 0) & (y % 2 == 0)
    assert first[unit == 0].all()
    # The right half begins at an odd column, whose blocks' first places are not its own.
    corner = objects[(y // 2 * 2) * WIDTH + x // 2 * 2]
    assert first[(unit == 1) & (corner == 2)].all()
    assert not first[(unit == 1) & (corner == 1)].any()
