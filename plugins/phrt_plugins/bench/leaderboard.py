"""Leaderboards of a comparison: who is shown to be better than whom, and by how much.

    run = BenchRun.read("runs/standard")
    boards = leaderboard(read_summary(run.folder), run)
    print(verdict(boards))

There is a board per budget and contest, the setups whose contestants can be compared. It is ordered by the main metric over
the judged frames that all who are ranked have. Whoever is not shown to be worse than the first of a rank, by the paired
difference on the same frames, shares that rank; the next rank counts them (1, 1, 3). Who failed is listed without a rank.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from phrt.errors import OptionError
from phrt.interfaces.metric import Better
from phrt_plugins.bench.plan import ALL_TRACE_NAME
from phrt_plugins.bench.results import BenchRun, Cell
from phrt_plugins.bench.series import RUN_COLUMNS, Series, common, frame_series, frames_of, judged_series, segments_of
from phrt_plugins.bench.statistics import (
    FEWEST_FRAMES,
    NOTHING,
    Interval,
    Statistic,
    Verdict,
    interval,
    judged,
    paired_interval,
)

MAIN_METRIC = "flip"
INSTEAD = ("display_error", "ssim", "psnr", "relmse", "frame_ms_p50")
"""What boards are ordered by where the main metric was not measured."""


@dataclass(frozen=True)
class Paired:
    """How one contestant compares with another on the same frames of the same repeats. difference: its value less the other's;
    verdict: what that says of it."""

    difference: Interval
    verdict: Verdict


@dataclass(frozen=True)
class Entry:
    """A contestant on a board.

    rank       : 1 is first; None where it failed, or has no frames
    against    : paired with the other contestants, by label; empty without a rank
    values     : its summary, by metric column
    main       : the main metric over the frames that the board is ordered by
    reason     : why it failed; empty where it did not
    """

    label: str
    heuristic: str
    state: str
    rank: int | None
    main: Interval
    against: Mapping[str, Paired]
    values: Mapping[str, Interval]
    reason: str = ""

    def value(self, metric: str) -> Interval:
        return self.values.get(metric, NOTHING)


@dataclass(frozen=True)
class Board:
    """The contestants of a contest under one budget, best first, those without a rank last.

    setups : whose contestants they are; a label is one contestant
    frames : how many judged frames all who are ranked have
    at_cost: what the one who is first alone is shown to pay for it in time, against the next; empty where nothing is shown
    reference: what pictures were compared with
    """

    contest: str
    setups: tuple[str, ...]
    scene: str
    size: str
    tracer: str
    gbuffer: str
    clock: str
    budget: str
    budget_kind: str
    metric: str
    unit: str
    better: Better
    entries: tuple[Entry, ...]
    frames: int
    at_cost: str = ""
    reference: str = ALL_TRACE_NAME

    @property
    def ranked(self) -> tuple[Entry, ...]:
        return tuple(entry for entry in self.entries if entry.rank is not None)

    @property
    def first(self) -> tuple[Entry, ...]:
        """Everybody of rank 1."""
        return tuple(entry for entry in self.entries if entry.rank == 1)

    @property
    def unfinished(self) -> tuple[Entry, ...]:
        """Who failed or is not done."""
        return tuple(entry for entry in self.entries if entry.state != "ok")


@dataclass(frozen=True)
class _Contestant:
    """Before it has a place. rows: of the summary, by metric; cells: its repeats; series: the main metric, frame by frame."""

    label: str
    rows: Mapping[str, Mapping[str, Any]]
    cells: tuple[Cell, ...]
    series: Series

    @property
    def about(self) -> Mapping[str, Any]:
        return next(iter(self.rows.values()))

    @property
    def placed(self) -> bool:
        return self.about["state"] != "failed" and not np.isnan(self.series.values).all()


def paired(run: BenchRun, a: Sequence[Cell], b: Sequence[Cell], metric: str, better: Better) -> Paired:
    """Contestant `a` against `b`, each given by its repeats, on the frames that both have. metric: a column of measures, by its
    mean, or a column of a run that is a statistic of its frames (`series.RUN_COLUMNS`)."""
    return _compared(_series(run, a, metric), _series(run, b, metric), better, _statistic(metric))


def leaderboard(summary: Iterable[Mapping[str, Any]], run: BenchRun, metric: str = MAIN_METRIC) -> list[Board]:
    """The boards of `run`, in the order of its cells. summary: its rows (`read_summary`). metric: by what boards are ordered, a
    column of pictures or one of RUN_COLUMNS; where FLIP was not measured, the first of INSTEAD that was takes its place.

    Raises OptionError where there is none to order by.
    """
    rows = list(summary)
    measured = {row["metric"]: row for row in rows}
    wanted = (metric, *INSTEAD) if metric == MAIN_METRIC else (metric,)
    main = next((measured[name] for name in wanted if name in measured), None)
    if main is None:
        raise OptionError(f"there is nothing to rank by: '{metric}' was not measured in '{run.folder}'")
    contests: dict[tuple[str, str], dict[str, dict[str, Mapping[str, Any]]]] = {}
    for row in rows:
        contest = contests.setdefault((row["contest"], row["budget"]), {})
        contest.setdefault(row["label"], {})[row["metric"]] = row
    groups = run.groups()
    return [_board(run, groups, labels, main) for labels in contests.values()]


def verdict(boards: Sequence[Board]) -> str:
    """One sentence on all boards: who is first where and by how much, what is not shown, and what is not done."""
    held = [(board, name) for board, name in zip(boards, board_names(boards), strict=True) if len(board.ranked) > 1]
    if not held:
        return "Nothing can be compared: no two contestants have judged frames."
    enough = [(board, name) for board, name in held if board.frames >= FEWEST_FRAMES]
    if not enough:
        return f"Nothing is shown: that takes {FEWEST_FRAMES} judged frames that all contestants have."
    by_first: dict[tuple[str, ...], list[tuple[Board, str]]] = {}
    for board, name in enough:
        by_first.setdefault(tuple(sorted(entry.label for entry in board.first)), []).append((board, name))
    ordered = sorted(by_first.items(), key=lambda item: (len(item[0]) > 1, -len(item[1])))
    parts = [(_first if len(labels) == 1 else _shared)(labels, where, len(held)) for labels, where in ordered]
    if len(enough) < len(held):
        parts.append(
            f"in {_count(len(held) - len(enough), len(held))} there are too few judged frames to show anything"
        )
    return "; ".join(filter(None, (*parts, _unfinished(boards)))) + "." + _judged_by(boards)


def _judged_by(boards: Sequence[Board]) -> str:
    """What the reference was, where it was not all-trace."""
    others = dict.fromkeys(board.reference for board in boards if board.reference != ALL_TRACE_NAME)
    return f" Pictures are judged by {' and '.join(others)}." if others else ""


def board_names(boards: Sequence[Board]) -> list[str]:
    """What boards are of, as short as tells them apart: "court at 50ms", "court 640x360 open3d at 50ms"."""
    varied = [n for n in ("size", "tracer", "gbuffer", "clock") if len({getattr(board, n) for board in boards}) > 1]
    names = []
    for board in boards:
        course = " ".join((board.scene, *(getattr(board, name) for name in varied)))
        names.append(f"{course} without a budget" if board.budget == "none" else f"{course} at {board.budget}")
    return names


def metric_name(metric: str) -> str:
    """As a sentence or a heading calls it: "FLIP", "display error"."""
    name, _, rest = metric.partition("_")
    named = {"flip": "FLIP", "ssim": "SSIM", "psnr": "PSNR", "relmse": "relMSE"}.get(name, name)
    return " ".join(filter(None, (named, rest.replace("_", " "))))


# A board


def _series(run: BenchRun, cells: Sequence[Cell], metric: str) -> Series:
    """What `metric` is of a contestant, frame by frame."""
    if metric in RUN_COLUMNS:
        return frame_series(frames_of(run, cells), metric)
    return judged_series(run, cells, [metric])[metric]


def _statistic(metric: str) -> Statistic:
    return RUN_COLUMNS[metric].statistic if metric in RUN_COLUMNS else "mean"


def _board(
    run: BenchRun,
    groups: Mapping[tuple[str, str, str], tuple[Cell, ...]],
    labels: Mapping[str, Mapping[str, Mapping[str, Any]]],
    main: Mapping[str, Any],
) -> Board:
    """The board of contestants with their rows of the summary."""
    everybody = []
    for label, rows in labels.items():
        about = next(iter(rows.values()))
        cells = groups.get((about["setup"], about["budget"], label), ())
        everybody.append(_Contestant(label, rows, cells, _series(run, cells, main["metric"])))
    statistic = _statistic(main["metric"])
    placed, figures, frames = _ordered([each for each in everybody if each.placed], main["better"], statistic)
    against = _all_pairs(placed, main["better"], statistic)
    ranks = _ranks([each.label for each in placed], against)
    entries = [_entry(each, ranks[each.label], figures[each.label], against[each.label]) for each in placed]
    entries += [_entry(each, None, NOTHING, {}) for each in everybody if not each.placed]
    about = everybody[0].about
    kept = ("contest", "scene", "size", "tracer", "gbuffer", "clock", "budget", "budget_kind")
    return Board(
        **{name: about[name] for name in kept},
        setups=tuple(dict.fromkeys(each.about["setup"] for each in everybody)),
        metric=main["metric"],
        unit=main["unit"],
        better=main["better"],
        entries=tuple(entries),
        frames=frames,
        at_cost=_at_cost(run, placed[0], placed[1]) if len(placed) > 1 and list(ranks.values()).count(1) == 1 else "",
        reference=run.reference_name,
    )


def _ordered(
    contestants: Sequence[_Contestant], better: Better, statistic: Statistic
) -> tuple[list[_Contestant], dict[str, Interval], int]:
    """Best first, and the main metric of each, by label, over the frames that all have, and how many those are. Where there is no
    such frame, all frames of each count."""
    if not contestants:
        return [], {}, 0
    frames = reduce(np.intersect1d, (each.series.frames for each in contestants))
    figures = {}
    for each in contestants:
        rows = np.isin(each.series.frames, frames) if len(frames) else np.ones(len(each.series), bool)
        figures[each.label] = interval(each.series.values[rows], segments_of(each.series.blocks[rows]), statistic)
    sign = -1.0 if better == "higher" else 1.0
    return sorted(contestants, key=lambda each: sign * figures[each.label].value), figures, len(frames)


def _all_pairs(
    contestants: Sequence[_Contestant], better: Better, statistic: Statistic
) -> dict[str, dict[str, Paired]]:
    """Everybody against everybody else, by label."""
    return {
        a.label: {b.label: _compared(a.series, b.series, better, statistic) for b in contestants if b is not a}
        for a in contestants
    }


def _compared(a: Series, b: Series, better: Better, statistic: Statistic) -> Paired:
    segments, mine, other = common(a, b)
    difference = paired_interval(mine, other, segments, statistic)
    return Paired(difference, judged(difference, better))


def _ranks(labels: Sequence[str], against: Mapping[str, Mapping[str, Paired]]) -> dict[str, int]:
    """By label, best first. Who is not shown to be worse than the first of a rank shares it."""
    ranks: dict[str, int] = {}
    head = ""
    for place, label in enumerate(labels, start=1):
        if not head or against[label][head].verdict == "worse":
            head = label
            ranks[label] = place
        else:
            ranks[label] = ranks[head]
    return ranks


def _entry(contestant: _Contestant, rank: int | None, main: Interval, against: Mapping[str, Paired]) -> Entry:
    values = {
        metric: Interval(float(row["value"]), float(row["low"]), float(row["high"]), int(row["frames"]))
        for metric, row in contestant.rows.items()
    }
    failures = [cell.failure for cell in contestant.cells if cell.failure is not None]
    about = contestant.about
    reason = failures[0].reason if failures else ""
    return Entry(contestant.label, about["heuristic"], about["state"], rank, main, against, values, reason)


def _at_cost(run: BenchRun, first: _Contestant, following: _Contestant) -> str:
    """Is the first shown to be later, or slower where the budget is none of time, than the one that follows it? Times of a clock of
    rays are none."""
    if first.about["clock"] != "wall":
        return ""
    timed = first.about["budget_kind"] == "frame_ms"
    metric = "late_share" if timed else "frame_ms_p50"
    if metric not in first.rows or metric not in following.rows:
        return ""
    if paired(run, first.cells, following.cells, metric, "lower").verdict != "worse":
        return ""
    ours, theirs = (float(each.rows[metric]["value"]) for each in (first, following))
    if timed:
        return f"{100 * ours:.1f} % of its frames late against {100 * theirs:.1f} %"
    return f"{ours:.1f} ms a frame against {theirs:.1f} ms"


# The verdict


def _first(labels: Sequence[str], boards: Sequence[tuple[Board, str]], held: int) -> str:
    """ "gain has the lowest FLIP in 2 of 3 comparisons, by 0.01 [0.008, 0.012] over random (court at 50ms) to ..." """
    board, name = boards[0]
    best = "highest" if board.better == "higher" else "lowest"
    text = f"{labels[0]} has the {best} {metric_name(board.metric)}"
    leads = sorted(((*_lead(board), name) for board, name in boards), key=lambda lead: lead[0])
    if len(boards) == 1:
        text += f" in {name}, by {leads[0][1]}"
    else:
        text += f" in {_count(len(boards), held)}"
        text += f", by {leads[0][1]} ({leads[0][2]}) to {leads[-1][1]} ({leads[-1][2]})"
    costs = [f"{board.at_cost} ({name})" for board, name in boards if board.at_cost]
    return text + (f", with {' and '.join(costs)}" if costs else "")


def _lead(board: Board) -> tuple[float, str]:
    """By how much the first is ahead of the next: to sort by, and as text."""
    first, following = board.ranked[:2]
    difference = first.against[following.label].difference
    low, high = sorted((abs(difference.low), abs(difference.high)))
    lead = abs(difference.value)
    return lead, f"{_number(lead)} [{_number(low)}, {_number(high)}] over {following.label}"


def _shared(labels: Sequence[str], boards: Sequence[tuple[Board, str]], held: int) -> str:
    board, name = boards[0]
    where = name if len(boards) == 1 else _count(len(boards), held)
    best = "highest" if board.better == "higher" else "lowest"
    named = metric_name(board.metric)
    return f"{_listed(labels)} share the first place in {where}, none shown to differ from the {best} {named}"


def _unfinished(boards: Sequence[Board]) -> str:
    everybody = [entry for board in boards for entry in board.entries]
    failed = sum(entry.state == "failed" for entry in everybody)
    partial = sum(entry.state == "partial" for entry in everybody)
    parts = [f"{failed} failed"] * bool(failed) + [f"{partial} not finished"] * bool(partial)
    return f"of {len(everybody)} entries {' and '.join(parts)}" if parts else ""


def _count(some: int, of: int) -> str:
    if some < of:
        return f"{some} of {of} comparisons"
    return "both comparisons" if of == 2 else f"all {of} comparisons"


def _listed(names: Sequence[str]) -> str:
    if len(names) > 3:
        names = (*names[:2], f"{len(names) - 2} others")
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _number(value: float) -> str:
    """Two or three digits that count."""
    if not math.isfinite(value) or value == 0.0:
        return f"{value:g}"
    return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value))) - (abs(value) < 1))}f}"
