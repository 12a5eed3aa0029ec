"""Leaderboards are tables that a terminal, Markdown and LaTeX can show, whatever contestants are called."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from typing import Any

import pytest

from phrt.errors import OptionError
from phrt_plugins.bench.leaderboard import Board, Entry, Paired
from phrt_plugins.bench.statistics import Interval
from phrt_plugins.bench.tables import Grid, export, grids, latex, markdown, terminal, text

NASTY = r"a|b_*c*`$1%&#{}~^\x<y>[z](w)"


def value(number: float, spread: float = 0.1) -> Interval:
    return Interval(number, number * (1 - spread), number * (1 + spread), 60)


def entry(label: str, rank: int | None, flip: float, behind: float | None = None, **more: Any) -> Entry:
    """A contestant; behind: by how much the first is better."""
    values = {
        "flip": value(flip),
        "oracle_share": value(0.8),
        "frame_ms_p50": value(46.04),
        "frame_ms_p99": Interval(52.0, math.nan, math.nan, 60),
        "late_share": value(0.0123),
        "rays": value(12345.0),
    }
    against = {} if behind is None else {"gain": Paired(Interval(behind, behind - 0.001, behind + 0.001, 60), "worse")}
    more = {"state": "ok"} | more
    return Entry(label, label, rank=rank, main=value(flip), against=against, values=values, **more)


def board(*entries: Entry, **more: Any) -> Board:
    about: dict[str, Any] = {
        "contest": "c", "setups": ("c",), "scene": "court", "size": "640x360", "tracer": "embree", "gbuffer": "raycast",
        "clock": "wall", "budget": "50ms", "budget_kind": "frame_ms", "metric": "flip", "unit": "", "better": "lower",
        "frames": 60,
    }  # fmt: skip
    return Board(**(about | more), entries=entries)


BOARD = board(
    entry("gain", 1, 0.04),
    entry(NASTY, 2, 0.06, 0.02),
    entry("broken", None, 0.05, state="failed", reason="heuristic 'broken' failed:\nindex_1 & 100 %"),
    entry("slow", 3, 0.07, 0.03, state="partial"),
)


def cells_of(line: str) -> list[str]:
    """Of a row of a Markdown table."""
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]


def test_a_grid_says_it_all() -> None:
    grid: Grid = grids([BOARD], ["oracle_share", "frame_ms_p50", "frame_ms_p99", "late_share", "rays", "fps"])[0]
    assert grid.title == "court at 50ms"
    headings = ("#", "heuristic", "FLIP", "to the first", "of the oracle", "p50 ms", "p99 ms", "late", "rays")
    assert grid.headings == headings, "nobody has fps"
    first, second, failed, slow = grid.rows
    assert [f"{cell.value} {cell.range}".strip() for cell in first] == [
        "1", "gain", "0.0400 [0.0360, 0.0440]", "", "80.0 % [72.0, 88.0]", "46.0 [41.4, 50.6]", "52.0", "1.2 % [1.1, 1.4]",
        "12345 [11110, 13580]",
    ]  # fmt: skip
    assert [cell.strong for cell in first[:4]] == [False, False, True, False]
    assert second[3].value + second[3].range == "+0.0200[+0.0190, +0.0210]"
    assert [cell.value for cell in failed] == ["–", "broken (failed)", "0.0500", "", "–", "–", "–", "–", "–"]
    assert slow[1].value == "slow (not finished)"
    assert grid.notes[0] == (
        "FLIP over 60 judged frames, less is better; [95 % intervals]; who shares a rank is not shown to differ."
    )
    assert grid.notes[-1] == "broken failed: heuristic 'broken' failed:\nindex_1 & 100 %."


def test_notes_say_what_times_are_and_what_being_first_takes() -> None:
    notes = grids([board(entry("gain", 1, 0.04), clock="100 ns a ray", at_cost="45.0 ms a frame against 40.0 ms")])[
        0
    ].notes
    assert "gain is first with 45.0 ms a frame against 40.0 ms of the next." in notes
    assert "Times are those of a clock of rays, 100 ns a ray." in notes


def test_the_oracle_may_be_passed() -> None:
    ahead = entry("gain", 1, 0.04)
    ahead = replace(ahead, values=ahead.values | {"oracle_share": value(1.4), "late_share": value(-0.0001, 0.0)})
    grid = grids([board(ahead, frames=3)])[0]
    assert (
        "The oracle traces whole items and has no values of earlier frames; who traces parts, or keeps values, can pass it."
        in grid.notes
    )
    assert "Fewer than 6 frames show no difference." in grid.notes
    assert "-0.0" not in [cell.value for cell in grid.rows[0]]
    assert "0.0 %" in [cell.value for cell in grid.rows[0]]


def test_boards_are_told_apart_by_what_varies() -> None:
    rows = (entry("gain", 1, 0.04),)
    boards = [board(*rows), board(*rows, size="64x36"), board(*rows, size="64x36", budget="none")]
    assert [grid.title for grid in grids(boards)] == [
        "court 640x360 at 50ms",
        "court 64x36 at 50ms",
        "court 64x36 without a budget",
    ]


def test_markdown_has_as_many_cells_in_every_row() -> None:
    lines = markdown([BOARD, BOARD]).split("\n")
    table = [cells_of(line) for line in lines if line.startswith("|")]
    assert len(table) == 2 * (2 + 4)
    assert {len(row) for row in table} == {9}
    assert set(table[1]) == {":--", "--:"}
    assert table[2][:3] == ["1", "gain", "**0.0400 [0.0360, 0.0440]**"]
    escaped = table[3][1]
    assert re.sub(r"\\(.)", r"\1", escaped) == NASTY
    assert not re.search(r"(?<!\\)[|*_`<>\[\]~#]", re.sub(r"\\\\", "", escaped))
    assert not any("\n" in cell for row in table for cell in row)
    assert any("index\\_1 & 100 %" in line for line in lines)


def test_latex_can_be_compiled() -> None:
    source = latex([BOARD])
    assert source.startswith("% \\usepackage{booktabs}\n")
    body = source.partition("\n")[2]
    assert not re.search(r"(?<!\\)[%$#~^]", body), "nothing that TeX reads as more than a letter"
    # What is left after escaped characters are gone must be balanced.
    plain = re.sub(r"\\[{}%&_#$\\]", "", body)
    depth = 0
    for letter in plain:
        depth += {"{": 1, "}": -1}.get(letter, 0)
        assert depth >= 0
    assert depth == 0
    for name in ("table", "tabular"):
        assert body.count(rf"\begin{{{name}}}") == body.count(rf"\end{{{name}}}") == 1
    rows = [line for line in body.split("\n") if line.endswith(r"\\")]
    assert {len(re.findall(r"(?<!\\)&", row)) for row in rows} == {8}
    assert len(rows) == 5
    columns = re.search(r"\\begin\{tabular\}\{(\w+)\}", body)
    assert columns
    assert columns[1] == "rlrrrrrrr"
    assert "_" not in re.sub(r"\\_", "", body)
    assert r"\textbackslash{}x\textless{}y\textgreater{}" in body
    assert r"\textbf{0.0400} {\scriptsize [0.0360, 0.0440]}" in body


def test_the_terminal_gets_a_table_that_fits() -> None:
    shown = text([BOARD])
    lines = shown.splitlines()
    assert max(len(line) for line in lines) <= 120
    assert "court at 50ms" in lines[0]
    assert any("[0.0360, 0.0440]" in line for line in lines)
    assert any("+0.0200" in line for line in lines)
    assert "80.0 %" in shown
    assert len(terminal([BOARD, BOARD])) == 2


def test_labels_are_no_markup_in_the_terminal() -> None:
    assert "[bold]x[/bold]" in text([board(entry("[bold]x[/bold]", 1, 0.04))])


def test_tables_are_exported_by_name() -> None:
    assert export([BOARD], "markdown") == markdown([BOARD])
    assert export([BOARD], "latex") == latex([BOARD])
    assert export([BOARD], "text") == text([BOARD])
    with pytest.raises(OptionError, match=r"tables are 'latx'; allowed: markdown, latex, text. Did you mean 'latex'\?"):
        export([BOARD], "latx")
