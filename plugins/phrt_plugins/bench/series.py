"""Series: one number a frame of a contestant, its repeats side by side, so that contestants can be compared frame by frame.

    flip = judged_series(run, cells, ["flip"])["flip"]
    times = frame_series(frames_of(run, cells), "frame_ms_p95")

The first is of judged frames, from measures.parquet; the second of all frames: those that this column of a run is a percentile of.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from phrt.interfaces.metric import RunFrames
from phrt.recording.arrow import import_arrow
from phrt_plugins.bench.results import BenchRun, Blocks
from phrt_plugins.bench.statistics import Statistic
from phrt_plugins.metrics.costs import errors_by_frame
from phrt_plugins.metrics.flips import flips_by_frame
from phrt_plugins.metrics.pacing import jitter_by_frame, late_by_frame, times_by_frame
from phrt_plugins.metrics.tables import ray_phase_rays


@dataclass(frozen=True)
class Series:
    """frames, blocks: (n,) int64, sorted; a frame's number and its block's. values: (n, repeats) float64, NaN where there is none.
    repeats: their numbers."""

    frames: np.ndarray
    blocks: np.ndarray
    values: np.ndarray
    repeats: tuple[int, ...] = (0,)

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def segments(self) -> np.ndarray:
        """(n,) equal numbers where frames follow each other on the path."""
        return segments_of(self.blocks)

    def at(self, frames: np.ndarray, repeats: Sequence[int]) -> np.ndarray:
        """(len(frames), len(repeats)) values; all of them are there."""
        columns = [self.repeats.index(repeat) for repeat in repeats]
        return self.values[np.searchsorted(self.frames, frames)][:, columns]


def segments_of(blocks: np.ndarray) -> np.ndarray:
    """(n,) equal numbers where the blocks (n,), sorted, follow each other. The renderer begins anew in each, but what is seen goes
    on; a new segment begins where a block is missing."""
    return np.concatenate([[0], np.cumsum(np.diff(blocks) > 1)]) if len(blocks) else np.zeros(0, np.int64)


def stacked(parts: Sequence[tuple[int, np.ndarray, np.ndarray, np.ndarray]]) -> Series:
    """One series of pieces (repeat, frames, blocks, values); repeats need not have the same frames."""
    frames, first = np.unique(np.concatenate([part[1] for part in parts] or [np.zeros(0)]), return_index=True)
    blocks = np.concatenate([part[2] for part in parts] or [np.zeros(0)])[first]
    repeats = tuple(sorted({part[0] for part in parts}))
    values = np.full((len(frames), len(repeats)), np.nan)
    for repeat, numbers, _, found in parts:
        values[np.searchsorted(frames, numbers), repeats.index(repeat)] = found
    return Series(frames.astype(np.int64), blocks.astype(np.int64), values, repeats)


def common(a: Series, b: Series) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Segments (n,), and values (n, repeats) of both where both have frames: the same frames of the same repeats."""
    frames, rows, _ = np.intersect1d(a.frames, b.frames, assume_unique=True, return_indices=True)
    repeats = [repeat for repeat in a.repeats if repeat in b.repeats]
    return segments_of(a.blocks[rows]), a.at(frames, repeats), b.at(frames, repeats)


def judged_series(run: BenchRun, cells: Sequence[Blocks], columns: Sequence[str]) -> dict[str, Series]:
    """Columns of measures.parquet of the repeats `cells` of a contestant."""
    tables = [(_repeat(cell), run.measures(cell, ["frame", *columns])) for cell in cells if cell.blocks]
    return {name: stacked([(repeat, *_arrays(table, name)) for repeat, table in tables]) for name in columns}


def frames_of(run: BenchRun, cells: Sequence[Blocks]) -> dict[int, RunFrames]:
    """By repeat, all frames of those of `cells` that have any."""
    return {_repeat(cell): run_frames(run, cell) for cell in cells if cell.blocks}


def frame_series(frames: Mapping[int, RunFrames], column: str) -> Series:
    """The frames' numbers that `column` of a run, one of RUN_COLUMNS, is a statistic of. frames: by repeat."""
    per_frame = RUN_COLUMNS[column].per_frame
    return stacked(
        [
            (repeat, np.asarray(each.columns["frame"]), np.asarray(each.columns["block"]), per_frame(each))
            for repeat, each in frames.items()
        ]
    )


def run_frames(run: BenchRun, cell: Blocks) -> RunFrames:
    """What a metric is given of all frames of a cell."""
    table, is_list = run.frames(cell), import_arrow().types.is_list
    plain = [name for name in table.column_names if not is_list(table.schema.field(name).type)]
    columns = {name: table.column(name).to_numpy() for name in plain}
    return RunFrames(columns, lambda names: run.candidates(cell, names))


@dataclass(frozen=True)
class RunColumn:
    """Which statistic a column of a run is, and of what: per_frame gives (n,), NaN where a frame has no part in it."""

    statistic: Statistic
    per_frame: Callable[[RunFrames], np.ndarray]


def _flips(frames: RunFrames) -> np.ndarray:
    return flips_by_frame(frames)[:, 0]


def _flips_area(frames: RunFrames) -> np.ndarray:
    return flips_by_frame(frames)[:, 1]


def _error_measured(frames: RunFrames) -> np.ndarray:
    return errors_by_frame(frames)["error_measured"]


def _error_paper(frames: RunFrames) -> np.ndarray:
    return errors_by_frame(frames)["error_paper"]


RUN_COLUMNS: dict[str, RunColumn] = {
    "frame_ms_p50": RunColumn("p50", times_by_frame),
    "frame_ms_p95": RunColumn("p95", times_by_frame),
    "frame_ms_p99": RunColumn("p99", times_by_frame),
    "fps": RunColumn("rate", times_by_frame),
    "late_share": RunColumn("share", late_by_frame),
    "jitter": RunColumn("mean", jitter_by_frame),
    "rays": RunColumn("mean", ray_phase_rays),
    "decision_flips": RunColumn("mean", _flips),
    "flips_area": RunColumn("mean", _flips_area),
    "error_measured": RunColumn("p50", _error_measured),
    "error_paper": RunColumn("p50", _error_paper),
}
"""The columns of a run that are statistics of one number a frame. Of others there is no interval."""


def _repeat(cell: Blocks) -> int:
    return int(getattr(cell, "repeat", 0))


def _arrays(table: Any, column: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Frames, blocks and values; NaN where a block does not have the column."""
    count = table.num_rows
    values = table.column(column).to_numpy() if column in table.column_names else np.full(count, np.nan)
    return table.column("frame").to_numpy(), table.column("block").to_numpy(), np.asarray(values, np.float64)
