"""Intervals hold the truth about as often as they say, and differences are called what they are."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phrt_plugins.bench.statistics import (
    Interval,
    Resampling,
    default_block_length,
    interval,
    intervals,
    judged,
    paired_interval,
    ratio_interval,
)

PLAIN = Resampling(block_length=1, widen=False)
"""The bootstrap of independent values."""


def alike(random: np.random.Generator, shape: tuple[int, ...], memory: float) -> np.ndarray:
    """Series along the last axis in which neighbours correlate by `memory` (AR(1)); mean 0, variance 1."""
    values = random.normal(size=shape)
    for n in range(1, shape[-1]):
        values[..., n] = memory * values[..., n - 1] + math.sqrt(1 - memory**2) * values[..., n]
    return values


def in_segments(frames: int, each: int) -> np.ndarray:
    return np.arange(frames) // each


@pytest.mark.parametrize("statistic", ["mean", "p50", "p95", "rate", "sum"])
def test_independent_frames_get_the_interval_that_scipy_gives(statistic: Any) -> None:
    from scipy import stats

    values = np.random.default_rng(3).gamma(4.0, 2.0, 80)
    oracle = {
        "mean": lambda v, axis: v.mean(axis=axis),
        "p50": lambda v, axis: np.percentile(v, 50, axis=axis),
        "p95": lambda v, axis: np.percentile(v, 95, axis=axis),
        "rate": lambda v, axis: 1e3 / v.mean(axis=axis),
        "sum": lambda v, axis: v.sum(axis=axis),
    }[statistic]
    options: dict[str, Any] = {"method": "percentile", "n_resamples": 9999, "vectorized": True}
    wanted = stats.bootstrap((values,), oracle, rng=np.random.default_rng(1), **options).confidence_interval
    found = interval(values, None, statistic, Resampling(block_length=1, widen=False, resamples=9999))
    assert found.value == pytest.approx(float(oracle(values, axis=0)))
    width = wanted.high - wanted.low
    assert found.low == pytest.approx(wanted.low, abs=0.05 * width)
    assert found.high == pytest.approx(wanted.high, abs=0.05 * width)
    assert found.frames == 80


def test_paired_differences_get_the_interval_that_scipy_gives() -> None:
    from scipy import stats

    random = np.random.default_rng(5)
    a = random.gamma(4.0, 2.0, 60)
    b = a + random.normal(0.3, 0.5, 60)

    def difference(x: np.ndarray, y: np.ndarray, axis: int) -> np.ndarray:
        return x.mean(axis=axis) - y.mean(axis=axis)

    wanted = stats.bootstrap(
        (a, b), difference, paired=True, vectorized=True, method="percentile", rng=np.random.default_rng(1)
    ).confidence_interval
    found = paired_interval(a, b, None, "mean", Resampling(block_length=1, widen=False, resamples=9999))
    assert found.value == pytest.approx(a.mean() - b.mean())
    assert (found.low, found.high) == pytest.approx((wanted.low, wanted.high), abs=0.01)
    assert found.high - found.low < 0.5 * (interval(a, None, "mean", PLAIN).high - interval(a, None, "mean", PLAIN).low)


@pytest.mark.parametrize(
    ("frames", "each", "memory", "least"),
    [(300, 50, 0.0, 0.92), (300, 50, 0.8, 0.88), (300, 300, 0.8, 0.88), (60, 10, 0.5, 0.88)],
)
def test_intervals_hold_the_truth_as_often_as_they_say(frames: int, each: int, memory: float, least: float) -> None:
    series = alike(np.random.default_rng(11), (300, frames), memory)
    segments = in_segments(frames, each)
    found = [interval(values, segments, "mean", Resampling(resamples=500)) for values in series]
    held = np.mean([i.low <= 0.0 <= i.high for i in found])
    assert least <= held <= 0.99


def test_frames_taken_for_independent_would_hold_it_far_less_often() -> None:
    series = alike(np.random.default_rng(11), (200, 300), 0.8)
    found = [interval(values, None, "mean", Resampling(block_length=1, resamples=500)) for values in series]
    assert np.mean([i.low <= 0.0 <= i.high for i in found]) < 0.7


def test_percentiles_hold_the_truth() -> None:
    series = alike(np.random.default_rng(12), (200, 300), 0.5)
    found = [interval(values, in_segments(300, 50), "p95", Resampling(resamples=300)) for values in series]
    held = np.mean([i.low <= 1.6449 <= i.high for i in found])  # of the normal distribution
    assert 0.85 <= held <= 0.99


def test_the_same_frames_give_the_same_interval() -> None:
    values = np.random.default_rng(1).normal(size=100)
    assert interval(values) == interval(values.copy())
    assert interval(values) != interval(values, None, "mean", Resampling(seed=1))


def test_several_statistics_at_once_are_those_one_by_one() -> None:
    values = np.random.default_rng(1).gamma(3.0, 1.0, (100, 2))
    names: list[Any] = ["p95", "mean", "p50", "rate", "max"]
    together = intervals(values, in_segments(100, 20), names)
    alone = [interval(values, in_segments(100, 20), name) for name in names]
    assert [str(i) for i in together] == [str(i) for i in alone]


def test_repeats_of_the_same_frames_are_no_further_frames() -> None:
    values = alike(np.random.default_rng(2), (100,), 0.5)
    once = interval(values)
    thrice = interval(np.stack([values] * 3, axis=1))
    assert (thrice.value, thrice.low, thrice.high) == pytest.approx((once.value, once.low, once.high))
    assert thrice.frames == 100


def test_noise_of_repeats_averages_out() -> None:
    random = np.random.default_rng(2)
    values = random.normal(size=(200, 4))
    one, four = interval(values[:, :1], None, "mean", PLAIN), interval(values, None, "mean", PLAIN)
    assert (four.high - four.low) == pytest.approx((one.high - one.low) / 2, rel=0.2)


def test_a_moving_block_stays_in_its_segment() -> None:
    from phrt_plugins.bench.statistics import _moving_blocks

    rows = _moving_blocks(np.array([4, 4, 4, 9, 9, 4]), 3)
    assert rows.tolist() == [[0, 1, 2], [1, 2, 0], [2, 0, 1], [3, 4, 3], [4, 3, 4], [5, 5, 5]]


def test_frames_without_a_value_are_left_out() -> None:
    values = np.random.default_rng(4).normal(size=60)
    gaps = np.insert(values, [0, 30, 60], np.nan)
    assert interval(gaps) == interval(values)
    repeats = np.stack([values, np.full(60, np.nan)], axis=1)
    assert interval(repeats) == interval(values)
    assert interval(repeats, None, "p95") == interval(values, None, "p95")
    assert str(interval(np.full(5, np.nan))) == str(Interval(math.nan, math.nan, math.nan, 0))
    assert interval(np.zeros(0)).frames == 0


def test_a_frame_that_is_missing_on_one_side_is_left_out_of_both() -> None:
    a, b = np.array([1.0, 2.0, np.nan, 4.0]), np.array([0.0, np.nan, 0.0, 1.0])
    found = paired_interval(a, b)
    assert (found.value, found.frames) == (2.0, 2)
    with pytest.raises(ValueError, match=r"paired values differ in shape: \(4, 1\) and \(3, 1\)"):
        paired_interval(a, b[:3])


def test_few_frames_and_a_maximum_have_no_interval() -> None:
    for frames in (1, 5):
        assert not interval(np.arange(frames)).known
        assert not paired_interval(np.arange(frames), np.zeros(frames)).known
        assert not ratio_interval(np.ones(frames), np.ones(frames)).known
    assert interval(np.arange(5.0)).value == 2.0
    assert interval(np.arange(6.0)).known
    assert not interval(np.arange(50.0), None, "max").known
    assert interval(np.arange(50.0), None, "max").value == 49.0
    assert not paired_interval(np.arange(50.0), np.zeros(50), None, "max").known


def test_sums_of_repeats_are_their_mean_sum() -> None:
    assert interval(np.array([[1.0, 3.0], [2.0, 4.0]]), None, "sum").value == 5.0


def test_what_never_happened_may_still_happen() -> None:
    """The exact bound for 100 independent frames (Clopper and Pearson): 1 - 0.025^(1/100) = 3.6 %."""
    never, always = (interval(values, None, "share") for values in (np.zeros(100), np.ones(100)))
    assert (never.value, never.low, never.high) == pytest.approx((0.0, 0.0, 1 - 0.025**0.01))
    assert (always.value, always.low, always.high) == pytest.approx((1.0, 0.025**0.01, 1.0))
    some = interval(np.arange(100) % 4 == 0, None, "share")
    assert 0.0 < some.low < some.value == 0.25 < some.high < 0.5


def test_a_ratio_is_of_the_sums() -> None:
    above, below = np.array([1.0, 0.0, 3.0, np.nan]), np.array([2.0, 0.0, 2.0, 9.0])
    found = ratio_interval(above, below)
    assert (found.value, found.frames) == (1.0, 3)
    random = np.random.default_rng(6)
    below = random.gamma(2.0, 1.0, 200)
    found = ratio_interval(0.7 * below + random.normal(0, 0.05, 200), below)
    assert found.low < 0.7 < found.high
    assert found.high - found.low < 0.05
    assert ratio_interval(np.ones(3), np.zeros(3)).frames == 0
    with pytest.raises(ValueError, match="differ in shape"):
        ratio_interval(np.ones(3), np.ones(4))


@pytest.mark.parametrize(
    ("low", "high", "better", "said"),
    [
        (-3.0, -1.0, "lower", "better"),
        (-3.0, -1.0, "higher", "worse"),
        (1.0, 3.0, "lower", "worse"),
        (1.0, 3.0, "higher", "better"),
        (-1.0, 3.0, "lower", "no difference shown"),
        (0.0, 3.0, "higher", "no difference shown"),
        (0.0, 0.0, "lower", "no difference shown"),
        (1.0, 3.0, "neither", "no difference shown"),
        (math.nan, math.nan, "lower", "no difference shown"),
    ],
)
def test_only_an_interval_without_zero_says_anything(low: float, high: float, better: Any, said: str) -> None:
    assert judged(Interval((low + high) / 2, low, high, 10), better) == said


def test_a_small_difference_shows_where_frames_are_paired_only() -> None:
    """What is hard for one is hard for the other: 2 % show against frames that vary by 50 %."""
    random = np.random.default_rng(7)
    hard = np.exp(0.5 * alike(random, (60,), 0.8))
    a, b = 0.98 * hard * np.exp(random.normal(0, 0.02, 60)), hard * np.exp(random.normal(0, 0.02, 60))
    segments = in_segments(60, 10)
    apart = interval(a, segments), interval(b, segments)
    assert apart[0].high > apart[1].low, "the intervals overlap"
    assert judged(paired_interval(a, b, segments), "lower") == "better"
    assert judged(paired_interval(b, a, segments), "lower") == "worse"


def test_no_difference_is_rarely_called_one() -> None:
    random = np.random.default_rng(8)
    hard = alike(random, (200, 60), 0.8)
    noise = alike(random, (2, 200, 60), 0.5)
    few = Resampling(resamples=500)
    found = [
        judged(paired_interval(h + a, h + b, in_segments(60, 10), "mean", few), "lower")
        for h, a, b in zip(hard, *noise, strict=True)
    ]
    assert 0 < sum(said != "no difference shown" for said in found) <= 0.14 * len(found)


def test_the_block_length_follows_the_frames() -> None:
    assert default_block_length(np.zeros(300)) == 26
    assert default_block_length(in_segments(300, 10)) == 10
    assert default_block_length(np.zeros(12)) == 3
    assert default_block_length(np.zeros(6)) == 1


@given(
    st.lists(st.floats(-1e6, 1e6), min_size=6, max_size=40),
    st.integers(1, 12),
    st.sampled_from(["mean", "p50", "p95", "p99"]),
)
def test_an_interval_lies_among_the_values(values: list[float], each: int, statistic: Any) -> None:
    found = interval(np.array(values), in_segments(len(values), each), statistic, Resampling(resamples=50))
    slack = 1e-9 * max(abs(min(values)), abs(max(values)), 1.0)
    assert min(values) - slack <= found.low <= found.high <= max(values) + slack
    assert found.frames == len(values)
