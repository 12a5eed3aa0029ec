"""Asking a heuristic: every form of answer, what fits, and what is nonsense."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from candidate_kit import candidates, context, units_of

from phrt import watchdog
from phrt.asking import Asking
from phrt.candidates import WorkItems
from phrt.errors import PhrtWarning, PluginError
from phrt.faults import Faults
from phrt.frame import MASK_HISTORY
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic, Request
from phrt.ledger import Ledger, Parts
from phrt.runs import unit_parts

SIZES = [40, 40, 8, 96]


class Says(Heuristic):
    """Gives a list of answers, to `take` when they are arrays, else to `next`."""

    def __init__(self, *answers: Any) -> None:
        self._answers = list(answers)
        self._arrays = any(isinstance(answer, (np.ndarray, list)) for answer in answers)

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        return

    def next(self, remaining: float) -> int | Request | None:
        return self._answers.pop(0) if self._answers else None

    def take(self, remaining: float, enough: float) -> np.ndarray | None:
        if not self._arrays:
            return None
        return self._answers.pop(0) if self._answers else np.zeros(0, np.int32)


def asking(heuristic: Heuristic, strict: bool = True) -> tuple[Asking, Ledger]:
    work = candidates(np.array(SIZES, float))
    first = np.concatenate([[0], np.cumsum(SIZES)[:-1]])
    ledger = Ledger(WorkItems(work, units_of(work, first), [np.arange(sum(SIZES), dtype=np.int32)], 4))
    made = Asking(heuristic, Faults(strict=strict), ledger, context(1e6))
    made.begin(work)
    return made, ledger


def taken(heuristic: Heuristic, remaining: float = 1e6, enough: float = 1e6) -> list[list[int]]:
    parts = asking(heuristic)[0].take(remaining, enough)
    return np.stack([parts.item, parts.start, parts.stop], axis=1).tolist()


def test_items_requests_and_numpy_numbers_are_understood() -> None:
    assert taken(Says(0, Request(1, 2), np.int64(3), Request(2, 4, pixels=3))) == [
        [0, 0, 40],
        [1, 0, 20],
        [3, 0, 96],
        [2, 0, 3],
    ]


def test_many_at_once() -> None:
    assert taken(Says(np.array([3, 0], np.int32))) == [[3, 0, 96], [0, 0, 40]]
    assert taken(Says(np.array([[3, 1], [0, 4]]))) == [[3, 0, 24], [0, 0, 40]]


def test_no_more_is_asked_than_is_enough() -> None:
    assert taken(Says(0, 1, 2, 3), enough=60) == [[0, 0, 40], [1, 0, 40]]


def test_what_does_not_fit_is_left_out_and_the_next_is_asked_for() -> None:
    made, ledger = asking(Says(3, 2, None))
    assert made.take(50.0, 50.0).item.tolist() == [2]
    assert ledger.order.tolist() == [-1, -1, 1, 0]
    assert ledger.asked.tolist() == [0, 0, 8, 0]


def test_the_pixels_of_a_request_can_be_asked_for_bit_by_bit() -> None:
    made, _ = asking(Says(*[Request(0, pixels=15)] * 3))
    stops = [made.take(1e6, 1.0).stop.tolist() for _ in range(3)]
    assert stops == [[15], [30], [40]]


def test_later_passes_of_an_item_of_few_pixels_may_be_empty() -> None:
    work = candidates([1.0])
    ledger = Ledger(WorkItems(work, units_of(work, [0]), [np.zeros(1, np.int32)], 4))
    made = Asking(Says(*[Request(0, 1)] * 4), Faults(strict=True), ledger, context(1e6))
    made.begin(work)
    assert made.take(1e6, 1e6).stop.tolist() == [1]
    assert len(made.take(1e6, 1e6)) == 0


@pytest.mark.parametrize(
    ("answers", "message"),
    [
        ([4], "returned item 4: not one of 4, or twice"),
        ([-1], "returned item -1: not one of 4, or twice"),
        ([0, None, 0], "returned item 0: not one of 4, or twice"),
        ([Request(0, 0)], "returned item 0: not one of 4, or twice"),
        ([Request(0, 1, pixels=0)], "returned item 0: not one of 4, or twice"),
        (["first"], r"returned 'first' from next\(\): expected an item's number"),
        ([np.array([0, 1, 0])], "returned item 0: not one of 4, or twice"),
        ([np.array([0.5])], r"returned array\(\[0.5\]\) from take\(\): expected \(k,\) items"),
        ([np.zeros((2, 3), int)], r"returned an array of shape \(2, 3\) from take\(\)"),
        ([[0, 1]], r"returned \[0, 1\] from take\(\)"),
    ],
)
def test_nonsense_is_the_heuristics_fault(answers: list[Any], message: str) -> None:
    made, _ = asking(Says(*answers))
    with pytest.raises(PluginError, match=f"heuristic Says {message}"):
        _ = [made.take(1e6, 1e6) for _ in range(3)]


def test_one_that_names_the_same_item_forever_though_it_does_not_fit_is_stopped() -> None:
    with pytest.raises(PluginError, match="returned item 3: not one of 4, or twice"):
        taken(Says(*[3] * 1000), remaining=50.0, enough=50.0)


def test_one_that_never_returns_is_switched_off_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    class Hangs(Says):
        def next(self, remaining: float) -> int | Request | None:
            while True:
                try:
                    sum(range(100))
                except Exception:
                    continue

    monkeypatch.setattr(watchdog, "PATIENCE_S", 0.05)
    made, _ = asking(Hangs(), strict=False)
    with pytest.warns(PhrtWarning, match=r"heuristic Hangs did not return from next\(\) within 0.05 seconds; it is"):
        assert len(made.take(1e6, 1e6)) == 0
    assert len(made.take(1e6, 1e6)) == 0


def test_pixels_of_an_item_that_has_none_left_are_not_asked_for_forever() -> None:
    made, _ = asking(Says(*[Request(0, pixels=40)] * 8))
    assert made.take(1e6, 1.0).stop.tolist() == [40]
    with pytest.raises(PluginError, match="returned item 0: not one of 4, or twice"):
        made.take(1e6, 1.0)


def test_part_of_a_pass_and_the_rest_of_it() -> None:
    made, _ = asking(Says(Request(3, 1, pixels=10), Request(3, 1, pixels=100), Request(3, 2)))
    assert [made.take(1e6, 1.0).stop.tolist() for _ in range(3)] == [[10], [24], [48]]


def test_what_is_missing_is_the_first_pass_and_what_is_held_the_others() -> None:
    work = candidates([100.0], history_share=np.array([0.6], np.float32))
    units = replace(units_of(work, [0]), held=np.array([60], np.int32))
    mask = np.zeros(100, np.uint8)
    mask[:60] = MASK_HISTORY
    items = WorkItems(work, units, [np.arange(100, dtype=np.int32)], 10, [mask])
    ledger = Ledger(items)
    made = Asking(Says(*[Request(0, 1)] * 4), Faults(strict=True), ledger, context(1e6))
    made.begin(work)
    assert [made.take(1e6, 1.0).stop.tolist() for _ in range(4)] == [[40], [60], [80], [100]]
    missing = unit_parts(items, Parts(np.array([0]), np.array([0]), np.array([40])), 1e6).pixels(items)[0]
    assert missing.tolist() == list(range(60, 100))
