"""`phrt plugins`: readable at any width, complete as JSON, and never the one that fails."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from cli_kit import phrt
from pydantic import Field

from phrt.cli import console
from phrt.cli import plugins as page
from phrt.registry import HeuristicPlugin, Options, TracerPlugin, get_registry, register
from phrt.registry.manager import BrokenPlugin

REASON = "it needs libfoo, which is not installed: apt-get install libfoo1, and a processor with vectors of sixty-four numbers"


class KnobOptions(Options):
    radius: float = Field(1.5, gt=0.0, json_schema_extra={"unit": "metres"}, description="how far " + "it looks " * 12)
    mode: str = Field(description="what it does")


@pytest.fixture
def two_more() -> Iterator[None]:
    """A heuristic with options, and a tracer that cannot run here."""
    register(HeuristicPlugin("knobs", "Has knobs.", f"{__name__}:Knobs", KnobOptions), owner="test_cli_plugins")
    register(TracerPlugin("foo", "By libfoo.", f"{__name__}:Foo", unavailable_reason=lambda: REASON), owner="libfoo")
    yield
    for owner in ("test_cli_plugins", "libfoo"):
        get_registry()._forget(owner)


def listed(monkeypatch: pytest.MonkeyPatch, width: int | None, *arguments: str) -> list[str]:
    """The lines of `phrt plugins`, on a terminal of so many columns, or None for none."""
    monkeypatch.setattr(console, "line_width", lambda: width)
    monkeypatch.setattr(page, "line_width", lambda: width)
    done = phrt("plugins", *arguments)
    assert done.code == 0, done.said
    return done.printed.splitlines()


@pytest.mark.usefixtures("two_more")
@pytest.mark.parametrize("width", [80, 200])
def test_no_line_is_longer_than_the_terminal_is_wide(width: int, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = listed(monkeypatch, width)
    assert [line for line in lines if len(line) > width] == []
    assert [line for line in listed(monkeypatch, width, "show", "foo") if len(line) > width] == []
    assert [line for line in listed(monkeypatch, width, "show", "knobs") if len(line) > width] == []
    assert ("what it is" in lines[0]) == (width == 200)


@pytest.mark.usefixtures("two_more")
def test_a_plugin_s_line_has_everything_and_reasons_come_after(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = listed(monkeypatch, None, "--kind", "tracer")
    assert lines[0].split()[:7] == list(page.COLUMNS)
    rows = {line.split()[1]: line.split() for line in lines if line.startswith("tracer ")}
    assert rows["foo"] == ["tracer", "foo", "libfoo", "1", "no", "By", "libfoo."]
    version = get_registry().find("tracer", "numpy").version
    assert rows["numpy"][:5] == ["tracer", "numpy", "built-in", version, "1"]
    assert f"  tracer foo: {REASON}" in lines[lines.index("Not available here:") :]
    used = lines[lines.index("Used when no other is named:") + 1 :]
    assert [line.split(":")[0].strip() for line in used] == ["tracer"]


@pytest.mark.usefixtures("two_more")
def test_long_reasons_are_broken_at_words_under_their_beginning(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = listed(monkeypatch, 60, "--kind", "tracer")
    first = next(n for n, line in enumerate(lines) if line.startswith("  tracer foo: it needs"))
    assert lines[first + 1].startswith("      ")
    end = next((n for n in range(first + 1, len(lines)) if not lines[n].startswith("      ")), len(lines))
    whole = " ".join(line.strip() for line in lines[first:end])
    assert whole == f"tracer foo: {REASON}"


@pytest.mark.usefixtures("two_more")
def test_show_has_every_option_with_default_unit_and_range(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = listed(monkeypatch, None, "show", "knobs")
    assert lines[0] == "heuristic knobs, test_cli_plugins, plugin API 1"
    assert "  radius = 1.5 metres    float > 0.0" in lines
    assert "  mode = required    text" in lines
    assert "available: yes" in lines
    assert "default: no, it is used where it is named" in lines
    auto = listed(monkeypatch, None, "show", "tracer/embree")
    assert (
        any(line.startswith("default: yes, `auto` is embree here: ") for line in auto) or "available: yes" not in auto
    )


@pytest.mark.usefixtures("two_more")
def test_show_as_json_has_the_page_and_the_options() -> None:
    found = json.loads(phrt("plugins", "show", "knobs", "--json").printed)
    assert (found["kind"], found["name"], found["origin"], found["owner"]) == (
        "heuristic", "knobs", "registered", "test_cli_plugins",
    )  # fmt: skip
    assert (found["api_version"], found["available"], found["default"]) == (1, True, "")
    assert found["page"].startswith("`phrt plugins`: readable at any width")
    radius, mode = found["options"]
    assert (radius["name"], radius["default"], radius["unit"], radius["allowed"]) == (
        "radius",
        "1.5",
        "metres",
        "float > 0.0",
    )
    assert (mode["default"], mode["unit"], mode["meaning"]) == ("required", "", "what it does")


@pytest.mark.usefixtures("two_more")
def test_the_list_as_json_says_what_is_default_and_why() -> None:
    found = json.loads(phrt("plugins", "--json").printed)
    rows = {(row["kind"], row["name"]): row for row in found["plugins"]}
    assert rows["tracer", "foo"]["reason"] == REASON
    assert not rows["tracer", "foo"]["available"]
    tracer = found["defaults"]["tracer"]
    assert tracer["reason"]
    assert rows["tracer", tracer["name"]]["default"] == "auto"
    assert found["defaults"]["heuristic"] == "all_trace"
    assert found["defaults"]["files"][".glb"] == "gltf"


def test_what_could_not_be_loaded_is_listed_and_shown_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = BrokenPlugin("phrt-bad", "ImportError: no libbar", ("bad", "phrt-bad"))
    monkeypatch.setattr(get_registry(), "broken", [broken])
    lines = listed(monkeypatch, None)
    assert lines[lines.index("Left out:") + 1] == "  plugin 'phrt-bad' was left out: ImportError: no libbar"
    done = phrt("plugins", "show", "bad")
    assert done.code == 2
    assert done.errors == ["error: 'bad' cannot be used: plugin 'phrt-bad' was left out: ImportError: no libbar"]


def test_a_file_is_shown_by_its_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plugin = tmp_path / "far" / "down" / "mine.py"
    plugin.parent.mkdir(parents=True)
    plugin.write_text(
        '"""mine: the page of a file."""\n__version__ = "0.3"\nfrom phrt.registry import HeuristicPlugin, hookimpl\n'
        "@hookimpl\ndef phrt_heuristics(): return [HeuristicPlugin('mine', 'Mine.', f'{__name__}:Mine')]\n"
    )
    try:
        lines = listed(monkeypatch, None, "--kind", "heuristic", "--plugin", str(plugin))
        (row,) = [line.split() for line in lines if line.startswith("heuristic  mine ")]
        assert len(row[2]) == page.LONGEST_ORIGIN
        assert row[2].endswith("/mine.py")
        assert row[3] == "0.3"
        assert "mine: the page of a file." in listed(monkeypatch, None, "show", "mine")
    finally:
        get_registry()._forget(str(plugin.resolve()))


def test_listing_imports_neither_tracing_libraries_nor_anything_else_that_is_slow() -> None:
    code = (
        "import sys\nimport phrt.cli.main as cli\nassert cli.run(['plugins', '--json']) == 0\n"
        "slow = set('open3d mitsuba drjit numba llvmlite embreex trimesh skimage flip_evaluator scipy pandas pyarrow matplotlib "
        "jinja2 distributed'.split()) & set(sys.modules)\nassert not slow, slow\n"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, timeout=60, stdout=subprocess.DEVNULL)


@pytest.mark.parametrize(
    "command", ["render", "analyze", "explain", "new", "plugins", "doctor", "schema", "bench", "report"]
)
def test_every_command_takes_plugins(command: str) -> None:
    done = phrt(command, "--help")
    assert "--plugin" in done.printed


def test_a_plugin_before_the_command_can_bring_it(tmp_path: Path) -> None:
    plugin = tmp_path / "greet.py"
    plugin.write_text(
        "import typer\nfrom phrt.registry import CommandPlugin, hookimpl\n"
        "def make(options):\n    app = typer.Typer()\n    app.command('greet')(lambda: print('good morning'))\n    return app\n"
        "@hookimpl\ndef phrt_commands(): return [CommandPlugin('greet', 'Greets.', f'{__name__}:make')]\n"
    )
    try:
        assert phrt("--plugin", str(plugin), "greet").printed == "good morning\n"
        assert "greet" in phrt("--plugin", str(plugin), "--help").printed
    finally:
        get_registry()._forget(str(plugin.resolve()))
    assert phrt("greet").code == 2


@pytest.mark.parametrize("what", ["raise RuntimeError('no')", "raise SystemExit(3)", "this is no Python"])
def test_a_package_that_cannot_be_imported_is_shown_without_its_page(
    what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "package_that_breaks"
    package.mkdir()
    (package / "__init__.py").write_text(what)
    (package / "tracer.py").write_text('"""Never read."""')
    monkeypatch.syspath_prepend(tmp_path)
    register(TracerPlugin("breaks", "Breaks.", "package_that_breaks.tracer:T"), owner="test_cli_plugins")
    try:
        done = phrt("plugins", "show", "breaks")
        assert (done.code, "Never read" in done.printed) == (0, False)
        assert "Options: none" in done.printed
    finally:
        get_registry()._forget("test_cli_plugins")
