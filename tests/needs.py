"""What tests need beyond the project itself. Where it is absent a test is skipped with the reason, but with `CI` set it fails:
nothing that should have run is left out in silence."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, NoReturn

import pytest

PROJECT = Path(__file__).resolve().parents[1]
ASSETS = Path(os.environ.get("PHRT_ASSETS") or PROJECT.parent / "shared" / "scenes").resolve()
"""The folder of real third-party scenes: the one that PHRT_ASSETS names, else `../shared/scenes` beside the project."""


def in_ci() -> bool:
    return os.environ.get("CI", "").lower() not in ("", "0", "false")


def absent(reason: str) -> NoReturn:
    """Skip the test, or fail it where nothing may be absent."""
    if in_ci():
        pytest.fail(f"not here, and CI is set: {reason}", pytrace=False)
    pytest.skip(reason, allow_module_level=True)


def package(name: str, reason: str | None = None) -> Any:
    """The optional package `name`, imported."""
    try:
        return pytest.importorskip(name, reason=reason)
    except pytest.skip.Exception as skipped:
        absent(str(skipped))


def all_need(reason: str | None) -> pytest.MarkDecorator:
    """A mark for tests that need what is absent for `reason`; None when it is there."""
    return pytest.mark.skipif(reason is not None and not in_ci(), reason=str(reason))
