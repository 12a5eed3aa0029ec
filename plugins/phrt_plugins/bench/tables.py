"""Leaderboards as tables: for the terminal, in Markdown, in LaTeX.

    print(markdown(boards))
    print(latex(boards))                 # needs the package booktabs
    rich.print(*terminal(boards))

Values have their 95 % intervals beside them. Quality and time stand side by side: at equal rays, contestants need not take
equal time.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from phrt.errors import OptionError, did_you_mean
from phrt_plugins.bench.leaderboard import Board, Entry, board_names, metric_name
from phrt_plugins.bench.series import RUN_COLUMNS
from phrt_plugins.bench.statistics import FEWEST_FRAMES, NOTHING, Interval

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

PERCENT = "%"
"""The form of a value that is a share."""

FORMS = {
    "flip": ".4f",
    "ssim": ".4f",
    "psnr": ".1f",
    "display_error": ".3g",
    "relmse": ".3g",
    "oracle_share": PERCENT,
    "parts_share": PERCENT,
    "relevance_share": PERCENT,
    "flips_area": PERCENT,
    "late_share": PERCENT,
    "frame_ms_p50": ".1f",
    "frame_ms_p95": ".1f",
    "frame_ms_p99": ".1f",
    "fps": ".1f",
    "rays": ".0f",
}
"""How values are written; others with four digits."""

HEADINGS = {
    "oracle_share": "of the oracle",
    "parts_share": "... in parts",
    "relevance_share": "of sum of R",
    "late_share": "late",
    "frame_ms_p50": "p50 ms",
    "frame_ms_p95": "p95 ms",
    "frame_ms_p99": "p99 ms",
}
BESIDE = (
    "ssim", "oracle_share", "parts_share", "relevance_share", "frame_ms_p50", "frame_ms_p95", "frame_ms_p99", "fps",
    "late_share", "rays",
)  # fmt: skip
"""What stands beside the main metric, where anybody has it."""

NARROW = ("oracle_share", "frame_ms_p50", "frame_ms_p99", "late_share", "rays")
"""The same where a line has an end: on paper, in a terminal."""

WITH_RANGES = 4
"""Columns with intervals in a terminal: rank, name, the main metric, and its distance to the first."""

FORMATS = ("markdown", "latex", "text")

_LATEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
    "–": "--", "|": r"\textbar{}", '"': r"\textquotedbl{}",
}  # fmt: skip
_MARKDOWN = re.compile(r"([\\`*_\[\]<>|#~])")
_CONTROL = re.compile(r"[\x00-\x1f\x7f]+")


@dataclass(frozen=True)
class Cell:
    """value and range are texts; range is empty where there is no interval."""

    value: str
    range: str = ""
    strong: bool = False


@dataclass(frozen=True)
class Grid:
    """A board as texts: title, headings, rows of as many cells, and notes that belong below it. The first columns are the rank, the
    name, the main metric and its distance to the first."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    notes: tuple[str, ...]


def export(boards: Sequence[Board], form: str) -> str:
    """The boards in one of FORMATS. Raises OptionError for another."""
    match form:
        case "markdown":
            return markdown(boards)
        case "latex":
            return latex(boards)
        case "text":
            return text(boards)
    raise OptionError(f"tables are '{form}'; allowed: {', '.join(FORMATS)}.{did_you_mean(form, list(FORMATS))}")


def grids(boards: Sequence[Board], beside: Sequence[str] = BESIDE) -> list[Grid]:
    """The boards as texts, none of them escaped. beside: which metrics stand beside the main one."""
    return [_grid(board, name, beside) for board, name in zip(boards, board_names(boards), strict=True)]


def markdown(boards: Sequence[Board], beside: Sequence[str] = BESIDE) -> str:
    """A heading, a table and its notes per board."""
    parts = []
    for grid in grids(boards, beside):
        lines = [f"### {_escaped(grid.title)}", "", _row(_escaped(heading) for heading in grid.headings)]
        lines.append(_row(":--" if number == 1 else "--:" for number in range(len(grid.headings))))
        lines += [_row(_marked(cell) for cell in row) for row in grid.rows]
        lines += ["", *(f"{_escaped(note)}  " for note in grid.notes)]
        parts.append("\n".join(lines).rstrip())
    return "\n\n".join(parts) + "\n"


def latex(boards: Sequence[Board], beside: Sequence[str] = NARROW) -> str:
    """A table environment per board, for a document that uses the package booktabs."""
    parts = ["% \\usepackage{booktabs}"]
    for number, grid in enumerate(grids(boards, beside), start=1):
        columns = "rl" + "r" * (len(grid.headings) - 2)
        lines = [r"\begin{table}", r"  \centering", rf"  \caption{{{_tex(grid.title)}. {_tex(' '.join(grid.notes))}}}"]
        lines += [rf"  \label{{tab:phrt-{number}}}", rf"  \begin{{tabular}}{{{columns}}}", r"    \toprule"]
        lines += [_tex_row(_tex(heading) for heading in grid.headings), r"    \midrule"]
        lines += [_tex_row(_tex_cell(cell) for cell in row) for row in grid.rows]
        lines += [r"    \bottomrule", r"  \end{tabular}", r"\end{table}"]
        parts.append("\n".join(lines))
    return "\n\n".join(parts) + "\n"


def terminal(boards: Sequence[Board], beside: Sequence[str] = NARROW) -> list[Table]:
    """Tables for rich to print; the intervals of the main metric stand below its values, others are left out."""
    from rich.table import Table
    from rich.text import Text

    made = []
    for grid in grids(boards, beside):
        notes = Text("\n".join(grid.notes), style="dim")
        table = Table(title=Text(grid.title), caption=notes, title_justify="left", caption_justify="left")
        for number, heading in enumerate(grid.headings):
            table.add_column(Text(heading), justify="left" if number == 1 else "right", no_wrap=number != 1)
        for row in grid.rows:
            table.add_row(*(_styled(cell, number < WITH_RANGES) for number, cell in enumerate(row)))
        made.append(table)
    return made


def text(boards: Sequence[Board], width: int = 120) -> str:
    """As `terminal`, without colours."""
    import io

    from rich.console import Console

    console = Console(file=io.StringIO(), width=width, color_system=None)
    for table in terminal(boards):
        console.print(table)
    return str(console.file.getvalue())  # type: ignore[attr-defined]


# A board as texts


def _grid(board: Board, name: str, beside: Sequence[str]) -> Grid:
    metrics = [m for m in beside if m != board.metric and any(_known(entry.value(m)) for entry in board.entries)]
    headings = ["#", "heuristic", metric_name(board.metric), "to the first"]
    headings += [HEADINGS.get(metric) or metric_name(metric) for metric in metrics]
    first = board.ranked[0].label if board.ranked else ""
    rows = []
    for entry in board.entries:
        row = [Cell("–" if entry.rank is None else str(entry.rank)), Cell(_name(entry))]
        row += [_cell(entry.main, board.metric, strong=entry.rank == 1), _behind(board, entry, first)]
        # What a failed one did up to there is no match for whole runs.
        row += [_cell(NOTHING if entry.state == "failed" else entry.value(metric), metric) for metric in metrics]
        rows.append(tuple(row))
    return Grid(name, tuple(headings), tuple(rows), tuple(_notes(board)))


def _notes(board: Board) -> list[str]:
    kind = ("" if board.metric in RUN_COLUMNS else "judged ") + ("frame" if board.frames == 1 else "frames")
    frames = f"{board.frames} {kind}" if board.frames else f"the {kind} of each, as none are of all"
    best = {"lower": "less is better", "higher": "more is better"}.get(board.better, "")
    notes = [
        f"{metric_name(board.metric)} over {frames}, {best}; [95 % intervals]; who shares a rank is not shown to differ."
    ]
    if board.at_cost:
        notes.append(f"{board.first[0].label} is first with {board.at_cost} of the next.")
    if any(entry.value("oracle_share").value > 1.0 for entry in board.ranked):
        notes.append(
            "The oracle traces whole items and has no values of earlier frames; who traces parts, or keeps values, can pass it."
        )
    if board.frames < FEWEST_FRAMES:
        notes.append(f"Fewer than {FEWEST_FRAMES} frames show no difference.")
    if board.clock != "wall":
        notes.append(f"Times are those of a clock of rays, {board.clock}.")
    notes += [f"{entry.label} failed: {entry.reason}." for entry in board.entries if entry.state == "failed"]
    return notes


def _name(entry: Entry) -> str:
    said = {"failed": " (failed)", "partial": " (not finished)"}.get(entry.state, "")
    return entry.label + said


def _behind(board: Board, entry: Entry, first: str) -> Cell:
    """How far the main metric is from the first's."""
    paired = entry.against.get(first)
    if paired is None:
        return Cell("")
    return _cell(paired.difference, board.metric, sign="+")


def _cell(value: Interval, metric: str, sign: str = "", strong: bool = False) -> Cell:
    if not _known(value):
        return Cell("–")
    form = FORMS.get(metric) or FORMS.get(metric.partition("_")[0], ".4g")
    shown = _written(value.value, form, sign) + (" %" if form == PERCENT else "")
    if not value.known:
        return Cell(shown, "", strong)
    return Cell(shown, f"[{_written(value.low, form, sign)}, {_written(value.high, form, sign)}]", strong)


def _written(value: float, form: str, sign: str) -> str:
    value, form = (100 * value, ".1f") if form == PERCENT else (value, form)
    shown = format(value, sign + form)
    # No "-0.0".
    return format(0.0, sign + form) if float(shown) == 0.0 else shown


def _known(value: Interval) -> bool:
    return math.isfinite(value.value)


# Markup


def _row(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _escaped(words: str) -> str:
    """For Markdown."""
    return _MARKDOWN.sub(r"\\\1", _CONTROL.sub(" ", words))


def _marked(cell: Cell) -> str:
    whole = f"{_escaped(cell.value)} {cell.range}".strip()
    return f"**{whole}**" if cell.strong and whole else whole


def _tex(words: str) -> str:
    return "".join(_LATEX.get(letter, letter) for letter in _CONTROL.sub(" ", words))


def _tex_row(cells: Iterable[str]) -> str:
    return f"    {' & '.join(cells)} \\\\"


def _tex_cell(cell: Cell) -> str:
    value = rf"\textbf{{{_tex(cell.value)}}}" if cell.strong else _tex(cell.value)
    return rf"{value} {{\scriptsize {_tex(cell.range)}}}" if cell.range else value


def _styled(cell: Cell, with_range: bool) -> Text:
    from rich.text import Text

    shown = Text(cell.value, style="bold" if cell.strong else "")
    return shown.append(f"\n{cell.range}", style="dim") if cell.range and with_range else shown
