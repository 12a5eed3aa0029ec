"""From a benchmark's folder to what the page shows. One contestant's tables are in memory at a time, and of those one block."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from phrt_plugins.bench.plan import ALL_TRACE_NAME
from phrt_plugins.bench.results import BenchRun, Cell
from phrt_plugins.bench.summary import clock_text
from phrt_plugins.report import costs, timelines, traces
from phrt_plugins.report.boards import Board
from phrt_plugins.report.costs import CostMaker, predictions
from phrt_plugins.report.drawing import Look, Plot
from phrt_plugins.report.figures import error_against, shares
from phrt_plugins.report.model import Entry
from phrt_plugins.report.pictures import Frame
from phrt_plugins.report.share_traces import share_traces
from phrt_plugins.report.timelines import Item, StripMaker, most_important, time_lines
from phrt_plugins.report.traces import Trace, axis_of, frame_times, trace_of
from phrt_plugins.report.worst import Worst

Advance = Callable[[], None]
"""Called once per step that is done."""


@dataclass
class Setup:
    """A section of the page: one scene, size, tracer, G-buffer and clock. id: of its first setup; key: for ids and file names;
    cells: the first repeat of every contestant under every budget."""

    id: str
    key: str
    name: str
    about: str
    cells: list[Cell]
    boards: list[Board] = field(default_factory=list)
    errors: list[Plot] = field(default_factory=list)
    oracle: list[Plot] = field(default_factory=list)
    times: list[Plot] = field(default_factory=list)
    lines: list[Plot] = field(default_factory=list)
    costs: list[Plot] = field(default_factory=list)
    frames: list[Frame] = field(default_factory=list)
    worst: list[Worst] = field(default_factory=list)

    @property
    def budgets(self) -> list[str]:
        return list(dict.fromkeys(cell.budget for cell in self.cells))


def setups_of(run: BenchRun) -> list[Setup]:
    """The run's setups, without a figure yet. Those that are compared with each other, as they differ in effects only, are one."""
    budgets = planned_budgets(run)
    found = []
    for number, id in enumerate(planned_contests(run)):
        cells = [cell for cell in run.cells if run.contest(cell.setup) == id]
        first = {cell.group: cell for cell in sorted(cells, key=lambda cell: -cell.repeat)}
        kept = sorted((c for c in cells if first[c.group] is c), key=lambda cell: budgets.index(cell.budget))
        found.append(Setup(id, f"{number + 1}-{slug(id)}", cells[0].scene, about_setup(cells[0]), kept))
    return found


def planned_contests(run: BenchRun) -> list[str]:
    """Contests in the order in which the plan has their setups."""
    plan = about(run, "plan").get("setups") or ()
    planned = [str(entry["id"]) for entry in plan if isinstance(entry, dict) and "id" in entry]
    used = list(dict.fromkeys(run.contest(cell.setup) for cell in run.cells))
    return sorted(used, key=lambda id: planned.index(id) if id in planned else len(planned))


def planned_budgets(run: BenchRun) -> list[str]:
    """Budgets in the order in which the config has them."""
    given = [str(budget) for budget in run.config.get("budgets") or ()]
    used = list(dict.fromkeys(cell.budget for cell in run.cells))
    return [*(budget for budget in given if budget in used), *(budget for budget in used if budget not in given)]


def about_setup(cell: Cell) -> str:
    width, height = cell.size
    return f"{width}x{height}, {cell.tracer}, {cell.gbuffer}, {clock_name(cell.clock)}"


def clock_name(clock: Any) -> str:
    """ "wall clock", or the price of a ray."""
    name = clock_text(clock)
    return "wall clock" if name == "wall" else name


def slug(text: str) -> str:
    """Letters, digits and dashes: for ids and names of files."""
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")[:60] or "x"


def summary_figures(setup: Setup, entries: Sequence[Entry], main: str, better: str, looks: Mapping[str, Look]) -> None:
    """Error against time and rays, and shares of the oracle."""
    by = "" if clock_name(setup.cells[0].clock) == "wall clock" else " of the clock of rays"
    axes = {"frame_ms_p50": f"time of a frame, median ms{by}", "rays": "rays of a frame, mean"}
    for cost, axis in axes.items():
        plot = error_against(
            f"error-{cost.partition('_')[0]}-{setup.key}", entries, (main, better), (cost, axis), looks
        )
        setup.errors += [plot] if plot else []
    plot = shares(f"oracle-{setup.key}", entries, looks)
    setup.oracle += [plot] if plot else []


def share_figures(setup: Setup, rows: Sequence[Mapping[str, Any]], looks: Mapping[str, Look]) -> None:
    """Shares of what was possible by frame; rows: of shares.parquet, of the setup's contest."""
    for budget in setup.budgets:
        mine = [row for row in rows if row["budget"] == budget]
        setup.oracle += filter(None, [share_traces(f"shares-{slug(budget)}-{setup.key}", budget, mine, looks)])


def frame_figures(run: BenchRun, setup: Setup, looks: Mapping[str, Look], advance: Advance) -> None:
    """Frame times, time lines and predicted costs: what is read frame by frame."""
    items, order = important_items(run, setup)
    contestants = []
    for budget in setup.budgets:
        cells = [cell for cell in setup.cells if cell.budget == budget and cell.blocks]
        drawn, strips = [], []
        for cell in cells:
            frames = run.frames(cell, traces.COLUMNS)
            drawn.append(trace_of(cell.label, cell.budget_kind, frames))
            strip, cost = from_candidates(run, cell, items, drawn[-1])
            strips.append(strip.strip())
            contestants.append(cost.costs())
            advance()
        if not cells:
            continue
        axis = axis_of(cells[0].budget_kind, "wall" if clock_name(cells[0].clock) == "wall clock" else "rays")
        key = f"{slug(budget)}-{setup.key}"
        setup.times += filter(None, [frame_times(f"times-{key}", budget, axis, drawn, looks)])
        setup.lines += filter(None, [time_lines(f"lines-{key}", budget, order, items, strips)])
    setup.costs += filter(None, [predictions(f"costs-{setup.key}", contestants, looks)])


def from_candidates(run: BenchRun, cell: Cell, items: Sequence[Item], trace: Trace) -> tuple[StripMaker, CostMaker]:
    """A cell's candidates, read once, block by block."""
    strip = StripMaker(cell.label, items, trace.frame)
    cost = CostMaker(cell.label, cell.budget)
    columns = list(dict.fromkeys((*timelines.COLUMNS, *costs.COLUMNS)))
    for _, table in run.candidate_blocks(cell, columns):
        if table.num_rows:
            strip.add(table)
            cost.add(table)
    return strip, cost


def important_items(run: BenchRun, setup: Setup) -> tuple[list[Item], str]:
    """The rows of a setup's time lines, and by what they were chosen: the oracle's benefit; the relevance that the first contestant
    gave them, where there was no oracle."""
    truth = run.oracle_items(setup.id, ["object", "effect", "benefit"])
    if truth.num_rows:
        return most_important([encoded(truth)], "benefit"), "by the oracle's benefit"
    begun = [cell for cell in setup.cells if cell.blocks]
    tables: Iterable[Any] = ()
    if begun:
        wanted = ("object", "effect", "relevance")
        tables = (table for _, table in run.candidate_blocks(begun[0], wanted) if table.num_rows)
    return most_important(tables, "relevance"), f"by {begun[0].label}'s R" if begun else ""


def encoded(table: Any) -> Any:
    """`table` with `object` and `effect` as dictionaries of text."""
    for name in ("object", "effect"):
        column = table.column(name)
        if not str(column.type).startswith("dictionary"):
            place = table.schema.get_field_index(name)
            table = table.set_column(place, name, column.dictionary_encode())
    return table


def progress_of(run: BenchRun) -> tuple[int, int]:
    """Blocks that are there, and blocks that were planned, of cells that did not fail."""
    cells = [cell for cell in run.cells if cell.failure is None]
    return sum(len(cell.blocks) for cell in cells), sum(max(cell.planned_blocks, len(cell.blocks)) for cell in cells)


def warnings_of(run: BenchRun) -> list[str]:
    """What a reader must know before anything else."""
    lines = []
    done, planned = progress_of(run)
    if run.state != "finished" or done < planned:
        state = {"running": "still running, or was ended", "finished": "finished, but not whole"}.get(
            run.state, run.state
        )
        lines.append(
            f"This comparison is {state}: {done} of {planned} blocks are there. Everything below may still change."
        )
    failed = [cell for cell in run.cells if cell.failure is not None]
    if failed:
        named = ", ".join(dict.fromkeys(f"{cell.label} under {cell.budget}" for cell in failed[:5]))
        more = f" and {len(failed) - 5} more" if len(failed) > 5 else ""
        lines.append(f"{len(failed)} of {len(run.cells)} cells failed: {named}{more}. The reasons are at the end.")
    return lines


def facts_of(run: BenchRun) -> list[tuple[str, str]]:
    """The comparison in a few words."""
    scene_of = {run.contest(cell.setup): cell.scene for cell in run.cells}
    scenes = dict.fromkeys(scene_of[contest] for contest in planned_contests(run))
    facts = [
        ("Scenes", ", ".join(scenes)),
        ("Contestants", str(len(dict.fromkeys(cell.label for cell in run.cells)))),
        ("Budgets", ", ".join(planned_budgets(run))),
        ("Reference", "" if run.reference_name == ALL_TRACE_NAME else run.reference_name),
        ("Repeats", str(1 + max((cell.repeat for cell in run.cells), default=0))),
        ("Cells", f"{sum(cell.state == 'ok' for cell in run.cells)} of {len(run.cells)} whole"),
        ("Machine", str(about(run, "machine").get("cpu") or "unknown")),
        ("Started", str(run.about.get("started") or "unknown").replace("T", " ")[:16]),
    ]
    return [(name, value) for name, value in facts if value]


def about(run: BenchRun, name: str) -> dict[str, Any]:
    """A mapping of bench.json; empty where it is none."""
    found = run.about.get(name)
    return found if isinstance(found, dict) else {}


def said_of_machine(run: BenchRun) -> list[tuple[str, str]]:
    names = {"cpu": "Processor", "cores": "Cores used", "memory_gb": "Memory, GB", "system": "System"}
    return [(names.get(name, name), str(value)) for name, value in about(run, "machine").items()]


def said_of_versions(run: BenchRun) -> list[tuple[str, str]]:
    return [(name, str(value or "not installed")) for name, value in about(run, "versions").items()]


def said_of_config(run: BenchRun) -> str:
    """The config as it was given; as it was understood, where the file is gone."""
    try:
        return (run.folder / "config.yaml").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return json.dumps(run.config, indent=2)


def said_of_contestants(cells: Sequence[Cell]) -> str:
    """One paragraph per label: what it is and with which options."""
    names = ("heuristic", "options", "persistence", "cost_model", "group_by", "history")
    found = {cell.label: {name: getattr(cell, name) for name in names} for cell in cells}
    return "\n".join(f"{label}: {json.dumps(values, default=str)}" for label, values in found.items())
