"""Many frames in few marks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phrt_plugins.report.thinning import COLUMNS, band, bin_size, pareto, spread


def test_few_frames_stay_as_they_are() -> None:
    frames, values = np.arange(4), np.array([3.0, 1.0, np.nan, 2.0])
    found = band(frames, values)
    assert found.size == 1
    assert found.middle is values
    assert found.frame is frames


def test_bins_hold_lowest_median_and_highest() -> None:
    found = band(np.arange(10, 17), np.array([1.0, 5.0, 3.0, 2.0, 2.0, 9.0, 7.0]), size=3)
    assert found.frame.tolist() == [10, 13, 16]
    assert found.low.tolist() == [1.0, 2.0, 7.0]
    assert found.middle.tolist() == [3.0, 2.0, 7.0]
    assert found.high.tolist() == [5.0, 9.0, 7.0]


def test_a_bin_of_nothing_is_nothing() -> None:
    found = band(np.arange(4), np.array([np.nan, np.nan, 1.0, np.nan]), size=2)
    assert np.isnan(found.middle).tolist() == [True, False]
    assert found.high[1] == 1.0


def test_an_infinite_budget_stays_infinite() -> None:
    assert np.isinf(band(np.arange(6), np.full(6, np.inf), size=3).middle).all()


@given(st.integers(1, 30_000))
def test_ten_thousand_frames_take_at_most_the_columns_there_are(count: int) -> None:
    assert len(range(0, count, bin_size(count))) <= COLUMNS


@given(st.integers(0, 2000), st.integers(2, 50))
def test_spread_keeps_first_and_last(count: int, most: int) -> None:
    rows = spread(count, most)
    assert len(rows) == min(count, most)
    assert rows.tolist() == sorted(set(rows.tolist()))
    if count:
        assert (rows[0], rows[-1]) == (0, count - 1)


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=1, max_size=20))
def test_the_front_is_what_nothing_beats(points: list[tuple[int, int]]) -> None:
    cost, error = np.array(points, np.float64).T
    front = set(zip(cost[pareto(cost, error)], error[pareto(cost, error)], strict=True))
    beaten = {(x, y) for x, y in points if any((u <= x and v < y) or (u < x and v <= y) for u, v in points)}
    assert front == set(points) - beaten


@pytest.mark.parametrize("missing", [np.nan, np.inf])
def test_who_has_no_cost_is_not_on_the_front(missing: float) -> None:
    assert pareto(np.array([missing, 2.0]), np.array([0.1, 0.5])).tolist() == [1]
