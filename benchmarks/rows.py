"""One line of the benchmark table: samples, their median, and the bar they are held to."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from rich.table import Table

Sense = Literal["<=", ">="]


@dataclass(frozen=True)
class Row:
    """samples: one value a repeat, in `unit` ("" for a ratio). limit: the bar; None where a value is only context."""

    number: int
    what: str
    unit: str
    samples: tuple[float, ...]
    sense: Sense = "<="
    limit: float | None = None

    @property
    def median(self) -> float:
        return float(np.median(self.samples))

    @property
    def met(self) -> bool | None:
        """Does the median meet the bar? None without one."""
        if self.limit is None:
            return None
        return self.median <= self.limit if self.sense == "<=" else self.median >= self.limit

    def as_json(self) -> dict[str, Any]:
        """The fields, and what follows from them, as plain values."""
        derived = {"median": self.median, "min": min(self.samples), "max": max(self.samples), "met": self.met}
        return asdict(self) | derived


def row(number: int, what: str, unit: str, samples: Iterable[float], sense: Sense, limit: float | None) -> Row:
    """A `Row` of any iterable of samples. Raises ValueError when there is none."""
    values = tuple(float(value) for value in samples)
    if not values:
        raise ValueError(f"row {number}, {what}: no samples")
    return Row(number, what, unit, values, sense, limit)


def shown(value: float, unit: str) -> str:
    """Two digits for ratios, seconds and gigabytes, one for milliseconds."""
    return f"{value:.1f}" if unit == "ms" else f"{value:.2f}"


def table(rows: Sequence[Row]) -> Table:
    """The rows, for `rich`."""
    made = Table(title="Benchmarks: median (min..max)", title_justify="left")
    for heading in ("row", "what", "bar", "measured", ""):
        made.add_column(heading, justify="right" if heading == "row" else "left")
    for entry in rows:
        bar = "" if entry.limit is None else f"{entry.sense} {entry.limit:g} {entry.unit}".rstrip()
        spread = f"({shown(min(entry.samples), entry.unit)}..{shown(max(entry.samples), entry.unit)})"
        measured = f"{shown(entry.median, entry.unit)} {spread} {entry.unit}".rstrip()
        verdict = {None: "", True: "[green]met[/]", False: "[red]missed[/]"}[entry.met]
        made.add_row(str(entry.number), entry.what, bar, measured, verdict)
    return made
