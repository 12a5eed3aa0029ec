"""What stands in by default where nothing is traced, and what it costs those who trace everything."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scene_kit import hall

import phrt
from phrt.clock import RayClock
from phrt.frame import FrameResult
from phrt.output.tonemap import to_8bit
from phrt_plugins.effects import shadow_maps
from phrt_plugins.effects.options import ReflectionsOptions, RefractionsOptions, ShadowsOptions
from phrt_plugins.effects.probes import Probes
from phrt_plugins.metrics.flip import flip_map

PAPER = {
    "shadows": {"fallback": "none"},
    "reflections": {"fallback": "environment"},
    "refractions": {"fallback": "environment"},
}


def test_the_best_fallbacks_are_the_defaults() -> None:
    assert ShadowsOptions().fallback == "shadow_map"
    assert ReflectionsOptions().fallback == "probe"
    assert RefractionsOptions().fallback == "probe"


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Filled with a word for every batch of a shadow map, and for every probe."""
    calls: list[str] = []
    cast, capture = shadow_maps.cast_depths, Probes._capture

    def counted_cast(*arguments: Any) -> np.ndarray:
        calls.append("map")
        return cast(*arguments)

    def counted_capture(*arguments: Any) -> None:
        calls.append("probe")
        capture(*arguments)

    monkeypatch.setattr(shadow_maps, "cast_depths", counted_cast)
    monkeypatch.setattr(Probes, "_capture", counted_capture)
    return calls


def frames(heuristic: str, budget: str | None = None, **options: Any) -> list[FrameResult]:
    fixed = {"size": (96, 54), "gbuffer": "raycast", "threads": 2, "strict": True, "remember_costs": False}
    with phrt.Renderer(hall(), heuristic=heuristic, budget=budget, clock=RayClock(), **(fixed | options)) as renderer:
        return [renderer.render(number / 30) for number in range(4)]


def test_all_trace_makes_no_map_and_no_probe(made: list[str]) -> None:
    frames("all_trace")
    assert made == []
    frames("raster_only")
    assert {"map", "probe"} == set(made)


def test_maps_and_probes_of_a_still_scene_are_made_once(made: list[str]) -> None:
    with phrt.Renderer(hall(), size=(96, 54), gbuffer="raycast", heuristic="raster_only", strict=True) as renderer:
        renderer.render()
        once = len(made)
        renderer.render()
        assert len(made) == once > 0


@pytest.mark.parametrize("heuristic", ["gain", "selection_graph"])
def test_within_a_budget_the_defaults_are_nearer_to_all_trace_than_the_papers_fallbacks(heuristic: str) -> None:
    truth = to_8bit(frames("all_trace")[-1].image, "neutral")

    def error(effects: dict[str, dict[str, object]] | None) -> float:
        shown = to_8bit(frames(heuristic, "1500rays", effects=effects)[-1].image, "neutral")
        return float(flip_map(truth, shown).mean())

    assert error(None) < 0.7 * error(PAPER)
