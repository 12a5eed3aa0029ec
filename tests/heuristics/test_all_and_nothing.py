"""all_trace yields every candidate once, mandatory ones first; raster_only yields none."""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic, Outcome
from phrt.registry import get_registry

CONTEXT = FrameContext(world=cast(Any, None), frame_index=0, time=0.0, budget=math.inf)


def candidates(mandatory: list[bool]) -> Candidates:
    n = len(mandatory)
    return Candidates(
        effect_names=("shadows",),
        object_id=np.arange(1, n + 1, dtype=np.int32),
        effect=np.zeros(n, np.int32),
        pixel_count=np.full(n, 10, np.int32),
        ray_estimate=np.ones(n, np.float32),
        mandatory=np.array(mandatory, dtype=bool),
        area=np.full(n, 0.1, np.float32),
    )


def one_frame(heuristic: Heuristic, work: Candidates, remaining: float = math.inf) -> list[int]:
    """The items of one frame, each reported at once, in order."""
    heuristic.begin_frame(work, CONTEXT)
    chosen = []
    while (item := heuristic.next(remaining)) is not None:
        chosen.append(item)
        heuristic.report(item, Outcome(pixels=10, rays=10, milliseconds=0.1, complete=True))
        assert len(chosen) <= len(work), "more items than candidates"
    heuristic.end_frame()
    return chosen


@given(st.lists(st.booleans(), max_size=60))
def test_all_trace_yields_every_candidate_once_and_mandatory_ones_first(mandatory: list[bool]) -> None:
    chosen = one_frame(get_registry().create("heuristic", "all_trace"), candidates(mandatory))
    assert sorted(chosen) == list(range(len(mandatory)))
    first = [item for item in range(len(mandatory)) if mandatory[item]]
    assert chosen == first + [item for item in range(len(mandatory)) if not mandatory[item]]


@given(st.lists(st.booleans(), max_size=20), st.lists(st.booleans(), max_size=20))
def test_all_trace_starts_afresh_each_frame(first: list[bool], second: list[bool]) -> None:
    heuristic = get_registry().create("heuristic", "all_trace")
    heuristic.begin_frame(candidates(first), CONTEXT)
    heuristic.next(math.inf)
    assert len(one_frame(heuristic, candidates(second))) == len(second)


@given(st.lists(st.booleans(), max_size=20))
def test_raster_only_yields_nothing_not_even_what_is_mandatory(mandatory: list[bool]) -> None:
    assert one_frame(get_registry().create("heuristic", "raster_only"), candidates(mandatory)) == []


@pytest.mark.parametrize("name", ["all_trace", "raster_only"])
def test_nothing_is_chosen_before_the_first_frame(name: str) -> None:
    assert get_registry().create("heuristic", name).next(math.inf) is None


def test_items_are_python_integers() -> None:
    assert all(
        type(item) is int
        for item in one_frame(get_registry().create("heuristic", "all_trace"), candidates([True, False]))
    )
