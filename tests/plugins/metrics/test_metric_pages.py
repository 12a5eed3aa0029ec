"""docs/metrics.md and the manual pages name every metric and every column."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from phrt.cli import main as cli
from phrt.cli.plugins import manual_page
from phrt.registry import get_registry
from phrt.registry.manager import RegisteredPlugin, import_factory

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "metrics.md").read_text()
BY_HAND = re.sub(r"<!-- generated.*?<!-- end -->", "", PAGE, flags=re.DOTALL)
METRICS = [entry for entry in get_registry().plugins("metric") if entry.origin == "built-in"]


def columns_of(entry: RegisteredPlugin) -> list[str]:
    return [column.name for column in import_factory(entry.name, entry).columns]  # type: ignore[attr-defined]


def test_there_are_metrics() -> None:
    assert len(METRICS) == 9
    assert all(columns_of(entry) for entry in METRICS)


@pytest.mark.parametrize("entry", METRICS, ids=lambda entry: entry.name)
def test_every_metric_and_column_is_in_the_page(entry: RegisteredPlugin) -> None:
    assert f"**{entry.name}**" in BY_HAND
    assert [name for name in columns_of(entry) if f"| `{name}` | `{entry.name}` |" not in PAGE] == []


def test_every_column_is_explained_by_hand() -> None:
    named = {entry.name for entry in METRICS}
    names = {name.removesuffix("_changeable") for entry in METRICS for name in columns_of(entry)} - named
    assert [name for name in sorted(names) if f"`{name}`" not in BY_HAND] == []


@pytest.mark.parametrize("entry", METRICS, ids=lambda entry: entry.name)
def test_every_column_is_in_the_manual_page(entry: RegisteredPlugin) -> None:
    page = manual_page(entry)
    assert page.startswith(f"{entry.name}: ")
    assert [name for name in columns_of(entry) if not re.search(rf"\b{name}\b", page)] == []
    assert re.findall(r"^(Columns|Options|Source|Example)\b", page, re.MULTILINE) == [
        "Columns", "Options", "Source", "Example",
    ]  # fmt: skip


def test_every_column_says_what_it_means() -> None:
    columns = [column for entry in METRICS for column in import_factory(entry.name, entry).columns]  # type: ignore[attr-defined]
    assert [column.name for column in columns if len(column.summary) < 15 or column.summary.endswith(".")] == []


def test_the_command_line_lists_and_explains_metrics(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["plugins", "--kind", "metric"]) == 0
    listed = capsys.readouterr().out
    assert [entry.name for entry in METRICS if not re.search(rf"^metric +{entry.name} ", listed, re.MULTILINE)] == []
    assert cli.run(["plugins", "show", "flip"]) == 0
    shown = capsys.readouterr().out
    assert "flip_p95" in shown
    assert "pixels_per_degree = 67.020643" in shown
