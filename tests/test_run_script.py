"""`./run`: sets up once, stops at the first failure, and says what is missing when it may not install."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parents[1]
pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the libraries are Linux ones")


class Sandbox:
    """A copy of `run` beside a stand-in environment that only notes what it is asked to do."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.log = folder, folder / "log"
        self.log.write_text("")
        shutil.copy(PROJECT / "run", folder / "run")
        (folder / "pyproject.toml").write_text("version = 1\n")
        self.program(".venv/bin/python", 'echo "python $*" >>"$LOG"; [ "$*" = "${FAIL:-}" ] && exit 7; exit 0')
        self.program(".venv/bin/phrt", 'echo "phrt $*" >>"$LOG"')
        self.program("tools/ldconfig", "echo $LIBRARIES")

    def program(self, name: str, text: str) -> None:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"#!/usr/bin/env bash\n{text}\n")
        path.chmod(0o755)

    def run(self, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
        variables = {
            "PATH": f"{self.folder}/tools:/usr/bin:/bin",
            "LOG": str(self.log),
            "PHRT_NO_APT": "1",
            "HOME": "/",
        }
        every = "libEGL.so.1 libusb-1.0.so.0 libgomp.so.1 libEGL_nvidia.so.0 libLLVM.so.19.1"
        return subprocess.run(
            [str(self.folder / "run"), *arguments],
            env=variables | {"LIBRARIES": every} | environment,
            capture_output=True,
            text=True,
            timeout=60,
            cwd="/",
        )

    def installs(self) -> list[str]:
        return [line.rpartition(" -e ")[2] for line in self.log.read_text().splitlines() if "pip install" in line]


@pytest.fixture
def sandbox(tmp_path: Path) -> Sandbox:
    return Sandbox(tmp_path)


def test_the_demo_renders_the_atrium_and_says_where_the_picture_is(sandbox: Sandbox) -> None:
    done = sandbox.run("demo")
    assert done.returncode == 0, done.stderr
    assert "phrt render scenes/atrium.yaml -o out/atrium.png --size 1280x720 --aa 4" in sandbox.log.read_text()
    assert f"the picture is at {sandbox.folder}/out/atrium.png" in done.stderr
    assert "missing system libraries" not in done.stderr


def test_it_installs_once_until_the_project_file_changes(sandbox: Sandbox) -> None:
    for _ in range(2):
        assert sandbox.run("demo").returncode == 0
    assert sandbox.installs() == ["."]
    for _ in range(2):
        assert sandbox.run("setup").returncode == 0
    assert sandbox.installs() == [".", ".[all]"]
    assert sandbox.run("demo").returncode == 0
    assert sandbox.installs() == [".", ".[all]"]
    (sandbox.folder / "pyproject.toml").write_text("version = 2\n")
    assert sandbox.run("demo").returncode == 0
    assert sandbox.installs() == [".", ".[all]", "."]


def test_an_installation_that_fails_stops_it_and_is_tried_again(sandbox: Sandbox) -> None:
    install = "-m pip install --quiet --disable-pip-version-check --no-warn-script-location -e ."
    done = sandbox.run("demo", FAIL=install)
    assert done.returncode != 0
    assert "phrt render" not in sandbox.log.read_text()
    assert sandbox.run("demo").returncode == 0
    assert sandbox.installs() == [".", "."]


def test_the_site_is_built_with_its_own_extra_alone(sandbox: Sandbox) -> None:
    sandbox.program(".venv/bin/mkdocs", 'echo "mkdocs $*" >>"$LOG"; [ "$1" != "${FAIL:-}" ]')
    done = sandbox.run("docs")
    assert done.returncode == 0, done.stderr
    assert sandbox.installs() == [".[docs]"]
    assert f"the documentation is at {sandbox.folder}/site/index.html" in done.stderr
    assert sandbox.run("docs", "--serve", "--dev-addr", "localhost:8001").returncode == 0
    assert "mkdocs serve --dev-addr localhost:8001" in sandbox.log.read_text()
    assert sandbox.run("docs", FAIL="build").returncode != 0
    done = sandbox.run("docs", "--server")
    assert done.returncode == 2
    assert "takes --serve or nothing, not: --server" in done.stderr
    assert sandbox.installs() == [".[docs]"]


def test_tests_that_fail_fail_the_command(sandbox: Sandbox) -> None:
    pytest_command = "-m pytest tests --ignore=tests/docs/test_snippets.py -n 2 -q"
    assert sandbox.run("test", FAIL=pytest_command).returncode != 0
    assert sandbox.run("test").returncode == 0


def test_packages_under_plugins_are_tested_too(sandbox: Sandbox) -> None:
    (sandbox.folder / "plugins" / "phrt-mine" / "tests").mkdir(parents=True)
    (sandbox.folder / "plugins" / "phrt_plugins").mkdir()
    assert sandbox.run("test").returncode == 0
    assert "python -m pytest tests plugins/phrt-mine/tests --ignore" in sandbox.log.read_text()


def test_a_check_that_fails_fails_the_command_after_all_have_run(sandbox: Sandbox) -> None:
    for tool in ("ruff", "mypy", "lint-imports"):
        sandbox.program(f".venv/bin/{tool}", f'echo "{tool} $*" >>"$LOG"; [ {tool} != mypy ]')
    done = sandbox.run("check")
    assert done.returncode != 0
    assert done.stderr.rstrip().endswith("failed: mypy;")
    assert "python -m pytest -q tests/docs/test_snippets.py" in sandbox.log.read_text()


def test_check_runs_the_tests_too_unless_told_not_to(sandbox: Sandbox) -> None:
    for tool in ("ruff", "mypy", "lint-imports"):
        sandbox.program(f".venv/bin/{tool}", "exit 0")
    all_tests = "-m pytest tests --ignore=tests/docs/test_snippets.py -n 2 -q"
    done = sandbox.run("check", "--no-tests", FAIL=all_tests)
    assert done.returncode == 0, done.stderr
    done = sandbox.run("check", FAIL=all_tests)
    assert done.returncode != 0
    assert done.stderr.rstrip().endswith(f"failed: python {all_tests};")
    done = sandbox.run("check", "--no-test")
    assert done.returncode != 0
    assert "takes --no-tests or nothing, not: --no-test" in done.stderr


@pytest.mark.parametrize("changed", ["core/phrt/kernels/jit.py", "plugins/mine/kernels.py", "core/phrt/conventions.py"])
def test_compiled_kernels_go_when_a_source_of_theirs_changes(sandbox: Sandbox, changed: str) -> None:
    sources = {
        "core/phrt/kernels/jit.py": "import numba\n",
        "plugins/mine/kernels.py": "from phrt.kernels.jit import device\n",
        "core/phrt/conventions.py": "BIAS = 1\n",
        "backends/other.py": "import math\n",
    }
    compiled = [sandbox.folder / f"core/phrt/kernels/__pycache__/light.{kind}" for kind in ("py311.nbi", "1.nbc")]
    for name, text in sources.items():
        (sandbox.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (sandbox.folder / name).write_text(text)

    def left_after_a_run() -> list[bool]:
        for path in compiled:
            path.parent.mkdir(exist_ok=True)
            path.write_text("machine code")
        assert sandbox.run("demo").returncode == 0
        return [path.exists() for path in compiled]

    left_after_a_run()
    assert left_after_a_run() == [True, True]
    (sandbox.folder / "backends/other.py").write_text("import cmath\n")
    assert left_after_a_run() == [True, True]
    (sandbox.folder / changed).write_text(sources[changed] + "BIAS = 2\n")
    assert left_after_a_run() == [False, False]
    assert left_after_a_run() == [True, True]


def test_missing_libraries_are_named_with_what_will_not_work(sandbox: Sandbox) -> None:
    done = sandbox.run("setup", LIBRARIES="libEGL_nvidia.so.0")
    assert done.returncode == 0, done.stderr
    assert "apt-get install libegl1 libusb-1.0-0 libgomp1" in done.stderr
    assert "the G-buffer 'moderngl' is not available" in done.stderr
    assert "the tracer 'open3d' is not available" in done.stderr
    assert "apt-get install libllvm19\n" in done.stderr
    assert "plugins/phrt-mitsuba has no tracer on the processor" in done.stderr


@pytest.mark.parametrize(
    ("libraries", "is_missing"),
    [("libLLVM-15.so.1", True), ("libLLVM-17.so.1", False), ("libLLVM.so.19.1", False), ("libLLVM.so.20.1", False)],
)
def test_an_llvm_that_is_too_old_does_not_count(sandbox: Sandbox, libraries: str, is_missing: bool) -> None:
    done = sandbox.run("setup", LIBRARIES=f"libEGL.so.1 libusb-1.0.so.0 libgomp.so.1 libEGL_nvidia.so.0 {libraries}")
    assert ("missing system libraries: libllvm19" in done.stderr) == is_missing, done.stderr


def test_a_package_that_the_system_does_not_have_keeps_no_other_away(sandbox: Sandbox) -> None:
    sandbox.program("tools/id", "echo 0")
    sandbox.program("tools/apt-get", 'echo "apt-get $*" >>"$LOG"; case "$*" in *libllvm*) exit 100 ;; esac')
    done = sandbox.run("setup", LIBRARIES="libEGL_nvidia.so.0 libgomp.so.1", PHRT_NO_APT="")
    assert done.returncode == 0, done.stderr
    assert "missing system libraries: libllvm19;" in done.stderr
    assert "apt-get install -y -q --no-install-recommends libegl1 libusb-1.0-0\n" in sandbox.log.read_text()


def test_missing_libraries_are_installed_when_it_may(sandbox: Sandbox) -> None:
    # The package lists are out of date: the first attempt fails, and succeeds after an update.
    sandbox.program("tools/id", "echo 0")
    sandbox.program("tools/apt-get", 'echo "apt-get $*" >>"$LOG"; grep -q "apt-get update" "$LOG"')
    done = sandbox.run("setup", LIBRARIES="libEGL_nvidia.so.0 libgomp.so.1 libLLVM-17.so", PHRT_NO_APT="")
    assert done.returncode == 0, done.stderr
    install = "apt-get install -y -q --no-install-recommends libegl1 libusb-1.0-0"
    calls = [line for line in sandbox.log.read_text().splitlines() if line.startswith("apt-get")]
    assert calls == [install, "apt-get update -q", install]
    assert "missing system libraries" not in done.stderr


def test_an_installation_of_libraries_that_fails_is_not_the_end(sandbox: Sandbox) -> None:
    sandbox.program("tools/id", "echo 0")
    sandbox.program("tools/apt-get", "echo no network; exit 100")
    done = sandbox.run("setup", LIBRARIES="libEGL_nvidia.so.0 libgomp.so.1 libLLVM-17.so", PHRT_NO_APT="")
    assert done.returncode == 0, done.stderr
    assert "no network" in done.stderr
    assert "missing system libraries: libegl1 libusb-1.0-0" in done.stderr


def test_the_demo_does_not_ask_for_what_only_extras_need(sandbox: Sandbox) -> None:
    done = sandbox.run("demo", LIBRARIES="libEGL.so.1 libEGL_nvidia.so.0")
    assert done.returncode == 0
    assert "libusb" not in done.stderr


def test_phrt_runs_where_the_user_is_and_keeps_its_arguments(sandbox: Sandbox) -> None:
    sandbox.program(".venv/bin/phrt", 'echo "$PWD|$1|$2"; exit 3')
    done = sandbox.run("phrt", "one two", "three")
    assert (done.returncode, done.stdout) == (3, "/|one two|three\n")


def test_an_unsuitable_python_is_told(sandbox: Sandbox) -> None:
    shutil.rmtree(sandbox.folder / ".venv")
    done = sandbox.run("demo", PYTHON="no-such-python")
    assert done.returncode != 0
    assert "no Python 3.11, 3.12 or 3.13 found (no-such-python)" in done.stderr


def test_an_unknown_command_is_told(sandbox: Sandbox) -> None:
    done = sandbox.run("tset")
    assert done.returncode == 2
    assert "Use one of: demo, test, check, bench, docs, setup, phrt" in done.stderr
