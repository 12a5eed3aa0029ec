"""Candidates built by hand, and heuristics run on them, for tests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any, cast

import numpy as np

from phrt.candidates import Units
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


def units_of(work: Candidates, first: Sequence[int] | np.ndarray) -> Units:
    """One unit for each of the candidates, whose pixels begin at `first`."""
    return Units(
        item=np.arange(len(work), dtype=np.int32),
        object_id=work.object_id,
        effect=work.effect,
        first=np.asarray(first, np.int64),
        count=work.pixel_count,
        rays=work.predicted_rays.astype(np.float64),
        ms=work.predicted_ms_measured.astype(np.float64),
        held=np.zeros(len(work), np.int32),
        age_sum=np.zeros(len(work)),
    )


def rows(work: Candidates, order: np.ndarray) -> Candidates:
    """`work` with its items in another order."""
    columns = {f.name: getattr(work, f.name) for f in fields(work)}
    return Candidates(**{name: a[order] if isinstance(a, np.ndarray) else a for name, a in columns.items()})


def context(budget: float = math.inf, frame_index: int = 0) -> FrameContext:
    unit: BudgetUnit = "rays" if math.isfinite(budget) else "none"
    return FrameContext(world=cast(Any, None), frame_index=frame_index, time=0.0, budget=budget, budget_unit=unit)


def one_frame(
    heuristic: Heuristic, work: Candidates, budget: float = math.inf, frame_index: int = 0
) -> list[tuple[int, int]]:
    """(item, passes) of one frame in order, each charged and reported at once. Fails on one that does not fit."""
    heuristic.begin_frame(work, context(budget, frame_index))
    remaining, chosen = budget, []
    ends = np.concatenate([np.zeros((len(work), 1)), np.cumsum(work.pass_shares(), axis=1, dtype=np.float64)], axis=1)
    given = np.zeros(len(work), int)
    while (answer := heuristic.next(remaining)) is not None:
        request = answer if isinstance(answer, Request) else Request(answer)
        assert type(request.item) is int
        before, given[request.item] = given[request.item], min(given[request.item] + request.passes, PASSES)
        share = float(ends[request.item, given[request.item]] - ends[request.item, before])
        if request.pixels is not None:
            share = min(share, request.pixels / float(work.pixel_count[request.item]))
        cost = float(work.predicted_cost[request.item]) * share
        assert cost <= remaining * (1 + 1e-6) + 1e-6, "an item over the remaining budget"
        remaining -= cost
        chosen.append((request.item, request.passes))
        heuristic.report(request.item, Outcome(pixels=10, rays=round(cost), milliseconds=0.1, complete=True))
        assert len(chosen) <= len(work) * PASSES, "more than there is"
    heuristic.end_frame()
    return chosen


def items_of(heuristic: Heuristic, work: Candidates, budget: float = math.inf, frame_index: int = 0) -> list[int]:
    return [item for item, _ in one_frame(heuristic, work, budget, frame_index)]
