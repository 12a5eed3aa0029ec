"""Shares of what was possible: of the error that an oracle takes off, and of the largest sum of R, over a path and frame by frame.

    for share in contestant_shares(run, cells):
        share.column.name, share.interval(), share.by_frame()

Each is a ratio of sums over judged frames, so that frames in which there was little to gain count little. docs/oracle.md explains
what the bounds mean.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from phrt.interfaces.metric import Column
from phrt.recording.arrow import import_arrow
from phrt_plugins.bench.pictures import ALL_TRACE_ERROR
from phrt_plugins.bench.plan import ALL_TRACE_NAME
from phrt_plugins.bench.results import BenchRun, Cell
from phrt_plugins.bench.series import Series, judged_series, stacked
from phrt_plugins.bench.statistics import Interval, ratio_interval

ORACLE_SHARE = Column(
    "oracle_share", "share of the error that the oracle takes off at the same budget", "", "higher", scope="run"
)
PARTS_SHARE = Column("parts_share", "the same of the oracle that may trace items in part", "", "higher", scope="run")
RELEVANCE_SHARE = Column(
    "relevance_share", "share of the largest sum of relevance at the same budget", "", "higher", scope="run"
)
SHARES = (ORACLE_SHARE, PARTS_SHARE, RELEVANCE_SHARE)
ORACLES = {ORACLE_SHARE: "error_oracle", PARTS_SHARE: "error_parts"}
"""Which column of the oracle's table each is a share of."""
ORACLE_ERROR = "display_error"
"""The column of measures that the oracle's errors are in, where pictures are compared with all-trace; else ALL_TRACE_ERROR."""

R_COLUMNS = ("frame", "relevance", "predicted_cost", "traced_pixels", "pixel_count")
MOST_KNAPSACKS = 300
"""Of a cell; of more judged frames, so many that are evenly spread are solved for `relevance_share`."""

FRAME_COLUMNS = ("contest", "setup", "budget", "label", "frame", *(column.name for column in SHARES))
"""Of shares.parquet: a row for each contestant and judged frame, repeats pooled."""


@dataclass(frozen=True)
class Share:
    """above, below: what a contestant got, and what there was to get, of the same frames and repeats."""

    column: Column
    above: Series
    below: Series

    def interval(self) -> Interval:
        """The ratio of the sums over all frames, with its 95 % interval."""
        return ratio_interval(self.above.values, self.below.values, self.above.segments)

    def by_frame(self) -> dict[int, float]:
        """The ratio by frame, NaN where there was nothing to get."""
        got, most = (np.nansum(series.values, axis=1) for series in (self.above, self.below))
        ratio = np.divide(got, most, out=np.full(len(got), np.nan), where=most > 0)
        return dict(zip(self.above.frames.tolist(), ratio.tolist(), strict=True))


def contestant_shares(run: BenchRun, cells: Sequence[Cell]) -> list[Share]:
    """The shares of a contestant, whose repeats are `cells`; of oracles where the run has them. Empty where it has no frames."""
    begun = [cell for cell in cells if cell.blocks]
    if not begun:
        return []
    return [*(oracle_shares(run, begun) if run.has_oracle(begun[0].setup) else ()), relevance_share(run, begun)]


def oracle_shares(run: BenchRun, cells: Sequence[Cell]) -> Iterator[Share]:
    """(error of the floor - error of the contestant) / (error of the floor - error of the oracle)."""
    cell = cells[0]
    table = run.oracle(cell.setup, ["frame", "budget", "error_floor", *ORACLES.values()])
    at = np.flatnonzero(np.asarray(table.column("budget").to_pylist(), object) == cell.budget)
    order = at[np.argsort(table.column("frame").to_numpy()[at])]
    known, floor = (table.column(name).to_numpy()[order] for name in ("frame", "error_floor"))
    column = ORACLE_ERROR if run.reference_name == ALL_TRACE_NAME else ALL_TRACE_ERROR.name
    error = judged_series(run, cells, [column])[column]
    frames, rows, places = np.intersect1d(error.frames, known, assume_unique=True, return_indices=True)
    took = Series(frames, error.blocks[rows], floor[places, None] - error.values[rows], error.repeats)
    for share, name in ORACLES.items():
        possible = (floor - table.column(name).to_numpy()[order])[places, None]
        most = np.where(np.isnan(took.values), np.nan, possible)
        yield Share(share, took, Series(frames, took.blocks, most, error.repeats))


def relevance_share(run: BenchRun, cells: Sequence[Cell]) -> Share:
    """Sum of R that was chosen / the most that the frame's budget could buy, by predicted costs."""
    from phrt_plugins.bench.oracle import relevance_share as of_frames

    chosen, best = [], []
    for cell in cells:
        wanted = spread(run.measures(cell, ["frame"]).column("frame").to_numpy(), MOST_KNAPSACKS)
        frames = run.frames(cell, ["frame", "budget"])
        for block, candidates in run.candidate_blocks(cell, R_COLUMNS):
            mine = frames.filter(import_arrow().compute.equal(frames.column("block"), block))
            found = of_frames(candidates, mine, only=wanted)
            blocks = np.full(len(found.frame), block)
            chosen.append((cell.repeat, found.frame, blocks, found.sum_chosen))
            best.append((cell.repeat, found.frame, blocks, found.sum_best))
    return Share(RELEVANCE_SHARE, stacked(chosen), stacked(best))


def frame_rows(run: BenchRun, shares: Mapping[Any, Sequence[Share]]) -> Iterator[dict[str, Any]]:
    """The rows of shares.parquet, of the `shares` of the groups of `run`. A share that a frame does not have is NaN."""
    for group, cells in run.groups().items():
        about = {"contest": run.contest(cells[0].setup), "setup": cells[0].setup}
        about |= {"budget": cells[0].budget, "label": cells[0].label}
        found = {share.column.name: share.by_frame() for share in shares[group]}
        for frame in sorted(set().union(*found.values())):
            values = {column.name: found.get(column.name, {}).get(frame, np.nan) for column in SHARES}
            yield about | {"frame": frame} | values


def spread(numbers: np.ndarray, most: int) -> list[int]:
    """At most `most` of `numbers`, evenly spread."""
    if len(numbers) <= most:
        return list(numbers.tolist())
    return list(numbers[np.linspace(0, len(numbers) - 1, most).round().astype(np.int64)].tolist())
