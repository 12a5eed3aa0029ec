"""Metric: how good a run is, by its pictures (frame by frame) or by its frames' times and decisions (run by run)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

Better = Literal["lower", "higher", "neither"]
Statistic = Literal["mean", "p50", "p95", "p99", "max", "sum"]
Scope = Literal["shot", "run"]

RESERVED_COLUMNS = ("frame", "oracle_share", "parts_share", "relevance_share")
"""Columns that comparisons have anyway: no metric can call one of its own so."""


@dataclass(frozen=True)
class Column:
    """One number that a metric finds.

    name     : what tables call it; lower case with underscores, unique over all metrics
    summary  : one line on what it means
    unit     : "ms", "dB", "1/s", ...; empty for none
    better   : which direction is better
    statistic: how values of several frames (or, of runs, of several repeats) become one
    scope    : "shot": `Metric.of_shot` gives it, a value a judged frame; "run": `Metric.of_run` does, one value a run
    """

    name: str
    summary: str
    unit: str
    better: Better
    statistic: Statistic = "mean"
    scope: Scope = "shot"


@dataclass(frozen=True)
class Shot:
    """A judged frame beside its reference: the frame with everything traced, or path traced. H, W >= 7.

    index            : the frame's
    image            : (H, W, 3) float32, linear Rec.709, exposure applied
    display          : (H, W, 3) uint8, sRGB, tone-mapped: what is shown
    reference, reference_display: the same of the reference
    changeable       : (H, W) bool, pixels that a decision could change: where what is shown with everything traced and with
                       nothing traced differs
    previous         : the frame before, whose own `previous` is None; None where it is not known
    motion           : (H, W, 2) float32, pixels, x right and y down: where the point was in the previous frame, minus here, as the
                       G-buffer's channel; NaN where that is not known; None where nothing is
    """

    index: int
    image: np.ndarray
    display: np.ndarray
    reference: np.ndarray
    reference_display: np.ndarray
    changeable: np.ndarray
    previous: Shot | None = None
    motion: np.ndarray | None = None


@dataclass(frozen=True)
class RunFrames:
    """All frames of a run, in order; n frames, which may come in blocks that know nothing of each other.

    columns   : (n,) arrays by name: the frames table of a recording (phrt.recording.rows) as `widened` gives it, with a column a
                stage and a kind of rays. `step` counts the frames of a block from 0; `frame` is unique.
    candidates: the candidates table of the same frames as a pyarrow table with (at least) the columns asked for, in the frames'
                order; read only when it is called
    """

    columns: Mapping[str, np.ndarray]
    candidates: Callable[[Sequence[str]], Any]

    def __len__(self) -> int:
        return len(self.columns["step"])

    def follows(self) -> np.ndarray:
        """(n,) bool: was the frame rendered right after the one in the row above? False for a block's first."""
        step = np.asarray(self.columns["step"])
        return np.concatenate([np.zeros(min(len(step), 1), bool), np.diff(step) == 1])


class Metric(ABC):
    """Contract: constructed from its pydantic options. It keeps nothing from one call to the next, does not change what it is
    given, and may be sent to another process (it can be pickled).

    Both methods return finite numbers by column name; a column that does not apply is left out, or NaN. A metric that raises, or
    returns something else, is contained: NaN stands for its columns, and one warning names it.
    """

    name: str = "?"
    """What the registry calls it; whoever makes it through the registry sets it."""

    @property
    @abstractmethod
    def columns(self) -> tuple[Column, ...]:
        """What it finds; a class attribute will do."""

    def of_shot(self, shot: Shot) -> Mapping[str, float]:
        """The columns of scope "shot" for one judged frame."""
        return {}

    def of_run(self, frames: RunFrames) -> Mapping[str, float]:
        """The columns of scope "run" for all frames of a run."""
        return {}
