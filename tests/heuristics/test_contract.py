"""What every heuristic that ships keeps: the contract, and more than it asks for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from candidate_kit import candidates, context, items_of, one_frame
from hypothesis import given
from hypothesis import strategies as st

from phrt.interfaces.heuristic import PASSES, Candidates
from phrt.registry import get_registry
from phrt.testing import check_heuristic

NAMES = sorted(entry.name for entry in get_registry().plugins("heuristic") if entry.origin == "built-in")
CHOOSING = [name for name in NAMES if name != "raster_only"]
VARIANTS = [
    *((name, {}) for name in CHOOSING),
    ("selection_graph", {"refresh_pointers": False, "n_pointers": 1}),
    ("random", {"seed": 7}),
]

works = st.lists(st.tuples(st.integers(1, 50), st.integers(0, 8), st.booleans()), max_size=30)


def made_of(items: list[tuple[int, int, bool]]) -> Candidates:
    return candidates([float(c) for c, _, _ in items], [r for _, r, _ in items], [m for _, _, m in items])


@pytest.mark.parametrize(("name", "options"), VARIANTS)
def test_it_keeps_the_contract(name: str, options: dict[str, object]) -> None:
    check_heuristic(name, options)


def test_raster_only_keeps_all_of_it_but_for_mandatory_items() -> None:
    check_heuristic("raster_only", mandatory=False)
    with pytest.raises(AssertionError, match="mandatory items that fit are asked for"):
        check_heuristic("raster_only")


@pytest.mark.parametrize(("name", "options"), VARIANTS)
@given(items=works)
def test_with_no_limit_everything_is_traced(
    name: str, options: dict[str, object], items: list[tuple[int, int, bool]]
) -> None:
    passes = np.zeros(len(items), int)
    for item, count in one_frame(get_registry().create("heuristic", name, options), made_of(items)):
        passes[item] += count
    assert (passes == PASSES).all()


@pytest.mark.parametrize(("name", "options"), VARIANTS)
def test_no_candidate_one_candidate_and_all_equal(name: str, options: dict[str, object]) -> None:
    heuristic = get_registry().create("heuristic", name, options)
    assert one_frame(heuristic, candidates([])) == []
    assert set(items_of(heuristic, candidates([5.0]), 5.0)) == {0}
    assert items_of(heuristic, candidates([5.0]), 1.0) == []
    equal = items_of(heuristic, candidates([5.0] * 20, np.zeros(20)), 50.0)
    assert sum(5 for _ in set(equal)) <= 100
    assert len(equal) == (10 if name != "uniform" else 40)


@pytest.mark.parametrize("name", NAMES)
def test_nothing_is_chosen_before_the_first_frame(name: str) -> None:
    assert get_registry().create("heuristic", name).next(math.inf) is None


@pytest.mark.parametrize("name", NAMES)
def test_every_heuristic_has_a_manual_page_with_its_source_and_an_example(name: str) -> None:
    page = type(get_registry().create("heuristic", name)).__module__
    text = __import__(page, fromlist=["_"]).__doc__
    assert text.startswith(f"{name}: ")
    for part in ("Options: ", "Source: ", "Example::", f"--heuristic {name}"):
        assert part in text


def test_keys_are_of_object_and_effect_name_and_not_of_the_order_of_effects() -> None:
    one = candidates([1.0, 1.0], effect_names=("a", "b"), effect=np.array([0, 1], np.int32))
    other = candidates([1.0, 1.0], effect_names=("b", "a"), effect=np.array([1, 0], np.int32))
    assert one.keys().tolist() == other.keys().tolist() == [2, 5]
    assert len(set(one.keys().tolist())) == 2


@pytest.mark.parametrize(("name", "options"), VARIANTS)
@given(items=works, budget=st.integers(0, 600).map(float), share=st.sampled_from([0.0, 0.3, 1.0]))
def test_many_at_once_are_the_same_as_one_by_one(
    name: str, options: dict[str, object], items: list[tuple[int, int, bool]], budget: float, share: float
) -> None:
    work = made_of(items)
    expected = one_frame(get_registry().create("heuristic", name, options), work, budget)
    heuristic = get_registry().create("heuristic", name, options)
    heuristic.begin_frame(work, context(budget))
    remaining, found = budget, []
    while (taken := heuristic.take(remaining, share * remaining)) is not None and len(taken):
        table = taken if taken.ndim == 2 else np.stack([taken, np.full(len(taken), PASSES)], axis=1)
        assert len(np.unique(table[:, 0])) == len(table), "an item twice in one answer"
        for item, passes in table.tolist():
            found.append((item, passes))
            remaining -= float(work.predicted_cost[item]) * passes / PASSES
    assert taken is None or found == expected
