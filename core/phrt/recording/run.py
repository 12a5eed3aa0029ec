"""Run: a recorded run, read back, finished or cut short."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from phrt.errors import OptionError
from phrt.recording.arrow import import_arrow
from phrt.recording.folder import parquet_path, read_about, stream_path
from phrt.recording.rows import widened
from phrt.recording.stream import joined, stream_batches


@dataclass(frozen=True)
class Run:
    """A recorded run.

    folder    : where it is
    about     : run.json
    frames    : pyarrow table, a row per frame, with a column per stage (`stage_rays_ms`) and kind of rays (`rays_shadows`)
    cut_short : None for a run that was finished, else how it ended
    """

    folder: Path
    about: dict[str, Any]
    frames: Any
    cut_short: str | None

    @property
    def config(self) -> dict[str, Any]:
        """What it was rendered with, defaults filled in."""
        return dict(self.about["config"])

    @property
    def faults(self) -> list[dict[str, Any]]:
        """What plugins did wrong, in order: frame, kind, name, package, cause, done, and all of it as a message."""
        return list(self.about.get("faults", ()))

    @cached_property
    def candidates(self) -> Any:
        """pyarrow table, a row per candidate, sample and frame. It is read when it is first asked for."""
        return self.read_candidates()

    @cached_property
    def numbers(self) -> np.ndarray:
        """(frames,) int64, the recorded frames' numbers, in the order in which they were rendered."""
        return np.asarray(self.frames.column("frame").to_numpy()) if self.frames.num_columns else np.zeros(0, np.int64)

    def read_candidates(self, columns: Sequence[str] | None = None, step: int | None = None) -> Any:
        """The candidates with some columns (None: all), of all frames or of the one that was rendered as number `step`."""
        arrow = import_arrow()
        path = parquet_path(self.folder, "candidates")
        wanted = None if columns is None else list(columns)
        if path.exists():
            chosen = None if step is None else [("step", "==", step)]
            return arrow.parquet.read_table(path, columns=wanted, filters=chosen)
        # A frame's row is written after its candidates, so there may be more of these.
        batches = islice(stream_batches(stream_path(self.folder, "candidates")), self.frames.num_rows)
        kept = [batch for number, batch in enumerate(batches) if step is None or number == step]
        if not kept:
            return arrow.table({})
        table = joined(kept)
        return table if wanted is None else table.select(wanted)

    def step_of(self, frame: int) -> int:
        """How many frames were rendered before frame number `frame` (the last of that number). Raises OptionError."""
        found = np.flatnonzero(self.numbers == frame)
        if not len(found):
            raise OptionError(f"frame {frame} is not in '{self.folder}'; recorded: {spans(self.numbers) or 'none'}")
        return int(found[-1])

    def frame(self, frame: int) -> dict[str, Any]:
        """The row of frame number `frame`. Raises OptionError."""
        return dict(self.frames.slice(self.step_of(frame), 1).to_pylist()[0])

    def items(self, frame: int) -> dict[str, np.ndarray]:
        """The candidates of frame number `frame`, arrays (n,) by column; names are text. Raises OptionError."""
        return as_arrays(self.read_candidates(step=self.step_of(frame)))


def read_run(folder: str | Path) -> Run:
    """The run in `folder`, whether it was finished, is being recorded, or was cut short.

    Raises OptionError where there is none, where it is of another version, and where pyarrow is missing.
    """
    arrow = import_arrow()
    folder = Path(folder)
    about = read_about(folder)
    try:
        path = parquet_path(folder, "frames")
        if path.exists():
            table = arrow.parquet.read_table(path)
        else:
            batches = list(stream_batches(stream_path(folder, "frames")))
            table = joined(batches) if batches else arrow.table({})
        frames = widened(table)
    except (OSError, arrow.ArrowException) as error:
        raise OptionError(f"'{folder}' cannot be read: {error}") from error
    return Run(folder, about, frames, how_it_ended(about, frames.num_rows))


def how_it_ended(about: dict[str, Any], frames: int) -> str | None:
    """None for a run that was finished, else one sentence."""
    match about["state"]:
        case "finished":
            return None
        case "recording":
            return f"the run is still being recorded, or its process was ended, after {frames} frames"
        case "failed":
            return f"recording failed after {frames} frames: {about['error']}"
        case _:
            return f"the run ended early, after {frames} frames: {about['error']}"


def as_arrays(table: Any) -> dict[str, np.ndarray]:
    """The columns of a pyarrow table as numpy arrays (n,); text is object."""
    return {name: np.asarray(table.column(name).to_numpy()) for name in table.column_names}


def spans(numbers: np.ndarray) -> str:
    """Sorted numbers as text: "0 to 4, 7, 9 to 12"."""
    numbers = np.unique(numbers)
    if not len(numbers):
        return ""
    pieces = np.split(numbers, np.flatnonzero(np.diff(numbers) != 1) + 1)
    return ", ".join(f"{piece[0]} to {piece[-1]}" if len(piece) > 1 else str(piece[0]) for piece in pieces)
