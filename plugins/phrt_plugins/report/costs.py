"""What the ray phases of frames were predicted to take, by both cost models, against what they took."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from phrt_plugins.report.drawing import INK, Look, Plot, draw, legend, legend_height, margins, table_csv
from phrt_plugins.report.thinning import spread

MODELS = {
    "predicted_ms_measured": "model: measured (a + b · rays)",
    "predicted_ms_paper": "model: paper (ms per unit of C)",
}
COLUMNS = ("frame", "pixel_count", "traced_pixels", "milliseconds", *MODELS)
WIDTH, HEIGHT = 9.6, 4.3
"""Inches, the height without the legend."""
MOST_OF_A_CONTESTANT = 400
MOST_MARKS = 800
"""More are drawn into a picture inside the SVG."""


@dataclass(frozen=True)
class Costs:
    """A contestant's ray phases. frame (n,), actual (n,) ms, predicted: (n,) ms by model, of what was traced."""

    label: str
    budget: str
    frame: np.ndarray
    actual: np.ndarray
    predicted: dict[str, np.ndarray]


class CostMaker:
    """Adds up candidates by frame, block by block."""

    def __init__(self, label: str, budget: str) -> None:
        self._about = label, budget
        self._frames: list[np.ndarray] = []
        self._sums: dict[str, list[np.ndarray]] = {name: [] for name in ("actual", *MODELS)}

    def add(self, table: Any) -> None:
        """table: pyarrow, with COLUMNS. An item that was traced in part counts by its traced share."""
        column = {name: np.asarray(table.column(name).to_numpy()) for name in COLUMNS}
        rows = np.flatnonzero(column["traced_pixels"] > 0)
        frames, place = np.unique(column["frame"][rows], return_inverse=True)
        share = column["traced_pixels"][rows] / np.maximum(column["pixel_count"][rows], 1)
        self._frames.append(frames)
        self._sums["actual"].append(np.bincount(place, column["milliseconds"][rows], len(frames)))
        for name in MODELS:
            predicted = np.nan_to_num(column[name][rows].astype(np.float64)) * share
            self._sums[name].append(np.bincount(place, predicted, len(frames)))

    def costs(self) -> Costs:
        joined = {name: np.concatenate([np.zeros(0), *parts]) for name, parts in self._sums.items()}
        frames = np.concatenate([np.zeros(0, np.int64), *self._frames])
        return Costs(*self._about, frames, joined.pop("actual"), joined)


def predictions(key: str, contestants: Sequence[Costs], looks: Mapping[str, Look]) -> Plot | None:
    """Predicted against actual time of the ray phase, a mark a frame, a panel per cost model. None where nothing was traced."""
    contestants = [each for each in contestants if (each.actual > 0).any()]
    if not contestants:
        return None
    shown = [(each, spread(len(each.frame), MOST_OF_A_CONTESTANT)) for each in contestants]
    drawn_as_picture = sum(len(rows) for _, rows in shown) > MOST_MARKS
    ends = limits([each.actual for each in contestants])
    below = legend_height(WIDTH, list(dict.fromkeys(each.label for each in contestants)))

    def paint(figure: Any) -> None:
        from matplotlib.ticker import LogLocator, NullLocator

        panels = figure.subplots(1, len(MODELS), sharex=True, sharey=True)
        handles: dict[str, Any] = {}
        for axes, (name, title) in zip(panels, MODELS.items(), strict=True):
            axes.plot(ends, ends, color=INK, linewidth=1, zorder=1)
            for factor in (0.8, 1.25):
                axes.plot(
                    ends, [end * factor for end in ends], color=INK, linewidth=0.7, linestyle=(0, (2, 2)), zorder=1
                )
            for each, rows in shown:
                look = looks[each.label]
                handles[each.label] = axes.scatter(
                    each.predicted[name][rows], each.actual[rows], s=9, marker=look.marker, color=look.colour, alpha=0.55,
                    linewidths=0, rasterized=drawn_as_picture,
                )  # fmt: skip
            axes.set_title(title)
            axes.set(xlabel="predicted, ms", xscale="log", yscale="log", xlim=ends, ylim=ends)
            for direction in (axes.xaxis, axes.yaxis):
                direction.set_major_locator(LogLocator(subs=(1, 2, 5), numticks=12))
                direction.set_major_formatter("{x:g}")
                direction.set_minor_locator(NullLocator())
        panels[0].set_ylabel("took, ms")
        margins(figure, 0.75, 0.55 + below, top=0.32, wspace=0.3)
        legend(figure, list(handles.values()), list(handles))

    rows = [
        (
            each.label,
            each.budget,
            int(each.frame[row]),
            float(each.actual[row]),
            *(float(each.predicted[n][row]) for n in MODELS),
        )
        for each, kept in shown
        for row in kept
    ]
    errors = said_of_errors(contestants)
    return Plot(
        key,
        "Predicted and actual cost",
        "A mark is a frame's ray phase, all budgets together. On the line, what was traced took what was predicted; "
        f"the dotted lines are 20 % below and 25 % above. {errors}",
        f"Scatter of predicted against actual milliseconds of the ray phase for both cost models. {errors}",
        draw(key, (WIDTH, HEIGHT + below), paint),
        table_csv(("label", "budget", "frame", "actual_ms", *MODELS), rows),
        wide=True,
    )


def limits(actual: Sequence[np.ndarray]) -> tuple[float, float]:
    """Ends of both axes, ms: all but the outermost hundredth of what frames took, and some room."""
    values = np.concatenate(actual)
    low, high = np.percentile(values[values > 0], (0.5, 99.5))
    return float(low) / 1.6, float(high) * 1.6


def median_error(costs: Costs, model: str) -> float:
    """Median over frames of |predicted - actual| / actual; NaN without a frame."""
    kept = costs.actual > 0
    if not kept.any():
        return float("nan")
    return float(np.median(np.abs(costs.predicted[model][kept] - costs.actual[kept]) / costs.actual[kept]))


def said_of_errors(contestants: Sequence[Costs]) -> str:
    """Both models' median errors over all contestants' frames."""
    parts = []
    for model, title in MODELS.items():
        errors = [np.abs(c.predicted[model] - c.actual)[c.actual > 0] / c.actual[c.actual > 0] for c in contestants]
        parts.append(f"{title.partition(' (')[0].removeprefix('model: ')} {np.median(np.concatenate(errors)):.0%}")
    return "Median error of a frame: " + ", ".join(parts).replace("%", " %") + "."
