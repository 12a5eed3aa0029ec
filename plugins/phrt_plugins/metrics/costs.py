"""costs: how far off the predictions of the cost models are.

For every frame the predicted milliseconds of what was traced are added up, of a partly traced item by the share of its pixels, and
compared with what the tracing took: |predicted - actual| / actual. Both models predict in every run, whichever the budget
is held by.

Columns: error_measured and error_paper, of the two cost models; the median over the frames in which something was traced.
Options: none.
Source: ours; the paper's model is that of Andrade et al. 2014, eq. (2), with milliseconds fitted to it.

Example, in a configuration of `phrt bench`::

    metrics: [flip, costs]
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.metric import Column, Metric, RunFrames
from phrt.registry import Options
from phrt_plugins.metrics.tables import candidates_by_frame

MODELS = {"error_measured": "predicted_ms_measured", "error_paper": "predicted_ms_paper"}
"""Which prediction each column judges."""


class Costs(Metric):
    """Of the frames' ray phases."""

    columns = (
        Column(
            "error_measured",
            "relative error of the measured cost model, median over the frames",
            "",
            "lower",
            scope="run",
        ),
        Column(
            "error_paper", "relative error of the paper's cost model, median over the frames", "", "lower", scope="run"
        ),
    )

    def __init__(self, options: Options) -> None:
        pass

    def of_run(self, frames: RunFrames) -> dict[str, float]:
        errors = errors_by_frame(frames)
        return {name: float(np.nanmedian(found)) for name, found in errors.items() if not np.isnan(found).all()}


def errors_by_frame(frames: RunFrames) -> dict[str, np.ndarray]:
    """(n,) float64 by column: each frame's relative error; NaN where nothing was traced."""
    wanted = ("pixel_count", "traced_pixels", "rays", "milliseconds", *MODELS.values())
    rows, table = candidates_by_frame(frames, wanted)
    share = traced_share(table["traced_pixels"], table["pixel_count"], table["rays"])
    took = table["milliseconds"].astype(np.float64)
    actual = per_frame(rows, np.where(share > 0, took, 0.0), len(frames))
    found = {}
    for name, prediction in MODELS.items():
        predicted = per_frame(rows, table[prediction] * share, len(frames))
        found[name] = relative_errors(predicted, actual)
    return found


def traced_share(traced_pixels: np.ndarray, pixel_count: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """(m,) float64, which share of its pixels was traced of each item, as predictions are for whole items; 0 where no ray was."""
    return np.where(rays > 0, traced_pixels / np.maximum(pixel_count, 1), 0.0)


def per_frame(rows: np.ndarray, values: np.ndarray, frames: int) -> np.ndarray:
    """(frames,) float64, sums of `values` (m,) by the frame that each belongs to."""
    return np.bincount(rows, weights=values, minlength=frames)


def relative_errors(predicted: np.ndarray, actual: np.ndarray) -> np.ndarray:
    """|predicted - actual| / actual, element by element; NaN where nothing was actually taken."""
    predicted, actual = np.asarray(predicted, np.float64), np.asarray(actual, np.float64)
    known = actual > 0
    return np.where(known, np.abs(predicted - actual) / np.where(known, actual, 1.0), np.nan)
