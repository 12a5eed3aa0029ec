"""all_trace yields every candidate once, mandatory ones first; raster_only yields none."""

from __future__ import annotations

import math

from candidate_kit import candidates, context, items_of
from hypothesis import given
from hypothesis import strategies as st

from phrt.interfaces.heuristic import Candidates
from phrt.registry import get_registry


def of(mandatory: list[bool]) -> Candidates:
    return candidates([10.0] * len(mandatory), mandatory=mandatory)


@given(st.lists(st.booleans(), max_size=60))
def test_all_trace_yields_every_candidate_once_and_mandatory_ones_first(mandatory: list[bool]) -> None:
    chosen = items_of(get_registry().create("heuristic", "all_trace"), of(mandatory))
    assert sorted(chosen) == list(range(len(mandatory)))
    first = [item for item in range(len(mandatory)) if mandatory[item]]
    assert chosen == first + [item for item in range(len(mandatory)) if not mandatory[item]]


@given(st.lists(st.booleans(), max_size=20), st.lists(st.booleans(), max_size=20))
def test_all_trace_starts_afresh_each_frame(first: list[bool], second: list[bool]) -> None:
    heuristic = get_registry().create("heuristic", "all_trace")
    heuristic.begin_frame(of(first), context())
    heuristic.next(math.inf)
    assert len(items_of(heuristic, of(second))) == len(second)


@given(st.lists(st.booleans(), max_size=20))
def test_raster_only_yields_nothing_not_even_what_is_mandatory(mandatory: list[bool]) -> None:
    assert items_of(get_registry().create("heuristic", "raster_only"), of(mandatory)) == []
