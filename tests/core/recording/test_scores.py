"""What a heuristic says it ranks by is recorded and explained, and decides nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recording_kit import record, renderer_of

from phrt.errors import PhrtWarning
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.recording import read_run
from phrt.recording.reasons import explain_object


class ByPixels(Heuristic):
    """The item with most pixels first, and says so."""

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self.scores = candidates.pixel_count.astype(np.float64)
        self._left = np.argsort(-candidates.pixel_count, kind="stable").tolist()

    def next(self, remaining: float) -> int | None:
        return self._left.pop(0) if self._left else None


def test_scores_are_recorded_and_named(tmp_path: Path) -> None:
    frames = record(tmp_path / "run", 2, heuristic=ByPixels())
    run = read_run(tmp_path / "run")
    items = run.items(1)
    assert items["score"].dtype == np.float32
    np.testing.assert_array_equal(items["score"], items["pixel_count"])
    np.testing.assert_array_equal(frames[1].decisions.score, frames[1].decisions.candidates.pixel_count)
    floor = explain_object(run, 1, "/World/Floor", "shadows")[0].sentence
    assert "with score number 1 and relevance number " in floor


def test_a_heuristic_that_goes_by_relevance_says_nothing_more(tmp_path: Path) -> None:
    record(tmp_path / "run", 1, heuristic="greedy_relevance")
    run = read_run(tmp_path / "run")
    assert np.isnan(run.items(0)["score"]).all()
    assert "asked for, with relevance number " in explain_object(run, 0, "/World/Floor", "shadows")[0].sentence


@pytest.mark.parametrize("said", [[1.0], "much", np.zeros(3, np.int32), np.zeros((2, 2)), np.zeros(1)])
def test_scores_that_are_none_are_left_out(said: object) -> None:
    class Odd(ByPixels):
        def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
            super().begin_frame(candidates, context)
            self.scores = said  # type: ignore[assignment]

    with renderer_of(heuristic=Odd(), strict=True) as renderer:
        decisions = renderer.render().decisions
    assert decisions.chosen.all()
    assert np.isnan(decisions.score).all()
    assert decisions.score.shape == decisions.chosen.shape


def test_scores_that_cannot_be_asked_for_are_the_heuristics_fault() -> None:
    class Raises(ByPixels):
        @property
        def scores(self) -> np.ndarray:  # type: ignore[override]
            raise ValueError("not today")

        @scores.setter
        def scores(self, value: np.ndarray) -> None:
            pass

    with renderer_of(heuristic=Raises()) as renderer:
        with pytest.warns(PhrtWarning, match="not today"):
            first = renderer.render()
        second = renderer.render()
    assert first.decisions.chosen.all()
    assert not second.decisions.chosen.any()
    assert np.isnan(second.decisions.score).all()
