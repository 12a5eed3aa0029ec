"""Everything that ships passes the conformance kit. (Heuristics: tests/heuristics/test_contract.py.)"""

from __future__ import annotations

import subprocess
import sys

import needs
import pytest

from phrt.registry import get_registry
from phrt.testing import check_effect, check_gbuffer, check_metric, check_tracer

TRACERS = [
    ("embree", {}), ("embree", {"robust": True}), ("embree", {"binding": "embreex"}), ("open3d", {}), ("numpy", {}),
]  # fmt: skip
EFFECTS = [
    ("shadows", {}), ("shadows", {"samples": 4, "fallback": "shadow_map"}), ("reflections", {"fallback": "environment"}),
    ("reflections", {"samples": 2, "fallback": "probe"}), ("refractions", {}), ("refractions", {"fallback": "probe"}),
    ("ambient_occlusion", {}), ("ambient_occlusion", {"fallback_value": 0.5}),
]  # fmt: skip
BEYOND = {"temporal": ("compensated_difference",)}
"""Columns by which a picture may be better than its reference."""


def available(kind: str, name: str) -> str:
    """`name`, or a skip that says why it cannot run here."""
    if reason := get_registry().find(kind, name).unavailable_reason():
        needs.absent(f"{name}: {reason}")
    return name


def built_in(kind: str) -> list[str]:
    return [entry.name for entry in get_registry().plugins(kind) if entry.origin == "built-in"]


@pytest.mark.parametrize(("name", "options"), TRACERS)
def test_tracers_conform(name: str, options: dict[str, object]) -> None:
    check_tracer(available("tracer", name), options)


@pytest.mark.parametrize("name", built_in("gbuffer"))
def test_gbuffer_producers_conform(name: str) -> None:
    check_gbuffer(available("gbuffer", name))


@pytest.mark.parametrize(("name", "options"), EFFECTS)
def test_effects_conform(name: str, options: dict[str, object]) -> None:
    check_effect(name, options)


@pytest.mark.parametrize("name", built_in("metric"))
def test_metrics_conform(name: str) -> None:
    check_metric(available("metric", name), beyond=BEYOND.get(name, ()))


def test_the_kit_needs_no_test_framework() -> None:
    code = "import sys, phrt.testing; assert not {'pytest', 'hypothesis', 'pyarrow'} & set(sys.modules)"
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, timeout=120)


def test_nothing_that_ships_is_left_out() -> None:
    assert {name for name, _ in TRACERS} == set(built_in("tracer"))
    assert {name for name, _ in EFFECTS} == set(built_in("effect"))
