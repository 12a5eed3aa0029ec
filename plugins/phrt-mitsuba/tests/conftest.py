"""The package is used from its folder, not installed: Mitsuba's tracer is registered for these tests alone."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1]
PROJECT = PACKAGE.parents[1]
sys.path[:0] = [path for path in (str(PACKAGE), str(PROJECT / "tests")) if path not in sys.path]

from phrt_mitsuba import llvm  # noqa: E402

# Dr.Jit takes its LLVM when it is imported, and other tests import it before these run.
if libraries := llvm.usable():
    os.environ.setdefault(llvm.VARIABLE, libraries[0])


@pytest.fixture(scope="session", autouse=True)
def registered() -> Iterator[None]:
    """Everything of the package, under its own name; gone again afterwards."""
    from phrt.registry import get_registry
    from phrt_mitsuba import plugin

    registry = get_registry()
    registry.register(plugin, "phrt-mitsuba")
    yield
    registry._forget("phrt-mitsuba")


@pytest.fixture
def fresh() -> Iterator[None]:
    """Nothing is remembered of what worked before, and nothing of this test afterwards."""
    from phrt_mitsuba import availability

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(llvm.VARIABLE, os.environ.get(llvm.VARIABLE, ""))
        for remembered in (availability._cuda_reason, availability._llvm_reason):
            remembered.cache_clear()
        yield
    for remembered in (availability._cuda_reason, availability._llvm_reason):
        remembered.cache_clear()
