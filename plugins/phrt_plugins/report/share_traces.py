"""Which share of what was possible every contestant reached, judged frame by judged frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from phrt_plugins.bench.shares import PARTS_SHARE, RELEVANCE_SHARE
from phrt_plugins.report.drawing import INK, Look, Plot, draw, margins, name_text, table_csv
from phrt_plugins.report.thinning import band

WIDTH, ROW_HEIGHT, GAP = 9.6, 0.6, 0.3
LOWEST, HIGHEST = -0.6, 2.0
"""Where the scale ends at the latest: in a frame with next to nothing to gain a share can be anything."""
R_COLOUR = "#6b7785"


def share_traces(key: str, budget: str, rows: Sequence[Mapping[str, Any]], looks: Mapping[str, Look]) -> Plot | None:
    """Small panels one below the other, a contestant each. rows: of shares.parquet, of one contest and budget. None where there is
    no oracle, or no frame."""
    labels = [label for label in looks if any(row["label"] == label for row in rows)]
    traces = {label: _columns([row for row in rows if row["label"] == label]) for label in labels}
    drawn = np.concatenate([trace[PARTS_SHARE.name] for trace in traces.values()] or [np.zeros(0)])
    if not np.isfinite(drawn).any():
        return None
    shown = np.concatenate([drawn, *(trace[RELEVANCE_SHARE.name] for trace in traces.values())])
    low = float(np.clip(np.nanmin(shown), LOWEST, 0.0))
    high = float(np.clip(np.nanmax(shown), 1.0, HIGHEST))

    def paint(figure: Any) -> None:
        panels = figure.subplots(len(traces), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
        for axes, (label, trace) in zip(panels, traces.items(), strict=True):
            axes.axhline(1, color=INK, linewidth=0.9, linestyle=(0, (4, 3)))
            for name, colour, width in (
                (RELEVANCE_SHARE.name, R_COLOUR, 0.9),
                (PARTS_SHARE.name, looks[label].colour, 1.4),
            ):
                each = band(trace["frame"], np.clip(trace[name], LOWEST, HIGHEST))
                axes.plot(
                    each.frame, each.middle, color=colour, linewidth=width, marker="." if len(each.frame) < 60 else ""
                )
            axes.set_title(name_text(label), fontsize=9, pad=2)
            axes.set_ylim(low - 0.05, high + 0.05)
            axes.margins(x=0.01)
            axes.locator_params(axis="y", nbins=3)
        panels[-1].set_xlabel("frame")
        panels[-1].xaxis.get_major_locator().set_params(integer=True)
        figure.supylabel("share", fontsize=9.5, color=INK, x=0.004)
        margins(figure, 0.6, 0.5, top=GAP, hspace=GAP)

    names = list(next(iter(traces.values())))
    return Plot(
        key,
        f"Shares by frame under {budget}",
        "In colour, of what the oracle that may trace items in part takes off the error; in grey, of the largest sum of R that "
        "the budget could buy by predicted cost. The dashed line is all of it; what is beyond the scale is drawn at its end.",
        f"Shares over the judged frames under {budget}. "
        + "; ".join(f"{label}: median {np.nanmedian(trace[PARTS_SHARE.name]):.2f}" for label, trace in traces.items())
        + ".",
        draw(key, (WIDTH, 0.5 + (ROW_HEIGHT + GAP) * len(traces)), paint),
        table_csv(
            ["label", *names], [(label, *row) for label in traces for row in zip(*traces[label].values(), strict=True)]
        ),
        wide=True,
    )


def _columns(rows: Sequence[Mapping[str, Any]]) -> dict[str, np.ndarray]:
    """Numbers by column, in the order of frames."""
    ordered = sorted(rows, key=lambda row: row["frame"])
    names = [name for name in ordered[0] if name == "frame" or name.endswith("_share")]
    return {name: np.array([row[name] for row in ordered], np.float64) for name in names}
