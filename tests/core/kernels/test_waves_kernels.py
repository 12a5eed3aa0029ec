"""Waves: the passes of units, parts of them, and sharing out what they took."""

from __future__ import annotations

import numpy as np
import pytest

from phrt.candidates import Passes, Units, WorkItems
from phrt.frame import MASK_HISTORY
from phrt.kernels.layers import pass_numbers
from phrt.kernels.primary import tile_order
from phrt.kernels.waves import gather_parts, pass_kinds, share_out, unit_shares

WIDTH, HEIGHT = 64, 36
COUNT = WIDTH * HEIGHT
FIRST, SIZE = np.array([400, 0, 100], np.int64), np.array([300, 100, 300], np.int32)
PIXELS = tile_order(WIDTH, HEIGHT)[:700]
MASK = np.where(np.random.default_rng(5).random(COUNT) < 0.6, MASK_HISTORY, 0).astype(np.uint8)
HELD = np.array([(MASK[PIXELS[a : a + n]] == MASK_HISTORY).sum() for a, n in zip(FIRST, SIZE, strict=True)], np.int32)
HELD[1] = 0  # as of an effect without history: its mask does not matter


def kinds() -> tuple[np.ndarray, np.ndarray]:
    numbers, found, sizes = np.empty(COUNT, np.uint8), np.empty(700, np.uint8), np.empty((3, 8), np.int32)
    pass_numbers(WIDTH, numbers)
    pass_kinds(PIXELS, FIRST, SIZE, HELD, numbers, MASK, MASK_HISTORY, found, sizes)
    return found, sizes


def expected(unit: int) -> np.ndarray:
    """Its pixels in the order in which parts of it are traced, by a sort."""
    own = PIXELS[FIRST[unit] : FIRST[unit] + SIZE[unit]]
    right, down = own % WIDTH % 2, own // WIDTH % 2
    rank = np.where(right == down, down, 2 + down) + 4 * ((MASK[own] == MASK_HISTORY) & (HELD[unit] > 0))
    return own[np.argsort(rank, kind="stable")]


@pytest.mark.parametrize(("start", "stop"), [(0, 100), (0, 37), (37, 38), (20, 90), (0, 0)])
def test_a_part_is_what_its_passes_hold_in_the_order_of_the_picture(start: int, stop: int) -> None:
    found, sizes = kinds()
    place = np.argsort(PIXELS)
    for unit in range(3):
        out = np.empty(stop - start, np.int32)
        row = slice(unit, unit + 1)
        begin, end = np.array([start]), np.array([stop])
        assert gather_parts(PIXELS, found, FIRST[row], SIZE[row], sizes[row], begin, end, out) == stop - start
        assert sorted(out.tolist()) == sorted(expected(unit)[start:stop].tolist())
        assert np.all(np.diff(place[np.searchsorted(PIXELS[place], out)]) > 0)


def test_whole_units_and_parts_are_gathered_one_after_the_other() -> None:
    found, sizes = kinds()
    out = np.empty(350, np.int32)
    rows = np.array([1, 2])
    gather_parts(
        PIXELS, found, FIRST[rows], SIZE[rows], sizes[rows], np.array([0, 50]), np.array([100, 300]), out
    )  # fmt: skip
    assert out[:100].tolist() == PIXELS[:100].tolist()
    assert sorted(out[100:].tolist()) == sorted(expected(2)[50:].tolist())


def test_passes_end_where_their_pixels_do_and_what_is_missing_is_the_first_one() -> None:
    order = np.argsort(FIRST)
    zeros = np.zeros(3)
    units = Units(np.arange(3, dtype=np.int32), np.arange(1, 4, dtype=np.int32), np.zeros(3, np.int32), FIRST[order],
                  SIZE[order], zeros, zeros, HELD[order], zeros)  # fmt: skip
    passes = Passes(WorkItems(None, units, [PIXELS], WIDTH, [MASK]))  # type: ignore[arg-type]
    passes.find(np.array([2, 0]))
    passes.find(np.array([0, 1, 1]))
    for row, unit in enumerate(order.tolist()):
        held, size = int(HELD[unit]), int(SIZE[unit])
        if held:
            np.testing.assert_allclose(passes.ends[row], size - held + held * np.arange(4) / 3, atol=0.67)
        else:
            own = PIXELS[FIRST[unit] : FIRST[unit] + size]
            right, down = own % WIDTH % 2, own // WIDTH % 2
            number = np.where(right == down, down, 2 + down)
            assert passes.ends[row].tolist() == np.cumsum(np.bincount(number, minlength=4)).tolist()
        assert passes.ends[row, 3] == size


def test_shares_of_units_make_groups_and_get_back_what_these_took() -> None:
    unit = np.array([0, 0, 1, 2, 3])
    arrays = [np.empty(5, np.int64) for _ in range(3)] + [np.empty(5) for _ in range(2)] + [np.empty(5, np.int64)]
    groups = [np.empty(5, np.int64), *(np.empty(5) for _ in range(3))]
    count, found = unit_shares(
        unit, np.full(5, 10), np.array([0, 5, 0, 0, 9]), np.array([5, 7, 10, 10, 10]), np.array([0, 0, 0, 1]),
        np.array([10, 100, 10, 5]), np.array([10.0, 500.0, 30.0, 8.0]), np.ones(4), 100.0, 2, *arrays, *groups,
    )  # fmt: skip
    kept, start, stop, rays, _, group = (values[:count] for values in arrays)
    assert (kept.tolist(), start.tolist(), stop.tolist()) == ([0, 1, 2, 3], [0, 0, 0, 4], [7, 100, 10, 5])
    assert rays.tolist() == pytest.approx([7.0, 500.0, 30.0, 1.6])
    assert group.tolist() == [0, 1, 0, 2], "the large one by itself"
    assert found == 3
    assert groups[2][:3].tolist() == pytest.approx([37.0, 500.0, 1.6])
    took = [np.zeros(4) for _ in range(3)]
    share_out(kept, group, start, stop, rays, arrays[4][:count], groups[2][:3], groups[3][:3],
              np.array([74.0, 400.0, 3.0]), np.array([1.0, 2.0, 3.0]), *took)  # fmt: skip
    assert took[0].tolist() == [7, 100, 10, 1]
    assert took[1].tolist() == pytest.approx([14.0, 400.0, 60.0, 3.0])
    assert took[2].sum() == pytest.approx(6.0)
