"""Leaderboards as the page shows them: one per setup and budget, every cell with what it is sorted by."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from phrt_plugins.report.drawing import Look, table_csv
from phrt_plugins.report.model import Entry, Value


@dataclass(frozen=True)
class Column:
    """metric: "" for the rank and the name; style: how a value is written; meaning: shown when the pointer rests on the heading;
    interval: below the value, too."""

    metric: str
    title: str
    style: str
    meaning: str
    text: bool = False
    interval: bool = False


RANK = Column("", "#", "", "rank; who shares one has not been shown to differ")
NAME = Column("", "heuristic", "", "the contestant's label", text=True)
COLUMNS = (
    Column("flip", "FLIP", ".4f", "mean FLIP against the reference, lower is better", interval=True),
    Column("oracle_share", "oracle", "percent", "share of the oracle's error reduction", interval=True),
    Column(
        "parts_share",
        "... in parts",
        "percent",
        "share of what the oracle takes off when items may be traced in part",
        interval=True,
    ),
    Column("relevance_share", "sum of R", "percent", "share of the largest sum of relevance", interval=True),
    Column(
        "flip_changeable", "changeable", ".4f", "mean FLIP over the pixels that a decision could change", interval=True
    ),
    Column("ssim", "SSIM", ".4f", "structural similarity, higher is better", interval=True),
    Column("popping", "popping", ".4f", "motion-compensated change that is not the reference's, 99th percentile"),
    Column("flips_area", "flips", "percent", "decision flips from frame to frame, weighted by area"),
    Column("frame_ms_p50", "p50 ms", ".1f", "time of a frame, median"),
    Column("frame_ms_p99", "p99 ms", ".1f", "time of a frame, 99th percentile"),
    Column("late_share", "late", "percent", "share of frames that passed the budget"),
    Column("rays", "rays", ",.0f", "secondary rays of a frame on average"),
)


@dataclass(frozen=True)
class Cell:
    """text: what is shown; sort: what it is sorted by, "" for last; note: a second, smaller line; bar: interval and value in
    percent of the column's width (left, width, value); best: the first's main metric."""

    text: str
    sort: str
    note: str = ""
    bar: tuple[float, float, float] | None = None
    best: bool = False


@dataclass(frozen=True)
class Row:
    cells: tuple[Cell, ...]
    colour: str
    first: bool


@dataclass(frozen=True)
class Board:
    key: str
    title: str
    columns: tuple[Column, ...]
    rows: tuple[Row, ...]
    csv: str
    note: str = ""


@dataclass(frozen=True)
class Placed:
    """A contestant's place. rank: None where it has none; note: how it compares with the first."""

    entry: Entry
    rank: int | None
    note: str = ""


def board(key: str, title: str, main: str, placed: Sequence[Placed], looks: Mapping[str, Look]) -> Board:
    """The table of `placed`, in their order. main: the metric that they are ordered by, shown first and with a bar."""
    columns = columns_of(main, [each.entry for each in placed])
    known = [each.entry.values[main] for each in placed if main in each.entry.values]
    top = max((v for value in known for v in (value.value, value.high) if math.isfinite(v)), default=1.0)
    rows = tuple(
        Row(
            (
                place_cell(each),
                name_cell(each),
                *(metric_cell(each, column, column.metric == main, top) for column in columns),
            ),
            looks[each.entry.label].colour,
            each.rank == 1,
        )
        for each in placed
    )
    return Board(key, title, (RANK, NAME, *columns), rows, all_metrics(placed))


def columns_of(main: str, entries: Sequence[Entry]) -> list[Column]:
    """The main metric's column, then those of COLUMNS that someone has a value in."""
    known = {column.metric: column for column in COLUMNS}
    first = known.get(main, Column(main, main, ".4g", main, interval=True))
    others = [c for c in COLUMNS if c.metric != main and any(math.isfinite(e.value(c.metric)) for e in entries)]
    return [first, *others]


def place_cell(placed: Placed) -> Cell:
    return Cell("–", "") if placed.rank is None else Cell(str(placed.rank), str(placed.rank))


def name_cell(placed: Placed) -> Cell:
    state = {"failed": "failed", "partial": "not finished"}.get(placed.entry.state, "")
    return Cell(placed.entry.label, placed.entry.label, ", ".join(filter(None, (state, placed.note))))


def metric_cell(placed: Placed, column: Column, is_main: bool, top: float) -> Cell:
    found = placed.entry.values.get(column.metric)
    if found is None or math.isnan(found.value):
        return Cell("–", "")
    bar = bar_of(found, top) if is_main else None
    return Cell(
        written(found.value, column.style),
        repr(found.value),
        interval(found, column.style) if column.interval else "",
        bar,
        is_main and placed.rank == 1,
    )


def interval(value: Value, style: str) -> str:
    """ "[0.031, 0.034]", or nothing where there is no interval."""
    if not (math.isfinite(value.low) and math.isfinite(value.high)) or value.low == value.high:
        return ""
    ends = (written(end, style).removesuffix(" %") for end in (value.low, value.high))
    return f"[{', '.join(ends)}]"


def written(value: float, style: str) -> str:
    """A number as a style says; a zero has no sign."""
    text = f"{100 * value:.1f} %" if style == "percent" else format(value, style)
    return text if any(digit in "123456789" for digit in text) else text.removeprefix("-")


def bar_of(value: Value, top: float) -> tuple[float, float, float] | None:
    """Left and width of the interval, and the value, in percent of `top`."""
    if not top > 0:
        return None
    low, high = (end if math.isfinite(end) else value.value for end in (value.low, value.high))
    return tuple(round(100 * part / top, 2) for part in (low, high - low, value.value))  # type: ignore[return-value]


def all_metrics(placed: Sequence[Placed]) -> str:
    """Every metric of every contestant as CSV, long form."""
    rows = [
        (
            each.rank,
            each.entry.label,
            each.entry.budget,
            each.entry.state,
            name,
            value.value,
            value.low,
            value.high,
            value.unit,
            value.better,
        )
        for each in placed
        for name, value in each.entry.values.items()
    ]
    return table_csv(("rank", "label", "budget", "state", "metric", "value", "low", "high", "unit", "better"), rows)
