"""The trial of a new user: from an empty folder to a heuristic in a leaderboard, and everything that can go wrong with it.

By hand, with the wheel of PHRT and its kernels still to be compiled: scripts/trial_new_user.sh
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import needs
import pytest
import venv_kit

SCRIPT = venv_kit.PROJECT / "scripts" / "trial_new_user.sh"


def trial(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST", "PIP", "PYTHON"))}
    clean["PYTHON"] = sys.executable
    return subprocess.run(["bash", str(SCRIPT), *arguments], cwd=folder, env=clean, capture_output=True, text=True)


@pytest.mark.skipif(os.name == "nt", reason="a script for bash")
def test_a_new_user_gets_from_an_empty_folder_to_the_leaderboard_and_back(tmp_path: Path) -> None:
    needs.package("hatchling")
    needs.package("pyarrow")
    done = trial("--checkout", str(tmp_path / "empty"), folder=tmp_path)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr
    assert done.stdout.endswith("# Done: everything said what it should.\n")
    assert (tmp_path / "empty" / "out" / "room" / "summary.csv").is_file()


def test_a_folder_with_something_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    done = trial("--checkout", str(tmp_path), folder=tmp_path)
    assert (done.returncode, done.stderr) == (2, f"{tmp_path} is not empty\n")
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
