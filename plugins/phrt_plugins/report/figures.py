"""Figures of the summary: error against what it cost, and shares of what was possible."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from phrt_plugins.report.drawing import (
    INK,
    Look,
    Plot,
    draw,
    legend,
    legend_height,
    margins,
    name_text,
    table_csv,
    text_width,
)
from phrt_plugins.report.model import Entry
from phrt_plugins.report.thinning import pareto

WIDTH, HEIGHT = 4.8, 3.2
"""Inches, the height without the legend."""


def error_against(
    key: str, entries: Sequence[Entry], main: tuple[str, str], paid: tuple[str, str], looks: Mapping[str, Look]
) -> Plot | None:
    """Error against a cost, every contestant under every budget a point, the Pareto front marked. main: the error's metric and
    which is better, "lower" or "higher"; paid: the cost's metric, and what it is in words. None for fewer than two points."""
    (error, better), (cost, axis) = main, paid
    shown = [e for e in entries if np.isfinite(e.value(error)) and np.isfinite(e.value(cost))]
    if len(shown) < 2:
        return None
    x, y = (np.array([e.value(name) for e in shown]) for name in (cost, error))
    front = pareto(x, -y if better == "higher" else y)
    named = ["Pareto front", *dict.fromkeys(e.label for e in shown)]
    below = legend_height(WIDTH, named)

    def paint(figure: Any) -> None:
        axes = figure.add_subplot()
        handles = axes.plot(x[front], y[front], color=INK, linewidth=5, alpha=0.2, solid_capstyle="round", zorder=1)
        for label in named[1:]:
            rows = [row for row, e in enumerate(shown) if e.label == label]
            rows.sort(key=lambda row: x[row])
            handles.append(_points(axes, [shown[row] for row in rows], x[rows], y[rows], error, cost, looks[label]))
        _name_budgets(axes, shown, x, y)
        axes.set(xlabel=axis, ylabel=f"mean {error.upper()} ({better} is better)")
        if better == "lower":
            axes.set_ylim(0, None)
        if x.min() > 0 and x.max() / x.min() > 20:
            axes.set_xscale("log")
        else:
            axes.locator_params(axis="x", nbins=6)
        axes.xaxis.set_major_formatter(lambda value, _: short(value))
        margins(figure, 0.72, 0.55 + below)
        legend(figure, handles, named)

    best = shown[int(front[-1])]
    columns = ("label", "budget", cost, f"{cost}_low", f"{cost}_high", error, f"{error}_low", f"{error}_high", "pareto")
    rows = [
        (e.label, e.budget, *_interval(e, cost), *_interval(e, error), int(row in front)) for row, e in enumerate(shown)
    ]
    return Plot(
        key,
        f"Error against {axis.partition(',')[0]}",
        "Every contestant under every budget, with 95 % intervals. On the Pareto front is what nothing beats in both.",
        f"Scatter of {error} against {axis}: {len(shown)} points, {len(front)} of them on the Pareto front; "
        f"the best is {y[front[-1]]:.4g}, of {best.label} under {best.budget}.",
        draw(key, (WIDTH, HEIGHT + below), paint),
        table_csv(columns, rows),
    )


def short(value: float) -> str:
    """A number for an axis: 1500 is "1.5k"."""
    for size, sign in ((1e6, "M"), (1e3, "k")):
        if abs(value) >= size:
            return f"{value / size:g}{sign}"
    return f"{value:g}"


def _points(
    axes: Any, entries: Sequence[Entry], x: np.ndarray, y: np.ndarray, error: str, cost: str, look: Look
) -> Any:
    """A contestant's points with their intervals, joined by a thin line. Returns the legend's handle."""
    spans = [[_reach(e, name) for e in entries] for name in (cost, error)]
    across, along = (np.array(span).T for span in spans)
    axes.plot(x, y, color=look.colour, linestyle=look.dash, linewidth=0.9, alpha=0.6, zorder=2)
    return axes.errorbar(
        x, y, xerr=across, yerr=along, fmt=look.marker, color=look.colour, markersize=6, elinewidth=1, capsize=2,
        markeredgecolor="white", markeredgewidth=0.6, zorder=3,
    )  # fmt: skip


def _reach(entry: Entry, name: str) -> tuple[float, float]:
    """How far a metric's interval reaches to both sides of its value; 0 where it is not known."""
    value, low, high = _interval(entry, name)
    return tuple(max(side, 0.0) if np.isfinite(side) else 0.0 for side in (value - low, high - value))  # type: ignore[return-value]


def _interval(entry: Entry, name: str) -> tuple[float, float, float]:
    found = entry.values[name]
    return found.value, found.low, found.high


def _name_budgets(axes: Any, entries: Sequence[Entry], x: np.ndarray, y: np.ndarray) -> None:
    """The budget's name below the lowest of its points, and below what is written there already."""
    across, along = max(float(np.ptp(x)), 1e-12), max(float(np.ptp(y)), 1e-12)
    written: list[tuple[float, float]] = []
    for budget in dict.fromkeys(e.budget for e in entries):
        low = min((row for row, e in enumerate(entries) if e.budget == budget), key=lambda row: y[row])
        place = float(x[low]) / across, float(y[low]) / along
        near = sum(abs(place[0] - other[0]) < 0.16 and abs(place[1] - other[1]) < 0.09 for other in written)
        written.append(place)
        at_the_axis = float(y[low]) < 0.08 * float(y.max())
        axes.annotate(
            name_text(budget, 24), (x[low], y[low]), xytext=(0, 7 + 9 * near if at_the_axis else -7 - 9 * near),
            textcoords="offset points", ha="center", va="bottom" if at_the_axis else "top", fontsize=8,
        )  # fmt: skip


SHARES = {
    "oracle_share": "of the oracle's error reduction",
    "parts_share": "of the oracle's that traces parts",
    "relevance_share": "of the largest sum of R",
}
"""The shares of what was possible, and what they are said to be."""


def shares(key: str, entries: Sequence[Entry], looks: Mapping[str, Look]) -> Plot | None:
    """How much of the oracle's error reduction, and of the largest sum of relevance, every contestant reached. None where neither
    is known."""
    names = [name for name in SHARES if any(np.isfinite(e.value(name)) for e in entries)]
    if not names:
        return None
    labels = list(dict.fromkeys(e.label for e in entries))
    budgets = list(dict.fromkeys(e.budget for e in entries))

    def paint(figure: Any) -> None:
        panels = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
        for axes, name in zip(panels, names, strict=True):
            for number, budget in enumerate(budgets):
                for e in (e for e in entries if e.budget == budget and np.isfinite(e.value(name))):
                    place = labels.index(e.label) + (number - (len(budgets) - 1) / 2) * 0.62 / max(len(budgets), 1)
                    low, high = _reach(e, name)
                    axes.errorbar(
                        e.value(name), place, xerr=[[low], [high]], fmt=looks[e.label].marker, color=looks[e.label].colour,
                        markersize=5.5, elinewidth=1.2, capsize=2,
                    )  # fmt: skip
                    axes.annotate(
                        name_text(budget, 16), (e.value(name) + high, place), xytext=(5, 0), textcoords="offset points",
                        va="center", fontsize=7,
                    )  # fmt: skip
            axes.axvline(1, color=INK, linewidth=1, linestyle=(0, (4, 3)))
            axes.set_title(SHARES[name])
            axes.set(xlabel="share", ylim=(len(labels) - 0.4, -0.6))
            axes.margins(x=0.12)
            axes.set_yticks(range(len(labels)), [name_text(label) for label in labels])
            axes.tick_params(axis="y", length=0)
        margins(figure, 0.25 + text_width(name_text(label) for label in labels), 0.5, top=0.3, wspace=0.25)

    columns = ["label", "budget", *(f"{n}{end}" for n in names for end in ("", "_low", "_high"))]
    rows = [[e.label, e.budget, *_cells(e, names)] for e in entries]
    height = max(2.4, 1.1 + len(labels) * (0.16 + 0.17 * len(budgets)))
    return Plot(
        key,
        "Share of the oracle",
        "1 is the exact knapsack: over every item's true benefit and cost for the error reduction, where 0 is raster only; over R "
        "and predicted cost for the sum of R. With 95 % intervals. The oracle traces whole items and has no values of earlier "
        "frames: who traces parts, or keeps values, can pass it.",
        "Dot plot of shares: " + "; ".join(_said(e, names) for e in entries[:40]) + ".",
        draw(key, (3.4 + 3.2 * len(names), height), paint),
        table_csv(columns, rows),
        wide=len(names) > 1,
    )


def _cells(entry: Entry, names: Sequence[str]) -> list[float | None]:
    cells: list[float | None] = []
    for name in names:
        cells += _interval(entry, name) if name in entry.values else (None, None, None)
    return cells


def _said(entry: Entry, names: Sequence[str]) -> str:
    values = (entry.value(name) for name in names)
    return f"{entry.label} under {entry.budget} " + ", ".join(f"{v:.2f}" if np.isfinite(v) else "-" for v in values)
