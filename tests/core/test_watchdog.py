"""Watchdog: a call that never returns is ended, one that does is left alone."""

from __future__ import annotations

import time

import pytest

from phrt.watchdog import Guard, NeverReturned


def spin(seconds: float) -> None:
    """Busy in Python, swallowing every Exception as a bad plugin would."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            sum(range(50))
        except Exception:
            continue


def test_a_call_that_never_returns_is_ended() -> None:
    with pytest.raises(NeverReturned), Guard(0.05):
        spin(60.0)


def test_calls_that_return_are_left_alone() -> None:
    guard = Guard(0.05)
    for _ in range(3):
        with guard:
            pass
        spin(0.4)  # long, but outside of the guard
    with guard:
        total = sum(range(10))
    assert total == 45


def test_an_error_of_the_call_is_its_own() -> None:
    with pytest.raises(KeyError, match="lost"), Guard(60.0):
        raise KeyError("lost")
