"""`phrt report`: a comparison's folder as one HTML page, or as tables for a paper.

The page opens offline and holds everything: the verdict, leaderboards, figures with their data, pictures side by side. A
run that is not finished gives a page that says so.
Example: `phrt report runs/smoke -o smoke.html`, `phrt report runs/smoke --tables latex`
"""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from phrt.cli.console import DelayedProgress, say, terminal
from phrt.cli.options import DebugOption, JsonOption, PluginOption, QuietOption
from phrt.registry import Options

if TYPE_CHECKING:
    from phrt_plugins.bench.results import BenchRun

SUFFIXES = {"html": (".html", ".htm"), "markdown": (".md", ".markdown", ".txt"), "latex": (".tex", ".txt")}


class Tables(StrEnum):
    """What `--tables` takes."""

    MARKDOWN = "markdown"
    LATEX = "latex"


def make_command(options: Options) -> typer.Typer:
    """The application that becomes `phrt report`."""
    app = typer.Typer(rich_markup_mode=None, add_completion=False)
    app.command("report")(report)
    return app


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="What phrt bench wrote, finished or not.")],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o", "--output", metavar="FILE", help="The page; DIR/report.html. With --tables: standard output."
        ),
    ] = None,
    tables: Annotated[
        Tables | None, typer.Option("--tables", help="Write the leaderboards as tables for a text instead of a page.")
    ] = None,
    plugin: PluginOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    debug: DebugOption = False,
) -> None:
    """Write what a comparison came to: one HTML file that opens without a network, with the verdict, leaderboards, figures (each
    as SVG and CSV too), pictures and the worst frames. What was there before stays until the new file is complete.
    """
    from phrt.output.files import check_output
    from phrt_plugins.bench.results import BenchRun

    target = output or (None if tables else folder / "report.html")
    run = BenchRun.read(folder)
    if target is not None:
        check_output(target, SUFFIXES[tables or "html"])
    if tables is not None:
        write_tables(run, tables, target, as_json)
    elif target is not None:
        write_html(run, target, as_json)


def write_html(run: BenchRun, target: Path, as_json: bool) -> None:
    """The page, and a line about it."""
    from phrt_plugins.report.report import steps_of, write_report

    with DelayedProgress(steps_of(run), f"reading {run.folder}") as progress:
        written = write_report(run, target, progress)
    if as_json:
        print_json(
            {
                "file": str(written.path),
                "bytes": written.bytes,
                "figures": written.figures,
                "pictures": written.pictures,
                "cells": len(run.cells),
                "state": run.state,
                "verdict": written.verdict,
                "notes": list(written.warnings),
                "warnings": terminal.warned,
            }
        )
        return
    say(f"{written.path}: {written.figures} figures, {written.pictures} pictures, {written.bytes / 1e6:.1f} MB")
    for line in (*written.warnings, written.verdict):
        say(f"  {line}")


def write_tables(run: BenchRun, form: Tables, target: Path | None, as_json: bool) -> None:
    """The leaderboards as text, into `target` or onto standard output."""
    from phrt.output.files import complete_file
    from phrt_plugins.report.ranking import tables_of

    with DelayedProgress(1, f"reading {run.folder}"):
        text = tables_of(run, form.value)
    if target is not None:
        with complete_file(target) as temporary:
            temporary.write_text(text, encoding="utf-8", errors="replace")
    if as_json:
        print_json({"file": None if target is None else str(target), "form": form.value, "text": text})
    elif target is None:
        typer.echo(text)
    else:
        say(f"{target}: leaderboards as {form.value}")


def print_json(values: dict[str, Any]) -> None:
    print(json.dumps(values))
