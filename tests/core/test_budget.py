"""Budgets as text: what is allowed, and what is said of the rest."""

from __future__ import annotations

import math

import pytest

from phrt.budget import UNLIMITED, Budget, parse_budget
from phrt.errors import OptionError


@pytest.mark.parametrize(
    ("given", "budget"),
    [
        (None, UNLIMITED),
        ("none", UNLIMITED),
        (" None ", UNLIMITED),
        ("200000rays", Budget(200_000, "rays")),
        ("200_000 Rays", Budget(200_000, "rays")),
        ("1ray", Budget(1, "rays")),
        ("0rays", Budget(0, "rays")),
        ("50ms", Budget(50, "frame_ms")),
        ("frame:33.3 ms", Budget(33.3, "frame_ms")),
        ("0.05s", Budget(50, "frame_ms")),
        ("rays:20ms", Budget(20, "ray_ms")),
        ("Rays: 500us", Budget(0.5, "ray_ms")),
        ("rays:0ms", Budget(0, "ray_ms")),
        (Budget(12.5, "ray_ms"), Budget(12.5, "ray_ms")),
        (Budget(5), UNLIMITED),
    ],
)
def test_budgets(given: str | Budget | None, budget: Budget) -> None:
    assert parse_budget(given) == budget


@pytest.mark.parametrize("text", ["none", "200000rays", "50ms", "rays:12.5ms"])
def test_a_budget_is_written_as_it_is_read(text: str) -> None:
    assert str(parse_budget(text)) == text


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ("0ms", "budget is '0ms'; a frame takes some time, so it must be above 0"),
        ("2h", "with unit 'h', expected a frame time (50ms), a time for the ray phase (rays:20ms)"),
        ("5000s", "allowed: at most an hour, or none"),
        ("infms", "budget is 'infms'; for no limit write none"),
        ("frame:200rays", "budget is 'frame:200rays' with unit 'rays', expected"),
        ("pixels:20ms", "budget is 'pixels:20ms', expected"),
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
        ("rays", "budget is 'rays', expected a frame time"),
        ("", "budget is '', expected a frame time"),
        ("inf", "budget is 'inf'; for no limit write none"),
        ("much", "budget is 'much', expected"),
        ("nan rays", "budget is 'nan rays', expected"),
        (Budget(math.nan, "rays"), "budget is nan rays; it must be 0 or more"),
        (Budget(-1, "ray_ms"), "budget is -1 ray_ms; it must be 0 or more"),
        (Budget(math.inf, "frame_ms"), "for no limit write none"),
    ],
)
def test_what_is_no_budget(given: str | Budget, message: str) -> None:
    with pytest.raises(OptionError) as caught:
        parse_budget(given)
    assert message in str(caught.value)


def test_the_message_calls_the_option_by_its_name() -> None:
    with pytest.raises(OptionError, match="--budget is 'x'"):
        parse_budget("x", "--budget")
