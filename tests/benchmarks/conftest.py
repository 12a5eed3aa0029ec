"""Benchmarks are imported by plain names, as `benchmarks/run.py` imports them."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def module(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], ModuleType]]:
    """A benchmark's module by name; none is left behind for other tests."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    yield importlib.import_module
    for name, found in list(sys.modules.items()):
        if Path(str(getattr(found, "__file__", None))).parent == BENCHMARKS:
            del sys.modules[name]
