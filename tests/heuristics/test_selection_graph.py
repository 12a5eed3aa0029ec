"""The selection graph: Table 2 of the paper, and what a graph with fresh pointers must choose."""

from __future__ import annotations

import pytest
from candidate_kit import candidates, context, items_of
from hypothesis import given
from hypothesis import strategies as st

from phrt.interfaces.heuristic import Candidates
from phrt.registry import get_registry
from phrt_heuristics.graph import Graph
from phrt_heuristics.selection_graph import SelectionGraph

# Andrade et al. 2014, Table 2: nodes 9 to 22.
COST = [20, 19, 18, 17, 16, 15, 14, 14, 13, 12, 11, 10, 9, 9]
RELEVANCE = [22, 21, 18, 30, 31, 32, 28, 27, 9, 29, 1, 20, 4, 3]
FIRST_NODE = 9


def made(**options: object) -> SelectionGraph:
    graph = get_registry().create("heuristic", "selection_graph", options)
    assert isinstance(graph, SelectionGraph)
    return graph


def table_2() -> Candidates:
    return candidates([float(c) for c in COST], RELEVANCE)


def nodes(items: list[int]) -> list[int]:
    return [item + FIRST_NODE for item in items]


@pytest.mark.parametrize("refresh", [True, False])
@pytest.mark.parametrize("n_pointers", [1, 3, 20])
def test_with_18_left_node_14_is_selected_and_nodes_9_and_10_move(refresh: bool, n_pointers: int) -> None:
    graph = made(refresh_pointers=refresh, n_pointers=n_pointers)
    graph.begin_frame(table_2(), context())
    item = graph.next(18.0)
    assert item is not None
    assert nodes([item]) == [14]
    assert nodes(graph.moved) == [9, 10]


@pytest.mark.parametrize(
    ("budget", "selected", "relevance"),
    [
        (8.9, [], 0),
        (9, [21], 4),
        (10, [20], 20),
        (13, [18], 29),
        (18, [14], 32),
        (40, [14, 13, 21], 67),
        (200, [14, 13, 12, 18, 15, 16, 9, 10, 20, 11, 17, 21, 22, 19], 275),
    ],
)
def test_further_budgets_on_table_2(budget: float, selected: list[int], relevance: int) -> None:
    graph = made()
    items = items_of(graph, table_2(), budget)
    assert sum(RELEVANCE[item] for item in items) == relevance
    if budget < 200:
        assert nodes(items) == selected
    assert sorted([*nodes(items), *nodes(graph.moved)]) == list(range(9, 23)), "what is not traced moves"


def test_the_order_without_a_budget_is_that_of_relevance() -> None:
    relevance = [RELEVANCE[item] for item in items_of(made(), table_2())]
    assert relevance == sorted(RELEVANCE, reverse=True)


def test_kept_pointers_are_those_of_the_paper() -> None:
    graph = Graph(table_2(), 3)
    assert graph._pointers is not None
    found = {node + FIRST_NODE: [p + FIRST_NODE for p in row if p >= 0] for node, row in enumerate(graph._pointers)}
    assert found[9] == found[11] == [14, 13, 12]
    assert found[12] == [14, 13]
    assert found[14] == []
    assert found[15] == [18]
    assert found[16] == [15, 18] or found[16] == [18, 15]
    assert found[19] == [20, 21, 22]
    assert found[20] == found[21] == []
    assert found[22] == [21]


def test_stale_pointers_miss_what_fresh_ones_find() -> None:
    """One pointer a node: when the node it led to is gone, the walk stops early."""
    # Nodes by cost: 4 (R 1), 3 (R 2), 2 (R 9), 1 (R 8). All point at R 9, the last at none.
    work = candidates([4.0, 3.0, 2.0, 1.0], [1, 2, 9, 8])
    assert items_of(made(), work, 10) == [2, 3, 1, 0]
    assert items_of(made(refresh_pointers=False, n_pointers=1), work, 10) == [2, 0, 1, 3]
    assert items_of(made(refresh_pointers=False, n_pointers=2), work, 10) == [2, 3, 0, 1]


def test_a_moved_node_does_not_come_back_in_the_frame() -> None:
    graph = made()
    graph.begin_frame(candidates([10.0, 2.0, 1.0], [5, 1, 2]), context())
    assert graph.next(3.0) == 2
    assert graph.moved == [0]
    assert graph.next(50.0) == 1
    assert graph.next(50.0) is None


def test_every_frame_begins_with_all_nodes() -> None:
    graph = made()
    assert items_of(graph, table_2(), 1) == []
    assert len(graph.moved) == 14
    assert len(items_of(graph, table_2())) == 14
    assert graph.moved == []


def test_nothing_is_chosen_before_the_first_frame() -> None:
    assert made().next(1.0) is None
    assert made().moved == []


work_items = st.lists(
    st.tuples(st.integers(1, 30), st.integers(0, 12), st.booleans()), max_size=40
)  # few values, so that equals are many


@given(work_items, st.lists(st.integers(0, 400), min_size=1, max_size=60))
def test_fresh_pointers_select_the_most_relevant_that_still_fits(
    rows: list[tuple[int, int, bool]], budgets: list[int]
) -> None:
    work = candidates([float(c) for c, _, _ in rows], [r for _, r, _ in rows])
    graph = made()
    graph.begin_frame(work, context())
    # What is left may only fall; a node that was passed has moved.
    left = set(range(len(rows)))
    for remaining in sorted(budgets, reverse=True):
        fits = [item for item in left if rows[item][0] <= remaining]
        item = graph.next(float(remaining))
        if not fits:
            assert item is None
            continue
        assert item in fits
        assert rows[item][1] == max(rows[i][1] for i in fits)
        left.discard(item)


@given(work_items, st.integers(1, 5), st.integers(0, 400))
def test_kept_pointers_with_room_for_all_nodes_select_as_fresh_ones(
    rows: list[tuple[int, int, bool]], n_pointers: int, budget: int
) -> None:
    work = candidates([float(c) for c, _, _ in rows], [r for _, r, _ in rows], [m for _, _, m in rows])
    fresh = items_of(made(n_pointers=n_pointers), work, float(budget))
    assert items_of(made(refresh_pointers=False, n_pointers=64), work, float(budget)) == fresh
    assert items_of(get_registry().create("heuristic", "greedy_relevance"), work, float(budget)) == fresh


@given(work_items, st.integers(1, 4))
def test_kept_pointers_are_the_most_relevant_nodes_that_cost_no_more(
    rows: list[tuple[int, int, bool]], n_pointers: int
) -> None:
    work = candidates([float(c) for c, _, _ in rows], [r for _, r, _ in rows])
    graph = Graph(work, n_pointers)
    assert graph._pointers is not None
    cost, relevance = graph._cost, work.relevance[graph._items]
    for node, pointers in enumerate(graph._pointers):
        better = sorted((r for c, r in zip(cost, relevance, strict=True) if c <= cost[node] and r > relevance[node]))
        found = [p for p in pointers if p >= 0]
        assert len(set(found)) == len(found)
        assert all(cost[p] <= cost[node] for p in found)
        assert relevance[found].tolist() == better[::-1][:n_pointers]
