"""Asking: the heuristic's side of a frame, with its answers checked and its faults contained."""

from __future__ import annotations

import operator
from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial
from typing import TypeVar

import numpy as np

from phrt import watchdog
from phrt.faults import Faults
from phrt.faults.fault import CAUGHT, raised
from phrt.interfaces.heuristic import PASSES, Candidates, FrameContext, Heuristic, Request
from phrt.kernels.booking import first_repeated
from phrt.ledger import ALL_PIXELS, NO_PARTS, Ledger, Parts
from phrt.watchdog import Guard, NeverReturned

R = TypeVar("R")

ROUNDING = 1e-6
"""Relative: predictions are single precision, and what fits exactly fits."""


class Asking:
    """Asks `heuristic` for parts of items, one frame long. From its first fault on it has no more to say (`Faults`)."""

    def __init__(self, heuristic: Heuristic, faults: Faults, ledger: Ledger, context: FrameContext) -> None:
        self._heuristic = heuristic
        self._faults = faults
        self._ledger = ledger
        self._context = context
        self._done = faults.heuristic_is_off
        self._guard = Guard()
        self._listens = type(heuristic).report is not Heuristic.report
        self._price = np.zeros(0)
        self._held: tuple[int, int, int] | None = None
        self._said_no_more = False

    def begin(self, candidates: Candidates) -> None:
        """A new frame."""
        self._price = candidates.predicted_cost.astype(np.float64) / PASSES
        self._call("begin_frame", lambda: self._heuristic.begin_frame(candidates, self._context))

    @property
    def has_more(self) -> bool:
        """Is it of use to ask for more in this wave? Not once the heuristic said that nothing should follow, or failed."""
        return not (self._done or self._said_no_more)

    def begin_wave(self) -> None:
        """There may be more again."""
        self._said_no_more = False

    def take(self, remaining: float, enough: float) -> Parts:
        """The next parts of items, together predicted to take about `enough`, and no more than `remaining`; none when the
        heuristic has no more. Those that do not fit are left out and noted."""
        refused: Counter[int] = Counter()
        while not self._done:
            answer = self._call("take", lambda: self._heuristic.take(remaining, enough))
            requests = self._one_by_one(remaining, enough) if answer is None else self._as_arrays(answer)
            if self._done or requests is None or not len(requests[0]):
                self._said_no_more = True
                break
            if (parts := self._parts(*requests)) is None:
                break
            fits = self._fit(parts, remaining)
            self._ledger.accept(parts.rows(fits))
            self._count_passes(*requests, refused=parts.item[~fits])
            if fits.any():
                return parts.rows(fits)
            # It may try again with less of an item, but not forever.
            refused.update(parts.item.tolist())
            item, times = refused.most_common(1)[0] if refused else (0, 0)
            if times > 2 * PASSES:
                self._nonsense(item)
            if self._said_no_more:
                break
        return NO_PARTS

    def report(self, traced: Parts) -> None:
        """`traced` is done."""
        if self._listens:
            self._call("report", lambda: self._report(dict.fromkeys(traced.item.tolist())))

    def _report(self, items: Iterable[int]) -> None:
        for item in items:
            self._heuristic.report(item, self._ledger.outcome(item))

    def end(self) -> None:
        """No more in this frame."""
        self._call("end_frame", self._heuristic.end_frame)

    def _one_by_one(self, remaining: float, enough: float) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """What `next` answers until it is enough, or until it names an item again: items, passes, pixels (k,)."""
        if self._held is not None:
            held, self._held = np.array([self._held], np.int64), None
            return held[:, 0], held[:, 1], held[:, 2]
        rows: list[tuple[int, int, int]] = []
        named: set[int] = set()
        planned = 0.0
        while planned < enough:
            left = remaining - planned
            answer = self._call("next", partial(self._heuristic.next, left))
            if answer is None:
                self._said_no_more = True
                break
            if (request := self._as_request(answer)) is None:
                return None
            item, passes, _ = request
            if item in named:
                self._held = request
                break
            rows.append(request)
            named.add(item)
            if not 0 <= item < len(self._price):
                break
            planned += float(self._price[item]) * min(max(passes, 1), PASSES)
        table = np.array(rows, np.int64).reshape(-1, 3)
        return table[:, 0], table[:, 1], table[:, 2]

    def _as_request(self, answer: int | Request) -> tuple[int, int, int] | None:
        request = answer if isinstance(answer, Request) else Request(answer)
        try:
            pixels = ALL_PIXELS if request.pixels is None else operator.index(request.pixels)
            return operator.index(request.item), operator.index(request.passes), pixels
        except TypeError:
            self._fault(f"returned {answer!r} from next(): expected an item's number, a Request or None")
            return None

    def _as_arrays(self, answer: object) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        if not isinstance(answer, np.ndarray) or answer.dtype.kind not in "iu" or answer.ndim not in (1, 2):
            self._fault(
                f"returned {answer!r:.80} from take(): expected (k,) items or (k, 2) items and passes, integers"
            )
            return None
        if answer.ndim == 2 and answer.shape[1] != 2:
            self._fault(f"returned an array of shape {answer.shape} from take(): expected (k,) or (k, 2)")
            return None
        items = (answer if answer.ndim == 1 else answer[:, 0]).astype(np.int64)
        passes = np.full(len(items), PASSES) if answer.ndim == 1 else answer[:, 1].astype(np.int64)
        if (repeated := first_repeated(items, len(self._price))) >= 0:
            self._nonsense(repeated)
            return None
        return items, passes, np.full(len(items), ALL_PIXELS)

    def _parts(self, items: np.ndarray, passes: np.ndarray, pixels: np.ndarray) -> Parts | None:
        parts = self._ledger.parts(items, passes, pixels)
        if parts is None:
            wrong = next(
                int(i) for i, *rest in zip(items, passes, pixels, strict=True)
                if self._ledger.parts(np.array([i]), np.array(rest[:1]), np.array(rest[1:])) is None
            )  # fmt: skip
            self._nonsense(wrong)
        return parts

    def _fit(self, parts: Parts, remaining: float) -> np.ndarray:
        """(k,) bool: which of `parts` fit, one after the other."""
        costs = self._ledger.predicted(parts)
        self._ledger.name(parts)
        fits = np.ones(len(parts), bool)
        if costs.sum() > remaining:
            left = remaining * (1 + ROUNDING)
            for row, cost in enumerate(costs.tolist()):
                fits[row] = cost <= left
                left -= cost if fits[row] else 0.0
        return fits

    def _count_passes(self, items: np.ndarray, passes: np.ndarray, pixels: np.ndarray, refused: np.ndarray) -> None:
        """These passes are taken; not those that were refused, nor of requests for some pixels only."""
        taken = pixels == ALL_PIXELS
        if len(refused):
            taken &= ~np.isin(items, refused)
        self._ledger.count(items[taken], passes[taken])

    def _nonsense(self, item: int) -> None:
        self._fault(f"returned item {item}: not one of {len(self._price)}, or twice")

    def _fault(self, cause: str, error: BaseException | None = None) -> None:
        self._done = True
        self._faults.lose_heuristic(self._heuristic, cause, error)

    def _call(self, call: str, function: Callable[[], R]) -> R | None:
        if self._done:
            return None
        try:
            with self._guard:
                return function()
        except NeverReturned:
            self._fault(f"did not return from {call}() within {watchdog.PATIENCE_S:g} seconds")
        except CAUGHT as error:
            self._fault(raised(f"{call}()", error), error)
        return None
