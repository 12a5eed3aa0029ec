"""A worker: does one task at a time, in whatever process it is called, and says what became of it.

It keeps the renderer of the setup it had last, the metrics, and nothing else. What goes wrong with a cell ends in the answer.
"""

from __future__ import annotations

import math
import os
import time
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from phrt.errors import InputError, PhrtWarning, PluginError
from phrt.faults import PluginFailure
from phrt.interfaces.metric import Metric
from phrt.registry.manager import describe
from phrt.renderer import Renderer
from phrt_plugins.bench.blocks import FaultError, Judges, Spent, run_block, write_measures, write_pictures
from phrt_plugins.bench.pictures import ReferencePicture, floor_shots
from phrt_plugins.bench.plan import Setup, Task
from phrt_plugins.bench.plugin_code import Registrar, check_codes
from phrt_plugins.bench.references import RUN_FILES, References
from phrt_plugins.bench.results import read_columns
from phrt_plugins.bench.scenes import new_clock, open_renderer
from phrt_plugins.bench.store import CELL_FILE, Store, read_json, whole_folder
from phrt_plugins.metrics.measure import make_metrics, measure_shots


@dataclass(frozen=True)
class Work:
    """What all tasks of a benchmark have in common; it can be sent to another process.

    root, cache: folders; metrics: names, None for all; plugins: modules and files to register; threads: where a setup does not say;
    token: of this run, as long as the folder belongs to it; strict: a metric that fails fails the cell
    """

    root: str
    cache: str
    metrics: tuple[str, ...] | None = None
    plugins: tuple[str, ...] = ()
    threads: int | None = None
    token: str = ""
    strict: bool = False


@dataclass(frozen=True)
class Failure:
    """cell: its id; None for all cells of the setup."""

    cell: str | None
    kind: str
    reason: str


@dataclass
class Done:
    """What became of a task. blocks: of cells, that were rendered now; seconds: by what they were spent on, `total` among them."""

    blocks: int = 0
    failures: list[Failure] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)
    warned: list[str] = field(default_factory=list)


@dataclass
class _Kept:
    """What this process keeps between tasks."""

    key: tuple[Any, ...] | None = None
    renderer: Renderer | None = None
    metrics: dict[tuple[str, ...] | None, list[Metric]] = field(default_factory=dict)
    registrar: Registrar = field(default_factory=Registrar)


_kept = _Kept()


def do(work: Work, task: Task) -> Done:
    """Do `task`. Never raises but for what ends the process."""
    began = time.perf_counter()
    done, spent = Done(), Spent()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", PhrtWarning)
        try:
            _register(work)
            check_codes(task.setup.plugins)
            {"reference": _reference, "cells": _cells, "oracle": _oracle}[task.stage](work, task, done, spent)
        except Exception as error:
            done.failures.append(Failure(None, kind_of(error, task.stage), reason_of(error)))
            release()
    done.warned = list(dict.fromkeys(str(warning.message) for warning in told))
    done.seconds = spent.seconds | {"total": time.perf_counter() - began}
    return done


def release() -> None:
    """Close the renderer that is kept."""
    renderer, _kept.renderer, _kept.key = _kept.renderer, None, None
    if renderer is not None:
        renderer.close()


def _register(work: Work) -> None:
    """The plugins of the benchmark are there in this process, too, as they are now."""
    if _kept.registrar.register(work.plugins):
        # What is kept was made from what was there before.
        release()
        _kept.metrics.clear()


def _metrics(work: Work) -> list[Metric]:
    if work.metrics not in _kept.metrics:
        _kept.metrics[work.metrics] = make_metrics(work.metrics, strict=work.strict)
    return _kept.metrics[work.metrics]


def renderer_of(setup: Setup, work: Work, spent: Spent, *, base: bool = False) -> Renderer:
    """The renderer of `setup`, kept from the task before or made; the one of another setup is closed first."""
    same = setup.effects == setup.base_effects
    key = (setup.id, setup.content, base and not same, work.threads, os.getpid())
    if _kept.key != key or _kept.renderer is None:
        release()
        with spent.on("load"):
            _kept.renderer = open_renderer(setup, base=base, threads=work.threads)
        _kept.key = key
    return _kept.renderer


def _references(work: Work, task: Task, spent: Spent) -> dict[int, ReferencePicture]:
    """Of the task's block: read, or rendered where they are not there."""

    def open_base() -> Renderer:
        return renderer_of(task.setup, work, spent, base=True)

    with spent.on("reference"):
        return References(Path(work.cache)).make(task.setup, task.block, open_base)


# The three stages


def _reference(work: Work, task: Task, done: Done, spent: Spent) -> None:
    """Render the reference of a block, or find it in the cache, and put into the folder what a report shows of it."""
    setup, block = task.setup, task.block
    target = Store(work.root).reference_block(setup.id, block)
    if target.is_dir():
        return
    references = _references(work, task, spent)
    source = References(Path(work.cache)).folder(setup, block)
    kept = setup.kept_pictures()
    judged = block.judged(setup.judge_every)
    with whole_folder(target) as part:
        for name in RUN_FILES:
            (part / name).write_bytes((source / name).read_bytes())
        with spent.on("metrics"):
            columns = measure_shots(_metrics(work), floor_shots(references, judged), strict=work.strict)
        write_measures(part / "measures.parquet", judged, columns)
        pictures: dict[str, Any] = {}
        for number in sorted(kept & set(judged)):
            pictures[f"frame-{number:06d}.png"] = references[number].display
            pictures[f"floor-{number:06d}.png"] = references[number].floor_display
        write_pictures(part / "pictures", {name: picture for name, picture in pictures.items() if picture is not None})


def _cells(work: Work, task: Task, done: Done, spent: Spent) -> None:
    """Every cell's turn at the block; those that have it, or have failed, are left out."""
    store = Store(work.root)
    waiting = [
        cell
        for cell in task.cells
        if not store.cell_block(cell.id, task.block).is_dir() and store.failure(cell.id) is None
    ]
    if not waiting:
        return
    judges = Judges(_metrics(work), _references(work, task, spent), work.strict)
    for cell in waiting:
        if not store.belongs_to(work.token):
            # Our run ended, and another one took the folder over: what is left is its business.
            return
        try:
            check_codes(cell.plugins)
            settings = read_json(store.cell(cell.id) / CELL_FILE)
            renderer = renderer_of(task.setup, work, spent)
            target = store.cell_block(cell.id, task.block)
            run_block(renderer, task.setup, cell, task.block, settings, judges, target, spent)
            done.blocks += 1
        except Exception as error:
            failure = Failure(cell.id, kind_of(error, task.stage), reason_of(error))
            done.failures.append(failure)
            if store.belongs_to(work.token):
                _note_failure(store, failure, task)
            if failure.kind not in ("heuristic", "disk"):
                # Whatever it was, it may have left something behind.
                release()


def _oracle(work: Work, task: Task, done: Done, spent: Spent) -> None:
    """The best choice for every judged frame of the block, at every budget that the setup's cells have."""
    from phrt_plugins.bench.oracle import write_oracle

    setup, block, store = task.setup, task.block, Store(work.root)
    if store.oracle_block(setup.id, block).exists():
        return
    renderer = renderer_of(setup, work, spent)
    frames = [(number, setup.path.time(number)) for number in block.judged(setup.judge_every)]
    with spent.on("oracle"):
        # Milliseconds of an item are those of the setup's clock.
        renderer.restart(heuristic="all_trace", history=False, clock=new_clock(setup), strict=True)
        budgets = oracle_budgets(store, task)
        write_oracle(
            store.root, setup.id, block.number, renderer, frames, budgets, camera=setup.camera, tone_map=setup.tone_map
        )


def oracle_budgets(store: Store, task: Task) -> list[tuple[str, str, float]]:
    """(text, unit, amount) of every budget of the task's cells: rays, or milliseconds of the ray phase. What a budget for the whole
    frame leaves to the ray phase is the median of what its cells were left in the block; NaN where none was recorded."""
    found: dict[str, tuple[str, str, float]] = {}
    for cell in task.cells:
        settings = read_json(store.cell(cell.id) / CELL_FILE) or cell.settings()
        kind, amount = settings["budget_kind"], settings["budget_amount"]
        unit = {"none": "none", "rays": "rays"}.get(kind, "ms")
        left = math.inf if kind == "none" else math.nan if amount is None else float(amount)
        if kind == "frame_ms":
            left = _ray_phase(store, task, cell.budget)
        found[cell.budget] = cell.budget, unit, left
    return list(found.values())


def _ray_phase(store: Store, task: Task, budget: str) -> float:
    """The median of the ray phase's budgets, ms, that cells of `budget` recorded in the block; NaN where there are none."""
    folders = [store.cell_block(cell.id, task.block) for cell in task.cells if cell.budget == budget]
    rows = [
        np.asarray(read_columns(folder / "frames.parquet", ["budget"])["budget"])
        for folder in folders
        if folder.is_dir()
    ]
    return float(np.median(np.concatenate(rows))) if rows else math.nan


def _note_failure(store: Store, failure: Failure, task: Task) -> None:
    """Write it down at once, so that it is known whatever comes next; where the disk is full, the answer alone carries it."""
    try:
        store.fail(str(failure.cell), task.block, failure.kind, failure.reason)
    except OSError as error:
        warnings.warn(PhrtWarning(f"the failure of {failure.cell} cannot be written down: {error}"), stacklevel=2)


def kind_of(error: BaseException, stage: str) -> str:
    """What kind of failure it is."""
    if isinstance(error, FaultError):
        return error.kind
    if isinstance(error, PluginFailure):
        return error.fault.kind
    if isinstance(error, PluginError):
        return "heuristic" if stage == "cells" else "plugin"
    if isinstance(error, InputError):
        return "scene"
    if isinstance(error, OSError):
        return "disk"
    return "memory" if isinstance(error, MemoryError) else "error"


def reason_of(error: BaseException) -> str:
    """In a line, for people."""
    return " ".join(str(error).split()) if isinstance(error, (InputError, FaultError)) else describe(error)
