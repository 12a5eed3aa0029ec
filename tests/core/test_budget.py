"""Budgets as text: what is allowed, and what is said of the rest."""

from __future__ import annotations

import math

import pytest

from phrt.budget import Budget, parse_budget
from phrt.errors import OptionError


@pytest.mark.parametrize(
    ("given", "rays"),
    [
        (None, math.inf),
        ("none", math.inf),
        (" None ", math.inf),
        ("200000rays", 200_000),
        ("200_000 Rays", 200_000),
        ("1ray", 1),
        ("0rays", 0),
        (Budget(12.5), 12.5),
    ],
)
def test_budgets(given: str | Budget | None, rays: float) -> None:
    assert parse_budget(given).rays == rays


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (
            "50ms",
            "budget is '50ms', but budgets of time are not available yet, expected a number of rays, as in 200000rays",
        ),
        ("1.5s", "budgets of time are not available yet"),
        ("-5rays", "budget is '-5rays'; it must be 0 or more"),
        ("-5ms", "it must be 0 or more"),
        ("200000", "budget is '200000' without a unit"),
        (200000, "budget is 200000 without a unit"),
        (True, "without a unit"),
        ("20krays", "with unit 'krays'"),
        ("1.5rays", "whole numbers of at most 18 digits"),
        ("1e5rays", "whole numbers"),
        ("1__0rays", "whole numbers"),
        ("9999999999999999999rays", "at most 18 digits"),
        ("rays", "budget is 'rays', expected a number of rays"),
        ("", "budget is '', expected a number of rays"),
        ("inf", "budget is 'inf', expected"),
        ("much", "budget is 'much', expected"),
        ("nan rays", "budget is 'nan rays', expected"),
        (Budget(math.nan), "budget is nan rays; it must be 0 or more"),
        (Budget(-1), "budget is -1 rays; it must be 0 or more"),
    ],
)
def test_what_is_no_budget(given: str | Budget, message: str) -> None:
    with pytest.raises(OptionError) as caught:
        parse_budget(given)
    assert message in str(caught.value)


def test_the_message_calls_the_option_by_its_name() -> None:
    with pytest.raises(OptionError, match="--budget is 'x'"):
        parse_budget("x", "--budget")
