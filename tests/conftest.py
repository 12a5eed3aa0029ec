"""Shared fixtures."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

PROJECT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def assets() -> Path:
    """The folder of real third-party scenes: `PHRT_ASSETS`, or ../shared/scenes beside the project."""
    folder = Path(os.environ.get("PHRT_ASSETS", PROJECT.parent / "shared" / "scenes"))
    if not (folder / "sponza" / "sponza_textured.glb").exists():
        pytest.skip(f"the real scenes are not at {folder}; set PHRT_ASSETS")
    return folder
