"""`phrt new` writes packages that work, and scenes, and writes nothing half. (Installed: test_new_installed.py.)"""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import needs
import pytest
from cli_kit import Outcome, phrt, render

from phrt.cli import template
from phrt.errors import OptionError
from phrt.registry import Registry, get_registry
from phrt.registry.local import import_file

NAMES = {"heuristic": "nearest", "effect": "under_things", "tracer": "one_by_one", "metric": "wrong_share"}


def written(kind: str, name: str, folder: Path) -> Path:
    """The package that `phrt new` writes into `folder`."""
    done = phrt("new", kind, name, "--dir", str(folder))
    assert done.code == 0, done.said
    return folder / f"phrt-{name.replace('_', '-')}"


def run(*command: str | Path, folder: Path) -> subprocess.CompletedProcess[str]:
    """`command`, which must succeed, in `folder`."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "PYTHON", "PIP"))}
    done = subprocess.run([str(part) for part in command], cwd=folder, env=clean, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


# What is written


@pytest.mark.parametrize(("kind", "name"), NAMES.items())
def test_the_package_registers_and_says_what_it_is(kind: str, name: str, tmp_path: Path) -> None:
    package = written(kind, name, tmp_path)
    module = package / f"phrt_{name}.py"
    registry = Registry()
    registry.register(import_file(module))
    (entry,) = registry.plugins()
    assert (entry.kind, entry.name) == (kind, name)
    assert isinstance(registry.create(kind, name), object)
    text = (ast.get_docstring(ast.parse(module.read_text())) or "").split("\n")[0]
    assert text.startswith(f"{name}: ")
    assert all(field.description for field in entry.plugin.options.model_fields.values())


@pytest.mark.parametrize(("kind", "name"), NAMES.items())
def test_nothing_of_the_template_s_name_is_left(kind: str, name: str, tmp_path: Path) -> None:
    package = written(kind, name, tmp_path)
    files = {str(path.relative_to(package)): path.read_text() for path in package.rglob("*") if path.is_file()}
    assert set(files) == {"README.md", "pyproject.toml", f"phrt_{name}.py", f"tests/test_{name}.py"}
    for path, text in files.items():
        for trace in (f"my_{kind}", f"my-{kind}", template.class_name(f"my_{kind}")):
            assert trace not in path + text
    project = tomllib.loads(files["pyproject.toml"])
    assert project["project"]["name"] == package.name
    assert project["project"]["entry-points"]["phrt"] == {name: f"phrt_{name}"}
    assert project["tool"]["hatch"]["build"]["targets"]["wheel"]["only-include"] == [f"phrt_{name}.py"]


def test_the_heuristic_is_twenty_lines(tmp_path: Path) -> None:
    module = written("heuristic", "nearest", tmp_path) / "phrt_nearest.py"
    tree = ast.parse(module.read_text())
    page = tree.body[0]
    lines = module.read_text().splitlines()[page.end_lineno :]
    assert len([line for line in lines if line.strip()]) <= 20


def test_the_packages_are_tidy(tmp_path: Path) -> None:
    needs.package("ruff")
    for kind, name in NAMES.items():
        package = written(kind, name, tmp_path)
        tidy = ("--isolated", "--select", "E,F,I,B,UP", "--line-length", "132")
        run(sys.executable, "-m", "ruff", "check", *tidy, ".", folder=package)


def test_what_to_do_next_is_said(tmp_path: Path) -> None:
    done = phrt("new", "heuristic", "nearest", "--dir", str(tmp_path))
    assert done.printed == ""
    for line in (f"cd {tmp_path}/phrt-nearest", 'pip install -e ".[test]"', "--heuristic nearest", "pytest"):
        assert line in done.said
    assert phrt("new", "heuristic", "other", "--dir", str(tmp_path), "--quiet").said == ""


# What is refused


@pytest.mark.parametrize(
    ("kind", "name", "says"),
    [
        ("heuristic", "gain", "NAME is 'gain'; PHRT has one, and names of heuristics are unique"),
        ("heuristic", "NearestFirst", "lower case letters, digits and single underscores.*Did you mean 'nearest_first'?"),
        ("effect", "2nd", "a letter first"),
        ("effect", "a__b", "Did you mean 'a_b'?"),
        ("metric", "x" * 41, "at most 40"),
        ("metric", "../x", "NAME is '../x'; allowed:"),
        ("tracer", "ray_batch", "PHRT itself has RayBatch"),
        ("effect", "plugins", "PHRT itself has phrt_plugins"),
        ("metric", "flip_p95", "metric 'flip' has a column 'flip_p95', and names of columns are unique"),
        ("metric", "oracle_share", "every comparison has a column 'oracle_share'"),
        ("heuristic", "none", "None is a word of Python's"),
        ("scene", "My Room", "Did you mean 'my_room'?"),
        ("heuristc", "x", "no template for 'heuristc'. Known: heuristic, effect, tracer, metric, scene. Did you mean 'heuristic'?"),
        ("loader", "x", "no template for 'loader'"),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused_and_leaves_nothing(kind: str, name: str, says: str, tmp_path: Path) -> None:
    done = phrt("new", kind, name, "--dir", str(tmp_path))
    assert done.code == 2
    for part in says.split(".*"):
        assert part in done.said
    assert list(tmp_path.iterdir()) == []


def test_the_same_name_serves_plugins_of_two_kinds(tmp_path: Path) -> None:
    assert written("metric", "gain", tmp_path).is_dir()


def test_a_folder_that_exists_is_left_alone(tmp_path: Path) -> None:
    mine = tmp_path / "phrt-nearest"
    mine.mkdir()
    (mine / "kept.txt").write_text("mine")
    done = phrt("new", "heuristic", "nearest", "--dir", str(tmp_path))
    assert done.code == 2
    assert f"'{mine}' exists already" in done.said
    assert [path.name for path in mine.iterdir()] == ["kept.txt"]


def test_a_parent_that_is_no_folder_is_told(tmp_path: Path) -> None:
    done = phrt("new", "heuristic", "nearest", "--dir", str(tmp_path / "absent"))
    assert (done.code, f"--dir is '{tmp_path}/absent', which is no folder" in done.said) == (2, True)


def test_nothing_half_written_is_left_when_the_disk_is_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write, count = Path.write_text, 0

    def failing(path: Path, *arguments: object, **named: object) -> int:
        nonlocal count
        count += 1
        if count == 3:
            raise OSError(28, "No space left on device")
        return write(path, *arguments, **named)  # type: ignore[arg-type]

    monkeypatch.setattr(Path, "write_text", failing)
    with pytest.raises(OptionError, match=r"phrt-nearest' cannot be written: No space left on device"):
        template.write_new("heuristic", "nearest", tmp_path)
    assert count == 3
    assert list(tmp_path.iterdir()) == []


def test_an_installed_phrt_has_its_templates_beside_its_modules(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = tmp_path / "site" / "phrt"
    (package / "_template").mkdir(parents=True)
    monkeypatch.setattr(template.phrt, "__file__", str(package / "__init__.py"))
    assert template.template_folder() == package / "_template"
    (package / "_template").rmdir()
    with pytest.raises(OptionError, match="templates of plugins are missing"):
        template.template_folder()


def test_every_template_s_own_name_is_free() -> None:
    for kind in template.KINDS:
        assert f"my_{kind}" not in get_registry().names(kind)
        template.check_name(kind, f"my_{kind}", template.template_files(kind))


# Scenes


def test_a_scene_comes_with_a_benchmark_on_it(tmp_path: Path) -> None:
    done = phrt("new", "scene", "room", "--dir", str(tmp_path))
    assert (done.code, done.printed) == (0, "")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["room.yaml", "room_bench.yaml"]
    assert all("my_scene" not in path.read_text() for path in tmp_path.iterdir())
    assert f"phrt render {tmp_path}/room.yaml -o room.png" in done.said
    picture = render(tmp_path / "room.yaml", tmp_path / "room.exr")
    assert (picture.code, picture.warnings, picture.finite) == (0, [], True)
    plan = phrt("bench", str(tmp_path / "room_bench.yaml"), "--dry-run", "--json")
    assert (plan.code, len(json.loads(plan.printed)["cells"])) == (0, 4)


def test_a_scene_that_is_there_is_left_alone_and_so_is_its_benchmark(tmp_path: Path) -> None:
    (tmp_path / "room_bench.yaml").write_text("mine")
    done = phrt("new", "scene", "room", "--dir", str(tmp_path))
    assert done.code == 2
    assert f"'{tmp_path}/room_bench.yaml' exists already" in done.said
    assert [path.name for path in tmp_path.iterdir()] == ["room_bench.yaml"]


def test_help_helps() -> None:
    done: Outcome = phrt("new", "--help")
    assert done.code == 0
    for part in (
        "heuristic, effect, tracer, metric or scene",
        "phrt-NAME",
        "--dir",
        "phrt new heuristic nearest_first",
    ):
        assert part in " ".join(done.printed.split())
