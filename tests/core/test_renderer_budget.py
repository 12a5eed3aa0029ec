"""Frames under a ray budget: held, reproducible bit for bit, and accounted for."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from candidate_kit import rows
from scene_kit import PLAIN_FALLBACKS, hall

import phrt
from phrt.errors import OptionError
from phrt.frame import Decisions, FrameResult
from phrt.registry import get_registry
from phrt.registry.manager import Registry
from phrt.scene import Scene

SIZE = (96, 64)
CHOOSING = ("selection_graph", "greedy_relevance", "greedy_ratio", "uniform", "round_robin", "random", "all_trace")


def frames(count: int, scene: Scene | None = None, **options: Any) -> list[FrameResult]:
    options = {"size": SIZE, "gbuffer": "raycast", "threads": 2, "strict": True} | options
    with phrt.Renderer(scene or hall(), **options) as renderer:
        return [renderer.render() for _ in range(count)]


@pytest.fixture(scope="module")
def all_rays() -> int:
    """Secondary rays of the picture with everything traced."""
    (frame,) = frames(1)
    return int(frame.decisions.rays.sum())


def in_order(decisions: Decisions) -> list[np.ndarray]:
    """What was decided, whatever the order of the candidates is."""
    order = np.argsort(decisions.candidates.keys())
    work = rows(decisions.candidates, order)
    letters = [work.keys(), work.predicted_cost, work.relevance, work.cost, work.was_selected]
    return [*letters, *(a[order] for a in (decisions.chosen, decisions.passes, decisions.rays))]


def assert_same(one: FrameResult, other: FrameResult) -> None:
    for a, b in zip(in_order(one.decisions), in_order(other.decisions), strict=True):
        np.testing.assert_array_equal(a, b)
    np.testing.assert_array_equal(one.image, other.image)


@pytest.mark.parametrize("name", CHOOSING)
def test_decisions_and_image_are_the_same_bit_for_bit_whatever_the_threads(name: str, all_rays: int) -> None:
    budget = f"{all_rays // 2}rays"
    one, four = (frames(3, heuristic=name, budget=budget, threads=count) for count in (1, 4))
    for a, b in zip(one, four, strict=True):
        assert_same(a, b)


@pytest.mark.parametrize("name", CHOOSING)
def test_decisions_and_image_are_the_same_whatever_the_order_of_plugins(
    name: str, all_rays: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    budget, names = f"{all_rays // 2}rays", Registry.names
    one = frames(3, heuristic=name, budget=budget)
    monkeypatch.setattr(Registry, "names", lambda registry, kind: names(registry, kind)[::-1])
    other = frames(3, heuristic=name, budget=budget)
    assert one[0].decisions.candidates.effect_names == other[0].decisions.candidates.effect_names[::-1]
    for a, b in zip(one, other, strict=True):
        assert_same(a, b)


@pytest.mark.parametrize("name", CHOOSING)
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_rays_pass_the_budget_only_by_what_predictions_were_short_of(name: str, share: float, all_rays: int) -> None:
    budget = int(share * all_rays)
    made = frames(6, heuristic=name, budget=f"{budget}rays")
    for frame in made:
        decisions = frame.decisions
        assert decisions.budget == budget
        assert decisions.rays[~decisions.chosen].sum() == 0
        # Shares of what items took together are rounded.
        counted = sum(count for effect, count in frame.rays.items() if effect != "primary")
        assert abs(counted - decisions.rays.sum()) <= len(decisions.rays) / 2
        share = decisions.traced_pixels / decisions.candidates.pixel_count
        short = np.maximum(decisions.rays - decisions.candidates.predicted_cost * share, 0).sum()
        assert counted <= budget * 1.03 + short, (
            "small items that were traced together share what predictions were short of"
        )


def test_nearly_all_of_the_budget_is_used(all_rays: int) -> None:
    decisions = frames(6, heuristic="uniform", budget=f"{all_rays // 2}rays")[-1].decisions
    assert decisions.rays.sum() > 0.9 * decisions.budget


def test_predictions_become_what_is_measured(all_rays: int) -> None:
    decisions = frames(3, heuristic="all_trace", budget=f"{4 * all_rays}rays")[-1].decisions
    assert decisions.chosen.all()
    np.testing.assert_allclose(decisions.candidates.predicted_cost, np.maximum(decisions.rays, 1), atol=1.01)


def test_a_large_budget_is_the_picture_without_one(all_rays: int) -> None:
    (limited,), (free,) = frames(1, budget=f"{4 * all_rays}rays"), frames(1)
    np.testing.assert_array_equal(limited.image, free.image)
    assert limited.rays == free.rays
    assert limited.decisions.traced_pixels.tolist() == free.decisions.traced_pixels.tolist()


def test_a_budget_of_nothing_is_raster_only() -> None:
    (nothing,), (raster,) = frames(1, budget="0rays"), frames(1, heuristic="raster_only")
    assert not nothing.decisions.chosen.any()
    np.testing.assert_array_equal(nothing.image, raster.image)


def test_a_larger_budget_comes_nearer_to_the_full_picture(all_rays: int) -> None:
    (full,) = frames(1, effects=PLAIN_FALLBACKS)
    errors = [
        float(
            np.abs(
                frames(2, heuristic="greedy_ratio", budget=f"{int(k * all_rays)}rays", effects=PLAIN_FALLBACKS)[
                    -1
                ].image
                - full.image
            ).mean()
        )
        for k in (0, 0.2, 0.8, 1.2)
    ]
    assert errors[0] > errors[1] > errors[2] > errors[3] == 0


def test_mandatory_items_are_traced_first(all_rays: int) -> None:
    scene = hall(effects={"reflections": "always"}, importance={"default": 0.0})
    (frame,) = frames(1, scene, heuristic="selection_graph", budget=f"{all_rays // 8}rays")
    mandatory = frame.decisions.candidates.mandatory
    assert mandatory.sum() == 1
    assert frame.decisions.chosen[mandatory].all()
    assert frame.decisions.candidates.relevance[mandatory] == 0


def test_what_was_traced_counts_for_the_next_frame(all_rays: int) -> None:
    before, after = frames(2, heuristic="random", budget=f"{all_rays // 3}rays", persistence=5.0)
    np.testing.assert_array_equal(after.decisions.candidates.was_selected, before.decisions.chosen)
    assert 0 < before.decisions.chosen.sum() < len(before.decisions.chosen)
    chosen, work = before.decisions.chosen, after.decisions.candidates
    assert work.relevance[chosen].min() > work.relevance[~chosen].max()


def test_sub_pixel_samples_share_the_budget(all_rays: int) -> None:
    frame = frames(2, heuristic="greedy_ratio", budget=f"{all_rays}rays", aa=4)[-1]
    assert frame.decisions.budget == all_rays / 4
    assert sum(count for effect, count in frame.rays.items() if effect != "primary") <= 1.05 * all_rays


def test_options_of_the_heuristic() -> None:
    one, other = (
        frames(1, heuristic="random", heuristic_options={"seed": seed}, budget="1500rays")[0].decisions.chosen
        for seed in (1, 2)
    )
    assert one.tolist() != other.tolist()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"budget": "0ms"}, "budget is '0ms'; a frame takes some time, so it must be above 0"),
        ({"budget": "50ms", "aa": 4}, "budget is 50ms and aa is 4; a budget for the whole frame needs aa 1"),
        ({"cost_model": "papers"}, "cost_model is 'papers', allowed: measured, paper. Did you mean 'paper'"),
        ({"group_by": "light"}, "group_by is 'light', allowed: object, object_effect, object_effect_light"),
        ({"reserve_ms": -1.0}, "reserve_ms is -1.0; it must be 0 or more"),
        ({"budget": "-1rays"}, "budget is '-1rays'; it must be 0 or more"),
        ({"budget": 1000}, "budget is 1000 without a unit"),
        ({"persistence": -1.0}, "persistence is -1.0; it must be 0 or more"),
        ({"persistence": float("nan")}, "persistence is nan"),
        ({"heuristic": "random", "heuristic_options": {"sed": 1}}, "unknown option 'sed'.*Did you mean 'seed'"),
        ({"heuristic": "all_trace", "heuristic_options": {"seed": 1}}, "unknown option 'seed'. It has no options"),
        ({"heuristic": "selection_graph", "heuristic_options": {"n_pointers": 0}}, "allowed: int >= 1"),
    ],
)
def test_what_is_wrong_is_said(options: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        frames(1, **options)


def test_options_are_for_a_heuristic_given_by_name() -> None:
    made = get_registry().create("heuristic", "random")
    with pytest.raises(OptionError, match="heuristic_options are for a heuristic given by name"):
        frames(1, heuristic=made, heuristic_options={"seed": 1})
