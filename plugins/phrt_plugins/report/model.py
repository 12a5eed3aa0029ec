"""What the page is made of: plain rows, read from a benchmark's summary."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

GROUP = ("setup", "scene", "size", "tracer", "gbuffer", "clock", "budget", "budget_kind", "budget_amount", "label")


@dataclass(frozen=True)
class Value:
    """A metric's value with its 95 % interval; NaN where there is none. better: "lower", "higher" or "neither"."""

    value: float
    low: float
    high: float
    unit: str
    better: str


@dataclass(frozen=True)
class Entry:
    """A contestant in a setup under a budget, its repeats pooled. state: "ok", "partial" or "failed"; values: by metric column."""

    setup: str
    scene: str
    size: str
    tracer: str
    gbuffer: str
    clock: str
    budget: str
    budget_kind: str
    budget_amount: float
    label: str
    state: str
    values: Mapping[str, Value]

    def value(self, metric: str) -> float:
        """The metric's value; NaN where it has none."""
        found = self.values.get(metric)
        return math.nan if found is None else found.value


def entries_of(rows: Iterable[Mapping[str, Any]]) -> list[Entry]:
    """The long table of a summary, one row per contestant and metric, as entries in the order of their first rows."""
    groups: dict[tuple[Any, ...], dict[str, Value]] = {}
    about: dict[tuple[Any, ...], Mapping[str, Any]] = {}
    for row in rows:
        key = tuple(row[name] for name in GROUP if name != "budget_amount")  # which may be NaN
        about.setdefault(key, row)
        found = Value(
            number(row["value"]), number(row["low"]), number(row["high"]), text(row["unit"]), text(row["better"])
        )
        groups.setdefault(key, {})[str(row["metric"])] = found
    return [entry_of(about[key], values) for key, values in groups.items()]


def entry_of(row: Mapping[str, Any], values: Mapping[str, Value]) -> Entry:
    """One with the settings of a row of the summary."""
    names = {name: text(row[name]) for name in GROUP if name != "budget_amount"}
    return Entry(**names, budget_amount=number(row["budget_amount"]), state=text(row["state"]), values=values)


def number(value: Any) -> float:
    """A number of a table; NaN for None and what is none."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return math.nan


def text(value: Any) -> str:
    return "" if value is None or value != value else str(value)
