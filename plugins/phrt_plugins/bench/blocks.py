"""One block of one cell: warm up, render and record; then, with the clock stopped, judge the pictures and write everything."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from phrt.errors import PhrtWarning
from phrt.interfaces.metric import Metric
from phrt.output.images import write_png
from phrt.recording import Recorder
from phrt.recording.arrow import import_arrow
from phrt.renderer import Renderer
from phrt_plugins.bench.config import HALF
from phrt_plugins.bench.pictures import ReferencePicture, all_trace_errors, shots
from phrt_plugins.bench.plan import Block, Cell, Setup
from phrt_plugins.bench.scenes import new_clock
from phrt_plugins.bench.store import whole_folder
from phrt_plugins.metrics.measure import measure_shots


class FaultError(Exception):
    """A cell cannot go on. kind: of the plugin that failed, or "disk"."""

    def __init__(self, kind: str, reason: str) -> None:
        super().__init__(reason)
        self.kind = kind


@dataclass
class Spent:
    """Seconds by what they were spent on: load, reference, render, metrics, oracle. What is inside of another is not in both."""

    seconds: dict[str, float] = field(default_factory=dict)
    _inside: list[float] = field(default_factory=lambda: [0.0])

    @contextmanager
    def on(self, what: str) -> Iterator[None]:
        self._inside.append(0.0)
        began = time.perf_counter()
        try:
            yield
        finally:
            whole = time.perf_counter() - began
            self.seconds[what] = self.seconds.get(what, 0.0) + whole - self._inside.pop()
            self._inside[-1] += whole


@dataclass(frozen=True)
class Judges:
    """What judges pictures: metrics, and the references of a block. strict: a metric that fails is an error."""

    metrics: Sequence[Metric]
    references: Mapping[int, ReferencePicture]
    strict: bool = False


def run_block(
    renderer: Renderer, setup: Setup, cell: Cell, block: Block, settings: Mapping[str, Any], judges: Judges, folder: Path,
    spent: Spent,
) -> None:  # fmt: skip
    """Render `block` of `cell` and write it to `folder`, whole or not at all.

    settings: cell.json, whose budget_amount holds. Raises FaultError, OSError, and PluginError and others that rendering raises.
    """
    with whole_folder(folder) as part:
        images = render_block(renderer, setup, cell, block, settings, part / "run", spent)
        for path in list((part / "run").iterdir()):
            path.rename(part / path.name)
        (part / "run").rmdir()
        judged = block.judged(setup.judge_every)
        with spent.on("metrics"):
            found = shots(images, judges.references, judged, setup.tone_map, renderer.workers)
            displays: dict[int, np.ndarray] = {}
            columns = measure_shots(judges.metrics, _keeping(found, displays), strict=judges.strict)
            columns |= all_trace_errors(judges.references, displays)
        write_measures(part / "measures.parquet", judged, columns)
        shown = worth_a_look(setup.kept_pictures(), judged, columns)
        write_pictures(part / "pictures", {f"frame-{k:06d}.png": displays[k] for k in displays if k in shown})


def render_block(
    renderer: Renderer, setup: Setup, cell: Cell, block: Block, settings: Mapping[str, Any], run: Path, spent: Spent
) -> dict[int, np.ndarray]:
    """Render and record `block` into folder `run`; the pictures to be judged, (H, W, 3) float32 linear, by number."""
    with spent.on("render"):
        restart(renderer, setup, cell, settings)
    wanted = set(block.pictured(setup.judge_every))
    images: dict[int, np.ndarray] = {}
    with contained(renderer) as check:
        for number in block.warm_up(setup.warm_up):
            with spent.on("render"):
                renderer.render(setup.path.time(number), frame_index=number, camera=setup.camera)
        check()
        kept = {"cell": dict(settings), "block": block.number, "warm_up": setup.warm_up}
        with Recorder(run, renderer, settings=kept) as recorder:
            for number in block.frames:
                with spent.on("render"):
                    frame = renderer.render(setup.path.time(number), frame_index=number, camera=setup.camera)
                recorder.add(frame)
                check(recorder)
                if number in wanted:
                    # A copy: the frame's own array belongs to a pool that must not run dry.
                    images[number] = frame.image.copy()
        check(recorder)
    return images


def restart(renderer: Renderer, setup: Setup, cell: Cell, settings: Mapping[str, Any]) -> None:
    """Let `renderer` forget everything and be `cell`'s."""
    budget = f"{settings['budget_amount']:.0f}rays" if cell.budget == HALF else cell.budget
    renderer.restart(
        heuristic=cell.heuristic,
        heuristic_options=cell.options,
        budget=budget,
        persistence=cell.persistence,
        cost_model=cell.cost_model,  # type: ignore[arg-type]
        group_by=cell.group_by,  # type: ignore[arg-type]
        clock=new_clock(setup),
        history=cell.history,
    )


@contextmanager
def contained(renderer: Renderer) -> Iterator[Callable[..., None]]:
    """Inside, faults of plugins that the renderer contains are collected; calling what is given raises them as a FaultError, and
    those of a recorder. Other warnings are passed on once the block is done."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", PhrtWarning)

        def check(recorder: Recorder | None = None) -> None:
            if log := renderer.run.faults.log:
                raise FaultError(log[0].kind, str(log[0]))
            if recorder is not None and recorder.failed is not None:
                raise FaultError("disk", f"nothing more can be written: {recorder.failed}")

        yield check
    for warning in told:
        warnings.warn(warning.message, stacklevel=3)


def worth_a_look(kept: set[int], judged: Sequence[int], columns: Mapping[str, np.ndarray]) -> set[int]:
    """The frames whose pictures are `kept`, and the worst of those that were `judged`; none where none are to be kept."""
    errors = next((columns[name] for name in ("flip", "display_error") if name in columns), None)
    if not kept or errors is None or not np.isfinite(errors).any():
        return kept
    return kept | {judged[int(np.nanargmax(errors))]}


def write_measures(path: Path, judged: Sequence[int], columns: Mapping[str, np.ndarray]) -> None:
    """A row per judged frame: its number, and a column each. Raises OSError."""
    arrow = import_arrow()
    table = arrow.table(
        {"frame": np.array(judged, np.int64), **{name: v.astype(np.float64) for name, v in columns.items()}}
    )
    arrow.parquet.write_table(table, path, compression="zstd")


def write_pictures(folder: Path, pictures: Mapping[str, np.ndarray]) -> None:
    """Pictures (H, W, 3) uint8 by name; no folder where there are none. Raises OSError."""
    if pictures:
        folder.mkdir(parents=True, exist_ok=True)
    for name, picture in pictures.items():
        write_png(folder / name, picture)


def _keeping(found: Any, displays: dict[int, np.ndarray]) -> Iterator[Any]:
    """The shots, one at a time; what they show goes into `displays`."""
    for shot in found:
        displays[shot.index] = shot.display
        yield shot
