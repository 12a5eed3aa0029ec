"""What is absent is skipped with its reason, and fails where CI is set."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import needs
import pytest

PROBE = """
import sys
sys.path.insert(0, {tests!r})
import needs
import pytest
from conftest import assets

pytestmark = needs.all_need({missing!r})


def test_package():
    needs.package("phrt_no_such_package", "it is in an extra")


def test_assets(assets):
    raise RuntimeError("the scenes cannot be there")


def test_backend():
    assert {missing!r} is None
"""


@pytest.mark.parametrize(
    ("ci", "missing", "counts"),
    [
        ("", None, "1 passed, 2 skipped"),
        ("", "no OpenGL", "3 skipped"),
        ("true", None, "1 failed, 1 passed, 1 error"),
        ("true", "no OpenGL", "2 failed, 1 error"),
    ],
)
def test_what_is_absent_fails_in_ci_only(tmp_path: Path, ci: str, missing: str | None, counts: str) -> None:
    probe = tmp_path / "test_probe.py"
    probe.write_text(PROBE.format(tests=str(Path(needs.__file__).parent), missing=missing))
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-rA", "-p", "no:dash", "-p", "no:cacheprovider", str(probe)],
        env=os.environ | {"CI": ci, "PHRT_ASSETS": str(tmp_path / "nowhere")},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert f"{counts} in" in done.stdout, done.stdout + done.stderr
    if missing is None:
        assert f"the real scenes are not at {tmp_path / 'nowhere'}; set PHRT_ASSETS" in done.stdout
    assert ("not here, and CI is set" in done.stdout) == bool(ci)
