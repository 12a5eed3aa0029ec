"""The kit finds what a heuristic does wrong, and says which rule it broke and in which case."""

from __future__ import annotations

import sys
import time

import numpy as np
import pytest

from phrt.errors import OptionError, PluginError
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic, Outcome, Request
from phrt.registry import HeuristicPlugin, Options
from phrt.testing import check_heuristic


class Sound(Heuristic):
    """By falling relevance: what every broken one below is but for one thing."""

    def __init__(self, options: Options) -> None:
        self.queue: list[int] = []

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        order = np.lexsort((candidates.keys(), -candidates.relevance, ~candidates.mandatory))
        self.costs, self.queue, self.count = candidates.predicted_cost, order.tolist(), len(candidates)

    def next(self, remaining: float) -> int | Request | None:
        while self.queue:
            item = self.queue.pop(0)
            if self.costs[item] <= remaining:
                return item
        return None


class OverBudget(Sound):
    def next(self, remaining: float) -> int | None:
        return self.queue.pop(0) if self.queue else None


class TwiceTheSame(Sound):
    def next(self, remaining: float) -> int | None:
        return self.queue[0] if self.queue and self.costs[self.queue[0]] <= remaining else None


class NoSuchItem(Sound):
    def next(self, remaining: float) -> int | None:
        return self.count if self.queue else None


class NoItem(Sound):
    def next(self, remaining: float) -> int | None:
        return 1.5 if self.queue else None  # type: ignore[return-value]


class TooManyPasses(Sound):
    def next(self, remaining: float) -> Request | None:
        return Request(self.queue.pop(0), passes=5) if self.queue else None


class MandatoryLast(Sound):
    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        super().begin_frame(candidates, context)
        self.queue.reverse()


class ForgetsMandatory(Sound):
    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        super().begin_frame(candidates, context)
        self.queue = [item for item in self.queue if not candidates.mandatory[item]]


class InTheirOrder(Sound):
    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        super().begin_frame(candidates, context)
        self.queue = np.argsort(~candidates.mandatory, kind="stable").tolist()


class Dice(Sound):
    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        super().begin_frame(candidates, context)
        mandatory = sum(candidates.mandatory)
        free = self.queue[mandatory:]
        np.random.default_rng().shuffle(free)
        self.queue[mandatory:] = free


class ChangesCandidates(Sound):
    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        super().begin_frame(candidates, context)
        candidates.relevance[:] = 0.0


class RaisesWithoutCandidates(Sound):
    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        super().begin_frame(candidates, context)
        self.best = candidates.relevance.max()


class TripsOverWhatWasNeverMeasured(Sound):
    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        super().begin_frame(candidates, context)
        self.steps = [int(1000 * change) for change in candidates.measured_change]


class RemembersRows(Sound):
    """Counts per row of the first frame, where rows come and go."""

    def report(self, item: int, outcome: Outcome) -> None:
        self.traced: np.ndarray = getattr(self, "traced", np.zeros(self.count, int))
        self.traced[item] += 1


class TakesTwice(Sound):
    def take(self, remaining: float, enough: float) -> np.ndarray:
        return np.array([item for item in self.queue[:1] * 2 if self.costs[item] <= remaining / 2], np.int32)


class TakesTooMuch(Sound):
    def take(self, remaining: float, enough: float) -> np.ndarray:
        taken, self.queue = self.queue, []
        return np.array(taken, np.int32)


class TakesFloats(Sound):
    def take(self, remaining: float, enough: float) -> np.ndarray:
        return np.zeros(0) if not self.queue else np.array([0.0])


BROKEN = [
    (OverBudget, "no item is over the remaining budget; item 0 is predicted to take"),
    (TwiceTheSame, "no item comes twice; item 0 does"),
    (NoSuchItem, "an answer is one of the 1 items, not 1"),
    (NoItem, "next returns an item's number, a Request or None, not 1.5"),
    (TooManyPasses, "a request is for 1 to 4 passes, not 5"),
    (MandatoryLast, "mandatory items come first|mandatory items that fit are asked for"),
    (ForgetsMandatory, r"mandatory items that fit are asked for; missing: \[\d"),
    (InTheirOrder, "decisions do not depend on the order of the candidates"),
    (Dice, "the same candidates give the same decisions"),
    (ChangesCandidates, "the candidates are not changed"),
    (RaisesWithoutCandidates, "a frame raised ValueError: zero-size array"),
    (TripsOverWhatWasNeverMeasured, "a frame raised ValueError: cannot convert float NaN to integer"),
    (RemembersRows, "a frame raised IndexError"),
    (TakesTwice, "take names no item twice in one answer"),
    (TakesTooMuch, "no item is over the remaining budget|take is content with"),
    (TakesFloats, "take returns .* integers or None"),
]  # fmt: skip


def test_the_sound_one_passes_by_class_by_descriptor_and_by_name() -> None:
    check_heuristic(Sound)
    check_heuristic(HeuristicPlugin("sound", "Sound.", f"{__name__}:Sound"), cases=5)
    check_heuristic("greedy_relevance", cases=5)


@pytest.mark.parametrize(("broken", "says"), BROKEN, ids=lambda value: getattr(value, "__name__", ""))
def test_a_broken_one_is_found(broken: type[Heuristic], says: str) -> None:
    with pytest.raises(AssertionError, match=f"heuristic {broken.__name__} breaks its contract: .*({says})") as found:
        check_heuristic(broken)
    assert "Case(items=" in str(found.value)


@pytest.mark.parametrize(("broken", "says"), BROKEN, ids=lambda value: getattr(value, "__name__", ""))
def test_a_broken_one_is_found_without_hypothesis(
    broken: type[Heuristic], says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "hypothesis", None)
    with pytest.raises(AssertionError, match=says):
        check_heuristic(broken)


def test_rules_that_one_does_not_claim_are_left_out() -> None:
    check_heuristic(ForgetsMandatory, mandatory=False, cases=20)
    check_heuristic(InTheirOrder, any_order=False, cases=20)


def test_a_call_that_never_returns_is_told() -> None:
    class Endless(Sound):
        def next(self, remaining: float) -> int | None:
            while self.queue:
                time.sleep(0.01)
            return None

    with pytest.raises(AssertionError, match=r"calls return; one took 0.3 seconds \[Case"):
        check_heuristic(Endless, patience_s=0.3)


def test_answers_that_never_end_are_told() -> None:
    class OnePixelForEver(Sound):
        def next(self, remaining: float) -> Request | None:
            return Request(0, passes=1, pixels=1) if self.count and remaining >= self.costs[0] else None

    with pytest.raises(AssertionError, match=r"no item comes twice|answers of a frame end"):
        check_heuristic(OnePixelForEver)


def test_what_is_no_heuristic_or_cannot_be_made_is_told() -> None:
    with pytest.raises(AssertionError, match=r"it is a phrt.interfaces.heuristic.Heuristic"):
        check_heuristic(lambda options: object())
    with pytest.raises(AssertionError, match="making it raised ZeroDivisionError: "):
        check_heuristic(lambda options: 1 / 0)
    with pytest.raises(PluginError, match=r"there is no heuristic 'gian'.*Did you mean 'gain'"):
        check_heuristic("gian")
    with pytest.raises(OptionError, match="unknown option 'sede'"):
        check_heuristic("random", {"sede": 3})
    with pytest.raises(OptionError, match=r"options must be an instance of its options' model, not \{'seed': 3\}"):
        check_heuristic(Sound, {"seed": 3})
