"""`phrt bench`: compares heuristics as a config says, and writes everything into a folder.

Everything in the config is compared with everything: scenes, sizes, budgets, heuristics, tracers, G-buffers. Frames are judged
against full tracing and against an oracle; --resume goes on where a run was stopped. docs/bench.md has every key.
Example: `phrt bench scenes/benchmarks/smoke.yaml -o runs/smoke && phrt report runs/smoke`
"""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from phrt.cli.console import DelayedProgress, print_table, say, terminal
from phrt.cli.options import DebugOption, JsonOption, PluginOption, QuietOption, StrictOption, check_plugins
from phrt.errors import OptionError
from phrt.registry.descriptors import Options


def make_command(options: Options) -> typer.Typer:
    """The application that becomes `phrt bench`."""
    app = typer.Typer(rich_markup_mode=None, add_completion=False)
    app.command("bench")(bench)
    return app


def bench(
    config: Annotated[
        Path, typer.Argument(metavar="CONFIG", help="What to compare (.yaml); docs/bench.md has every key.")
    ],
    output: Annotated[
        Path | None, typer.Option("-o", "--output", metavar="DIR", help="Folder for everything that comes of it.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with what is in DIR; finished blocks stay.")] = False,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="With --resume: try cells again that failed.")
    ] = False,
    dry_run: Annotated[
        bool,
        typer.Option("--dry-run", help="Check everything, show the cells and the time they will take; write nothing."),
    ] = False,
    executor: Annotated[
        str, typer.Option(metavar="WHERE", help="Where tasks run: local, or dask://host:port, an existing cluster.")
    ] = "local",
    jobs: Annotated[
        int | None, typer.Option(metavar="N", help="Tasks at a time; those that measure time run one at a time.")
    ] = None,
    cache: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where references are kept; by default PHRT_CACHE/references.")
    ] = None,
    frames: Annotated[str | None, typer.Option(metavar="A:B", help="These frames of every scene.")] = None,
    change: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Change the config, as repeats=3. Repeatable."),
    ] = None,
    strict: StrictOption = False,
    plugin: PluginOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Compare heuristics as CONFIG says, and write pictures, decisions and measures into DIR."""
    if jobs is not None and not 1 <= jobs <= 1024:
        raise OptionError(f"--jobs is {jobs}, allowed: 1 to 1024")
    if retry_failed and not resume:
        raise OptionError("--retry-failed is for --resume, which was not given")
    check_plugins(strict)
    if output is None and not dry_run:
        raise OptionError("nothing says where to: -o DIR, or --dry-run")

    from phrt_plugins.bench.checks import checked_plan, plugin_source
    from phrt_plugins.bench.estimate import Estimate
    from phrt_plugins.bench.reading import read_config, with_frames
    from phrt_plugins.bench.references import default_cache
    from phrt_plugins.bench.run import run_bench
    from phrt_plugins.bench.worker import Work

    file = read_config(config, change or ())
    if frames is not None:
        file = with_frames(file, frames)
    with DelayedProgress(1, "loading scenes"):
        plan = checked_plan(file)
    kept = (cache or default_cache()).absolute()
    estimate = None if quiet and not dry_run else Estimate(plan, kept, file.config.metrics)
    if dry_run:
        show_plan(plan, estimate, as_json)
        return
    assert output is not None
    sources = [plugin_source(source, file.folder) for source in file.config.plugins]
    sources += [plugin_source(source, Path.cwd()) for source in terminal.plugins]
    metrics = None if file.config.metrics is None else tuple(file.config.metrics)
    work = Work(str(output.absolute()), str(kept), metrics, tuple(dict.fromkeys(sources)), strict=strict)
    outcome = run_bench(
        file, plan, work, resume=resume, retry_failed=retry_failed, executor=executor, jobs=jobs, estimate=estimate
    )
    report(output, outcome, as_json)
    if outcome.failures or outcome.problems:
        raise typer.Exit(1)


def show_plan(plan: Any, estimate: Any, as_json: bool) -> None:
    """The cells, and how long everything will take."""
    from phrt_plugins.bench.estimate import spoken
    from phrt_plugins.bench.plan import ALL_TRACE_NAME, STAGES

    tasks = [task for stage in STAGES for task in plan.tasks(stage)]
    estimate.measure(tasks)
    total = estimate.total(tasks)
    setups = {setup.id: setup for setup in plan.setups}
    rows = []
    for cell in plan.cells:
        setup = setups[cell.setup]
        cost = estimate.cost(setup)
        counted = setup.path.count + len(setup.blocks()) * setup.warm_up
        seconds = counted * cost.frame(cell, setup) if cost else None
        rows.append(cell.settings() | {"frames": setup.path.count, "blocks": len(setup.blocks()), "seconds": seconds})
    reference = plan.setups[0].reference
    judge = ALL_TRACE_NAME if reference is None else reference.name
    if as_json:
        warned = terminal.warned
        said = {"cells": rows, "tasks": len(tasks), "seconds": round(total, 1), "reference": judge}
        print(json.dumps(said | {"warnings": warned}))
        return
    title = f"{len(rows)} cells, {sum(row['frames'] for row in rows)} frames, about {spoken(total)}"
    table = Table(title=title if reference is None else f"{title}, judged by {judge}")
    for name in (
        "scene",
        "size",
        "tracer",
        "gbuffer",
        "budget",
        "heuristic",
        "repeats",
        "frames",
        "blocks",
        "rendering",
    ):
        table.add_column(name, justify="right" if name in ("repeats", "frames", "blocks", "rendering") else "left")
    names = ("setup", "scene", "size", "tracer", "gbuffer", "budget", "label")
    repeats = Counter(tuple(str(row[name]) for name in names) for row in rows)
    for row in rows:
        if row["repeat"] == 0:
            key = tuple(str(row[name]) for name in names)
            took = "?" if row["seconds"] is None else spoken(row["seconds"] * repeats[key])
            size = "x".join(map(str, row["size"]))
            table.add_row(
                row["scene"], size, row["tracer"], row["gbuffer"], row["budget"], row["label"], str(repeats[key]),
                str(row["frames"]), str(row["blocks"]), took,
            )  # fmt: skip
    print_table(table)


def report(folder: Path, outcome: Any, as_json: bool) -> None:
    """What came of it: one JSON object, or the leaderboard and what failed."""
    if as_json:
        said = {"folder": str(folder), "cells": outcome.cells, "failed": outcome.failures, "problems": outcome.problems}
        print(json.dumps(said | {"time": outcome.time, "verdict": outcome.verdict, "warnings": terminal.warned}))
        return
    if outcome.leaderboard:
        print(outcome.leaderboard)
    if outcome.verdict:
        print(outcome.verdict)
    for cell, failure in outcome.failures.items():
        say(f"failed: {cell}: {failure['reason']}")
    for problem in outcome.problems:
        say(f"failed: {problem['stage']} of {problem['setup']}: {problem['reason']}")
    done = len(outcome.cells) - len(outcome.failures)
    say(f"{folder}: {done} of {len(outcome.cells)} cells done, {outcome.time['wall_s']:.0f} s")
