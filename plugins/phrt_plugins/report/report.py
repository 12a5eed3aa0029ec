"""`write_report`: a benchmark's folder into one HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from phrt_plugins.bench.results import BenchRun
from phrt_plugins.report import gather
from phrt_plugins.report.drawing import looks
from phrt_plugins.report.gather import Setup
from phrt_plugins.report.html import page_of, write_page
from phrt_plugins.report.maps import magma_stops
from phrt_plugins.report.pictures import Album, frames_of
from phrt_plugins.report.ranking import Ranking, rank_run, shares_of
from phrt_plugins.report.worst import worst_frames

PARTS: tuple[tuple[str, str, str, str], ...] = (
    ("errors", "Error against cost", "errors", "All budgets of a setup together."),
    ("oracle", "Share of the oracle", "oracle", ""),
    ("times", "Frame times", "times", "The first repeat of every contestant."),
    ("lines", "What was traced when", "lines", ""),
    ("costs", "Predicted and actual cost", "costs", ""),
)
"""Sections of figures: id, title, the attribute of Setup, a sentence."""


class Progress(Protocol):
    """What a progress bar does here."""

    def step(self, text: str) -> None: ...

    def advance(self) -> None: ...


@dataclass(frozen=True)
class Written:
    """What was written. bytes: the file's size; figures, pictures: how many it holds; verdict: the sentence on its top; warnings:
    what it says before that."""

    path: Path
    bytes: int
    figures: int
    pictures: int
    verdict: str
    warnings: tuple[str, ...]


class Silent:
    """No progress bar."""

    def step(self, text: str) -> None:
        pass

    def advance(self) -> None:
        pass


def steps_of(run: BenchRun) -> int:
    """How many steps `write_report` takes, or a few more."""
    setups = gather.setups_of(run)
    frames = sum(len(run.pictures(run.references[setup.id])) for setup in setups if setup.id in run.references)
    return 2 + sum(1 + len(setup.cells) for setup in setups) + frames


def write_report(run: BenchRun, path: Path, progress: Progress | None = None) -> Written:
    """Write the report of `run` to `path`. Raises OptionError: a table cannot be read, a package is missing, or the file cannot be
    written."""
    bar = progress or Silent()
    bar.step("ranking")
    ranking = rank_run(run)
    bar.advance()
    setups, shares = gather.setups_of(run), shares_of(run)
    look = looks(dict.fromkeys(cell.label for cell in run.cells))
    for setup in setups:
        entries = ranking.entries(setup.id)
        setup.boards = ranking.boards(setup.id, setup.key, look, setup.budgets)
        bar.step(f"drawing {setup.name}")
        gather.summary_figures(setup, entries, ranking.main, ranking.better, look)
        gather.share_figures(setup, [row for row in shares if row["contest"] == setup.id], look)
        gather.frame_figures(run, setup, look, bar.advance)
        bar.step("worst frames")
        setup.worst = worst_frames(run, setup.cells, ranking.main, ranking.better)
        bar.advance()
    note = add_pictures(run, setups, bar)
    bar.step("writing")
    page = page_of(values_of(run, ranking, setups, note))
    write_page(path, page)
    bar.advance()
    figures = sum(len(getattr(setup, name)) for setup in setups for _, _, name, _ in PARTS)
    pictures = sum(len(frame.shots) for setup in setups for frame in setup.frames)
    return Written(path, path.stat().st_size, figures, pictures, ranking.verdict, tuple(gather.warnings_of(run)))


def add_pictures(run: BenchRun, setups: Sequence[Setup], bar: Progress) -> str:
    """Fill the setups' frames; returns what is to be said of those that were left out."""
    album = Album.of({setup.id: frames_of(run, setup.id, setup.cells) for setup in setups})
    bar.step("pictures and FLIP maps")
    album.make(bar.advance)
    for setup in setups:
        setup.frames = album.made[setup.id]
    return album.note


def values_of(run: BenchRun, ranking: Ranking, setups: Sequence[Setup], pictures_note: str) -> dict[str, Any]:
    """What the template names."""
    import phrt

    parts = [
        {"id": id, "title": title, "text": text, "setups": found}
        for id, title, name, text in PARTS
        if (found := [(setup, plots) for setup in setups if (plots := getattr(setup, name))])
    ]
    failures = [cell for cell in run.cells if cell.failure is not None]
    has_pictures, has_worst = (any(getattr(setup, name) for setup in setups) for name in ("frames", "worst"))
    optional = (
        ("pictures", "Pictures", has_pictures),
        ("worst", "Worst frames", has_worst),
        ("failed", "What failed", failures),
    )
    contents = [("boards", "Leaderboards"), *((part["id"], part["title"]) for part in parts)]
    contents += [(id, title) for id, title, there in optional if there] + [("about", "How it was made")]
    return {
        "title": run.title,
        "verdict": ranking.verdict,
        "main_metric": ranking.main.upper(),
        "reference": run.reference_name,
        "better": ranking.better,
        "warnings": gather.warnings_of(run),
        "facts": gather.facts_of(run),
        "contents": contents,
        "setups": setups,
        "parts": parts,
        "has_pictures": has_pictures,
        "pictures_note": pictures_note,
        "bar": magma_stops() if has_pictures else "",
        "has_worst": has_worst,
        "failures": failures,
        "machine": gather.said_of_machine(run),
        "versions": gather.said_of_versions(run),
        "config": gather.said_of_config(run),
        "contestants": gather.said_of_contestants(run.cells),
        "cells": len(run.cells),
        "version": phrt.__version__,
    }
