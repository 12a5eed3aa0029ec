"""The summary of a comparison: one row per contestant and metric column, repeats pooled, with 95 % intervals.

    path = summarise("runs/standard")          # DIR/summary.parquet, and summary.csv beside it
    rows = read_summary("runs/standard")

What is measured frame by frame is summarised over the judged frames, what is measured once a run over all frames; `oracle_share`,
`parts_share` and `relevance_share` are the shares of what was possible. Rows are dicts with the columns COLUMNS. docs/statistics.md
has them all.
"""

from __future__ import annotations

import csv
import json
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from phrt.errors import OptionError, PhrtWarning, PluginError
from phrt.interfaces.metric import Column, Metric, RunFrames
from phrt.output.files import complete_file
from phrt.recording.arrow import import_arrow
from phrt_plugins.bench.pictures import ALL_TRACE_ERROR
from phrt_plugins.bench.results import BenchRun, Cell, State, read_columns
from phrt_plugins.bench.series import RUN_COLUMNS, Series, frame_series, frames_of, judged_series
from phrt_plugins.bench.shares import FRAME_COLUMNS, RELEVANCE_SHARE, SHARES, Share, contestant_shares, frame_rows
from phrt_plugins.bench.statistics import NOTHING, Interval, interval, intervals, statistic_of

SETTINGS = (
    "contest", "setup", "scene", "size", "tracer", "gbuffer", "clock", "budget", "budget_kind", "budget_amount",
    "label", "heuristic", "persistence", "cost_model", "group_by", "history", "cells", "state", "reference",
)  # fmt: skip
COLUMNS = (*SETTINGS, "metric", "unit", "better", "value", "low", "high", "frames")


def summarise(folder: str | Path, *, strict: bool = False) -> Path:
    """Write summary.parquet and summary.csv into the run `folder`, of what is there, and shares.parquet and shares.csv, the shares
    of what was possible frame by frame; each is replaced whole. The first's path.

    strict: a metric that fails is a PluginFailure, and nothing is written.

    Raises OptionError where the run cannot be read, or nothing can be written.
    """
    arrow = import_arrow()
    run = BenchRun.read(folder)
    shares = all_shares(run)
    path = run.folder / "summary.parquet"
    write_both(path, list(summary_rows(run, strict=strict, shares=shares)), _schema())
    numbers = dict.fromkeys((column.name for column in SHARES), arrow.float64()) | {"frame": arrow.int64()}
    schema = arrow.schema([(name, numbers.get(name, arrow.string())) for name in FRAME_COLUMNS])
    write_both(run.folder / "shares.parquet", list(frame_rows(run, shares)), schema)
    return path


def write_both(path: Path, rows: Sequence[Mapping[str, Any]], schema: Any) -> None:
    """Write `rows` to `path` as Parquet, and as CSV beside it; a number that is not there is an empty field."""
    arrow = import_arrow()
    with complete_file(path) as temporary:
        arrow.parquet.write_table(arrow.Table.from_pylist(rows, schema), temporary)
    with (
        complete_file(path.with_suffix(".csv")) as temporary,
        open(temporary, "w", newline="", encoding="utf-8") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(schema.names)
        writer.writerows(["" if row[name] != row[name] else row[name] for name in schema.names] for row in rows)


def _schema() -> Any:
    arrow = import_arrow()
    numbers = dict.fromkeys(("budget_amount", "persistence", "value", "low", "high"), arrow.float64())
    types = numbers | {"history": arrow.bool_(), "cells": arrow.int64(), "frames": arrow.int64()}
    return arrow.schema([(name, types.get(name, arrow.string())) for name in COLUMNS])


def read_summary(folder: str | Path) -> list[dict[str, Any]]:
    """The rows of DIR/summary.parquet. Raises OptionError where it is not there (`summarise` writes it)."""
    path = Path(folder) / "summary.parquet"
    import_arrow()
    table = read_columns(path)
    if table is None:
        raise OptionError(f"there is no '{path}'; it is written when `phrt bench` ends")
    return list(table.to_pylist())


def summary_rows(
    run: BenchRun, *, strict: bool = False, shares: Mapping[Any, Sequence[Share]] | None = None
) -> Iterator[dict[str, Any]]:
    """The rows, contestant by contestant. One without a whole block has values NaN of no frames. shares: by group, where they are
    known (`all_shares`)."""
    metrics = metrics_of(run)
    known = {column.name: column for metric in metrics for column in metric.columns} | said_columns(run)
    known[ALL_TRACE_ERROR.name] = ALL_TRACE_ERROR
    shot_columns = [known.get(name) or Column(name, name, "", "neither") for name in measured(run)]
    shares = all_shares(run) if shares is None else shares
    for group, cells in run.groups().items():
        about = settings_of(run, cells)
        for column, found in group_values(run, cells, shares[group], shot_columns, metrics, strict):
            yield about | {"metric": column.name, "unit": column.unit, "better": column.better} | vars(found)


def all_shares(run: BenchRun) -> dict[Any, list[Share]]:
    """The shares of every contestant, by its group."""
    return {group: contestant_shares(run, cells) for group, cells in run.groups().items()}


def settings_of(run: BenchRun, cells: Sequence[Cell]) -> dict[str, Any]:
    """What is said of a contestant in all its rows."""
    cell = cells[0]
    width, height = cell.size
    return {
        "contest": run.contest(cell.setup),
        "setup": cell.setup,
        "scene": cell.scene,
        "size": f"{width}x{height}",
        "tracer": cell.tracer,
        "gbuffer": cell.gbuffer,
        "clock": clock_text(cell.clock),
        "budget": cell.budget,
        "budget_kind": cell.budget_kind,
        "budget_amount": cell.budget_amount,
        "label": cell.label,
        "heuristic": cell.heuristic,
        "persistence": math.nan if cell.persistence is None else float(cell.persistence),
        "cost_model": cell.cost_model,
        "group_by": cell.group_by,
        "history": cell.history,
        "cells": len(cells),
        "state": state_of(cells),
        "reference": run.reference_name,
    }


def state_of(cells: Sequence[Cell]) -> State:
    """failed where a repeat failed, partial where one is not done."""
    states = {cell.state for cell in cells}
    return "failed" if "failed" in states else "partial" if "partial" in states else "ok"


def clock_text(clock: Any) -> str:
    """ "wall", or "100 ns a ray"."""
    if isinstance(clock, Mapping) and "rays" in clock:
        return f"{clock['rays']:g} ns a ray"
    return "wall" if clock in (None, "wall") else json.dumps(clock)


def group_values(
    run: BenchRun,
    cells: Sequence[Cell],
    shares: Sequence[Share],
    shot_columns: Sequence[Column],
    metrics: Sequence[Metric],
    strict: bool,
) -> Iterator[tuple[Column, Interval]]:
    """Every column of a contestant with its value."""
    begun = [cell for cell in cells if cell.blocks]
    judged = judged_series(run, begun, [column.name for column in shot_columns])
    for column in shot_columns:
        series = judged[column.name]
        yield column, interval(series.values, series.segments, column.statistic)
    yield from run_values(run, begun, metrics, strict)
    for column in SHARES if run.has_oracle(cells[0].setup) else (RELEVANCE_SHARE,):
        found = [share.interval() for share in shares if share.column is column]
        yield column, found[0] if found else NOTHING


def run_values(
    run: BenchRun, cells: Sequence[Cell], metrics: Sequence[Metric], strict: bool
) -> Iterator[tuple[Column, Interval]]:
    """The columns of scope "run". One that is a statistic of a number a frame (`RUN_COLUMNS`) has an interval; others are the mean
    of the repeats, or their maximum or sum where the column says so."""
    from phrt_plugins.metrics.measure import all_columns, measure_run

    frames = frames_of(run, cells)
    found = {repeat: measure_run(metrics, each, strict=strict) for repeat, each in frames.items()}
    longest = max((len(each) for each in frames.values()), default=0)
    with_interval = intervals_of(frames, found)
    for column in all_columns(metrics, "run"):
        if column.name in with_interval:
            yield column, with_interval[column.name]
        else:
            repeats = np.array([values.get(column.name, math.nan) for values in found.values()])
            pooled = statistic_of(repeats, column.statistic)
            yield column, Interval(pooled, math.nan, math.nan, 0 if math.isnan(pooled) else longest)


def intervals_of(frames: Mapping[int, RunFrames], found: Mapping[int, Mapping[str, float]]) -> dict[str, Interval]:
    """Of those RUN_COLUMNS whose value in every repeat is what our statistic of its frames comes to; else the metric that found it
    means something else by the name."""
    ours: dict[Any, list[str]] = {}
    for name, column in RUN_COLUMNS.items():
        if any(math.isfinite(values.get(name, math.nan)) for values in found.values()):
            ours.setdefault(column.per_frame, []).append(name)
    made: dict[str, Interval] = {}
    for names in ours.values():
        series = frame_series(frames, names[0])
        same = [name for name in names if is_of(series, name, found)]
        statistics = [RUN_COLUMNS[name].statistic for name in same]
        made |= dict(zip(same, intervals(series.values, series.segments, statistics), strict=True))
    return made


def is_of(series: Series, column: str, found: Mapping[int, Mapping[str, float]]) -> bool:
    """Is what was `found` in each repeat the statistic of its frames' numbers?"""
    statistic = RUN_COLUMNS[column].statistic
    ours = [statistic_of(series.values[:, number], statistic) for number in range(len(series.repeats))]
    theirs = [found[repeat].get(column, math.nan) for repeat in series.repeats]
    return bool(ours) and np.allclose(ours, theirs, rtol=1e-6, atol=1e-9, equal_nan=True)


def metrics_of(run: BenchRun) -> list[Metric]:
    """The metrics that the run was judged with. One that is not to be had here is left out, with a PhrtWarning."""
    from phrt_plugins.metrics.measure import available_metrics, make_metric

    made = []
    named = run.config.get("metrics")
    for name in named if isinstance(named, list) else available_metrics():
        try:
            made.append(make_metric(name, {}))
        except PluginError as error:
            warnings.warn(PhrtWarning(f"nothing is said of the columns of metric '{name}': {error}"), stacklevel=2)
    return made


def said_columns(run: BenchRun) -> dict[str, Column]:
    """What bench.json says of metrics' columns: those of metrics that are not installed here."""
    found = {}
    for entry in run.about.get("columns") or ():
        names = {
            name: entry[name] for name in ("name", "summary", "unit", "better", "statistic", "scope") if name in entry
        }
        found[entry["name"]] = Column(**names)
    return found


def measured(run: BenchRun) -> list[str]:
    """The columns in the measures of any cell."""
    names: dict[str, None] = {}
    for cell in run.cells:
        if cell.blocks:
            names |= dict.fromkeys(run.measures(cell).column_names)
    return [name for name in names if name not in ("block", "frame")]
