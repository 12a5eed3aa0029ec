"""What a work item is: an object with all its effects, with one, or with one light of one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scene_kit import hall

import phrt
from phrt.candidates import GROUPINGS, GroupBy
from phrt.frame import FrameResult
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic

SIZE = (96, 64)


def frame(group_by: GroupBy, **options: Any) -> FrameResult:
    effects = {"ambient_occlusion": {}, "shadows": {"fallback": "none"}}
    given = {"size": SIZE, "gbuffer": "raycast", "threads": 2, "strict": True, "effects": effects}
    with phrt.Renderer(hall(), group_by=group_by, **(given | options)) as renderer:
        return renderer.render()


class Only(Heuristic):
    """Items of these names only."""

    def __init__(self, *names: str) -> None:
        self._names = names

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self._left = [i for i in range(len(candidates)) if candidates.effect_names[candidates.effect[i]] in self._names]

    def next(self, remaining: float) -> int | None:
        return self._left.pop(0) if self._left else None


@pytest.mark.parametrize("group_by", GROUPINGS)
def test_everything_traced_is_the_same_picture_however_it_is_grouped(group_by: GroupBy) -> None:
    one, other = frame("object_effect"), frame(group_by)
    np.testing.assert_array_equal(one.image, other.image)
    assert sum(one.rays.values()) == sum(other.rays.values())


def test_an_object_is_one_item_with_the_sums_of_its_effects() -> None:
    by_object, by_effect = frame("object").decisions, frame("object_effect").decisions
    whole, single = by_object.candidates, by_effect.candidates
    assert whole.effect_names == ("all",)
    assert sorted(whole.object_id.tolist()) == sorted(set(single.object_id.tolist()))
    for row, object_id in enumerate(whole.object_id):
        mine = single.object_id == object_id
        assert whole.ray_estimate[row] == pytest.approx(single.ray_estimate[mine].sum())
        assert whole.cost[row] == pytest.approx(single.cost[mine].sum(), rel=1e-5)
        assert whole.predicted_rays[row] == pytest.approx(single.predicted_rays[mine].sum())
        assert by_object.rays[row] == pytest.approx(by_effect.rays[mine].sum(), abs=int(mine.sum()))


def test_an_object_is_traced_with_all_its_effects_or_with_none() -> None:
    budget = f"{sum(frame('object').rays.values()) // 3}rays"
    decided = frame("object", budget=budget, heuristic="greedy_relevance")
    whole = decided.decisions
    traced = whole.traced_pixels == whole.candidates.pixel_count
    assert 0 < traced.sum() < len(traced)
    ids = decided.gbuffer.object_id
    full = frame("object")
    for object_id in whole.candidates.object_id[traced]:
        for name, mask in full.masks.items():
            mine = ids == object_id
            np.testing.assert_array_equal(decided.masks[name][mine], mask[mine])


def test_lights_are_items_of_their_own_and_each_writes_its_own_component() -> None:
    full = frame("object_effect_light")
    names = full.decisions.candidates.effect_names
    lights = [name for name in names if name.startswith("shadows@")]
    assert len(lights) == 2
    first = frame("object_effect_light", heuristic=Only(lights[0]))
    np.testing.assert_array_equal(first.layers["visibility"][..., 0], full.layers["visibility"][..., 0])
    assert np.all(first.layers["visibility"][..., 1] == 1)
    assert first.rays[lights[0]] == full.rays[lights[0]]
    assert set(first.layers) == set(frame("object_effect").layers)


@pytest.mark.parametrize("group_by", GROUPINGS)
@pytest.mark.parametrize("heuristic", ["selection_graph", "uniform"])
def test_budgets_hold_for_every_grouping(group_by: GroupBy, heuristic: str) -> None:
    options = {"size": SIZE, "gbuffer": "raycast", "threads": 2, "strict": True, "group_by": group_by}
    with phrt.Renderer(hall(), heuristic=heuristic, budget="4000rays", **options) as renderer:
        decisions = [renderer.render().decisions for _ in range(4)][-1]
    assert 0 < decisions.rays.sum() <= 1.05 * 4000
