"""Virtual environments of tests: fresh ones that see what this one has, into which wheels are installed without a network."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import venv
from dataclasses import dataclass
from pathlib import Path

import needs

PROJECT = Path(__file__).resolve().parents[1]
BUILD = ("--no-index", "--no-deps", "--no-build-isolation")


def run(*command: str | Path, folder: Path, code: int = 0) -> subprocess.CompletedProcess[str]:
    """`command` in `folder`, which must leave with `code`. Nothing of how pytest was started is handed on."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "PYTHON", "PIP"))}
    done = subprocess.run([str(part) for part in command], cwd=folder, env=clean, capture_output=True, text=True)
    assert done.returncode == code, done.stdout + done.stderr
    return done


@dataclass(frozen=True)
class Environment:
    """A virtual environment in `folder`, without a pip of its own."""

    folder: Path

    @property
    def python(self) -> Path:
        return self.folder / "bin" / "python"

    def install(self, *wheels: Path) -> None:
        self.pip("install", *BUILD, "--force-reinstall", *wheels)

    def uninstall(self, *packages: str) -> None:
        self.pip("uninstall", "--yes", *packages)

    def pip(self, *arguments: str | Path) -> None:
        """pip of this environment, on that one; nothing is downloaded."""
        offline = ("--disable-pip-version-check", "--quiet", "--no-input")
        run(sys.executable, "-m", "pip", "--python", self.python, *offline, *arguments, folder=self.folder)

    def phrt(self, *arguments: str | Path, folder: Path, code: int = 0) -> subprocess.CompletedProcess[str]:
        """`phrt ARGUMENTS` there; warnings of Python's are errors."""
        return run(self.python, "-W", "error", "-m", "phrt.cli", *arguments, folder=folder, code=code)


def environment(folder: Path) -> Environment:
    """A fresh one in `folder`, which sees the packages of this one, PHRT among them."""
    needs.package("hatchling")
    venv.create(folder, with_pip=False)
    packages = next(folder.glob("lib/python*/site-packages"))
    here = sysconfig.get_paths()["purelib"]
    (packages / "here.pth").write_text(f"import site; site.addsitedir({here!r})\n")
    return Environment(folder)


def wheel(package: Path, into: Path) -> Path:
    """The wheel of the package in folder `package`, built into folder `into`."""
    needs.package("hatchling")
    into.mkdir(parents=True, exist_ok=True)
    before = set(into.glob("*.whl"))
    quiet = ("--disable-pip-version-check", "--quiet", "--no-input")
    run(sys.executable, "-m", "pip", "wheel", *quiet, *BUILD, "-w", into, package, folder=into)
    (made,) = set(into.glob("*.whl")) - before
    return made
