"""The long path: does the choice wear out? Row 12, and the question that the paper leaves open (Andrade et al. 2014, section 6:
"stress tests, where the hybrid renderer will run a very long path, in order to measure the degradation level, if any, of the
selection graph").

    .venv/bin/python benchmarks/longpath.py [--frames 10000] [--out FOLDER] [--plot FILE.svg]

Walks the atrium up and down its path, lap after lap, in small pictures and under a `RayClock`, so that decisions depend on
nothing but the scene and on what came before. What is counted lap by lap must then stay as it is. Writes `longpath.csv`,
`longpath.json` and a plot.
"""

from __future__ import annotations

import argparse
import csv
import gc
import json
import os
import sys
import time
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from fallbacks import PLAIN
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table
from rows import Row, row
from watch import Watch, watch

from phrt import Renderer, Scene, load_scene
from phrt.budget import Budget
from phrt.clock import RayClock
from phrt.registry import get_registry

PROJECT = Path(__file__).resolve().parent.parent
ATRIUM = PROJECT / "scenes" / "atrium.yaml"
FRAMES, SIZE = 10_000, (160, 90)
GROUP_BY = "object_effect_light"
"""Shadows count by light, which makes some 300 candidates of the objects in sight."""
NANOSECONDS_PER_RAY = 100.0
BUDGET_SHARE = 0.4
"""Of the rays that all-trace takes on average: little enough that most items have to be left out."""

RUNNERS: dict[str, tuple[str, Mapping[str, object]]] = {
    "selection_graph, fresh pointers": ("selection_graph", {"refresh_pointers": True}),
    "selection_graph, kept pointers": ("selection_graph", {"refresh_pointers": False}),
    "gain": ("gain", {}),
}
"""By what plots call them: heuristic and options."""


@dataclass(frozen=True)
class Lap:
    """One time up and down the path; means over its frames, times in ms as medians.

    candidates, chosen: items a frame. moved: nodes not selected, which wait in the graph of the next frame (selection_graph).
    kilorays: of the ray phase. selection_ms: what the heuristic took. heuristic_kb: all that it holds on to at the lap's
    end. resident_mb: of the whole process. objects: that Python's collector knows of.
    """

    lap: int
    frames: int
    candidates: float
    chosen: float
    moved: float
    kilorays: float
    selection_ms: float
    frame_ms: float
    heuristic_kb: float
    resident_mb: float
    objects: int


def lap_times(scene: Scene) -> list[float]:
    """Seconds of the frames of a lap: to the end of the path and back, every place but the two ends twice."""
    there = [frame / scene.settings.fps for frame in range(scene.settings.frames)]
    return there + there[-2:0:-1]


def resident_mb() -> float:
    """Resident size of this process now, in 10^6 bytes; NaN where the system does not say."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return float("nan")
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def held_bytes(root: object) -> int:
    """Bytes of everything that can be reached from `root`, classes, functions and modules apart."""
    seen: set[int] = set()
    waiting: list[object] = [root]
    total = 0
    while waiting:
        found = waiting.pop()
        if id(found) in seen or isinstance(found, type | types.ModuleType | types.FunctionType | types.MethodType):
            continue
        seen.add(id(found))
        total += sys.getsizeof(found)
        if isinstance(found, np.ndarray):
            # What a view looks at counts where the owner is found.
            waiting += [found.base] if found.base is not None else []
        else:
            waiting += gc.get_referents(found)
    return total


def moved_nodes(heuristic: Any) -> int:
    """Nodes in the graph under construction; 0 for heuristics without one."""
    return len(getattr(heuristic, "moved", ()))


class Runner:
    """One heuristic on its way, and the columns of the lap that it is in."""

    def __init__(self, renderer: Renderer) -> None:
        self.renderer = renderer
        self._watch: Watch = watch(renderer)
        self._heuristic = renderer.heuristic
        self._frames: list[tuple[float, ...]] = []

    def frame(self, at: float) -> None:
        """One frame more in this lap."""
        start = time.perf_counter()
        result = self.renderer.render(at)
        spent = (time.perf_counter() - start) * 1e3
        rays = sum(count for kind, count in result.rays.items() if kind != "primary")
        decisions = result.decisions
        self._frames.append(
            (
                len(decisions.candidates),
                int(decisions.chosen.sum()),
                moved_nodes(self._heuristic),
                rays / 1e3,
                self._watch.phase.heuristic_ms,
                spent,
            )
        )

    def lap(self, number: int) -> Lap:
        """The lap that ends here."""
        columns = np.array(self._frames)
        candidates, chosen, moved, kilorays = columns[:, :4].mean(axis=0).tolist()
        selection_ms, frame_ms = np.median(columns[:, 4:], axis=0).tolist()
        count = len(self._frames)
        self._frames = []
        gc.collect()
        held = held_bytes(self._heuristic) / 1e3
        return Lap(
            number, count, candidates, chosen, moved, kilorays, selection_ms, frame_ms, held, resident_mb(),
            len(gc.get_objects()),
        )  # fmt: skip


def mean_rays(scene: Scene, size: tuple[int, int], threads: int) -> float:
    """Rays of all-trace's ray phase, on average along the path."""
    with Renderer(
        scene, size=size, threads=threads, gbuffer="raycast", tracer="embree", heuristic="all_trace", group_by=GROUP_BY
    ) as renderer:
        counts = []
        for at in lap_times(scene)[: scene.settings.frames : 10]:
            counts.append(sum(count for kind, count in renderer.render(at).rays.items() if kind != "primary"))
    return float(np.mean(counts))


def run_laps(
    scene: Scene,
    heuristic: str,
    options: Mapping[str, object],
    budget: Budget,
    frames: int,
    *,
    size: tuple[int, int] = SIZE,
    threads: int = 2,
    advance: Callable[[], None] = lambda: None,
) -> list[Lap]:
    """As many whole laps of `scene` as `frames` frames need. advance: called after every frame."""
    times = lap_times(scene)
    laps = []
    with Renderer(
        scene, size=size, threads=threads, gbuffer="raycast", tracer="embree", heuristic=heuristic,
        heuristic_options=options, budget=budget, clock=RayClock(NANOSECONDS_PER_RAY), group_by=GROUP_BY,
        effects=PLAIN,
    ) as renderer:  # fmt: skip
        runner = Runner(renderer)
        for number in range(-(-frames // len(times))):
            for at in times:
                runner.frame(at)
                advance()
            laps.append(runner.lap(number))
    return laps


@dataclass
class LongPath:
    """Laps by runner, and what they had in common."""

    scene: str
    size: tuple[int, int]
    budget: Budget
    laps: dict[str, list[Lap]]

    def as_json(self) -> dict[str, Any]:
        """Plain values."""
        return {
            "scene": self.scene,
            "size": list(self.size),
            "budget": str(self.budget),
            "nanoseconds_per_ray": NANOSECONDS_PER_RAY,
            "laps": {name: [asdict(lap) for lap in laps] for name, laps in self.laps.items()},
            "drift_percent": {name: drifts(laps) for name, laps in self.laps.items()},
        }


def runners_here() -> dict[str, tuple[str, Mapping[str, object]]]:
    """Those of RUNNERS whose heuristic there is."""
    known = get_registry().names("heuristic")
    return {name: entry for name, entry in RUNNERS.items() if entry[0] in known}


@dataclass(frozen=True)
class Step:
    """One frame is done, of runner `name`; `total` frames are to come from each."""

    name: str
    total: int


def measure(
    scene: Scene,
    frames: int = FRAMES,
    *,
    size: tuple[int, int] = SIZE,
    threads: int = 2,
    tell: Callable[[Step], None] = lambda step: None,
) -> LongPath:
    """All runners, one after the other."""
    budget = Budget(round(mean_rays(scene, size, threads) * BUDGET_SHARE * NANOSECONDS_PER_RAY * 1e-6, 4), "ray_ms")
    lap = len(lap_times(scene))
    total = -(-frames // lap) * lap
    laps = {}
    for name, (heuristic, options) in runners_here().items():
        advance = partial(tell, Step(name, total))
        laps[name] = run_laps(scene, heuristic, options, budget, frames, size=size, threads=threads, advance=advance)
    return LongPath(scene.name, size, budget, laps)


COUNTED = ("candidates", "chosen", "moved", "kilorays", "heuristic_kb", "resident_mb", "selection_ms", "frame_ms")


def drift(values: Sequence[float]) -> float:
    """By how much `values` (one a lap) rise over the whole run, in percent of their median: the median of the slopes between
    all pairs (Sen 1968), which single slow laps do not move. 0 for fewer than two."""
    y = np.asarray(values, np.float64)
    if len(y) < 2 or np.median(y) == 0:
        return 0.0
    a, b = np.triu_indices(len(y), k=1)
    slope = float(np.median((y[b] - y[a]) / (b - a)))
    return slope * (len(y) - 1) / float(np.median(y)) * 100.0


def settled(laps: Sequence[Lap]) -> Sequence[Lap]:
    """All but the first lap, where everything is new; that, too, when there is no other."""
    return laps[1:] if len(laps) > 1 else laps


def drifts(laps: Sequence[Lap]) -> dict[str, float]:
    """`drift` by column, from the second lap on."""
    return {name: drift([getattr(lap, name) for lap in settled(laps)]) for name in COUNTED}


def spread(laps: Sequence[Lap], name: str) -> float:
    """Largest less smallest of a column in percent of its mean, from the second lap on."""
    values = [getattr(lap, name) for lap in settled(laps)]
    mean = float(np.mean(values))
    return (max(values) - min(values)) / mean * 100.0 if mean else 0.0


def path_rows(found: LongPath) -> list[Row]:
    """Row 12: what is flat, over how many frames."""
    rows = []
    for name, laps in found.laps.items():
        rises = drifts(laps)
        frames = sum(lap.frames for lap in laps)
        trend = abs(rises["chosen"])
        rows += [
            row(12, f"{frames:,} frames, {name}: memory rises by", "%", [rises["resident_mb"]], "<=", 1.0),
            row(12, "  frame time rises by", "%", [rises["frame_ms"]], "<=", 5.0),
            row(12, "  selection time rises by", "%", [rises["selection_ms"]], "<=", 5.0),
            row(12, "  what the heuristic holds on to rises by", "%", [rises["heuristic_kb"]], "<=", 1.0),
            row(12, "  items chosen: trend, up or down", "%", [trend], "<=", 2.0),
            row(12, "  items chosen: spread over the laps", "%", [spread(laps, "chosen")], "<=", None),
        ]
    return rows


def tables(found: LongPath) -> list[Table]:
    """A table for each runner."""
    headings = (
        "lap", "items", "chosen", "waiting", "k rays", "selection ms", "frame ms", "heuristic kB", "RSS MB", "objects"
    )  # fmt: skip
    made = []
    for name, laps in found.laps.items():
        table = Table(title=f"Long path: {name}; {found.scene}, budget {found.budget}", title_justify="left")
        for heading in headings:
            table.add_column(heading, justify="right")
        for lap in laps:
            table.add_row(
                str(lap.lap + 1), f"{lap.candidates:.2f}", f"{lap.chosen:.3f}", f"{lap.moved:.2f}",
                f"{lap.kilorays:.2f}", f"{lap.selection_ms:.3f}", f"{lap.frame_ms:.2f}", f"{lap.heuristic_kb:.1f}",
                f"{lap.resident_mb:.1f}", f"{lap.objects:,}",
            )  # fmt: skip
        made.append(table)
    return made


def write_csv(found: LongPath, path: Path) -> None:
    """One line a lap."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer: csv.DictWriter[str] | None = None
        for name, laps in found.laps.items():
            for lap in laps:
                line = {"runner": name, **asdict(lap)}
                if writer is None:
                    writer = csv.DictWriter(file, list(line))
                    writer.writeheader()
                writer.writerow(line)


PANELS = (
    ("chosen", "items chosen a frame"),
    ("moved", "nodes in the next graph"),
    ("selection_ms", "selection, ms a frame"),
    ("heuristic_kb", "held by the heuristic, kB"),
    ("resident_mb", "memory of the process, MB"),
    ("frame_ms", "frame, ms"),
)


def plot(found: LongPath, path: Path) -> None:
    """Every panel over the laps, from zero, so that flat looks flat."""
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    # Text as text, and the same file from the same laps.
    with rc_context({"svg.fonttype": "none", "svg.hashsalt": "phrt", "font.size": 9}):
        figure = Figure(figsize=(9.0, 4.6), layout="constrained")
        axes = figure.subplots(2, 3, sharex=True)
        for axis, (name, label) in zip(axes.flat, PANELS, strict=True):
            for style, (runner, laps) in zip(_styles(), found.laps.items(), strict=False):
                axis.plot([lap.lap + 1 for lap in laps], [getattr(lap, name) for lap in laps], label=runner, **style)
            axis.set_title(label, fontsize=9)
            axis.set_ylim(bottom=0)
            axis.grid(alpha=0.3)
        for axis in axes[1]:
            axis.set_xlabel("lap")
        handles, labels = axes[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
        figure.savefig(path, format="svg", metadata={"Date": None})


def _styles() -> Iterator[dict[str, Any]]:
    """Told apart without colours, too."""
    for color, line, marker in (("#1f77b4", "-", "o"), ("#d95f02", "--", "s"), ("#1b9e77", ":", "^")):
        yield {"color": color, "linestyle": line, "marker": marker, "markersize": 3, "linewidth": 1.2}


def progress_bar(console: Console) -> tuple[Progress, Callable[[Step], None]]:
    """A bar for each runner, and what moves it."""
    # A bar that cannot be redrawn is no use: lines are written instead.
    shown = Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn(),
        console=console, disable=not console.is_terminal,
    )  # fmt: skip
    tasks: dict[str, Any] = {}

    def tell(step: Step) -> None:
        if step.name not in tasks:
            tasks[step.name] = shown.add_task(step.name, total=step.total)
        shown.advance(tasks[step.name])
        done = int(shown.tasks[tasks[step.name]].completed)
        if not console.is_terminal and done % 1000 == 0:
            print(f"{step.name}: frame {done} of {step.total}", file=sys.stderr, flush=True)

    return shown, tell


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=FRAMES, help=f"of each runner (default {FRAMES})")
    parser.add_argument("--threads", type=int, default=2, help="threads of a renderer (default 2)")
    parser.add_argument("--out", type=Path, default=Path("out"), help="folder of longpath.csv and .json (default out)")
    parser.add_argument("--plot", type=Path, help="where the plot goes (default longpath.svg in the folder)")
    arguments = parser.parse_args()
    shown, tell = progress_bar(Console(stderr=True))
    with shown:
        found = measure(load_scene(ATRIUM), arguments.frames, threads=arguments.threads, tell=tell)
    arguments.out.mkdir(parents=True, exist_ok=True)
    write_csv(found, arguments.out / "longpath.csv")
    (arguments.out / "longpath.json").write_text(json.dumps(found.as_json(), indent=2) + "\n", encoding="utf-8")
    plot(found, arguments.plot or arguments.out / "longpath.svg")
    console = Console(width=None if sys.stdout.isatty() else 130)
    for table in tables(found):
        console.print(table)


if __name__ == "__main__":
    main()
