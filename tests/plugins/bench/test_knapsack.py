"""Knapsacks against every subset, against dynamic programming, and against HiGHS asked directly."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import needs
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phrt.errors import PhrtWarning
from phrt_plugins.bench import knapsack, knapsack_states
from phrt_plugins.bench.knapsack import best_items, solve

needs.package("scipy")

amounts = st.floats(0.0, 1e6, allow_subnormal=False) | st.integers(0, 20).map(float)
benefits = st.floats(-10.0, 1e6, allow_subnormal=False) | st.integers(-3, 20).map(float)


def brute_force(benefit: np.ndarray, cost: np.ndarray, budget: float, group: np.ndarray | None = None) -> float:
    """The most that any subset brings."""
    best = 0.0
    for chosen in product((False, True), repeat=len(benefit)):
        mask = np.array(chosen, bool)
        if group is not None and len(np.unique(group[mask])) < mask.sum():
            continue
        if math.fsum(cost[mask]) <= budget:
            best = max(best, math.fsum(benefit[mask]))
    return best


def by_table(benefit: np.ndarray, cost: np.ndarray, budget: int) -> float:
    """Dynamic programming over whole costs (Bellman 1957)."""
    best = np.zeros(budget + 1)
    for b, c in zip(benefit, cost, strict=True):
        if b > 0 and c <= budget:
            best[c:] = np.maximum(best[c:], best[: budget + 1 - c] + b)
    return float(best[-1])


def check(benefit: np.ndarray, cost: np.ndarray, budget: float, group: np.ndarray | None = None) -> None:
    chosen = solve(benefit, cost, budget, group)
    assert chosen.gap == 0
    mask = chosen.chosen
    assert mask.dtype == bool
    assert mask.shape == benefit.shape
    assert (benefit[mask] > 0).all()
    assert math.fsum(cost[mask]) <= budget * (1 + 2e-9)
    brought, wanted = math.fsum(benefit[mask]), brute_force(benefit, cost, budget, group)
    assert brought >= wanted * (1 - 1e-9)
    if (cost == np.floor(cost)).all():
        assert math.fsum(cost[mask]) <= budget
        assert brought == pytest.approx(wanted, rel=1e-9)
    if group is None:
        assert mask[(cost == 0) & (benefit > 0)].all()
    else:
        assert len(np.unique(group[mask])) == mask.sum()


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(benefits, amounts), max_size=10), st.floats(0.0, 1.2))
def test_nothing_brings_more_than_the_items_chosen(items: list[tuple[float, float]], share: float) -> None:
    benefit, cost = np.array(items, np.float64).reshape(-1, 2).T
    check(benefit, cost, float(cost.sum()) * share)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(benefits, st.integers(0, 30)), max_size=10), st.integers(0, 120))
def test_whole_costs_never_pass_the_budget(items: list[tuple[float, int]], budget: int) -> None:
    benefit, cost = np.array(items, np.float64).reshape(-1, 2).T
    check(benefit, cost, budget)


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(benefits, amounts, st.integers(0, 3)), max_size=9), st.floats(0.0, 1.2))
def test_one_of_each_group(items: list[tuple[float, float, int]], share: float) -> None:
    benefit, cost, group = np.array(items, np.float64).reshape(-1, 3).T
    check(benefit, cost, float(cost.sum()) * share, group.astype(int))


@pytest.mark.parametrize("seed", range(6))
def test_two_hundred_items_are_as_the_table_has_them(seed: int) -> None:
    random = np.random.default_rng(seed)
    cost = np.ceil(random.lognormal(2, 1, 200)).astype(int)
    benefit = cost * random.lognormal(0, 0.1 + 0.3 * seed, 200)
    budget = int(cost.sum() * (0.1 + 0.15 * seed))
    chosen = best_items(benefit, cost, budget)
    assert cost[chosen].sum() <= budget
    assert benefit[chosen].sum() == pytest.approx(by_table(benefit, cost, budget), rel=1e-12)


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_units_do_not_matter(scale: float) -> None:
    random = np.random.default_rng(3)
    cost, benefit = random.lognormal(0, 1, 12), random.lognormal(0, 1, 12)
    wanted = best_items(benefit, cost, cost.sum() / 3)
    assert benefit[wanted].sum() == pytest.approx(brute_force(benefit, cost, float(cost.sum() / 3)), rel=1e-9)
    assert (best_items(benefit * scale, cost, cost.sum() / 3) == wanted).all()
    assert (best_items(benefit, cost * scale, cost.sum() * scale / 3) == wanted).all()


def test_what_fits_exactly_fits() -> None:
    cost = np.array([0.1, 0.2, 0.3])
    assert sum(cost.tolist()) > 0.6
    assert best_items(np.ones(3), cost, 0.6).all()


def test_a_tiny_item_beside_a_huge_one_is_not_forgotten() -> None:
    assert best_items(np.array([1e9, 1e-9, 1.0]), np.array([1.0, 1e-9, 5.0]), 1.5).tolist() == [True, True, False]


def test_no_items_and_no_budget() -> None:
    assert best_items(np.zeros(0), np.zeros(0), 5.0).shape == (0,)
    assert best_items(np.array([1.0, 2.0, -1.0]), np.array([0.0, 1.0, 0.0]), 0.0).tolist() == [True, False, False]


def test_without_a_limit_all_that_brings_something_is_taken() -> None:
    benefit, cost = np.array([3.0, 0.0, -2.0, 1e-9]), np.array([1e300, 1.0, 1.0, math.inf])
    assert best_items(benefit, cost, math.inf).tolist() == [True, False, False, False]


@pytest.mark.parametrize(
    ("benefit", "cost", "budget", "message"),
    [
        ([math.nan], [1.0], 1.0, "a benefit is NaN or infinite"),
        ([1.0], [math.nan], 1.0, "1 costs are NaN"),
        ([1.0], [1.0], math.nan, "the budget is nan"),
        ([1.0], [-1.0], 1.0, "the smallest cost is -1.0"),
        ([1.0, 2.0], [1.0], 1.0, r"benefit \(2,\), cost \(1,\)"),
    ],
)
def test_nonsense_is_refused(benefit: list[float], cost: list[float], budget: float, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        best_items(np.array(benefit), np.array(cost), budget)


def hard(count: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Strongly correlated items, the hardest there are (Pisinger 2005)."""
    cost = np.random.default_rng(0).integers(1, 1000, count)
    return (cost + 100.0), cost, float(cost.sum() // 3)


@pytest.mark.parametrize("grouped", [False, True])
def test_highs_answers_where_there_are_too_many_states(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], grouped: bool
) -> None:
    random = np.random.default_rng(5)
    cost = random.integers(1, 200, 60)
    benefit = np.ceil(cost * random.lognormal(0, 0.3, 60))
    group = np.arange(60) // 3 if grouped else None
    wanted = solve(benefit, cost, 800, group)
    monkeypatch.setattr(knapsack_states, "MOST_STATES", 1)
    asked: list[Any] = []
    highs = knapsack._highs

    def ask(*given: Any) -> Any:
        asked.append(given)
        return highs(*given)

    monkeypatch.setattr(knapsack, "_highs", ask)
    found = solve(benefit, cost, 800, group)
    assert asked
    assert found.gap == 0
    assert cost[found.chosen].sum() <= 800
    assert benefit[found.chosen].sum() == benefit[wanted.chosen].sum()
    assert capfd.readouterr().out == ""


def test_a_choice_that_is_not_proven_is_said_to_be(monkeypatch: pytest.MonkeyPatch) -> None:
    benefit, cost, budget = hard(400)
    monkeypatch.setattr(knapsack_states, "MOST_STATES", 20)
    monkeypatch.setattr(knapsack, "_highs", lambda problem, *rest: (np.zeros(len(problem), bool), math.inf))
    with pytest.warns(
        PhrtWarning, match=r"a knapsack of 400 items was not solved in time: the optimum may be better by"
    ):
        chosen = best_items(benefit, cost, budget)
    assert cost[chosen].sum() <= budget
    solution = solve(benefit, cost, budget)
    optimum = by_table(benefit, cost, int(budget))
    assert 0 < solution.gap < 0.05
    assert benefit[solution.chosen].sum() <= optimum <= benefit[solution.chosen].sum() * (1 + solution.gap)


def test_the_solver_is_stopped_and_its_bound_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    benefit, cost, budget = hard(400)
    monkeypatch.setattr(knapsack_states, "MOST_STATES", 20)
    solution = solve(benefit, cost, budget, time_limit_s=0.02)
    optimum, found = by_table(benefit, cost, int(budget)), benefit[solution.chosen].sum()
    assert cost[solution.chosen].sum() <= budget
    assert found <= optimum <= found * (1 + max(solution.gap, 1e-9))
