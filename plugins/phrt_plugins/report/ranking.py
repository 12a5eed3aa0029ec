"""Who is ahead: the comparison's summary, leaderboards and verdict, as the page and the tables for texts show them."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from phrt.errors import OptionError
from phrt_plugins.bench import leaderboard as ranks
from phrt_plugins.bench.results import BenchRun, read_columns
from phrt_plugins.bench.shares import frame_rows
from phrt_plugins.bench.summary import all_shares, read_summary, summary_rows
from phrt_plugins.report.boards import Board, Placed, board
from phrt_plugins.report.drawing import Look
from phrt_plugins.report.model import Entry, entries_of


@dataclass(frozen=True)
class Ranking:
    """main: the metric that decides; better: "lower" or "higher"; verdict: one sentence; all: entries by contest; found: the
    leaderboards."""

    main: str
    better: str
    verdict: str
    all: Mapping[str, Sequence[Entry]]
    found: Sequence[ranks.Board]

    def entries(self, contest: str) -> list[Entry]:
        """Of the setups that are compared with each other."""
        return list(self.all.get(contest, ()))

    def boards(self, contest: str, key: str, looks: Mapping[str, Look], budgets: Sequence[str]) -> list[Board]:
        """The contest's leaderboards, in the order of `budgets`. key: for ids and names of files."""
        known = {(e.setup, e.budget, e.label): e for e in self.entries(contest)}
        mine = sorted((b for b in self.found if b.contest == contest), key=lambda b: budgets.index(b.budget))
        made = []
        for number, each in enumerate(mine):
            places = [place for entry in each.entries if (place := placed(each, entry, known)) is not None]
            title = "No budget" if each.budget_kind == "none" else f"Budget {each.budget}"
            title += f" · {each.frames} judged frames"
            made.append(board(f"board-{number + 1}-{key}", title, self.main, places, looks))
        return made


def placed(of: ranks.Board, entry: ranks.Entry, known: Mapping[tuple[str, str, str], Entry]) -> Placed | None:
    """A contestant of a leaderboard, and in words how it compares with the first."""
    mine = next((known[key] for setup in of.setups if (key := (setup, of.budget, entry.label)) in known), None)
    return None if mine is None else Placed(mine, entry.rank, compared(of, entry))


def compared(of: ranks.Board, entry: ranks.Entry) -> str:
    """How a contestant compares with the first of the board; nothing for the first, and for who has no rank."""
    if entry.rank is None or not of.ranked or of.ranked[0].label == entry.label:
        return ""
    pair = entry.against.get(of.ranked[0].label)
    if pair is None or not pair.difference.known:
        return ""
    said = f"{pair.difference.value:+.4f} [{pair.difference.low:+.4f}, {pair.difference.high:+.4f}]"
    return f"{said}\n{pair.verdict}" if pair.verdict == "no difference shown" else said


def rank_run(run: BenchRun) -> Ranking:
    """The ranking of what is there."""
    rows = summary_of(run)
    try:
        found = ranks.leaderboard(rows, run)
    except OptionError:
        # An unfinished run may have no measure yet, and its page says so.
        found = []
    entries: dict[str, list[Entry]] = {}
    for entry in entries_of(rows):
        entries.setdefault(run.contest(entry.setup), []).append(entry)
    main, better = (found[0].metric, found[0].better) if found else (ranks.MAIN_METRIC, "lower")
    return Ranking(main, better, ranks.verdict(found), entries, found)


def summary_of(run: BenchRun) -> list[dict[str, Any]]:
    """The rows of the summary: those that were written, where nothing has changed since, else of what is there now."""
    return read_summary(run.folder) if is_of_now(run, "summary.parquet") else list(summary_rows(run))


def shares_of(run: BenchRun) -> list[dict[str, Any]]:
    """The shares of what was possible, frame by frame: the rows of shares.parquet, or what they would be now."""
    if is_of_now(run, "shares.parquet"):
        return list(read_columns(run.folder / "shares.parquet").to_pylist())
    return list(frame_rows(run, all_shares(run)))


def is_of_now(run: BenchRun, name: str) -> bool:
    """Was `name` of the folder written at the end of the run, and has nothing changed since?"""
    written = run.folder / name
    newest = max((os.path.getmtime(cell.folder) for cell in run.cells if cell.folder.exists()), default=0.0)
    return run.state == "finished" and written.exists() and written.stat().st_mtime >= newest


def tables_of(run: BenchRun, form: str) -> str:
    """The leaderboards as "markdown" or "latex". Raises OptionError where nothing has been measured yet."""
    from phrt_plugins.bench.tables import export

    return export(ranks.leaderboard(summary_of(run), run), form)
