"""The frame in which each contestant was worst, and what it left out there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from phrt.errors import OptionError
from phrt.recording.reasons import Items, frame_items, sentence
from phrt.recording.run import read_run
from phrt_plugins.bench.results import BenchRun, Cell
from phrt_plugins.report.pictures import thumbnail

MOST_REASONS = 3


@dataclass(frozen=True)
class Worst:
    """frame: its number; error: its main metric; median: of the contestant's judged frames; reasons: sentences about what was
    left out, the most harmful first; picture, reference: data: links, "" where no picture was kept."""

    label: str
    budget: str
    frame: int
    error: float
    median: float
    reasons: tuple[str, ...]
    picture: str
    reference: str


def worst_frame(run: BenchRun, cell: Cell, metric: str, better: str, truth: Any) -> Worst | None:
    """Of `cell`; truth: the oracle's items of its setup, a pyarrow table, perhaps empty. None where nothing was judged."""
    measured = run.measures(cell, ["frame", metric])
    if not measured.num_rows or metric not in measured.column_names:
        return None
    errors = np.asarray(measured.column(metric).to_numpy(), np.float64)
    if np.isnan(errors).all():
        return None
    row = int(np.nanargmin(errors) if better == "higher" else np.nanargmax(errors))
    frame, block = int(measured.column("frame")[row].as_py()), int(measured.column("block")[row].as_py())
    pictures = run.pictures(cell)
    references = run.pictures(run.references[cell.setup]) if cell.setup in run.references else {}
    return Worst(
        cell.label,
        cell.budget,
        frame,
        float(errors[row]),
        float(np.nanmedian(errors)),
        reasons(cell.block_folder(block), frame, truth),
        thumbnail(pictures[frame]) if frame in pictures else "",
        thumbnail(references[frame]) if frame in pictures and frame in references else "",
    )


def reasons(folder: Path, frame: int, truth: Any) -> tuple[str, ...]:
    """Why what was missing most in a frame of the run in `folder` was not traced."""
    try:
        recorded = read_run(folder)
        row, items = recorded.frame(frame), frame_items(recorded, frame)
    except OptionError as error:
        return (f"The decisions of this frame cannot be read: {error}",)
    harm = harm_of(items, frame, truth)
    worst = [int(item) for item in np.argsort(-harm, kind="stable")[:MOST_REASONS] if harm[item] > 0]
    return tuple(sentence(recorded, row, items, item) for item in worst)


def harm_of(items: Items, frame: int, truth: Any) -> np.ndarray:
    """(n,) what the pixels that were not traced are worth: by the oracle's benefit of the item, by their number where that is
    not known."""
    if not items:
        return np.zeros(0)
    missing = 1.0 - items["traced_pixels"] / np.maximum(items["pixel_count"], 1)
    missing[missing < 0.01] = 0.0
    benefit = benefits(frame, truth)
    if not benefit:
        return missing * items["pixel_count"]
    pairs = zip(items["object"].tolist(), items["effect"].tolist(), strict=True)
    return missing * np.array([benefit.get((path, effect.partition("@")[0]), 0.0) for path, effect in pairs])


def benefits(frame: int, truth: Any) -> dict[tuple[str, str], float]:
    """The oracle's benefit of every item of a frame, by object and effect, and of an object with "all" its effects; none is below
    0. An effect of one light (`group_by: object_effect_light`) is looked up as the whole effect."""
    if not truth.num_rows:
        return {}
    found: dict[tuple[str, str], float] = {}
    for row in truth.filter(np.asarray(truth.column("frame").to_numpy()) == frame).to_pylist():
        if math.isfinite(row["benefit"]):
            found[row["object"], row["effect"]] = max(row["benefit"], 0.0)
            found[row["object"], "all"] = found.get((row["object"], "all"), 0.0) + max(row["benefit"], 0.0)
    return found


def worst_frames(run: BenchRun, cells: Sequence[Cell], metric: str, better: str) -> list[Worst]:
    """Of every cell, the worst first."""
    names = dict.fromkeys(cell.setup for cell in cells)
    truth = {name: run.oracle_items(name, ["frame", "object", "effect", "benefit"]) for name in names}
    found = [
        worst for cell in cells if (worst := worst_frame(run, cell, metric, better, truth[cell.setup])) is not None
    ]
    return sorted(found, key=lambda worst: worst.error if better == "higher" else -worst.error)
