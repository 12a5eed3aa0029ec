"""The package is tested as it lies here, installed or not: its folder is on the path, its plugins are registered for its tests."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1]
if str(PACKAGE) not in sys.path:
    sys.path.insert(0, str(PACKAGE))


@pytest.fixture(scope="package", autouse=True)
def registered() -> Iterator[None]:
    """Heuristic and metric, unless they are installed; gone again before tests of other folders."""
    from phrt_saliency import plugin

    from phrt.registry import get_registry

    registry = get_registry()
    if any(entry.name == "saliency" for entry in registry.plugins("heuristic")):
        yield
        return
    registry.register(plugin, "phrt-saliency")
    yield
    registry._forget("phrt-saliency")
