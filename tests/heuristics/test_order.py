"""Order: the same as np.lexsort gives."""

from __future__ import annotations

import numpy as np
import pytest
from candidate_kit import candidates
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from phrt.packing import sorted_places
from phrt_heuristics.order import ordered

NUMBERS = st.floats(-1e3, 1e3, width=32) | st.sampled_from([0.0, -0.0, 1.0, 1e-45, float("inf"), float("-inf")])


def by_lexsort(mandatory: np.ndarray, keys: np.ndarray, *order_by: np.ndarray) -> list[int]:
    return np.lexsort((keys, *order_by, ~mandatory)).tolist()


@given(st.data(), st.integers(0, 40), st.integers(0, 3))
def test_items_come_in_the_order_of_lexsort(data: st.DataObject, count: int, values: int) -> None:
    mandatory = data.draw(arrays(bool, count))
    made = candidates(np.ones(count), mandatory=mandatory)
    order_by = [data.draw(arrays(np.float32, count, elements=NUMBERS)) for _ in range(values)]
    assert ordered(made, *order_by).tolist() == by_lexsort(mandatory, made.keys(), *order_by)


@pytest.mark.parametrize(
    "values",
    [
        1 + np.array([5, 1, 4, 1, 3]) * 1e-12,
        np.array([2**63 + 2, 2**63 + 1, 2**63 + 1, 0, 2**64 - 1], np.uint64),
        np.array([2**40 + 1, 2**40, -(2**40), 2**40, 0]),
    ],
    ids=["float64", "uint64", "int64"],
)
def test_values_of_64_bits_keep_their_order_where_32_are_not_enough(values: np.ndarray) -> None:
    made = candidates(np.ones(5), mandatory=[False, True, False, False, True])
    assert ordered(made, values).tolist() == by_lexsort(made.mandatory, made.keys(), values)


@given(arrays(np.int64, st.integers(0, 30), elements=st.integers(0, 2**40)))
def test_places_sort_and_keep_the_order_of_equals(values: np.ndarray) -> None:
    assert sorted_places(values).tolist() == np.argsort(values, kind="stable").tolist()
    assert sorted_places(values % 4).tolist() == np.argsort(values % 4, kind="stable").tolist()
