"""Putting values in place, filling gaps and sorting pixels, against plain numpy twins."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from phrt.kernels.layers import (
    FILLED,
    KEPT,
    LONELY,
    MISSING,
    count_by_object,
    fill_gaps,
    gather_ranges,
    mark_targets,
    pass_numbers,
    place_by_object,
    refine_gaps,
    scatter,
    select_pixels,
)
from phrt.kernels.primary import tile_order

WIDTH, HEIGHT = 37, 23
COUNT = WIDTH * HEIGHT


def test_pixels_are_sorted_by_object_in_tile_order_and_then_those_an_effect_applies_to() -> None:
    rng = np.random.default_rng(1)
    ids = rng.integers(0, 7, COUNT).astype(np.uint32)
    materials = rng.integers(0, 4, COUNT).astype(np.uint32)
    applies, allowed = np.array([True, False, True, True]), np.array([False, True, True, False, True, True, True])
    order = tile_order(WIDTH, HEIGHT)
    begins, every = np.zeros(8, np.int64), np.full(COUNT, -1, np.int32)
    count_by_object(order, ids, begins[1:])
    np.testing.assert_array_equal(begins[1:], np.bincount(ids, minlength=7))
    begins = np.cumsum(begins)
    place_by_object(order, ids, begins[:-1].copy(), every)
    np.testing.assert_array_equal(every, order[np.argsort(ids[order], kind="stable")])

    start, pixels = np.empty(8, np.int64), np.full(COUNT, -1, np.int32)
    selected = select_pixels(begins, every, materials, applies, allowed, start, pixels)
    wanted = order[applies[materials[order]] & allowed[ids[order]] & (ids[order] != 0)]
    expected = wanted[np.argsort(ids[wanted], kind="stable")]
    assert selected == len(expected)
    np.testing.assert_array_equal(pixels[:selected], expected)
    np.testing.assert_array_equal(np.diff(start), np.bincount(ids[wanted], minlength=7))
    assert start[0] == 0


def fill_twin(pixels: np.ndarray, ids: np.ndarray, mask: np.ndarray, layer: np.ndarray) -> dict[int, tuple[int, Any]]:
    """What is made of each of `pixels`, and its value then; 2 is traced, 4 of an earlier frame."""
    made: dict[int, tuple[int, Any]] = {}
    for row in pixels.tolist():
        y, x = divmod(row, WIDTH)
        rings: list[list[int]] = [[], [], []]
        for dy, dx in np.ndindex(5, 5):
            other = (y + dy - 2) * WIDTH + x + dx - 2
            if 0 <= y + dy - 2 < HEIGHT and 0 <= x + dx - 2 < WIDTH and ids[other] == ids[row]:
                rings[max(abs(dy - 2), abs(dx - 2))].append(other)
        good = [[k for k in ring if mask[k] in (2, 4)] for ring in rings]
        enough = len(good[1]) >= 3 or 9 * sum(map(len, good)) >= sum(map(len, rings))
        if mask[row] == 2 or (mask[row] == 4 and enough):
            made[row] = KEPT, layer[row]
        elif enough:
            made[row] = FILLED, layer[good[1] or good[2]].mean(axis=0)
        else:
            made[row] = LONELY if mask[row] == 4 else MISSING, layer[row]
    return made


@pytest.mark.parametrize("density", [0.25, 0.06, 0.02])
def test_gaps_take_the_mean_of_the_nearest_values_of_their_object_where_there_are_enough(density: float) -> None:
    rng = np.random.default_rng(2)
    ids = (np.arange(COUNT) % WIDTH // 9 + 1).astype(np.uint32)
    mask = np.where(rng.random(COUNT) < density, rng.choice([2, 4], COUNT), 0).astype(np.uint8)
    layer = rng.random((COUNT, 3)).astype(np.float32)
    pixels = rng.permutation(np.flatnonzero(ids <= 3)).astype(np.int32)
    expected, before, found = fill_twin(pixels, ids, mask, layer), layer.copy(), np.empty(len(pixels), np.uint8)
    left = fill_gaps(pixels, ids, mask, WIDTH, HEIGHT, 2, 4, True, layer, found, np.zeros(len(mask), np.uint8))
    assert found.tolist() == [expected[row][0] for row in pixels.tolist()]
    assert left == (found != KEPT).sum()
    trusting = np.empty(len(pixels), np.uint8)
    fill_gaps(pixels, ids, mask, WIDTH, HEIGHT, 2, 4, False, before.copy(), trusting, np.zeros(COUNT, np.uint8))
    np.testing.assert_array_equal(trusting, np.where(found == LONELY, KEPT, found))
    for row, (_, value) in expected.items():
        np.testing.assert_allclose(layer[row], value, rtol=1e-5)
    others = np.setdiff1d(np.arange(COUNT), pixels)
    np.testing.assert_array_equal(layer[others], before[others])
    kinds = {0.25: {KEPT, FILLED}, 0.06: {KEPT, FILLED, MISSING, LONELY}, 0.02: {KEPT, MISSING, LONELY}}
    assert kinds[density] <= set(found.tolist())


def test_one_pass_fills_a_surface_and_single_values_do_not() -> None:
    """A quarter of the pixels stands for all of them; a dot here and there is no picture."""
    y, x = np.divmod(np.arange(COUNT), WIDTH)
    ids, pixels, found = np.ones(COUNT, np.uint32), np.arange(COUNT, dtype=np.int32), np.empty(COUNT, np.uint8)
    layer = np.ones((COUNT, 1), np.float32)
    mask = np.where((x % 2 == 0) & (y % 2 == 0), 4, 0).astype(np.uint8)
    fill_gaps(pixels, ids, mask, WIDTH, HEIGHT, 2, 4, True, layer, found, np.zeros(COUNT, np.uint8))
    np.testing.assert_array_equal(found, np.where(mask == 4, KEPT, FILLED))
    mask = np.where((x % 8 == 4) & (y % 8 == 4), 4, 0).astype(np.uint8)
    assert fill_gaps(pixels, ids, mask, WIDTH, HEIGHT, 2, 4, True, layer, found, np.zeros(len(mask), np.uint8)) == COUNT
    np.testing.assert_array_equal(found == LONELY, mask == 4)


def refined(truth: np.ndarray, fallback: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A picture of which a quarter is traced, filled and refined; and what it was before that."""
    y, x = np.divmod(np.arange(COUNT), WIDTH)
    ids, pixels = np.ones(COUNT, np.uint32), np.arange(COUNT, dtype=np.int32)
    mask = np.where((x % 2 == 0) & (y % 2 == 0), 2, 0).astype(np.uint8)
    layer = np.where((mask == 2)[:, None], truth, 0).astype(np.float32)
    found, needed = np.empty(COUNT, np.uint8), np.zeros(COUNT, np.uint8)
    fill_gaps(pixels, ids, mask, WIDTH, HEIGHT, 2, 4, True, layer, found, needed)
    assert needed.all()
    before = layer.copy()
    refine_gaps(pixels, found, ids, mask, WIDTH, HEIGHT, 2, 4, fallback.astype(np.float32), layer)
    return layer, before


def test_filled_gaps_keep_what_the_fallback_knows() -> None:
    rng = np.random.default_rng(5)
    truth = (rng.random((COUNT, 2)) < 0.3).astype(np.float32)
    exact, _ = refined(truth, truth)
    np.testing.assert_allclose(exact, truth, atol=1e-6)
    constant, before = refined(truth, np.full((COUNT, 2), 0.7))
    np.testing.assert_allclose(constant, before, atol=1e-6)


def test_filled_gaps_stay_among_the_values_around_and_the_fallback() -> None:
    rng = np.random.default_rng(6)
    truth, fallback = rng.uniform(0.2, 0.6, (COUNT, 1)), rng.uniform(0.0, 3.0, (COUNT, 1))
    layer, before = refined(truth, fallback)
    assert layer.min() >= 0.0
    assert (layer <= np.maximum(0.6, fallback) + 1e-6).all()
    assert np.abs(layer - before).max() > 0.1


def test_scatter_writes_only_what_was_traced() -> None:
    layer, mask = np.zeros((6, 2), np.float32), np.zeros(6, np.uint8)
    values = np.arange(6, dtype=np.float32).reshape(3, 2) + 1
    scatter(np.array([5, 0, 2], np.int32), values, np.array([1, 0, 1], np.uint8), np.uint8(2), layer, mask)
    assert layer.tolist() == [[0, 0], [0, 0], [5, 6], [0, 0], [0, 0], [1, 2]]
    assert mask.tolist() == [0, 0, 2, 0, 0, 2]


@pytest.mark.parametrize("is_point", [True, False])
def test_mark_targets_starts_paths_at_the_eyes_distance(is_point: bool) -> None:
    position = np.random.default_rng(1).normal(size=(10, 3)).astype(np.float32)
    eye = np.array([[1.0, 2.0, 3.0]], np.float32)
    traced, path = np.zeros(3, np.uint8), np.empty(4, np.float32)
    target, pixels = np.array([2, 0, 2, 2], np.int32), np.array([7, 8, 9], np.int32)
    mark_targets(target, pixels, position, eye, is_point, traced, path)
    assert traced.tolist() == [1, 0, 1]
    expected = np.linalg.norm(position[pixels[target]] - eye, axis=1) if is_point else np.zeros(4)
    np.testing.assert_allclose(path, expected, rtol=1e-5)


def test_gaps_that_hold_an_earlier_value_keep_it_and_help_to_fill_others() -> None:
    layer, mask, found = np.zeros((4, 1), np.float32), np.array([2, 4, 0, 2], np.uint8), np.empty(4, np.uint8)
    layer[:, 0] = [1, 7, 0, 3]
    assert (
        fill_gaps(
            np.arange(4, dtype=np.int32),
            np.ones(4, np.uint32),
            mask,
            4,
            1,
            2,
            4,
            True,
            layer,
            found,
            np.zeros(len(mask), np.uint8),
        )
        == 1
    )
    assert layer[:, 0].tolist() == [1, 7, 5, 3]
    assert found.tolist() == [KEPT, KEPT, FILLED, KEPT]


def pass_of(pixels: np.ndarray) -> np.ndarray:
    """(n,) int, the interleaved pass of each pixel."""
    corner = {(0, 0): 0, (1, 1): 1, (0, 1): 2, (1, 0): 3}
    return np.array([corner[(y % 2, x % 2)] for y, x in zip(*np.divmod(pixels, WIDTH), strict=True)])


def test_interleaved_passes_take_the_corners_of_each_block_in_turn() -> None:
    numbers = np.empty(COUNT, np.uint8)
    pass_numbers(WIDTH, numbers)
    np.testing.assert_array_equal(numbers, pass_of(np.arange(COUNT)))


def test_ranges_are_gathered_in_order() -> None:
    out = np.empty(6, np.int32)
    gather_ranges(np.arange(20, dtype=np.int32), np.array([8, 0, 5]), np.array([10, 3, 6]), out)
    assert out.tolist() == [8, 9, 0, 1, 2, 5]
