"""gain: passes by the error they take away per cost, optimism about what is not known, steadiness from frame to frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from candidate_kit import candidates, context, one_frame, rows
from hypothesis import given
from hypothesis import strategies as st

from phrt.frame import MASK_HISTORY, MASK_TRACED
from phrt.interfaces.heuristic import NEVER_TRACED, PASSES, Candidates, Request
from phrt.kernels.change import neighbour_values
from phrt.kernels.layers import fill_gaps
from phrt.registry import get_registry
from phrt_heuristics.gain import ERROR_LEFT, SMALL_PIXELS, STEPS, Gain

PIXELS = 1000


def made(**options: object) -> Gain:
    heuristic: Gain = get_registry().create("heuristic", "gain", options)
    return heuristic


def measured(
    change: list[float], detail: list[float] | None = None, cost: list[float] | None = None, **columns: Any
) -> Candidates:
    """Items of 1000 pixels that were traced in the previous frame, and what that changed."""
    n = len(change)
    filled = {
        "pixel_count": np.full(n, PIXELS, np.int32),
        "frames_since_traced": np.ones(n, np.int32),
        "measured_change": np.array(change, np.float32),
        "measured_strength": np.array(change, np.float32),
        "measured_detail": np.array(change if detail is None else detail, np.float32),
    }
    return candidates(cost or [4000.0] * n, **(filled | columns))


def passes_of(chosen: list[tuple[int, int]], count: int) -> list[int]:
    total = np.zeros(count, int)
    for item, passes in chosen:
        total[item] += passes
    return total.tolist()


def test_what_changes_more_comes_first() -> None:
    assert one_frame(made(), measured([0.1, 0.3, 0.2]), 3000) == [(1, 1), (2, 1), (0, 1)]


def test_what_costs_less_comes_first() -> None:
    assert one_frame(made(), measured([0.2, 0.2], cost=[4000.0, 3000.0]), 800) == [(1, 1)]


def test_what_is_important_comes_first() -> None:
    work = measured([0.2, 0.2], importance_factor=np.array([1, 2], np.float32))
    assert one_frame(made(), work, 1000) == [(1, 1)]


def test_everything_gets_a_pass_before_anything_smooth_gets_two() -> None:
    work = measured([0.1, 0.4], [0.01, 0.04])
    assert passes_of(one_frame(made(), work, 2000), 2) == [1, 1]
    assert passes_of(one_frame(made(), work, 3000), 2) == [1, 2]


def test_more_passes_go_where_filling_fails() -> None:
    """Both change as much, but the second one is full of detail."""
    assert passes_of(one_frame(made(), measured([0.3, 0.3], [0.01, 0.3]), 5000), 2) == [1, 4]


def test_what_changes_nothing_comes_last() -> None:
    assert passes_of(one_frame(made(), measured([0.0, 0.1, 0.0]), 4000), 3) == [0, 4, 0]
    assert passes_of(one_frame(made(), measured([0.0, 0.1, 0.0]), 12000), 3) == [4, 4, 4]


def test_small_items_are_asked_for_whole() -> None:
    few = np.full(2, SMALL_PIXELS - 1, np.int32)
    assert one_frame(made(), measured([0.1, 0.2], cost=[100.0, 100.0], pixel_count=few), 200) == [(1, 4), (0, 4)]


def test_a_power_prefers_few_large_changes() -> None:
    work = measured([0.1, 0.09], measured_strength=np.array([0.1, 0.9], np.float32))
    assert one_frame(made(power=1), work, 1000) == [(0, 1)]
    assert one_frame(made(power=2), work, 1000) == [(1, 1)]


def test_an_unknown_item_is_expected_to_be_better_than_its_effects_mean() -> None:
    work = measured([0.1, 0.2, math.nan], frames_since_traced=np.array([1, 1, NEVER_TRACED], np.int32))
    assert [item for item, _ in one_frame(made(optimism=2.0), work, 3000)] == [2, 1, 0]
    assert [item for item, _ in one_frame(made(optimism=1.0), work, 3000)] == [1, 2, 0]
    assert [item for item, _ in one_frame(made(optimism=0.0), work, 3000)] == [1, 0, 1]


def test_means_are_of_the_effect_and_are_remembered() -> None:
    two = {"effect_names": ("shadows", "reflections")}
    first = measured([0.4, 0.1], effect=np.array([0, 1], np.int32), **two)
    heuristic = made(optimism=1.0)
    one_frame(heuristic, first, 0)
    unknown = measured([math.nan, math.nan, 0.2], effect=np.array([1, 0, 0], np.int32), **two)
    unknown = rows(unknown, np.array([0, 1]))
    assert one_frame(heuristic, unknown, 1000) == [(1, 1)]


def test_what_changed_nothing_is_tried_again_some_time() -> None:
    def first(waited: int) -> int:
        work = measured([0.0, 0.1, 0.1], frames_since_traced=np.array([waited, 1, 1], np.int32))
        return one_frame(made(forget_frames=60, optimism=2), work, 1000)[0][0]

    assert first(2) == 1
    assert first(300) == 0
    assert first(NEVER_TRACED) == 0


def test_trying_again_takes_a_small_share() -> None:
    """One of fifty items changes something; the others are tried from time to time, and cost little."""
    n, frames = 50, 400
    truth = np.where(np.arange(n) == 7, 0.3, 0.0).astype(np.float32)
    known, waited = np.full(n, np.nan, np.float32), np.full(n, NEVER_TRACED, np.int64)
    heuristic, traced = made(damping=0), np.zeros((frames, n), int)
    for frame in range(frames):
        work = measured(known.tolist(), frames_since_traced=waited.astype(np.int32))
        traced[frame] = passes_of(one_frame(heuristic, work, 6000, frame), n)
        known = np.where(traced[frame] > 0, truth, known)
        waited = np.where(traced[frame] > 0, 1, np.minimum(waited + 1, NEVER_TRACED))
    assert (traced.sum(axis=0) > 0).all(), "all were tried"
    assert (traced[50:, 7] == 4).mean() > 0.95, "the one that counts is traced whole"


def test_passes_of_the_previous_frame_have_an_advantage() -> None:
    def second(damping: float) -> int:
        heuristic = made(damping=damping)
        one_frame(heuristic, measured([0.2, 0.19]), 1000)
        return one_frame(heuristic, measured([0.19, 0.2]), 1000)[0][0]

    assert second(0.0) == 1
    assert second(0.2) == 0


def test_history_leaves_less_to_gain_and_age_makes_it_more() -> None:
    def order(share: list[float], age: list[float]) -> list[int]:
        work = measured(
            [0.2, 0.2],
            [0.02, 0.02],
            history_share=np.array(share, np.float32),
            history_age=np.array(age, np.float32),
            measured_drift=np.full(2, 0.01, np.float32),
        )
        # A first pass of an item that is held whole is empty.
        return [item for item, passes in one_frame(made(), work, 2000) if (passes, share[item]) != (1, 1.0)]

    assert order([1.0, 0.0], [1.0, 0.0]) == [1, 1], "nothing stands in for the second one"
    assert order([1.0, 1.0], [2.0, 9.0])[0] == 1, "the older one"


def test_mandatory_items_come_first_even_if_they_change_nothing() -> None:
    work = measured([0.0, 0.5], mandatory=np.array([True, False]))
    assert passes_of(one_frame(made(), work, 6000), 2) == [4, 2]


def test_an_item_that_is_too_dear_as_a_whole_is_tried_in_part() -> None:
    work = measured([math.nan, 0.1], cost=[8000.0, 400.0])
    assert passes_of(one_frame(made(), work, 2400), 2)[0] == 1


shares = st.floats(0, 1, width=32)
unknown = st.one_of(st.just(math.nan), shares)
things = st.lists(
    st.tuples(
        st.integers(1, 5000), st.floats(0.25, 1e6, width=32), unknown, unknown, unknown, unknown, shares, st.booleans(),
        st.sampled_from([1, 2, 40, NEVER_TRACED]),
    ),
    max_size=25,
)  # fmt: skip


def made_of(items: list[tuple[Any, ...]]) -> Candidates:
    columns = list(zip(*items, strict=True)) or [()] * 9
    pixels, cost, change, strength, detail, drift, share, mandatory, since = (np.array(column) for column in columns)
    f = np.float32
    return candidates(
        cost.astype(f), mandatory=mandatory.astype(bool), pixel_count=pixels.astype(np.int32), measured_change=change.astype(f),
        measured_strength=strength.astype(f), measured_detail=detail.astype(f), measured_drift=drift.astype(f),
        history_share=share.astype(f), history_age=(share * 5).astype(f), frames_since_traced=since.astype(np.int32),
    )  # fmt: skip


@given(
    items=things,
    budget=st.floats(0, 1e7),
    shuffle=st.randoms(use_true_random=False),
    power=st.sampled_from([0, 1, 2.5]),
)
def test_any_measurements_give_a_choice_that_fits_and_does_not_depend_on_order(
    items: list[tuple[Any, ...]], budget: float, shuffle: Any, power: float
) -> None:
    work = made_of(items)
    order = np.arange(len(items))
    shuffle.shuffle(order)
    one, other = made(power=power), made(power=power)
    for frame in range(2):
        chosen = one_frame(one, work, budget, frame)  # asserts what fits
        assert max(passes_of(chosen, len(items)), default=0) <= PASSES
        mandatory = [bool(work.mandatory[item]) for item, _ in chosen]
        assert mandatory == sorted(mandatory, reverse=True)
        moved = one_frame(other, rows(work, order), budget, frame)
        assert [(int(order[item]), passes) for item, passes in moved] == chosen
    assert passes_of(one_frame(one, work), len(items)) == [PASSES] * len(items), "with no limit everything"


@given(items=things, budget=st.integers(0, 10**6), share=st.sampled_from([0.0, 0.1, 1.0]))
def test_many_at_once_are_the_same_passes(items: list[tuple[Any, ...]], budget: int, share: float) -> None:
    work = made_of([(item[0], float(item[1] // 4 * 4 + 4), *item[2:]) for item in items])
    expected = passes_of(one_frame(made(), work, budget), len(items))
    heuristic, remaining, found = made(), float(budget), np.zeros(len(items), int)
    heuristic.begin_frame(work, context(budget))
    ends = np.pad(np.cumsum(work.pass_shares(), axis=1, dtype=np.float64), ((0, 0), (1, 0)))

    def cost(item: int, passes: int, pixels: int | None = None) -> float:
        part = ends[item, min(found[item] + passes, PASSES)] - ends[item, found[item]]
        found[item] += passes
        return float(work.predicted_cost[item]) * min(part, (pixels or np.inf) / work.pixel_count[item])

    while (taken := heuristic.take(remaining, share * remaining)) is not None and len(taken):
        assert len(np.unique(taken[:, 0])) == len(taken), "an item twice in one answer"
        remaining -= sum(cost(item, passes) for item, passes in taken.tolist())
        assert remaining >= -1e-6 * budget
    while (request := heuristic.next(remaining)) is not None:
        remaining -= cost(request.item, request.passes, request.pixels)
        assert remaining >= -1e-6 * budget
    assert found.tolist() == expected


def test_where_the_budget_ends_within_a_step_part_of_it_is_traced() -> None:
    heuristic = made()
    heuristic.begin_frame(measured([0.3, 0.1], [0.3, 0.1]), context(1250.0))
    assert heuristic.take(1250.0, 1250.0).tolist() == [[0, 1]]
    assert heuristic.take(250.0, 250.0) is None
    assert heuristic.next(250.0) == Request(1, 1, pixels=62)


def test_a_small_rest_is_not_worth_a_part() -> None:
    heuristic = made()
    heuristic.begin_frame(measured([0.3]), context(100.0))
    assert heuristic.take(100.0, 100.0).tolist() == []
    assert heuristic.next(100.0) is None


def test_equal_items_go_by_their_keys() -> None:
    assert [item for item, _ in one_frame(made(), measured([0.1] * 5), 3000)] == [0, 1, 2]


@pytest.mark.parametrize("after", [1, 2])
def test_what_filling_leaves_is_what_straight_edges_leave(after: int) -> None:
    """Lit on one side of an edge, in shadow on the other, the edge in any direction: error over all pixels once the gaps after one
    and two passes are filled, as a share of what pixels differ by from their neighbours."""
    rng, size = np.random.default_rng(0), 64
    y, x = np.mgrid[:size, :size]
    place = np.where((x & 1) == (y & 1), y & 1, 2 + (y & 1)).ravel()
    one, pixels = np.ones(size * size, np.uint32), np.arange(size * size, dtype=np.int32)
    firsts = pixels[place == 0]
    whole = np.full(len(pixels), MASK_TRACED, np.uint8)
    left = detail = 0.0
    for _ in range(150):
        angle, shift = rng.uniform(0, 2 * np.pi), rng.uniform(-5, 5)
        lit = (
            ((x - size / 2) * np.cos(angle) + (y - size / 2) * np.sin(angle) > shift).astype(np.float32).reshape(-1, 1)
        )
        layer, mask = lit * (place < after)[:, None], np.where(place < after, MASK_TRACED, 0).astype(np.uint8)
        found, needed = np.zeros((2, len(pixels)), np.uint8)
        fill_gaps(pixels, one, mask, size, size, MASK_TRACED, MASK_HISTORY, True, layer, found, needed)
        left += float(np.abs(layer - lit).mean())
        means, found = np.empty((len(firsts), 1), np.float32), np.empty(len(firsts), np.uint8)
        neighbour_values(firsts, one, whole, MASK_TRACED, size, size, lit, means, found)
        detail += float(np.abs(means - lit[firsts]).mean())
    step = int(np.flatnonzero(np.cumsum(STEPS[0]) == after)[0])
    assert left / detail == pytest.approx(ERROR_LEFT[step], abs=0.03)
