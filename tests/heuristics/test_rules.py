"""What sets each heuristic apart from the others."""

from __future__ import annotations

import numpy as np
import pytest
from candidate_kit import candidates, items_of, one_frame

from phrt.errors import OptionError
from phrt.interfaces.heuristic import Heuristic
from phrt.registry import get_registry


def made(name: str, **options: object) -> Heuristic:
    heuristic: Heuristic = get_registry().create("heuristic", name, options)
    return heuristic


def test_greedy_relevance_looks_at_relevance_alone() -> None:
    work = candidates([50.0, 10.0, 10.0], [5, 3, 4])
    assert items_of(made("greedy_relevance"), work, 60) == [0, 2]


def test_greedy_ratio_looks_at_what_relevance_costs() -> None:
    work = candidates([50.0, 10.0, 10.0], [5, 3, 4])
    assert items_of(made("greedy_ratio"), work, 60) == [2, 1]
    assert items_of(made("greedy_ratio"), work, 70) == [2, 1, 0]


def test_greedy_ratio_is_near_the_best_sum_of_relevance_where_items_are_small() -> None:
    random = np.random.default_rng(5)
    cost, relevance = random.integers(1, 30, 60), random.integers(1, 100, 60)
    best = np.zeros(301)
    for c, r in zip(cost, relevance, strict=True):
        best[c:] = np.maximum(best[c:], best[:-c] + r)
    got = relevance[items_of(made("greedy_ratio"), candidates(cost.astype(float), relevance), 300)].sum()
    assert 0.95 * best[300] <= got <= best[300]


def test_random_is_reproducible_and_differs_by_seed_and_frame() -> None:
    work = candidates([1.0] * 30)
    orders = [
        items_of(made("random", seed=seed), work, frame_index=frame) for seed, frame in ((0, 0), (0, 0), (1, 0), (0, 1))
    ]
    assert orders[0] == orders[1]
    assert len({tuple(order) for order in orders}) == 3


def test_random_chooses_all_items_equally_often() -> None:
    work, heuristic, times = candidates([1.0] * 20), made("random"), np.zeros(20)
    for frame in range(1000):
        times[items_of(heuristic, work, 5, frame)] += 1
    # 250 expected, standard deviation 14.
    assert times.min() > 190
    assert times.max() < 310


def test_random_draws_an_item_by_itself() -> None:
    """Of two items the order is the same whether or not there are others."""
    all_of_them = items_of(made("random"), candidates([1.0] * 30))
    some = np.array([3, 8, 20])
    work = candidates([1.0] * 3, object_id=(some + 1).astype(np.int32))
    assert some[items_of(made("random"), work)].tolist() == [item for item in all_of_them if item in some]


@pytest.mark.parametrize("seed", [-1, 2**63, "x"])
def test_random_refuses_a_seed_that_is_none(seed: object) -> None:
    with pytest.raises(OptionError, match="option 'seed'"):
        made("random", seed=seed)


def test_round_robin_gives_every_item_its_turn() -> None:
    work, heuristic = candidates([1.0] * 7), made("round_robin")
    turns = [items_of(heuristic, work, 3) for _ in range(7)]
    assert turns[:3] == [[0, 1, 2], [3, 4, 5], [6, 0, 1]]
    assert np.bincount(np.concatenate(turns)).tolist() == [3] * 7


def test_round_robin_remembers_items_that_were_out_of_sight() -> None:
    heuristic = made("round_robin")
    both, second = candidates([1.0, 1.0]), candidates([1.0], object_id=np.array([2], np.int32))
    assert items_of(heuristic, both, 1) == [0]
    assert items_of(heuristic, second, 1) == [0]
    assert items_of(heuristic, both, 1) == [0], "object 1 has waited longer than object 2"
    late = candidates([1.0] * 3, object_id=np.array([1, 2, 9], np.int32))
    assert items_of(heuristic, late, 2) == [2, 1], "and one never seen before longer than both"


def test_uniform_gives_one_pass_to_all_before_a_second_one() -> None:
    work = candidates([8.0, 8.0, 8.0], [1, 3, 2])
    assert one_frame(made("uniform"), work, 6) == [(1, 1), (2, 1), (0, 1)]
    assert one_frame(made("uniform"), work, 8) == [(1, 1), (2, 1), (0, 1), (1, 1)]
    assert len(one_frame(made("uniform"), work)) == 12


def test_uniform_traces_mandatory_items_whole() -> None:
    work = candidates([8.0, 8.0], mandatory=[False, True])
    assert one_frame(made("uniform"), work, 12) == [(1, 4), (0, 1), (0, 1)]
