"""The benchmark table: the rows of `docs/benchmarks.md`, on this machine.

    PHRT_ASSETS=/path/to/scenes ./run bench [--rows 1,4,5] [--repeats N] [--frames N] [--threads N] [--json FILE]

Figures are medians over repeats that take turns, after a warm-up that compiles the kernels; rows 6 to 8 and 12 walk a camera
path instead. With the rows come tables of what they are made of: stages of a frame, bare rates of the tracers, every heuristic
under every budget, laps of the long path. That page says how each figure is defined, its bar, and how long it takes.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import budgets
import contest
import frames
import loads
import longpath
import machine
import numpy as np
import quality
import rows
import selection
import tracers
from rich.console import Console
from rich.table import Table

from phrt import Scene, load_scene
from phrt.errors import PhrtWarning
from phrt.registry import get_registry
from phrt_backends.availability import embree_reason
from phrt_plugins.packages import missing_packages

PROJECT = Path(__file__).resolve().parent.parent
SCENE = PROJECT / "scenes" / "sponza_armadillo.yaml"
MILLION = Path("gltf", "MetalRoughSpheresNoTextures", "MetalRoughSpheresNoTextures.glb")
"""Row 11's scene: 1,040,409 triangles in 123 objects."""

FRAME_ROWS, BUDGET_ROWS, SELECTION_ROWS, LOAD_ROWS, PATH_ROWS, TRACER_ROWS = (
    (1, 2, 3, 4, 5), (6, 7, 8), (9,), (10, 11), (12,), (13,),
)  # fmt: skip
ALL_ROWS = tuple(range(1, 14))


@dataclass(frozen=True)
class Plan:
    """What to measure. places: times along the camera path; repeats: rounds over them. frames: of the path in rows 6 to 8,
    None for all; every: the pictures among them that are compared; long: frames of row 12. heuristics: of rows 6 to 9,
    none for all."""

    assets: Path
    wanted: Sequence[int]
    repeats: int
    threads: int = 2
    size: tuple[int, int] = (640, 360)
    places: int = 10
    frames: int | None = None
    every: int = 5
    long: int = longpath.FRAMES
    heuristics: Sequence[str] = ()
    progress: Callable[[str], None] = lambda text: None

    def any_of(self, group: Sequence[int]) -> list[int]:
        """The rows of `group` that are wanted."""
        return [number for number in group if number in self.wanted]

    def scene(self, variant: str | None = None) -> Scene:
        """The reference scene."""
        self.progress("loading the reference scene")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PhrtWarning)
            return load_scene(SCENE, search=[self.assets], variant=variant)


@dataclass
class Report:
    """What a run found. tracers: bare rates; context: times that have no bar."""

    machine: dict[str, object]
    rows: list[rows.Row] = field(default_factory=list)
    tracers: list[tracers.RateRow] = field(default_factory=list)
    frames: frames.FrameTimes | None = None
    loads: dict[str, list[loads.Load]] = field(default_factory=dict)
    contests: list[contest.Contest] = field(default_factory=list)
    deciding: list[selection.Deciding] = field(default_factory=list)
    long_path: longpath.LongPath | None = None

    def as_json(self) -> dict[str, Any]:
        """Everything but raw samples of stages, as plain values."""
        return {
            "machine": self.machine,
            "rows": [row.as_json() for row in self.rows],
            "tracers": [asdict(row) for row in self.tracers],
            "frames": {} if self.frames is None else frame_context(self.frames),
            "loads": {name: [asdict(load) for load in found] for name, found in self.loads.items()},
            "budgets": [budgets.as_json(held) for held in self.contests],
            "selection": [asdict(entry) | {"median": entry.median} for entry in self.deciding],
            "long_path": {} if self.long_path is None else self.long_path.as_json(),
        }


def frame_context(times: frames.FrameTimes) -> dict[str, Any]:
    """Medians by stage and numbers of rays, by G-buffer and heuristic."""
    context: dict[str, Any] = {"tracer_calls": times.queries, "tracer_rays": times.query_rays}
    for (gbuffer, heuristic), found in times.frames.items():
        context[f"{gbuffer} {heuristic}"] = {"ms": found.medians(), "rays": found.ray_counts()}
    context["ms"] = {"bare tracer": float(np.median(times.bare)), "surface": float(np.median(times.surfaces))}
    return context


def gbuffers_here() -> tuple[str, ...]:
    """The producers that work on this machine, raycast first."""
    registry = get_registry()
    others = [name for name in registry.names("gbuffer") if name != "raycast"]
    return ("raycast", *(name for name in others if registry.get("gbuffer", name).unavailable_reason() is None))


def load_rows(number: int, name: str, found: Sequence[loads.Load], limit_s: float, limit_gb: float) -> list[rows.Row]:
    """Seconds and memory of one scene."""
    if not all(load.lit for load in found):
        raise RuntimeError(f"row {number}: {name} did not render")
    size = f"{found[0].triangles:,} triangles, {found[0].objects} objects"
    return [
        rows.row(number, f"load {name} ({size})", "s", [load.load_s for load in found], "<=", limit_s),
        rows.row(number, "  peak memory, one frame rendered", "GB", [load.peak_gb for load in found], "<=", limit_gb),
        rows.row(number, "  before that: imports", "s", [load.import_s for load in found], "<=", None),
        rows.row(number, "  after that: the first frame", "s", [load.frame_s for load in found], "<=", None),
    ]


def tracer_row(rate: tracers.RateRow) -> rows.Row:
    """Row 13 for one kind of rays."""
    what = f"embree / embreex run, {rate.kind} rays, {rate.triangles:,} triangles"
    return rows.row(13, what, "", rate.ratios, ">=", rate.bar)


def measure_frames(plan: Plan, report: Report) -> None:
    """Rows 1 to 5."""
    if not plan.any_of(FRAME_ROWS):
        return
    scene = plan.scene()
    last = scene.duration * (plan.places - 1) / plan.places if plan.places > 1 else 0.0
    at = [float(time) for time in np.linspace(0.0, last, plan.places)]
    report.frames = frames.measure(
        scene, at, plan.repeats, size=plan.size, threads=plan.threads, gbuffers=gbuffers_here(), progress=plan.progress
    )
    report.rows += [row for row in report.frames.rows() if row.number in plan.wanted]


def measure_budgets(plan: Plan, report: Report) -> None:
    """Rows 6 to 8."""
    names = budgets.in_table_order(plan.heuristics or contest.heuristics_here())
    for number in plan.any_of(BUDGET_ROWS):
        for rules in budgets.RULES[number]:
            scene = plan.scene(rules.variant)
            path = contest.Path(plan.frames or scene.settings.frames, scene.settings.fps, plan.every)
            held = contest.hold(scene, rules, names, path, size=plan.size, threads=plan.threads, progress=plan.progress)
            report.contests.append(held)
            if rules is budgets.RULES[number][0]:
                report.rows += budgets.contest_rows(number, held)


def measure_selection(plan: Plan, report: Report) -> None:
    """Row 9."""
    if plan.any_of(SELECTION_ROWS):
        names = plan.heuristics or contest.heuristics_here()
        report.deciding = selection.measure(
            names, selection.COUNTS, plan.repeats, threads=plan.threads, progress=plan.progress
        )
        report.rows += selection.selection_rows(report.deciding)


def measure_loads(plan: Plan, report: Report) -> None:
    """Rows 10 and 11."""
    scenes = {
        10: (SCENE, "the reference scene", 2.0, 0.8),
        11: (plan.assets / MILLION, "a million triangles", 10.0, 2.0),
    }
    for number in plan.any_of(LOAD_ROWS):
        path, name, limit_s, limit_gb = scenes[number]
        found = []
        for repeat in range(min(plan.repeats, 5) + 1):
            plan.progress(f"row {number}: {name}, process {repeat + 1}")
            found.append(loads.fresh(path, plan.size, plan.threads))
        report.loads[name] = found[1:]
        report.rows += load_rows(number, name, found[1:], limit_s, limit_gb)


def measure_path(plan: Plan, report: Report) -> None:
    """Row 12."""
    if not plan.any_of(PATH_ROWS):
        return
    done: dict[str, int] = {}

    def tell(step: longpath.Step) -> None:
        done[step.name] = done.get(step.name, 0) + 1
        if done[step.name] % 500 == 1:
            plan.progress(f"row 12: {step.name}, frame {done[step.name]} of {step.total}")

    scene = load_scene(longpath.ATRIUM)
    report.long_path = longpath.measure(scene, plan.long, threads=plan.threads, tell=tell)
    report.rows += longpath.path_rows(report.long_path)


def measure_tracers(plan: Plan, report: Report) -> None:
    """Row 13, and the bare rates that belong to row 1."""
    if not plan.any_of((1, *TRACER_ROWS)):
        return
    for geometry in tracers.reference_geometries(plan.assets):
        plan.progress(f"bare tracers: {geometry.name}")
        for count in (1, 2):
            report.tracers += tracers.measure(geometry, count, plan.repeats)
    if plan.any_of(TRACER_ROWS):
        report.rows += [tracer_row(rate) for rate in report.tracers if rate.bar is not None]


def run_benchmarks(plan: Plan) -> Report:
    """Measure what is wanted."""
    report = Report(machine.machine())
    for measure in (measure_frames, measure_budgets, measure_selection, measure_loads, measure_path, measure_tracers):
        measure(plan, report)
    return report


def stage_table(times: frames.FrameTimes) -> Table:
    """Median ms by stage, a column for every G-buffer and heuristic."""
    made = Table(title="Stages of a frame, ms (medians)", title_justify="left")
    made.add_column("stage")
    columns = {f"{gbuffer} {heuristic}": found.medians() for (gbuffer, heuristic), found in times.frames.items()}
    for heading in columns:
        made.add_column(heading, justify="right")
    stages = list(dict.fromkeys(stage for medians in columns.values() for stage in medians))
    for stage in stages:
        made.add_row(stage, *(f"{medians.get(stage, 0.0):.1f}" for medians in columns.values()))
    return made


def show(report: Report, console: Console) -> None:
    """The tables, to read."""
    for line in machine.lines(report.machine):
        console.print(line, highlight=False)
    if report.rows:
        console.print(rows.table(report.rows))
    if report.frames is not None:
        console.print(stage_table(report.frames))
        counts = report.frames.frames["raycast", "all_trace"].ray_counts()
        text = ", ".join(f"{kind} {count:,.0f}" for kind, count in counts.items())
        console.print(f"Rays of an all-trace frame: {text}.", highlight=False)
        bare, calls = float(np.median(report.frames.bare)), report.frames.queries
        asked = f"Its ray phase asks the tracer {calls:.0f} times, for {report.frames.query_rays:,.0f} rays"
        console.print(f"{asked}: {bare:.1f} ms bare.", highlight=False)
    for held in report.contests:
        for table in budgets.tables(held):
            console.print(table)
        for said in held.warnings:
            console.print(f"{held.rules.name}: {said}", highlight=False)
    if report.deciding:
        console.print(selection.table(report.deciding))
    if report.long_path is not None:
        for table in longpath.tables(report.long_path):
            console.print(table)
    if report.tracers:
        console.print(tracers.table(report.tracers))


def row_numbers(text: str) -> list[int]:
    """ "1,4,5" as numbers. Raises ArgumentTypeError for others than ALL_ROWS."""
    names = {str(number): number for number in ALL_ROWS}
    given = [part.strip() for part in text.split(",") if part.strip()]
    if not given or (unknown := [part for part in given if part not in names]):
        told = ", ".join(unknown) if given else "nothing"
        raise argparse.ArgumentTypeError(f"given {told}; rows are {', '.join(names)}")
    return [names[part] for part in given]


def heuristic_names(text: str) -> list[str]:
    """ "gain,random" as names. Raises ArgumentTypeError for a heuristic that there is not."""
    known = contest.heuristics_here()
    given = [part.strip() for part in text.split(",") if part.strip()]
    if not given or (unknown := [name for name in given if name not in known]):
        told = ", ".join(unknown) if given else "nothing"
        raise argparse.ArgumentTypeError(f"given {told}; heuristics are {', '.join(known)}")
    return given


def size_of(text: str) -> tuple[int, int]:
    """ "640x360" as (640, 360)."""
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"given {text}; wanted WIDTHxHEIGHT, such as 640x360")
    return int(width), int(height)


def at_least_one(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"given {text}; wanted a whole number from 1")
    return int(text)


def arguments_of(given: Sequence[str] | None) -> argparse.Namespace:
    """The command line; ends the process with one message when it is wrong."""
    parser = argparse.ArgumentParser(
        prog="./run bench", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rows", type=row_numbers, default=list(ALL_ROWS), help="which, such as 1,4,5 (default all)")
    parser.add_argument("--repeats", type=at_least_one, default=15, help="rounds; of processes, at most 5 (default 15)")
    parser.add_argument("--threads", type=at_least_one, default=2, help="threads of a renderer (default 2)")
    parser.add_argument("--places", type=at_least_one, default=10, help="times along the camera path (default 10)")
    parser.add_argument("--frames", type=at_least_one, help="of the camera path in rows 6 to 8 (default all of it)")
    parser.add_argument("--every", type=at_least_one, default=5, help="picture in rows 6 to 8 is compared (default 5)")
    parser.add_argument(
        "--long", type=at_least_one, default=longpath.FRAMES, help=f"frames of row 12 (default {longpath.FRAMES})"
    )
    parser.add_argument(
        "--heuristics", type=heuristic_names, default=(), help="of rows 6 to 9, such as gain,random (default all)"
    )
    parser.add_argument("--size", type=size_of, default=(640, 360), help="of frames (default 640x360)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here, too")
    arguments = parser.parse_args(given)
    folder = os.environ.get("PHRT_ASSETS")
    if not folder:
        parser.error("PHRT_ASSETS is not set; it must name the folder of the real scenes (sponza/, armadillo/, gltf/)")
    arguments.assets = Path(folder).expanduser().resolve()
    needed = [Path("sponza", "sponza_textured.glb"), Path("armadillo", "armadillo_100k.obj"), MILLION]
    if missing := [str(path) for path in needed if not (arguments.assets / path).is_file()]:
        parser.error(f"PHRT_ASSETS is {arguments.assets}, where these are missing: {', '.join(missing)}")
    if reason := embree_reason():
        parser.error(f"the tracer 'embree' is not available: {reason}")
    if set(arguments.rows) & set(BUDGET_ROWS) and (missing := missing_packages(*quality.NEEDED)):
        parser.error(f"rows 6 to 8 compare pictures with {', '.join(missing)}: install the extra `bench`")
    return arguments


def main(given: Sequence[str] | None = None) -> int:
    arguments = arguments_of(given)
    console = Console()
    if not console.is_terminal:
        # Written to a file: tables keep their columns.
        console = Console(width=150)
    told = Console(stderr=True)
    with told.status("starting") as status:

        def progress(text: str) -> None:
            status.update(text)
            if not told.is_terminal:
                print(text, file=sys.stderr, flush=True)

        report = run_benchmarks(
            Plan(
                arguments.assets, arguments.rows, arguments.repeats, arguments.threads, arguments.size,
                arguments.places, arguments.frames, arguments.every, arguments.long, arguments.heuristics, progress,
            )
        )  # fmt: skip
    show(report, console)
    if arguments.json:
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
        arguments.json.write_text(json.dumps(report.as_json(), indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
