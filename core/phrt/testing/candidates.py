"""Candidates made by hand, and heuristics run on them for a frame, with every answer checked."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import fields, replace
from functools import cache
from typing import Any

import numpy as np

from phrt.interfaces.heuristic import (
    NEVER_TRACED,
    PASSES,
    BudgetUnit,
    Candidates,
    FrameContext,
    Heuristic,
    Outcome,
    Request,
)
from phrt.testing.contract import BROKEN_BY_THE_PLUGIN, Contract
from phrt.testing.pictures import StripedPicture
from phrt.testing.worlds import at, box, world_of
from phrt.world import World

__tracebackhide__ = BROKEN_BY_THE_PLUGIN

OBJECTS = 32
"""Of the world that contexts made here are about."""
ROUNDING = 1e-6
"""Relative: predictions are single precision, and what fits exactly fits."""
DONE = 1 - 1e-9


def candidates(
    cost: Sequence[float] | np.ndarray,
    relevance: Sequence[float] | np.ndarray | None = None,
    mandatory: Sequence[bool] | np.ndarray | None = None,
    **columns: Any,
) -> Candidates:
    """Items of predicted `cost` rays and `relevance` (1 each), one object each with one effect; `columns` replace others."""
    n = len(cost)
    relevant = np.ones(n) if relevance is None else np.asarray(relevance)
    made = Candidates(
        effect_names=("shadows",),
        object_id=np.arange(1, n + 1, dtype=np.int32),
        effect=np.zeros(n, np.int32),
        pixel_count=np.asarray(cost, np.float64).astype(np.int32),
        mandatory=np.zeros(n, bool) if mandatory is None else np.asarray(mandatory, bool),
        predicted_cost=np.asarray(cost, np.float32),
        ray_estimate=np.ones(n, np.float32),
        area=np.full(n, 0.1, np.float32),
        center_closeness=np.ones(n, np.float32),
        distance=np.ones(n, np.float32),
        visibility=relevant.astype(np.float32),
        cost=np.asarray(cost, np.float32),
        importance_factor=np.ones(n, np.float32),
        was_selected=np.zeros(n, bool),
        relevance=relevant.astype(np.float32),
        persistence=0.0,
        predicted_rays=np.asarray(cost, np.float32),
        predicted_ms_paper=np.asarray(cost, np.float32) * np.float32(1e-4),
        predicted_ms_measured=np.asarray(cost, np.float32) * np.float32(1e-4),
        history_share=np.zeros(n, np.float32),
        history_age=np.zeros(n, np.float32),
        seen_frames=np.zeros(n, np.int32),
        frames_since_traced=np.full(n, NEVER_TRACED, np.int32),
        measured_change=np.full(n, np.nan, np.float32),
        measured_strength=np.full(n, np.nan, np.float32),
        measured_detail=np.full(n, np.nan, np.float32),
        measured_drift=np.full(n, np.nan, np.float32),
        measured_ms_per_pixel=np.full(n, np.nan, np.float32),
    )
    return replace(made, **columns)


def rows(work: Candidates, order: np.ndarray) -> Candidates:
    """`work` with its items in another order, or some of them only."""
    columns = {f.name: getattr(work, f.name) for f in fields(work)}
    return Candidates(**{name: a[order] if isinstance(a, np.ndarray) else a for name, a in columns.items()})


@cache
def small_world() -> World:
    """A row of `OBJECTS` boxes, for heuristics that look at the scene."""
    return world_of([(box(), at(x=2.0 * i)) for i in range(OBJECTS)])


@cache
def striped() -> StripedPicture:
    """A picture in which the boxes of `small_world` are stripes, for heuristics that look at it."""
    return StripedPicture(OBJECTS)


def context(budget: float = math.inf, frame_index: int = 0, **changes: Any) -> FrameContext:
    """A budget of rays, or none where it is infinite, in a frame of `small_world` with a made-up picture; `changes` replace other
    fields."""
    unit: BudgetUnit = "rays" if math.isfinite(budget) else "none"
    made = FrameContext(
        world=small_world(), frame_index=frame_index, time=0.0, budget=budget, budget_unit=unit, raster=striped()
    )
    return replace(made, **changes)


class Tally:
    """What was asked for of every item, and what that is predicted to cost. Raises BrokenContract for a wrong answer."""

    def __init__(self, contract: Contract, work: Candidates, case: object = "") -> None:
        self._contract, self._work, self._case = contract, work, case
        self._ends = np.zeros((len(work), PASSES + 1))
        np.cumsum(work.pass_shares(), axis=1, dtype=np.float64, out=self._ends[:, 1:])
        self._passes = np.zeros(len(work), np.int64)
        self._done = np.zeros(len(work))

    def request(self, answer: Any) -> Request:
        """What `next` returned, as a request for an item of the frame."""
        request = answer if isinstance(answer, Request) else Request(answer)
        try:
            item, passes = operator.index(request.item), operator.index(request.passes)
        except TypeError:
            self._holds(False, f"next returns an item's number, a Request or None, not {answer!r}")
            raise
        self._holds(0 <= item < len(self._work), f"an answer is one of the {len(self._work)} items, not {item}")
        self._holds(1 <= passes <= PASSES, f"a request is for 1 to {PASSES} passes, not {passes}")
        self._holds(request.pixels is None or request.pixels >= 1, f"pixels are None or 1 and more: {request.pixels}")
        return Request(item, passes, request.pixels)

    def add(self, request: Request, remaining: float) -> float:
        """Predicted cost of `request`, which must not be all done already, and must fit into `remaining`."""
        item = request.item
        again = self._passes[item] == PASSES or (request.pixels is not None and self._done[item] >= DONE)
        self._holds(not again, f"no item comes twice; item {item} does")
        last = min(int(self._passes[item]) + request.passes, PASSES)
        share = max(float(self._ends[item, last] - self._done[item]), 0.0)
        if request.pixels is None:
            self._passes[item] = last
        else:
            share = min(share, request.pixels / max(float(self._work.pixel_count[item]), 1.0))
        self._done[item] += share
        cost = float(self._work.predicted_cost[item]) * share
        self._holds(
            cost <= remaining * (1 + ROUNDING) + ROUNDING,
            f"no item is over the remaining budget; item {item} is predicted to take {cost:g}, {remaining:g} are left",
        )
        return cost

    def outcome(self, item: int) -> Outcome:
        """What tracing took, just as predicted."""
        share = float(self._done[item])
        pixels, rays = (round(float(a[item]) * share) for a in (self._work.pixel_count, self._work.predicted_rays))
        ms = float(self._work.predicted_ms_measured[item]) * share
        return Outcome(pixels=pixels, rays=rays, milliseconds=ms, complete=share >= DONE)

    def _holds(self, condition: object, rule: str) -> None:
        self._contract.holds(condition, rule, self._case)


def one_frame(
    heuristic: Heuristic,
    work: Candidates,
    budget: float = math.inf,
    frame_index: int = 0,
    *,
    late: int = 0,
    contract: Contract | None = None,
    case: object = "",
    **changes: Any,
) -> list[tuple[int, int]]:
    """(item, passes) of one frame in the order asked for, each charged at once.

    late: an item is reported when so many others were asked for after it. changes: fields of the context.
    Raises BrokenContract where an answer is none, does not fit, comes twice, or answers never end.
    """
    contract = contract or Contract(f"heuristic {type(heuristic).__name__}")
    tally, chosen, unreported, left = Tally(contract, work, case), [], [], budget
    heuristic.begin_frame(work, context(budget, frame_index, **changes))
    while (answer := heuristic.next(left)) is not None:
        request = tally.request(answer)
        left -= tally.add(request, left)
        chosen.append((request.item, request.passes))
        unreported.append(request.item)
        if len(unreported) > late:
            item = unreported.pop(0)
            heuristic.report(item, tally.outcome(item))
        most = len(work) * PASSES if request.pixels is None else max(int(work.pixel_count.sum()), len(work) * PASSES)
        contract.holds(len(chosen) <= most, "answers of a frame end", case)
    for item in unreported:
        heuristic.report(item, tally.outcome(item))
    heuristic.end_frame()
    return chosen


def items_of(heuristic: Heuristic, work: Candidates, budget: float = math.inf, frame_index: int = 0) -> list[int]:
    """The items of one frame in the order asked for."""
    return [item for item, _ in one_frame(heuristic, work, budget, frame_index)]
