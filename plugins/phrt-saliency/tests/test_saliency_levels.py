"""Levels: what is worth more gets more of its pixels."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phrt_saliency.levels import SMALL_PIXELS, STALE, Levels, errors_left, falling, steps_of

from phrt.interfaces.heuristic import PASSES
from phrt.testing.candidates import candidates


def taken(work_cost: list[float], worth: list[float], budget: float, **columns: np.ndarray) -> list[tuple[int, int]]:
    work = candidates(work_cost, **columns)
    line, left, found = Levels(work, np.array(worth)), budget, []
    while (request := line.next(left)) is not None:
        found.append((request.item, request.passes))
        left -= work.predicted_cost[request.item] * request.passes / PASSES
    return found


def test_everybody_gets_a_pass_before_anybody_gets_all_when_all_are_worth_the_same() -> None:
    assert taken([400, 400, 400], [1, 1, 1], 1e9) == [
        (0, 1),
        (1, 1),
        (2, 1),
        (0, 1),
        (1, 1),
        (2, 1),
        (0, 2),
        (1, 2),
        (2, 2),
    ]


def test_what_is_worth_ten_times_as_much_is_traced_whole_first() -> None:
    assert taken([400, 400], [1, 10], 500) == [(1, 1), (1, 1), (1, 2), (0, 1)]


def test_a_small_item_is_one_step() -> None:
    assert taken([SMALL_PIXELS - 1, 400], [1, 1], 1e9)[0] == (0, 4)


def test_mandatory_items_are_first_and_whole() -> None:
    assert taken([400, 400], [9, 1], 500, mandatory=np.array([False, True])) == [(1, 4), (0, 1)]


def test_after_a_step_that_does_not_fit_no_later_one_of_the_item_is_asked_for() -> None:
    found = taken([4000, 400], [100, 1], 900)
    assert found == [(1, 1), (1, 1), (1, 2)], "a pass of the first would take 1000"


def test_where_values_of_earlier_frames_stand_in_what_is_missing_comes_first() -> None:
    held = np.array([0.8, 0.0], np.float32)
    found = taken([400, 400], [1, 1], 1e9, history_share=held)
    assert found == [(1, 1), (0, 1), (1, 1), (1, 2), (0, 1), (0, 2)]


def test_errors_are_those_of_gaps_and_of_stale_values() -> None:
    none, half = errors_left(np.array([0.0, 0.5]), np.array([[0.25, 0.5, 1.0], [0.5, 0.5 + 0.5 / 3, 1.0]]))
    assert none.tolist() == [1.0, 0.42, 0.25, 0.0]
    np.testing.assert_allclose(half, [0.5 + 0.5 * STALE, 0.5 * STALE, 0.5 * STALE * 2 / 3, 0.0], atol=1e-12)


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(0, 30))
def test_steps_are_whole_items_and_never_rise_in_worth_per_cost(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    held = np.where(random.random(count) < 0.5, random.choice([0.3, 1.0], count), 0).astype(np.float32)
    work = candidates(random.integers(1, 500, count).astype(float), history_share=held)
    item, passes, cost, value = steps_of(work, random.random(count))
    assert np.isfinite(value).all()
    for number in range(count):
        mine = item == number
        assert passes[mine].sum() == PASSES
        assert cost[mine].sum() == pytest.approx(float(work.predicted_cost[number]), rel=1e-5)
        assert (np.diff(value[mine]) <= 0).all()


@given(st.lists(st.sampled_from([0.0, 1e-30, 0.5, 0.75, 3.0, 1e30]), max_size=40))
def test_falling_order_is_that_of_a_stable_sort(values: list[float]) -> None:
    assert falling(np.array(values)).tolist() == np.argsort(-np.array(values), kind="stable").tolist()
