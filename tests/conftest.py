"""Shared fixtures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import needs
import pytest
from hypothesis import settings

settings.register_profile("unhurried", deadline=None)  # a first call may load or compile a kernel
settings.load_profile("unhurried")


@pytest.fixture(scope="session", autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """What runs remember on this machine stays out of the tests, and the other way round."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PHRT_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="session")
def assets() -> Path:
    """The folder of real third-party scenes."""
    if not (needs.ASSETS / "sponza" / "sponza_textured.glb").exists():
        needs.absent(f"the real scenes are not at {needs.ASSETS}; set PHRT_ASSETS")
    return needs.ASSETS
