"""`phrt plugins`: what there is, where it comes from, whether it runs here, and each one's manual page."""

from __future__ import annotations

import ast
import importlib.util
import json
from typing import Annotated, Any

import typer

from phrt.cli.console import results
from phrt.cli.options import DebugOption, JsonOption, PluginOption
from phrt.errors import PluginError, did_you_mean
from phrt.registry.manager import KINDS, RegisteredPlugin, get_registry
from phrt.registry.options import option_rows

plugins_app = typer.Typer(rich_markup_mode=None, help="List plugins, or show one.")


@plugins_app.callback(invoke_without_command=True)
def list_plugins(
    context: typer.Context,
    kind: Annotated[str | None, typer.Option("--kind", help=f"Only one of: {', '.join(KINDS)}.")] = None,
    as_json: JsonOption = False,
    plugin: PluginOption = None,
    debug: DebugOption = False,
) -> None:
    """List plugins with their origin, and whether they run here or exactly why not; `show NAME` for one."""
    if context.invoked_subcommand is not None:
        return
    rows = [describe_plugin(entry) for entry in get_registry().plugins(kind)]
    if as_json:
        print(json.dumps({"plugins": rows, "broken": [str(each) for each in get_registry().broken]}, indent=2))
        return
    columns = ("kind", "name", "origin", "default", "available")
    lines = [columns, *((*(row[c] for c in columns[:4]), availability(row["reason"])) for row in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(4)]
    for line in lines:
        text = "  ".join([*(cell.ljust(width) for cell, width in zip(line, widths, strict=False)), line[4]])
        results().print(text, markup=False, style="bold" if line is columns else None)


@plugins_app.command("show")
def show_plugin(
    name: Annotated[str, typer.Argument(help="Its name, or KIND/NAME where a name is used twice.")],
    plugin: PluginOption = None,
    debug: DebugOption = False,
) -> None:
    """Show a plugin's manual page and all its options."""
    entry = find_by_name(name)
    out = results()
    out.print(f"{entry.kind} {entry.name}, {entry.source}", style="bold", markup=False)
    out.print(entry.plugin.summary, markup=False)
    reason = entry.unavailable_reason()
    out.print(f"available: {availability(reason)}", markup=False)
    if page := manual_page(entry):
        out.print(f"\n{page}", markup=False)
    out.print("\nOptions:" if entry.plugin.options.model_fields else "\nOptions: none", markup=False)
    for row in option_rows(entry.plugin.options):
        out.print(f"  {row.name} = {row.default}    {row.allowed}\n      {row.meaning}", markup=False)


def find_by_name(name: str) -> RegisteredPlugin:
    """The plugin called NAME or KIND/NAME. Raises PluginError when there is none, or several."""
    registry = get_registry()
    kind, slash, rest = name.partition("/")
    if slash:
        return registry.find(kind, rest)
    found = [entry for entry in registry.plugins() if entry.name == name]
    if len(found) == 1:
        return found[0]
    if found:
        raise PluginError(f"'{name}' is ambiguous: use one of {', '.join(f'{e.kind}/{e.name}' for e in found)}")
    known = [entry.name for entry in registry.plugins()]
    raise PluginError(f"there is no plugin '{name}'. Known: {', '.join(known)}.{did_you_mean(name, known)}")


def describe_plugin(entry: RegisteredPlugin) -> dict[str, Any]:
    """One row of the table, as plain data."""
    reason = entry.unavailable_reason()
    return {
        "kind": entry.kind,
        "name": entry.name,
        "summary": entry.plugin.summary,
        "origin": entry.source,
        "owner": entry.owner,
        "default": default_use(entry),
        "available": reason is None,
        "reason": reason,
    }


def availability(reason: str | None) -> str:
    return "yes" if reason is None else f"no: {reason}"


def default_use(entry: RegisteredPlugin) -> str:
    """When it is used without being asked for: always, by `auto` here, for some files; empty if never."""
    from phrt.registry.auto import DEFAULT_EFFECTS, DEFAULT_HEURISTIC, choose_gbuffer, choose_tracer

    if entry.kind == "tracer":
        return "auto" if choose_tracer().name == entry.name else ""
    if entry.kind == "gbuffer":
        return "auto" if choose_gbuffer().name == entry.name else ""
    if entry.kind == "effect":
        return "yes" if entry.name in DEFAULT_EFFECTS else ""
    if entry.kind == "heuristic":
        return "yes" if entry.name == DEFAULT_HEURISTIC else ""
    return " ".join(getattr(entry.plugin, "suffixes", ()))


def manual_page(entry: RegisteredPlugin) -> str:
    """The docstring on top of the plugin's file, read without importing it; empty when there is none."""
    try:
        module = entry.plugin.factory.partition(":")[0]
        spec = importlib.util.find_spec(module)
        get_source = getattr(spec.loader if spec else None, "get_source", None)
        source = get_source(module) if get_source else None
        return ast.get_docstring(ast.parse(source)) or "" if source else ""
    except (ImportError, ValueError, SyntaxError):
        return ""
