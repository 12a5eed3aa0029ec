"""Plugins that are not installed: files and modules by name."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from phrt.errors import PluginError
from phrt.registry import get_registry
from phrt.registry.local import import_file, register_source

PLUGIN = """
from phrt.registry import HeuristicPlugin, hookimpl

class Mine:
    which = {which!r}
    def __init__(self, options): self.options = options

@hookimpl
def phrt_heuristics():
    return [HeuristicPlugin({name!r}, {which!r}, f"{{__name__}}:Mine")]
"""


@pytest.fixture(autouse=True)
def forgotten(tmp_path: Path) -> Iterator[None]:
    """What was registered from here is gone afterwards."""
    yield
    registry = get_registry()
    for owner in {entry.owner for entry in registry.plugins() if entry.owner.startswith(str(tmp_path))}:
        registry._forget(owner)


def plugin_file(path: Path, name: str = "from_a_file", which: str = "one") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(PLUGIN.format(name=name, which=which))
    return path


def test_a_single_file_is_a_plugin(tmp_path: Path) -> None:
    path = tmp_path / "my_heuristic.py"
    path.write_text(
        "from phrt.registry import HeuristicPlugin, hookimpl\n"
        "class Mine:\n    def __init__(self, options): self.options = options\n"
        "@hookimpl\n"
        "def phrt_heuristics(): return [HeuristicPlugin('from_a_file', '', f'{__name__}:Mine')]\n"
    )
    register_source(str(path))
    assert type(get_registry().create("heuristic", "from_a_file")).__name__ == "Mine"
    get_registry()._forget(str(path))
    assert "from_a_file" not in get_registry().names("heuristic")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "does not exist"),
        ("import no_such_module_anywhere", "cannot be imported: ModuleNotFoundError"),
        ("x = 1", "implements none of the hooks"),
    ],
)
def test_a_file_that_is_no_plugin_is_an_error_that_names_it(tmp_path: Path, text: str | None, message: str) -> None:
    path = tmp_path / "broken.py"
    if text is not None:
        path.write_text(text)
    with pytest.raises(PluginError, match=rf"broken\.py.*{message}"):
        register_source(str(path))


def test_a_file_that_was_edited_is_read_anew_at_once(tmp_path: Path) -> None:
    """Also within the same second, and with as many characters as before: what Python caches would not notice."""
    for which in ("one", "two", "six"):
        register_source(str(plugin_file(tmp_path / "mine.py", which=which)))
        assert get_registry().get("heuristic", "from_a_file").summary == which
        assert get_registry().create("heuristic", "from_a_file").which == which
    assert not (tmp_path / "__pycache__").exists()


def test_a_file_is_one_owner_however_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = plugin_file(tmp_path / "deep" / "mine.py")
    monkeypatch.chdir(tmp_path)
    owners = {register_source(source) for source in (str(path), "deep/mine.py", "./deep/../deep/mine.py")}
    assert owners == {str(path)}
    assert get_registry().find("heuristic", "from_a_file").owner == str(path)


def test_two_files_of_one_name_are_two_plugins(tmp_path: Path) -> None:
    for which in ("one", "two"):
        register_source(str(plugin_file(tmp_path / which / "plugin.py", name=f"from_{which}", which=which)))
    for which in ("one", "two"):
        assert get_registry().create("heuristic", f"from_{which}").which == which


def test_a_file_that_breaks_leaves_what_it_brought_before(tmp_path: Path) -> None:
    path = plugin_file(tmp_path / "mine.py")
    register_source(str(path))
    path.write_text("raise RuntimeError('halfway through an edit')")
    with pytest.raises(PluginError, match=r"mine\.py' cannot be imported: RuntimeError: halfway through an edit"):
        register_source(str(path))
    assert get_registry().create("heuristic", "from_a_file").which == "one"


def test_a_hook_that_raises_is_told_with_the_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text("from phrt.registry import hookimpl\n@hookimpl\ndef phrt_heuristics(): return 1 / 0\n")
    with pytest.raises(PluginError, match=r"mine\.py' is refused: its hook failed: ZeroDivisionError"):
        register_source(str(path))


def test_a_module_that_lies_here_is_pointed_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plugin_file(tmp_path / "just_a_file.py")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry])
    with pytest.raises(
        PluginError, match=r"ModuleNotFoundError.*There is a file just_a_file\.py: name it with its ending"
    ):
        register_source("just_a_file")


def test_a_module_by_name_is_a_plugin(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plugin_file(tmp_path / "module_of_mine.py", name="from_a_module")
    monkeypatch.syspath_prepend(tmp_path)
    try:
        assert register_source("module_of_mine") == "module_of_mine"
        assert get_registry().create("heuristic", "from_a_module").which == "one"
    finally:
        get_registry()._forget("module_of_mine")


def test_only_python_files_are_imported(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("x = 1")
    with pytest.raises(PluginError, match=r"notes\.txt' is not a Python file"):
        import_file(path)
