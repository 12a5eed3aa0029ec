"""The pages for who extends PHRT say what is so."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from pathlib import Path

import pytest

from phrt import testing
from phrt.cli.template import renamed, template_files
from phrt.registry import OLDEST_API_VERSION, PLUGIN_API_VERSION, hookspecs
from phrt.registry.manager import KINDS, hook_name

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
    assert len(checks) == 6
    assert [name for name in checks if f"| `{name}` |" not in page] == []


@pytest.mark.parametrize("kind", KINDS)
def test_every_hook_has_a_page_with_its_contract_and_an_example_that_runs(kind: str) -> None:
    """Who calls from which thread, what may be kept, what a failure does; and a file with the hook in it, used by a command."""
    text = (PAGES / f"{kind}.md").read_text()
    assert f"`{hook_name(kind)}` returns `{KINDS[kind].__name__}`s" in text
    for word in ("**Threads", "**Between ", "**When it fails**"):
        assert word in text, word
    examples = re.findall(r"^```bash\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert any(f"def {hook_name(kind)}()" in example for example in examples)
    plugin = next(example for example in examples if f"def {hook_name(kind)}()" in example)
    code = re.search(r"<<'PYTHON'\n(.*?)PYTHON\n", plugin, re.DOTALL)
    assert code
    assert len([line for line in code[1].splitlines() if line.strip()]) <= 60


@pytest.mark.parametrize("kind", KINDS)
def test_every_hook_says_what_it_is_for(kind: str) -> None:
    page = inspect.getdoc(getattr(hookspecs, hook_name(kind)))
    assert page
    assert len(page) > 100
    if kind != "command":
        assert re.search(rf"`phrt\.interfaces\.{kind}\.\w+`", page)


def test_what_is_public_is_there_and_says_its_types() -> None:
    """The modules that the page calls public can be imported; their packages are typed."""
    table = (PAGES.parent / "plugins.md").read_text().partition("## What is public")[2]
    cells = re.findall(r"^\| ([^|]*) \|", table, re.MULTILINE)[2:]
    modules = [name for cell in cells for name in re.findall(r"`([\w.]+?)(?:\.\*)?`", cell)]
    assert {"phrt", "phrt.interfaces", "phrt.registry", "phrt.errors", "phrt.testing", "phrt.tracing"} <= set(modules)
    for name in modules:
        package = importlib.import_module(name.partition(".")[0])
        importlib.import_module(name)
        assert (Path(str(package.__file__)).parent / "py.typed").is_file()


def test_the_policy_names_the_versions_that_hold() -> None:
    text = (PAGES.parent / "plugins.md").read_text()
    assert f"this is version {PLUGIN_API_VERSION}, `phrt.registry.PLUGIN_API_VERSION`" in text
    assert f"`phrt.registry.OLDEST_API_VERSION`, today {OLDEST_API_VERSION};" in text
