"""The benchmark table: rows 1 to 5, 10, 11 and 13 of `docs/benchmarks.md`, on this machine.

    PHRT_ASSETS=/path/to/scenes ./run bench [--rows 1,4,5] [--repeats N] [--threads N] [--json FILE]

Figures are medians over repeats that take turns, after a warm-up that compiles the kernels. With rows 1 to 5 come the
stages of a frame and the frames of every G-buffer producer, with row 1 or 13 the bare rates of the tracers, all from
the same run. That page says how each figure is defined, and its bar.
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

import frames
import loads
import machine
import numpy as np
import rows
import tracers
from rich.console import Console
from rich.table import Table

from phrt import load_scene
from phrt.errors import PhrtWarning
from phrt.registry import get_registry
from phrt_backends.availability import embree_reason

PROJECT = Path(__file__).resolve().parent.parent
SCENE = PROJECT / "scenes" / "sponza_armadillo.yaml"
MILLION = Path("gltf", "MetalRoughSpheresNoTextures", "MetalRoughSpheresNoTextures.glb")
"""Row 11's scene: 1,040,409 triangles in 123 objects."""

FRAME_ROWS, LOAD_ROWS, TRACER_ROWS = (1, 2, 3, 4, 5), (10, 11), (13,)
ALL_ROWS = (*FRAME_ROWS, *LOAD_ROWS, *TRACER_ROWS)


@dataclass
class Report:
    """What a run found. tracers: bare rates; context: times that have no bar."""

    machine: dict[str, object]
    rows: list[rows.Row] = field(default_factory=list)
    tracers: list[tracers.RateRow] = field(default_factory=list)
    frames: frames.FrameTimes | None = None
    loads: dict[str, list[loads.Load]] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        """Everything but raw samples of stages, as plain values."""
        return {
            "machine": self.machine,
            "rows": [row.as_json() for row in self.rows],
            "tracers": [asdict(row) for row in self.tracers],
            "frames": {} if self.frames is None else frame_context(self.frames),
            "loads": {name: [asdict(load) for load in found] for name, found in self.loads.items()},
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


def run_benchmarks(
    assets: Path,
    wanted: Sequence[int],
    repeats: int,
    *,
    threads: int = 2,
    size: tuple[int, int] = (640, 360),
    places: int = 10,
    progress: Callable[[str], None] = lambda text: None,
) -> Report:
    """Measure the rows `wanted`. places: how many times along the camera path; repeats: rounds over them."""
    report = Report(machine.machine())
    if set(wanted) & set(FRAME_ROWS):
        progress("loading the reference scene")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PhrtWarning)
            scene = load_scene(SCENE, search=[assets])
        last = scene.duration * (places - 1) / places if places > 1 else 0.0
        at = [float(time) for time in np.linspace(0.0, last, places)]
        report.frames = frames.measure(
            scene, at, repeats, size=size, threads=threads, gbuffers=gbuffers_here(), progress=progress
        )
        report.rows += [row for row in report.frames.rows() if row.number in wanted]
    scenes = {10: (SCENE, "the reference scene", 2.0, 0.8), 11: (assets / MILLION, "a million triangles", 10.0, 2.0)}
    for number in sorted(set(wanted) & set(LOAD_ROWS)):
        path, name, limit_s, limit_gb = scenes[number]
        found = []
        for repeat in range(min(repeats, 5) + 1):
            progress(f"row {number}: {name}, process {repeat + 1}")
            found.append(loads.fresh(path, size, threads))
        report.loads[name] = found[1:]
        report.rows += load_rows(number, name, found[1:], limit_s, limit_gb)
    if set(wanted) & {1, *TRACER_ROWS}:
        for geometry in tracers.reference_geometries(assets):
            progress(f"bare tracers: {geometry.name}")
            for count in (1, 2):
                report.tracers += tracers.measure(geometry, count, repeats)
        if 13 in wanted:
            report.rows += [tracer_row(rate) for rate in report.tracers if rate.bar is not None]
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
    return arguments


def main(given: Sequence[str] | None = None) -> int:
    arguments = arguments_of(given)
    console = Console()
    if not console.is_terminal:
        # Written to a file: tables keep their columns.
        console = Console(width=130)
    told = Console(stderr=True)
    with told.status("starting") as status:

        def progress(text: str) -> None:
            status.update(text)
            if not told.is_terminal:
                print(text, file=sys.stderr, flush=True)

        report = run_benchmarks(
            arguments.assets, arguments.rows, arguments.repeats,
            threads=arguments.threads, size=arguments.size, places=arguments.places, progress=progress,
        )  # fmt: skip
    show(report, console)
    if arguments.json:
        arguments.json.parent.mkdir(parents=True, exist_ok=True)
        arguments.json.write_text(json.dumps(report.as_json(), indent=2) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
