"""The documentation walks with the code: every hook, descriptor, error and command is in it."""

from __future__ import annotations

from pathlib import Path

import pytest

from phrt import errors
from phrt.cli.main import app
from phrt.registry.manager import KINDS, hook_name

PROJECT = Path(__file__).resolve().parents[2]
PLUGINS_PAGE = (PROJECT / "docs" / "plugins.md").read_text()


@pytest.mark.parametrize(("kind", "descriptor"), KINDS.items())
def test_every_hook_is_documented(kind: str, descriptor: type) -> None:
    assert f"| `{hook_name(kind)}` | `{descriptor.__name__}` |" in PLUGINS_PAGE


@pytest.mark.parametrize(
    "name", [n for n, e in vars(errors).items() if isinstance(e, type) and issubclass(e, (Exception, Warning))]
)
def test_every_error_is_documented(name: str) -> None:
    assert f"| `{name}` |" in PLUGINS_PAGE


def test_every_command_is_documented() -> None:
    pages = "\n".join(path.read_text() for path in [PROJECT / "README.md", *(PROJECT / "docs").rglob("*.md")])
    names = [str(c.name) for c in app.registered_commands] + [str(g.name) for g in app.registered_groups]
    assert len(names) == 4
    assert [name for name in names if f"phrt {name}" not in pages] == []
