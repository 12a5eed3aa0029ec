"""What `phrt new` writes, built into wheels and installed: it runs by config alone, changes nothing else, and can be taken back."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass
from pathlib import Path

import needs
import numpy as np
import pytest
import run_bench_kit
import venv_kit
import yaml
from cli_kit import phrt, read_exr

from phrt.cli.template import KINDS, template_files

NAMES = {"heuristic": "nearest", "effect": "under_things", "tracer": "one_by_one", "metric": "wrong_share"}
SIZE = ("--size", "64x36")


@dataclass(frozen=True)
class Site:
    """packages: of every kind, as written; wheels: of every kind; before: the default pictures without any of them."""

    environment: venv_kit.Environment
    packages: dict[str, Path]
    wheels: dict[str, Path]
    before: dict[str, np.ndarray]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Site:
    """A fresh environment with the packages of all kinds installed."""
    folder = tmp_path_factory.mktemp("site")
    packages, wheels = {}, {}
    for kind, name in NAMES.items():
        done = phrt("new", kind, name, "--dir", str(folder))
        assert done.code == 0, done.said
        packages[kind] = folder / f"phrt-{name.replace('_', '-')}"
        wheels[kind] = venv_kit.wheel(packages[kind], folder / "wheels")
    environment = venv_kit.environment(folder / "venv")
    before = default_pictures(environment, folder / "before")
    environment.install(*wheels.values())
    return Site(environment, packages, wheels, before)


def default_pictures(environment: venv_kit.Environment, folder: Path) -> dict[str, np.ndarray]:
    """(channels, H, W) of a described scene and of a bare model file, with nothing but defaults."""
    folder.mkdir()
    (folder / "balls.yaml").write_text(run_bench_kit.SCENE)
    (folder / "corner.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\nf 1 4 2\n")
    for name in ("balls.yaml", "corner.obj"):
        environment.phrt("render", name, "-o", f"{name}.exr", *SIZE, folder=folder)
    return {name: all_channels(folder / f"{name}.exr") for name in ("balls.yaml", "corner.obj")}


def all_channels(path: Path) -> np.ndarray:
    """(channels, H, W): the picture and every layer in an EXR file."""
    channels = read_exr(path)
    return np.stack([channels[name] for name in sorted(channels)])


def test_all_of_them_are_listed_with_package_version_and_plugin_api(site: Site, tmp_path: Path) -> None:
    listed = json.loads(site.environment.phrt("plugins", "--json", folder=tmp_path).stdout)
    found = {row["kind"]: row for row in listed["plugins"] if row["origin"] == "installed"}
    assert set(found) == set(KINDS)
    for kind, row in found.items():
        assert (row["name"], row["owner"]) == (NAMES[kind], site.packages[kind].name)
        assert (row["version"], row["api_version"], row["available"], row["default"]) == ("0.1.0", 1, True, "")
    assert listed["broken"] == []
    shown = site.environment.phrt("plugins", "show", "nearest", folder=tmp_path).stdout
    assert "heuristic nearest, phrt-nearest 0.1.0, plugin API 1" in shown
    assert "Items are taken by falling area / distance" in shown
    assert "power = 1.0" in shown


def test_listing_them_imports_nothing_that_is_slow(site: Site, tmp_path: Path) -> None:
    code = (
        "import sys, phrt.cli.main as cli; cli.run(['plugins']); "
        "slow = {'open3d', 'mitsuba', 'drjit', 'numba', 'skimage', 'flip_evaluator', 'scipy', 'pandas', 'pyarrow'}; "
        "assert not slow & set(sys.modules), slow & set(sys.modules)"
    )
    listed = venv_kit.run(site.environment.python, "-W", "error", "-c", code, folder=tmp_path).stdout
    assert all(name in listed for name in NAMES.values())


@pytest.mark.parametrize("kind", KINDS)
def test_its_own_tests_pass_on_what_is_installed(site: Site, kind: str, tmp_path: Path) -> None:
    """The module that is tested is the installed one: only the tests are here."""
    (tmp_path / "tests").mkdir()
    (test,) = (site.packages[kind] / "tests").glob("*.py")
    (tmp_path / "tests" / test.name).write_text(test.read_text())
    quiet = (
        "-q",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:dash",
        "-p",
        "no:xdist",
    )  # dash comes with open3d; its plugin warns
    done = venv_kit.run(site.environment.python, "-W", "error", "-m", "pytest", *quiet, folder=tmp_path)
    assert "2 passed" in done.stdout


def test_heuristic_and_effect_serve_a_scene_by_what_it_says(site: Site, tmp_path: Path) -> None:
    from phrt.recording.run import read_run

    scene = yaml.safe_load(run_bench_kit.SCENE)
    scene["prims"]["Settings"] |= {"heuristic": "nearest", "effects": {"under_things": {"height": 2.0}}}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene))
    said = ("--budget", "1500rays", "--record", "run", "--json")
    done = site.environment.phrt("render", "scene.yaml", "-o", "out.png", *SIZE, *said, folder=tmp_path)
    rays = json.loads(done.stdout)["frames"][0]["rays"]
    assert rays["under_things"] > 0
    frame = read_run(tmp_path / "run").frames.to_pylist()[0]
    assert frame["heuristic"] == "nearest"
    assert 0 < frame["traced"] < frame["candidates"]


def test_a_benchmark_takes_all_four_by_its_config(site: Site, tmp_path: Path) -> None:
    scene = yaml.safe_load(run_bench_kit.SCENE)
    for ball in ("Mirror", "Glass", "Clay"):  # few triangles: the tracer tries each
        scene["prims"][ball]["subdivision"] = 1
    # No probes nor shadow maps, which are thousands of rays.
    effects = {"under_things": {}, "shadows": {"fallback": "none"}} | {
        name: {"fallback": "environment"} for name in ("reflections", "refractions")
    }
    config = run_bench_kit.write_config(
        tmp_path, metrics=["wrong_share", "error"], tracers=["one_by_one"], sizes=["32x18"],
        heuristics=["random", {"heuristic": "nearest", "options": {"power": 2.0}}],
        scenes=[{"scene": "balls.yaml", "frames": "0:2", "effects": effects}], warm_up=0,
    )  # fmt: skip
    (tmp_path / "balls.yaml").write_text(yaml.safe_dump(scene))
    site.environment.phrt("bench", config, "-o", "run", "--cache", "cache", "--quiet", "--jobs", "1", folder=tmp_path)
    cells = [json.loads(path.read_text()) for path in tmp_path.glob("run/cells/*/cell.json")]
    assert {cell["heuristic"] for cell in cells} == {"random", "nearest"}
    assert {cell["tracer"] for cell in cells} == {"one_by_one"}
    assert {len(cell["plugins"]) for cell in cells if cell["heuristic"] == "nearest"} == {1}
    with (tmp_path / "run" / "summary.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["label"] for row in rows if row["metric"] == "wrong_share"} == {"random", "nearest"}
    setup = json.loads((tmp_path / "run" / "bench.json").read_text())["plan"]["setups"][0]
    assert set(setup["plugins"]) == {"tracer/one_by_one", "effect/under_things"}


def test_no_comparison_has_another_metric_because_one_is_installed(site: Site, tmp_path: Path) -> None:
    code = "from phrt_plugins.metrics.measure import default_metrics as d; print(*d())"
    found = venv_kit.run(site.environment.python, "-c", code, folder=tmp_path).stdout.split()
    assert "flip" in found
    assert "wrong_share" not in found


def test_what_is_installed_changes_no_default_picture_and_leaves_nothing_behind(site: Site, tmp_path: Path) -> None:
    """The last of this file: it takes the packages away again."""
    with_them = default_pictures(site.environment, tmp_path / "with")
    site.environment.uninstall(*(package.name for package in site.packages.values()))
    without = default_pictures(site.environment, tmp_path / "without")
    for name, picture in site.before.items():
        assert picture.std() > 0.01
        assert np.array_equal(picture, with_them[name])
        assert np.array_equal(picture, without[name])
    gone = site.environment.phrt("plugins", "show", "nearest", folder=tmp_path, code=2)
    assert "there is no plugin 'nearest'" in gone.stderr


# The wheel of PHRT


@pytest.fixture(scope="module")
def user(tmp_path_factory: pytest.TempPathFactory) -> venv_kit.Environment:
    """A fresh environment with PHRT from its wheel."""
    folder = tmp_path_factory.mktemp("user")
    made = venv_kit.environment(folder / "venv")
    made.install(venv_kit.wheel(venv_kit.PROJECT, folder / "wheels"))
    return made


def test_the_wheel_has_the_templates_and_nothing_else_of_them(user: venv_kit.Environment, tmp_path: Path) -> None:
    (home,) = user.folder.glob("lib/python*/site-packages/phrt")
    inside = {
        path.relative_to(home / "_template").as_posix() for path in (home / "_template").rglob("*") if path.is_file()
    }
    wanted = {f"{kind}/{path}" for kind in (*KINDS, "scene") for path in template_files(kind)}
    assert {path for path in inside if "__pycache__" not in path} == wanted | {"README.md"}
    where = venv_kit.run(user.python, "-c", "import phrt; print(phrt.__file__)", folder=tmp_path).stdout.strip()
    assert Path(where) == home / "__init__.py"


def test_who_has_only_the_wheel_gets_a_scene(user: venv_kit.Environment, tmp_path: Path) -> None:
    """It is not rendered here: kernels of an installation that is new take long to compile. scripts/trial_new_user.sh does."""
    said = user.phrt("new", "scene", "room", folder=tmp_path).stderr
    assert "phrt render room.yaml -o room.png" in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["room.yaml", "room_bench.yaml"]
    code = "import phrt; print(len(phrt.load_scene('room.yaml').objects))"
    assert int(venv_kit.run(user.python, "-W", "error", "-c", code, folder=tmp_path).stdout) == 8


def test_the_types_of_a_plugin_are_right_by_what_is_installed(user: venv_kit.Environment, tmp_path: Path) -> None:
    """All templates and their tests pass `mypy --strict` against the wheel: what they use is public and typed."""
    needs.package("mypy")
    written = []
    for kind, name in NAMES.items():
        user.phrt("new", kind, name, folder=tmp_path)
        package = tmp_path / f"phrt-{name.replace('_', '-')}"
        written += [package / f"phrt_{name}.py", package / "tests" / f"test_{name}.py"]
    # An ignore that is not needed is an error: so these types are known, and not Any.
    (tmp_path / "public.py").write_text(
        "import phrt\n"
        "from phrt.interfaces.heuristic import Candidates\n"
        "def area(work: Candidates) -> int:\n    return work.area  # type: ignore[return-value]\n"
        "def scene() -> int:\n    return phrt.load_scene('scene.yaml')  # type: ignore[return-value]\n"
    )
    options = ("--strict", "--config-file=", "--no-incremental", "--python-executable", user.python)
    venv_kit.run(user.python, "-m", "mypy", *options, *written, "public.py", folder=tmp_path)
