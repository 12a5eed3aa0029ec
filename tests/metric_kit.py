"""Shots and runs made by hand, for tests of metrics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import needs
import numpy as np

from phrt.interfaces.metric import Metric, RunFrames, Shot
from phrt_plugins.metrics.measure import make_metrics

SHAPE = (36, 64, 3)


def codes(value: int, shape: tuple[int, ...] = SHAPE) -> np.ndarray:
    """A flat display: every channel the same 8-bit code."""
    return np.full(shape, value, np.uint8)


def noise(seed: int = 0, shape: tuple[int, ...] = SHAPE) -> np.ndarray:
    """A display of random codes."""
    return np.random.default_rng(seed).integers(0, 256, shape).astype(np.uint8)


def waves(shift: float = 0.0, shape: tuple[int, ...] = SHAPE) -> np.ndarray:
    """A smooth display whose content lies `shift` pixels further to the right."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    value = 0.5 + 0.3 * np.sin((x - shift) / 5.0) + 0.1 * np.cos(y / 4.0)
    return np.repeat(np.round(value[..., None] * 255).astype(np.uint8), 3, axis=2)


def metric(name: str, **options: object) -> Metric:
    return make_metrics([name], {name: options})[0]


def found(name: str, of: Shot | RunFrames, **options: object) -> dict[str, float]:
    """What metric `name` finds in a shot or a run."""
    made = metric(name, **options)
    return dict(made.of_shot(of) if isinstance(of, Shot) else made.of_run(of))


def run_of(
    steps: Sequence[int], candidates: dict[str, Sequence[object]] | None = None, **columns: Sequence[object]
) -> RunFrames:
    """A run of frames 100, 101, ... with the given column `step`; `columns` of the frames table, and the candidates table."""
    arrow = needs.package("pyarrow")
    n = len(steps)
    made: dict[str, Any] = {
        "step": np.array(steps, np.int64),
        "frame": np.arange(100, 100 + n),
        "clock_ms": np.full(n, 10.0),
        "deadline_ms": np.full(n, np.inf),
        "late": np.zeros(n, bool),
        "overrun_ms": np.zeros(n),
        "budget_unit": np.full(n, "none", object),
    }
    table = arrow.table({name: arrow.array(list(values)) for name, values in (candidates or {}).items()})
    return RunFrames(
        made | {name: np.array(values) for name, values in columns.items()},
        lambda names: table.select([name for name in names if name in table.column_names]),
    )
