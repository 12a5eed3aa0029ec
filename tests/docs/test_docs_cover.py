"""The documentation walks with the code: every hook, descriptor, error and command is in it."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import pytest

from phrt import errors
from phrt.cli.main import app
from phrt.interfaces.heuristic import Candidates
from phrt.registry import get_registry
from phrt.registry.manager import KINDS, hook_name

PROJECT = Path(__file__).resolve().parents[2]
PLUGINS_PAGE = (PROJECT / "docs" / "plugins.md").read_text()


@pytest.mark.parametrize(("kind", "descriptor"), KINDS.items())
def test_every_hook_is_documented(kind: str, descriptor: type) -> None:
    assert f"| `{hook_name(kind)}` | `{descriptor.__name__}` |" in PLUGINS_PAGE


def test_every_heuristic_is_documented() -> None:
    page = (PROJECT / "docs" / "heuristics.md").read_text()
    names = [entry.name for entry in get_registry().plugins("heuristic") if entry.origin == "built-in"]
    assert len(names) == 9
    assert [name for name in names if f"| `{name}` |" not in page] == []


def test_every_letter_is_documented() -> None:
    page = (PROJECT / "docs" / "heuristics.md").read_text()
    bookkeeping = {"effect_names", "object_id", "effect", "pixel_count", "mandatory", "predicted_cost"}
    letters = [f.name for f in fields(Candidates) if f.name not in bookkeeping]
    assert [name for name in letters if f"| `{name}` |" not in page] == []


@pytest.mark.parametrize(
    "name", [n for n, e in vars(errors).items() if isinstance(e, type) and issubclass(e, (Exception, Warning))]
)
def test_every_error_is_documented(name: str) -> None:
    assert f"| `{name}` |" in PLUGINS_PAGE


def test_every_command_is_documented() -> None:
    pages = "\n".join(path.read_text() for path in [PROJECT / "README.md", *(PROJECT / "docs").rglob("*.md")])
    names = [str(c.name) for c in app.registered_commands] + [str(g.name) for g in app.registered_groups]
    assert len(names) == 7
    assert [name for name in names if f"phrt {name}" not in pages] == []
