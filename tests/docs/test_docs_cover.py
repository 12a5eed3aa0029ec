"""The documentation walks with the code: every hook, heuristic, letter, metric column, command and option of one is in it."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

import cli_tables
import generate
import pytest
import typer

from phrt.interfaces.heuristic import Candidates
from phrt.registry import Plugin, get_registry
from phrt.registry.manager import KINDS, hook_name
from phrt.registry.options import option_rows
from phrt_plugins.bench.config import BenchConfig, HeuristicEntry, PathTraced, SceneEntry

DOCS = Path(__file__).resolve().parents[2] / "docs"
COMMANDS = cli_tables.commands()


def page(name: str) -> str:
    return (DOCS / name).read_text()


def section(name: str, title: str) -> str:
    """The text below heading `title` of a page, up to the next heading."""
    found = re.search(rf"^#+ {re.escape(title)}\n(.*?)(?=^#+ |\Z)", page(name), re.MULTILINE | re.DOTALL)
    assert found, f"{name} has no heading '{title}'"
    return found[1]


@pytest.mark.parametrize(("kind", "descriptor"), KINDS.items())
def test_every_hook_is_documented_with_its_descriptor_and_all_fields(kind: str, descriptor: type[Plugin]) -> None:
    text = section("reference/hooks.md", f"`{hook_name(kind)}`")
    assert f"Returns a list of `{descriptor.__name__}`" in text
    added = {field.name for field in fields(descriptor)} - {field.name for field in fields(Plugin)}
    assert [name for name in added if f"`{name}`" not in text] == []


def test_every_field_of_all_descriptors_is_documented() -> None:
    text = section("reference/hooks.md", "Every descriptor")
    assert [field.name for field in fields(Plugin) if f"- `{field.name}`: " not in text] == []


def test_every_heuristic_is_documented() -> None:
    names = [entry.name for entry in get_registry().plugins("heuristic") if entry.origin == "built-in"]
    assert len(names) == 9
    assert [name for name in names if f"| `{name}` |" not in page("heuristics.md")] == []


def test_every_letter_is_documented() -> None:
    bookkeeping = {"effect_names", "object_id", "effect", "pixel_count", "mandatory", "predicted_cost"}
    letters = [f.name for f in fields(Candidates) if f.name not in bookkeeping]
    assert [name for name in letters if f"| `{name}` |" not in page("heuristics.md")] == []


def test_every_metric_column_is_documented() -> None:
    text = page("metrics.md")
    entries = generate.built_in("metric")
    columns = [column for entry in entries for column in generate.import_factory(entry.name, entry).columns]
    assert len(columns) > 20
    assert [c.name for c in columns if not re.search(rf"^\| `{c.name}` \|.*{re.escape(c.summary)}", text, re.M)] == []


@pytest.mark.parametrize("model", [BenchConfig, SceneEntry, HeuristicEntry, PathTraced])
def test_every_key_of_a_benchmark_is_documented(model: type) -> None:
    rows = option_rows(model)
    assert [row.name for row in rows if not row.meaning] == []
    assert [
        row.name for row in rows if f"| `{row.name}` | {row.default} | {row.meaning} |" not in page("bench.md")
    ] == []


def test_commands_and_subcommands_are_found() -> None:
    assert {"phrt", "phrt render", "phrt bench", "phrt report", "phrt plugins", "phrt plugins show"} <= set(COMMANDS)
    options = {name for row in cli_tables.rows(COMMANDS["phrt render"]) for name in row.names}
    assert {"SCENE", "-o", "--output", "--history", "--no-history", "--plugin"} <= options


@pytest.mark.parametrize("path", COMMANDS)
def test_every_command_is_documented_with_every_argument_and_option(path: str) -> None:
    text = section("command-line.md", path)
    assert f"<!-- generated: {path.replace(' ', '_')} -->" in text
    assert cli_tables.usage(path, COMMANDS[path]) in text
    for row in cli_tables.rows(COMMANDS[path]):
        assert row.meaning, f"{path} {row.names[0]} says nothing of itself"
        typed = ", ".join(f"`{name}`" for name in row.names) + (
            f" `{row.value}`".replace("|", "\\|") if row.value else ""
        )
        default = row.default if row.default in ("", "required") else f"`{row.default}`"
        assert f"| {typed} | {default} | {row.meaning} |" in text


def test_every_command_is_in_the_list_of_commands() -> None:
    text = page("command-line.md")
    assert [path for path in COMMANDS if path != "phrt" and not re.search(rf"^\| `{path}[ `]", text, re.M)] == []


def test_an_option_that_is_not_documented_is_noticed() -> None:
    application = typer.Typer()

    @application.command("render")
    def render(scene: str, quick: bool = False, often: int = 3) -> None:
        """Render."""

    command = typer.main.get_command(application)
    assert [(row.names, row.value, row.default) for row in cli_tables.rows(command)] == [
        (("SCENE",), "", "required"),
        (("--quick", "--no-quick"), "", ""),
        (("--often",), "NUMBER", "3"),
    ]
    assert cli_tables.usage("phrt render", command) == "phrt render SCENE [options]"
    assert "`--often`" not in section("command-line.md", "phrt render")
