"""The package is used from its folder, not installed: its effect is registered for these tests alone."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
sys.path[:0] = [path for path in (str(HERE.parent), str(HERE)) if path not in sys.path]


@pytest.fixture(scope="session", autouse=True)
def registered() -> Iterator[None]:
    """The effect, unless it is installed; gone again afterwards."""
    from phrt_caustics import plugin

    from phrt.registry import get_registry

    registry = get_registry()
    if "caustics" in registry.names("effect"):
        yield
        return
    registry.register(plugin, "phrt-caustics")
    yield
    registry._forget("phrt-caustics")
