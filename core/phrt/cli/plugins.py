"""`phrt plugins`: what there is, where it comes from, whether it runs here, and each one's manual page."""

from __future__ import annotations

import ast
import importlib.util
import json
from pathlib import Path
from typing import Annotated, Any

import typer

from phrt.cli.console import line_width, print_wrapped, results
from phrt.cli.options import DebugOption, JsonOption, PluginOption
from phrt.errors import PluginError, did_you_mean
from phrt.registry.defaults import Defaults
from phrt.registry.manager import KINDS, RegisteredPlugin, get_registry
from phrt.registry.options import option_rows

COLUMNS = ("kind", "name", "origin", "version", "API", "default", "available")
LONGEST_ORIGIN = 20
"""Characters; the end of a longer one is shown, which is a file's name."""
ROOM_FOR_SUMMARY = 40
"""Characters: with less the summaries are left out."""

plugins_app = typer.Typer(rich_markup_mode=None, help="List plugins, or show one.")


@plugins_app.callback(invoke_without_command=True)
def list_plugins(
    context: typer.Context,
    kind: Annotated[str | None, typer.Option("--kind", help=f"Only one of: {', '.join(KINDS)}.")] = None,
    as_json: JsonOption = False,
    plugin: PluginOption = None,
    debug: DebugOption = False,
) -> None:
    """List plugins with origin, version and plugin API, whether they run here or exactly why not, and what is used when none is
    named and why; `show NAME` for one."""
    if context.invoked_subcommand is not None:
        return
    registry = get_registry()
    entries, defaults = registry.plugins(kind), Defaults.find(registry)
    rows = [describe_plugin(entry, defaults) for entry in entries]
    broken = [str(each) for each in registry.broken]
    if as_json:
        print(json.dumps({"plugins": rows, "defaults": defaults.as_json(), "broken": broken}, indent=2))
        return
    print_rows(rows)
    print_section("Not available here", [f"{r['kind']} {r['name']}: {r['reason']}" for r in rows if r["reason"]])
    print_section("Used when no other is named", defaults.lines(None if kind is None else {kind}))
    print_section("Left out", broken)


@plugins_app.command("show")
def show_plugin(
    name: Annotated[str, typer.Argument(help="Its name, or KIND/NAME where a name is used twice.")],
    as_json: JsonOption = False,
    plugin: PluginOption = None,
    debug: DebugOption = False,
) -> None:
    """Show a plugin's manual page, and every option with its default, range and unit."""
    entry = find_by_name(name)
    about = describe_plugin(entry, Defaults.find(get_registry()))
    page, options = manual_page(entry), option_rows(entry.plugin.options)
    if as_json:
        listed = [vars(row) for row in options]
        print(json.dumps(about | {"factory": entry.plugin.factory, "page": page, "options": listed}, indent=2))
        return
    out = results()
    version = "" if entry.origin != "built-in" else f" {entry.version}"
    title = f"{entry.kind} {entry.name}, {entry.source}{version}, plugin API {entry.plugin.api_version}"
    out.print(title, style="bold", markup=False)
    print_wrapped(entry.plugin.summary)
    print_wrapped("available: " + ("yes" if about["available"] else f"no: {about['reason']}"))
    print_wrapped("default: " + (about["default_reason"] or "no, it is used where it is named"))
    for paragraph in page.split("\n\n") if page else ():
        out.print("")
        print_paragraph(paragraph)
    out.print("\nOptions:" if options else "\nOptions: none", markup=False)
    for row in options:
        value = " ".join(filter(None, (row.default, row.unit)))
        print_wrapped(f"  {row.name} = {value}    {row.allowed}", "      ")
        print_wrapped(f"      {row.meaning}", "      ")


def print_paragraph(text: str) -> None:
    """A paragraph of a manual page: its words flow, but lists and what is indented keep their lines."""
    lines = text.splitlines()
    if line_width() is not None and not any(line.startswith((" ", "-", "|")) for line in lines):
        lines = [" ".join(lines)]
    for line in lines:
        print_wrapped(line, " " * (len(line) - len(line.lstrip()) + 2 * line.lstrip().startswith("-")))


def print_rows(rows: list[dict[str, Any]]) -> None:
    """A line a plugin, with its summary where there is room for it."""
    cells = [COLUMNS, *(row_cells(row) for row in rows)]
    widths = [max(len(line[column]) for line in cells) for column in range(len(COLUMNS))]
    used = sum(widths) + 2 * len(widths)
    width = line_width()
    summaries = ["what it is", *(row["summary"] for row in rows)]
    for number, (line, summary) in enumerate(zip(cells, summaries, strict=True)):
        text = "  ".join(cell.ljust(wide) for cell, wide in zip(line, widths, strict=True))
        if width is None:
            text += f"  {summary}"
        elif width - used >= ROOM_FOR_SUMMARY:
            text += "  " + shortened(summary, width - used)
        results().print(text.rstrip(), markup=False, style=None if number else "bold")


def row_cells(row: dict[str, Any]) -> tuple[str, ...]:
    """The cells of a plugin's line, by COLUMNS."""
    origin = "built-in" if row["origin"] == "built-in" else row["owner"]
    if len(origin) > LONGEST_ORIGIN:
        origin = "..." + origin[3 - LONGEST_ORIGIN :]
    used = "yes" if row["default"] and row["kind"] == "loader" else row["default"]
    available = "yes" if row["available"] else "no"
    return row["kind"], row["name"], origin, row["version"], str(row["api_version"]), used, available


def shortened(text: str, width: int) -> str:
    return text if len(text) <= width else text[: width - 3].rstrip() + "..."


def print_section(title: str, lines: list[str]) -> None:
    """Lines under a title; nothing where there are none."""
    if lines:
        results().print(f"\n{title}:", style="bold", markup=False)
        for line in lines:
            print_wrapped(f"  {line}", "      ")


def find_by_name(name: str) -> RegisteredPlugin:
    """The plugin called NAME or KIND/NAME. Raises PluginError when there is none, or several, or it could not be loaded."""
    registry = get_registry()
    kind, slash, rest = name.partition("/")
    if slash:
        return registry.find(kind, rest)
    found = [entry for entry in registry.plugins() if entry.name == name]
    if len(found) == 1:
        return found[0]
    if found:
        raise PluginError(f"'{name}' is ambiguous: use one of {', '.join(f'{e.kind}/{e.name}' for e in found)}")
    if cause := registry.why_lost(name):
        raise PluginError(cause)
    known = [entry.name for entry in registry.plugins()]
    raise PluginError(f"there is no plugin '{name}'. Known: {', '.join(known)}.{did_you_mean(name, known)}")


def describe_plugin(entry: RegisteredPlugin, defaults: Defaults) -> dict[str, Any]:
    """One plugin as plain data. default: when it is used without being named: always ("yes"), by `auto` here, or the endings of the
    files that it reads; empty if never."""
    reason = entry.unavailable_reason()
    return {
        "kind": entry.kind,
        "name": entry.name,
        "summary": entry.plugin.summary,
        "origin": entry.origin,
        "owner": entry.owner,
        "version": entry.version,
        "api_version": entry.plugin.api_version,
        "default": defaults.use_of(entry),
        "default_reason": defaults.reason_of(entry),
        "available": reason is None,
        "reason": reason,
    }


def manual_page(entry: RegisteredPlugin) -> str:
    """The docstring on top of the plugin's file, read without importing it; empty when there is none, or it cannot be found out."""
    try:
        spec = importlib.util.find_spec(entry.plugin.factory.partition(":")[0])
        if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
            return ""
        return ast.get_docstring(ast.parse(Path(spec.origin).read_text(encoding="utf-8"))) or ""
    except (Exception, SystemExit):
        # To find a module its package is imported, and that may do anything.
        return ""
