"""pacing: are frames in time, and how evenly do they come?

Times are milliseconds of the renderer's clock, of whole frames with what the renderer was told to keep for closing them. Under a
clock of rays they are the same on every machine, and say nothing of milliseconds. Frames follow each other within a block.

Columns: frame_ms_p50, frame_ms_p95, frame_ms_p99, percentiles of the frames' times. fps, frames / their time. late_share, how many
frames passed the budget for the frame; late_streak, how many did in a row at most; both are left out without such a budget.
jitter, the mean of |time - the time of the frame before|. overrun_ms_worst, by how much the ray phase passed its budget of
time at most; left out without one. rays, of the ray phase, mean.
Options: none.
Source: percentiles as numpy's, linear between frames.

Example, in a configuration of `phrt bench`::

    metrics: [flip, pacing]
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.metric import Column, Metric, RunFrames
from phrt.registry import Options
from phrt_plugins.metrics.tables import numbers, ray_phase_rays

PERCENTILES = (50, 95, 99)


class Pacing(Metric):
    """Of all frames."""

    columns = (
        *(
            Column(f"frame_ms_p{percentile}", f"time of a frame, {percentile}th percentile", "ms", "lower", scope="run")
            for percentile in PERCENTILES
        ),
        Column("fps", "frames by the time that they took", "1/s", "higher", scope="run"),
        Column("late_share", "share of the frames that passed their budget", "", "lower", scope="run"),
        Column("late_streak", "most late frames in a row", "frames", "lower", statistic="max", scope="run"),
        Column("jitter", "difference of a frame's time and the one before, mean", "ms", "lower", scope="run"),
        Column(
            "overrun_ms_worst",
            "most that a ray phase passed its budget by",
            "ms",
            "lower",
            statistic="max",
            scope="run",
        ),
        Column("rays", "rays of a frame's ray phase, mean", "rays", "neither", scope="run"),
    )

    def __init__(self, options: Options) -> None:
        pass

    def of_run(self, frames: RunFrames) -> dict[str, float]:
        if not len(frames):
            return {}
        times = times_by_frame(frames)
        found = {f"frame_ms_p{percentile}": float(np.percentile(times, percentile)) for percentile in PERCENTILES}
        found["rays"] = float(ray_phase_rays(frames).mean())
        if times.sum() > 0:
            found["fps"] = float(1e3 / times.mean())
        if frames.follows().any():
            found["jitter"] = float(np.nanmean(jitter_by_frame(frames)))
        return found | lateness(frames) | overrun(frames)


def times_by_frame(frames: RunFrames) -> np.ndarray:
    """(n,) milliseconds."""
    return numbers(frames, "clock_ms")


def late_by_frame(frames: RunFrames) -> np.ndarray:
    """(n,) 1 where late, 0 where in time, NaN without a budget for the whole frame."""
    limited = np.isfinite(numbers(frames, "deadline_ms"))
    return np.where(limited, numbers(frames, "late") > 0, np.nan)


def jitter_by_frame(frames: RunFrames) -> np.ndarray:
    """(n,) |time - the time of the frame before|, milliseconds; NaN for a block's first."""
    times = times_by_frame(frames)
    return np.where(frames.follows(), np.abs(np.diff(times, prepend=times[:1])), np.nan)


def lateness(frames: RunFrames) -> dict[str, float]:
    """late_share and late_streak of the frames that have a budget for the whole frame."""
    late = late_by_frame(frames)
    if np.isnan(late).all():
        return {}
    return {
        "late_share": float(np.nanmean(late)),
        "late_streak": float(longest_streak(late == 1, frames.follows())),
    }


def longest_streak(late: np.ndarray, follows: np.ndarray) -> int:
    """Most True in a row of `late` (n,), where a row ends wherever `follows` (n,) is False."""
    longest = streak = 0
    for is_late, goes_on in zip(late.tolist(), follows.tolist(), strict=True):
        streak = (streak if goes_on else 0) + 1 if is_late else 0
        longest = max(longest, streak)
    return longest


def overrun(frames: RunFrames) -> dict[str, float]:
    """overrun_ms_worst of the frames whose ray phase has a budget of time."""
    timed = np.asarray(frames.columns["budget_unit"]) == "ms"
    return {"overrun_ms_worst": float(numbers(frames, "overrun_ms")[timed].max())} if timed.any() else {}
