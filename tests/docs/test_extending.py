"""The pages for who extends PHRT say what is so."""

from __future__ import annotations

import ast
import re
from pathlib import Path

from phrt import testing
from phrt.cli.template import renamed, template_files

PAGES = Path(__file__).resolve().parents[2] / "docs" / "extending"


def tutorial_heuristic() -> str:
    """The module that the tutorial writes."""
    found = re.search(r"nearest\.py <<'PYTHON'\n(.*?)PYTHON\n", (PAGES / "heuristic.md").read_text(), re.DOTALL)
    assert found
    return found[1]


def test_the_heuristic_of_the_tutorial_is_twenty_lines() -> None:
    lines = [line for line in tutorial_heuristic().splitlines() if line.strip()]
    assert len(lines) <= 20


def test_the_tutorial_s_heuristic_is_the_one_that_phrt_new_writes() -> None:
    (path,) = [path for path in template_files("heuristic") if path.startswith("phrt_")]
    code = ast.parse(renamed({path: template_files("heuristic")[path]}, "heuristic", "nearest")["phrt_nearest.py"])
    own = ast.parse(tutorial_heuristic())
    imports = (ast.Import, ast.ImportFrom)
    assert [ast.unparse(each) for each in own.body if not isinstance(each, imports)] == [
        ast.unparse(each) for each in code.body[1:] if not isinstance(each, imports)
    ]


def test_every_check_is_documented() -> None:
    page = (PAGES / "conformance.md").read_text()
    checks = [name for name in testing.__all__ if name.startswith("check_")]
    assert len(checks) == 5
    assert [name for name in checks if f"| `{name}` |" not in page] == []
