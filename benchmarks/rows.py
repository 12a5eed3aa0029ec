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
    """samples: one value a repeat, in `unit` ("" for a ratio), or a single figure of all frames. limit: the bar; None where a
    value is only context. digits: after the point, to read; None as the unit says."""

    number: int
    what: str
    unit: str
    samples: tuple[float, ...]
    sense: Sense = "<="
    limit: float | None = None
    digits: int | None = None

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


def row(
    number: int,
    what: str,
    unit: str,
    samples: Iterable[float],
    sense: Sense,
    limit: float | None,
    digits: int | None = None,
) -> Row:
    """A `Row` of any iterable of samples. Raises ValueError when there is none."""
    values = tuple(float(value) for value in samples)
    if not values:
        raise ValueError(f"row {number}, {what}: no samples")
    return Row(number, what, unit, values, sense, limit, digits)


def shown(value: float, entry: Row) -> str:
    """Two digits for ratios, seconds and gigabytes, one for milliseconds and percent, if the row does not say otherwise."""
    digits = entry.digits if entry.digits is not None else 1 if entry.unit in ("ms", "%") else 2
    return f"{value:.{digits}f}"


def table(rows: Sequence[Row]) -> Table:
    """The rows, for `rich`."""
    made = Table(title="Benchmarks: median (min..max), or one figure of all frames", title_justify="left")
    for heading in ("row", "what", "bar", "measured", ""):
        made.add_column(heading, justify="right" if heading == "row" else "left")
    for entry in rows:
        bar = "" if entry.limit is None else f"{entry.sense} {entry.limit:g} {entry.unit}".rstrip()
        several = len(entry.samples) > 1
        spread = f" ({shown(min(entry.samples), entry)}..{shown(max(entry.samples), entry)})" if several else ""
        measured = f"{shown(entry.median, entry)}{spread} {entry.unit}".rstrip()
        verdict = {None: "", True: "[green]met[/]", False: "[red]missed[/]"}[entry.met]
        made.add_row(str(entry.number), entry.what, bar, measured, verdict)
    return made
