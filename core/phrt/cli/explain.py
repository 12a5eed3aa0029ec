"""`phrt explain`: why an object was, or was not, ray traced in a frame of a recorded run."""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from phrt.cli.console import print_table, results, warn_of
from phrt.cli.options import DebugOption, JsonOption, PluginOption
from phrt.interfaces.heuristic import NEVER_TRACED

if TYPE_CHECKING:
    from phrt.recording.reasons import Explanation, Items
    from phrt.recording.run import Run

LETTERS = {
    "area": "A",
    "center_closeness": "P",
    "distance": "D",
    "visibility": "V",
    "ray_estimate": "Q",
    "cost": "C",
    "importance_factor": "K",
    "was_selected": "S",
    "persistence": "I",
    "relevance": "R",
}
"""The paper's letters by column."""
BOOKKEEPING = ("step", "frame", "sample", "object", "object_id", "effect", "reason", "chosen", "mandatory")
"""Columns without a meaningful rank; the sentence says what they hold."""


def explain(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A run that `phrt render --record DIR` wrote.")],
    frame: Annotated[int | None, typer.Option(metavar="N", help="Number of the frame.")] = None,
    path: Annotated[
        str | None, typer.Option("--object", metavar="PATH", help="Object: its path, or the end of it if unique.")
    ] = None,
    effect: Annotated[str | None, typer.Option(help="One effect alone, as shadows.")] = None,
    plugin: PluginOption = None,
    as_json: JsonOption = False,
    debug: DebugOption = False,
) -> None:
    """Why an object was or was not traced in a frame. Without --object: every item of the frame, in order. Without --frame:
    how often each item was traced over the run."""
    from phrt.recording import read_run
    from phrt.recording.reasons import explain_object, find_object, frame_items, over_time

    run = read_run(folder)
    if run.cut_short:
        warn_of([f"'{folder}': {run.cut_short}"])
    thing = None if path is None else find_object(run, path)
    if frame is None:
        show_lines([asdict(line) for line in over_time(run, thing, effect)], run, as_json)
    elif thing is None:
        show_frame(run, frame, frame_items(run, frame), effect, as_json)
    else:
        items = frame_items(run, frame)
        show_object(run, frame, thing, items, explain_object(run, frame, thing, effect), as_json)


def show_object(run: Run, frame: int, path: str, items: Items, found: list[Explanation], as_json: bool) -> None:
    """A sentence per effect, and the letters of its items with their ranks."""
    if as_json:
        effects = [
            {"effect": e.effect, "sentence": e.sentence, "item": None if e.item is None else item_row(items, e.item)}
            for e in found
        ]
        print(json.dumps({"frame": frame, "object": path, "effects": effects, "cut_short": run.cut_short}))
        return
    out = results()
    for explanation in found:
        out.print(explanation.sentence, markup=False)
    shown = [explanation for explanation in found if explanation.item is not None]
    if shown:
        count = len(items["object"])
        print_table(letter_table(items, shown, f"rank among {count} items, largest first"))


def letter_table(items: Items, shown: list[Explanation], caption: str) -> Any:
    """A rich table: a row per letter, value and rank per item."""
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE, caption=caption, caption_justify="left")
    table.add_column("")
    table.add_column("value of")
    for explanation in shown:
        table.add_column(explanation.effect, justify="right")
        table.add_column("rank", justify="right", style="dim")
    rows = [item_row(items, int(e.item)) for e in shown if e.item is not None]
    for name in columns(items):
        cells = [cell for row in rows for cell in (number(row[name]["value"]), number(row[name]["rank"]))]
        table.add_row(LETTERS.get(name, ""), name, *cells)
    return table


def columns(items: Items) -> list[str]:
    """The columns of a table of letters: the paper's first, in its order, then the others."""
    others = [name for name in items if name not in LETTERS and name not in BOOKKEEPING]
    return [*(name for name in LETTERS if name in items), *others]


def item_row(items: Items, item: int) -> dict[str, Any]:
    """Everything about an item, as plain data: value and rank of every letter, and the rest as it is."""
    from phrt.recording.reasons import rank

    row: dict[str, Any] = {name: plain(items[name][item]) for name in BOOKKEEPING if name in items}
    for name in columns(items):
        row[name] = {"value": plain(items[name][item]), "rank": rank(items[name], item)}
    return row


def plain(value: Any) -> Any:
    """A numpy value as JSON can hold it; NaN, infinity and NEVER_TRACED are None."""
    value = value.item() if isinstance(value, np.generic) else value
    if value == NEVER_TRACED:
        return None
    return None if isinstance(value, float) and not math.isfinite(value) else value


def number(value: Any) -> str:
    """A table's cell."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else f"{value:,}" if isinstance(value, int) else str(value)


def show_frame(run: Run, frame: int, items: Items, effect: str | None, as_json: bool) -> None:
    """Every item of a frame: those that were asked for in order, then the others by relevance."""
    from phrt.recording.reasons import chosen_effects, known_effects

    wanted = chosen_effects(run, known_effects(run, items), effect)
    shown = [item for item in in_order(items) if items["effect"][item] in wanted]
    rows = [{column: plain(values[item]) for column, values in items.items()} for item in shown]
    about = run.frame(frame)
    if as_json:
        print(json.dumps({"frame": frame, "items": rows, "budget": frame_budget(about), "cut_short": run.cut_short}))
        return
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE)
    for title in ("order", "object", "effect", "why", "pixels", "traced", "R", "predicted", "ms", "rays"):
        table.add_column(title, justify="left" if title in ("object", "effect", "why") else "right", no_wrap=True)
    for row in rows:
        share = f"{row['traced_pixels'] / max(row['pixel_count'], 1):.0%}" if row["chosen"] else ""
        order = str(row["order"] + 1) if row["order"] >= 0 else ""
        why = row["reason"].replace("_", " ") + (" (mandatory)" if row["mandatory"] else "")
        table.add_row(
            order, row["object"], row["effect"], why, f"{row['pixel_count']:,}", share, number(row["relevance"]),
            number(row["predicted_cost"]), f"{row['milliseconds']:.2f}" if row["chosen"] else "",
            f"{row['rays']:,}" if row["chosen"] else "",
        )  # fmt: skip
    results().print(frame_line(about), markup=False)
    print_table(table)


def in_order(items: Items) -> list[int]:
    """Rows of a frame's items: asked for ones by order, then the others, the most relevant first."""
    if not items:
        return []
    order = np.where(items["order"] >= 0, items["order"], np.iinfo(np.int32).max)
    return [int(row) for row in np.lexsort([-items["relevance"], order])]


def frame_budget(about: dict[str, Any]) -> dict[str, Any]:
    """What a frame might take, and what it took."""
    names = (
        "milliseconds",
        "frame_budget",
        "budget",
        "budget_unit",
        "left",
        "ray_ms",
        "overrun_ms",
        "headroom_ms",
        "late",
    )
    return {name: plain(about[name]) for name in names if name in about}


def frame_line(about: dict[str, Any]) -> str:
    """A frame in one line."""
    from phrt.recording.reasons import amount

    text = f"frame {about['frame']}: {about['milliseconds']:.1f} ms, {about['traced']} of {about['candidates']} items traced"
    text += f" by {about['heuristic']}, budget {about['frame_budget']}"
    if about["budget_unit"] != "none":
        unit = about["budget_unit"]
        text += f", {amount(about['left'], unit)} of the ray phase's {amount(about['budget'], unit)} left"
    return text + ("".join(f"\nwarning: {warning}" for warning in about["warnings"]) if about["warnings"] else "")


def show_lines(lines: list[dict[str, Any]], run: Run, as_json: bool) -> None:
    """Items over time."""
    from phrt.recording.run import spans

    if as_json:
        frames = [int(number) for number in run.numbers]
        print(json.dumps({"frames": frames, "items": lines, "faults": run.faults, "cut_short": run.cut_short}))
        return
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE)
    for title in ("object", "effect", "candidate in", "traced in", "whole in", "first", "last", "traced in frames"):
        table.add_column(title, justify="left" if title in ("object", "effect", "traced in frames") else "right")
    for line in lines:
        cells = [number(line[name]) for name in ("frames", "traced", "whole", "first", "last")]
        table.add_row(line["object"], line["effect"], *cells, shortened(line["runs"]))
    results().print(f"{len(run.numbers)} frames recorded: {spans(run.numbers) or 'none'}", markup=False)
    for fault in run.faults:
        where = "" if fault["frame"] is None else f"frame {fault['frame']}: "
        results().print(f"fault: {where}{fault['message']}", markup=False)
    print_table(table)


def shortened(runs: str, most: int = 60) -> str:
    """The beginning of a long list."""
    return runs if len(runs) <= most else runs[:most].rpartition(",")[0] + ", ..."
