"""What every frame took, and the line it should have stayed under."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from phrt_plugins.report.drawing import INK, Look, Plot, draw, margins, name_text, table_csv
from phrt_plugins.report.thinning import Band, band, bin_size

COLUMNS = ("frame", "clock_ms", "deadline_ms", "ray_ms", "budget", "left")
WIDTH, ROW_HEIGHT, GAP = 9.6, 0.52, 0.3
LIMIT_COLOUR = "#b3261e"

OVER_A_LITTLE = 1e-6
"""Beyond the budget by rounding only is not beyond it."""


@dataclass(frozen=True)
class Trace:
    """A contestant's frames. frame, spent, limit: (n,), limit +inf where there is no budget."""

    label: str
    frame: np.ndarray
    spent: np.ndarray
    limit: np.ndarray


def trace_of(label: str, budget_kind: str, frames: Any) -> Trace:
    """From a pyarrow table with COLUMNS: what the budget bounds - the frame's time, the ray phase's, or rays."""
    column = {name: np.asarray(frames.column(name).to_numpy(), np.float64) for name in COLUMNS}
    none = np.full(len(column["frame"]), np.inf)
    match budget_kind:
        case "frame_ms":
            spent, limit = column["clock_ms"], column["deadline_ms"]
        case "ray_ms" | "rays_ms":
            spent, limit = column["ray_ms"], column["budget"]
        case "rays":
            spent, limit = column["budget"] - column["left"], column["budget"]
        case _:
            spent, limit = column["clock_ms"], none
    return Trace(label, column["frame"], spent, limit)


def axis_of(budget_kind: str, clock: str) -> str:
    """What is on the vertical axis, with its unit."""
    by = "" if clock in ("", "wall") else ", by the clock of rays"
    match budget_kind:
        case "ray_ms" | "rays_ms":
            return f"ray phase, ms{by}"
        case "rays":
            return "secondary rays"
        case _:
            return f"frame, ms{by}"


def frame_times(key: str, budget: str, axis: str, traces: Sequence[Trace], looks: Mapping[str, Look]) -> Plot | None:
    """Small panels one below the other, a contestant each, with the budget's line. None without a frame."""
    traces = [trace for trace in traces if len(trace.frame)]
    if not traces:
        return None
    size = bin_size(max(len(trace.frame) for trace in traces))
    bands = [band(trace.frame, trace.spent, size) for trace in traces]
    limits = [band(trace.frame, trace.limit, size) for trace in traces]
    top = highest(bands, limits)

    def paint(figure: Any) -> None:
        panels = figure.subplots(len(traces), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
        for axes, trace, each, limit in zip(panels, traces, bands, limits, strict=True):
            colour = looks[trace.label].colour
            if each.size > 1:
                axes.fill_between(each.frame, each.low, each.high, color=colour, alpha=0.3, linewidth=0)
            axes.plot(each.frame, each.middle, color=colour, linewidth=1.1)
            if np.isfinite(limit.middle).any():
                axes.plot(limit.frame, limit.middle, color=LIMIT_COLOUR, linewidth=1.1, linestyle=(0, (5, 2)))
            late = each.high > limit.middle * (1 + OVER_A_LITTLE)
            axes.plot(each.frame[late], np.minimum(each.high[late], top), "|", color=LIMIT_COLOUR, markersize=6)
            axes.set_title(name_text(trace.label), fontsize=9, pad=2)
            axes.set_title(said_of_limit(trace), fontsize=8.5, pad=2, loc="right", fontweight="normal")
            axes.set_ylim(0, top * 1.08)
            axes.margins(x=0)
            axes.locator_params(axis="y", nbins=3)
        panels[-1].set_xlabel("frame")
        panels[-1].xaxis.get_major_locator().set_params(integer=True)
        figure.supylabel(axis, fontsize=9.5, color=INK, x=0.004)
        margins(figure, 0.85, 0.5, top=GAP, hspace=GAP)

    joined = size > 1
    bounded = any(np.isfinite(trace.limit).any() for trace in traces)
    caption = f"The dashed line is the budget, {budget}; ticks mark where it was passed. " if bounded else ""
    caption += "All panels have the same scale"
    caption += ", which ends above the 99.9th percentile." if top < max(np.nanmax(each.high) for each in bands) else "."
    caption += f" Median, lowest and highest of every {size} frames." if joined else ""
    return Plot(
        key,
        f"Frames under {budget}" if bounded else "Frames without a budget",
        caption,
        f"Traces of {axis} over the frames under {budget}. " + "; ".join(map(said, traces)) + ".",
        draw(key, (WIDTH, 0.5 + (ROW_HEIGHT + GAP) * len(traces)), paint),
        rows_csv(traces, bands, limits, joined),
        wide=True,
    )


def highest(bands: Sequence[Band], limits: Sequence[Band]) -> float:
    """Where the scale ends: a few outliers do not flatten everything else."""
    values = np.concatenate([each.high for each in bands])
    finite = np.concatenate([each.middle[np.isfinite(each.middle)] for each in limits])
    return max(float(np.nanpercentile(values, 99.9)), float(finite.max(initial=0.0)), 1e-9)


def late_share(trace: Trace) -> float | None:
    """Share of frames beyond the budget; None where there is none."""
    bounded = np.isfinite(trace.limit)
    if not bounded.any():
        return None
    return float((trace.spent[bounded] > trace.limit[bounded] * (1 + OVER_A_LITTLE)).mean())


def said_of_limit(trace: Trace) -> str:
    share = late_share(trace)
    return "" if share is None else f"{100 * share:.3g} % of the frames beyond the budget"


def said(trace: Trace) -> str:
    return f"{trace.label}: median {np.nanmedian(trace.spent):.4g}, highest {np.nanmax(trace.spent):.4g}"


def rows_csv(traces: Sequence[Trace], bands: Sequence[Band], limits: Sequence[Band], joined: bool) -> str:
    """What is drawn, as CSV."""
    columns = ("label", "frame", *(("lowest", "median", "highest") if joined else ("spent",)), "budget")
    rows: list[tuple[Any, ...]] = []
    for trace, each, limit in zip(traces, bands, limits, strict=True):
        values = (each.low, each.middle, each.high) if joined else (each.middle,)
        allowed = np.where(np.isfinite(limit.middle), limit.middle, np.nan)
        numbers = (column.tolist() for column in (*values, allowed))
        rows += [(trace.label, int(frame), *row) for frame, *row in zip(each.frame.tolist(), *numbers, strict=True)]
    return table_csv(columns, rows)
