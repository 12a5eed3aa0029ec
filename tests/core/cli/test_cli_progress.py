"""Progress appears only when work takes longer than the delay, and never on standard output."""

from __future__ import annotations

import time

import pytest

from phrt.cli import console


@pytest.fixture(autouse=True)
def _short_delay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console, "PROGRESS_AFTER_S", 0.05)
    monkeypatch.setattr(console.terminal, "quiet", False)


def wait_until_shown(bar: console.DelayedProgress) -> None:
    """The delay is a timer's; once its thread has ended, whatever it had to show is shown."""
    bar._timer.join(timeout=30)


def test_quick_work_shows_nothing(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console, "PROGRESS_AFTER_S", 60.0)
    with console.DelayedProgress(2, "working") as bar:
        bar.advance()
    time.sleep(0.01)
    assert capsys.readouterr() == ("", "")


def test_long_work_names_its_step_once(capsys: pytest.CaptureFixture[str]) -> None:
    with console.DelayedProgress(3, "working") as bar:
        bar.advance()
        bar.step("polishing")
        wait_until_shown(bar)
    assert capsys.readouterr() == ("", "polishing ... (1 of 3 done)\n")


def test_quiet_shows_nothing(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console.terminal, "quiet", True)
    with console.DelayedProgress(3, "working") as bar:
        bar.advance()
        assert not bar._timer.is_alive()
    assert capsys.readouterr() == ("", "")
