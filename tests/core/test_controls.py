"""Controls: who has a say, in which order, and what is told when somebody asks for what there is not."""

from __future__ import annotations

import math
import warnings
from dataclasses import fields
from typing import Any

import pytest

from phrt.budget import UNLIMITED, Budget
from phrt.controls import (
    DEFAULT_PERSISTENCE,
    Conditions,
    ControlKey,
    Controls,
    changed,
    in_force,
    known_situations,
)
from phrt.errors import OptionError, PhrtWarning
from phrt.scene import Scene, SceneObject


def scene() -> Scene:
    return Scene(
        "hall",
        objects=[
            SceneObject("/coin", 0, 0, tags=("gold", "coin"), importance={"default": 1.0, "hunt": 9.0}),
            SceneObject("/wall", 0, 0, tags=("building",)),
        ],
        situations=("default", "night"),
    )


def test_conditions_settle_every_field_of_controls() -> None:
    assert [entry.name for entry in fields(Controls)] == [entry.name for entry in fields(Conditions)]


def test_without_a_word_the_defaults_hold() -> None:
    found = in_force(Controls(), [], 0.0, scene())
    assert found == Conditions(UNLIMITED, DEFAULT_PERSISTENCE, "default", {}, 0.0, {})


def test_the_loaded_variant_is_the_situation_until_somebody_says_otherwise() -> None:
    night = scene()
    night.situation = "night"
    assert in_force(Controls(), [], 0.0, night).situation == "night"
    assert in_force(Controls(situation="default"), [], 0.0, night).situation == "default"


def test_a_key_of_the_track_holds_from_its_time_until_a_later_one_says_otherwise() -> None:
    track = [
        ControlKey(1.0, Controls(situation="night", persistence=0.5)),
        ControlKey(2.0, Controls(situation="hunt", attention={"gold": 3.0})),
    ]
    seen = [in_force(Controls(), track, time, scene()) for time in (0.999, 1.0, 2.0, 50.0, 1.5)]
    assert [entry.situation for entry in seen] == ["default", "night", "hunt", "hunt", "night"]
    assert [entry.persistence for entry in seen] == [DEFAULT_PERSISTENCE, 0.5, 0.5, 0.5, 0.5]
    assert [dict(entry.attention) for entry in seen] == [{}, {}, {"gold": 3.0}, {"gold": 3.0}, {}]


def test_the_caller_is_stronger_than_the_track_field_by_field_and_can_give_a_field_back() -> None:
    track = [ControlKey(0.0, Controls(budget=Budget(33.0, "frame_ms"), situation="night"))]
    asked = changed(Controls(), {"budget": "200rays"}, scene())
    found = in_force(asked, track, 0.0, scene())
    assert (found.budget, found.situation) == (Budget(200.0, "rays"), "night")
    again = changed(asked, {"budget": None}, scene())
    assert in_force(again, track, 0.0, scene()).budget == Budget(33.0, "frame_ms")


def test_no_budget_is_said_with_none_and_not_with_none_at_all() -> None:
    track = [ControlKey(0.0, Controls(budget=Budget(33.0, "frame_ms")))]
    assert in_force(changed(Controls(), {"budget": "none"}, scene()), track, 0.0, scene()).budget == UNLIMITED


def test_a_track_made_by_hand_may_hold_a_budget_as_text() -> None:
    found = in_force(Controls(), [ControlKey(0.0, Controls(budget="33ms"))], 0.0, scene())
    assert found.budget == Budget(33.0, "frame_ms")


def test_an_empty_attention_is_stronger_than_that_of_the_track() -> None:
    track = [ControlKey(0.0, Controls(attention={"gold": 3.0}))]
    assert in_force(changed(Controls(), {"attention": {}}, scene()), track, 0.0, scene()).attention == {}


def test_what_was_handed_in_may_change_afterwards() -> None:
    attention, parameters = {"gold": 3.0}, {"hurry": 1}
    kept = changed(Controls(), {"attention": attention, "parameters": parameters}, scene())
    attention["gold"], parameters["hurry"] = 7.0, 2
    assert (kept.attention, kept.parameters) == ({"gold": 3.0}, {"hurry": 1})


def test_known_situations_are_default_the_variants_and_those_of_importance_maps() -> None:
    assert known_situations(scene()) == ["default", "night", "hunt"]


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"situaton": "night"}, "no control 'situaton'; there are budget, persistence, .* Did you mean 'situation'"),
        ({"budget": "-3rays"}, "budget is '-3rays'; it must be 0 or more"),
        ({"budget": 33}, "budget is 33 without a unit"),
        ({"persistence": -0.1}, "persistence is -0.1; it must be 0 or more, and at most 1e[+]18"),
        ({"persistence": math.inf}, "persistence is inf; it must be 0 or more, and at most 1e[+]18"),
        ({"persistence": "much"}, "persistence is 'much'; it must be 0 or more, and at most 1e[+]18"),
        ({"view_speed": math.nan}, "view_speed is nan; it must be 0 or more, and at most 1e[+]18"),
        ({"view_speed": -1}, "view_speed is -1; it must be"),
        ({"situation": "nihgt"}, "no situation 'nihgt'; the scene has default, night, hunt. Did you mean 'night'"),
        ({"situation": 3}, "no situation 3; the scene has default, night, hunt"),
        ({"attention": {"gold": -1.0}}, "attention for 'gold' is -1.0; it must be 0 or more, and at most 1e[+]18"),
        ({"attention": {"gold": math.inf}}, "attention for 'gold' is inf; it must be 0 or more, and at most 1e[+]18"),
        ({"attention": {"gold": True}}, "attention for 'gold' is True; it must be 0 or more, and at most 1e[+]18"),
        ({"attention": "gold"}, "attention is 'gold', expected factors by tag"),
        ({"parameters": [1]}, r"parameters is \[1\], expected values by name"),
        ({"parameters": {1: 2}}, "parameters is {1: 2}, expected values by name"),
    ],
)
def test_what_cannot_be_is_told(changes: dict[str, Any], told: str) -> None:
    with pytest.raises(OptionError, match=told):
        changed(Controls(), changes, scene())


def test_a_wrong_change_changes_nothing_else() -> None:
    controls = Controls(persistence=0.5)
    with pytest.raises(OptionError):
        changed(controls, {"persistence": 0.7, "view_speed": -1}, scene())
    assert controls.persistence == 0.5


def test_attention_to_a_tag_that_no_object_has_is_a_warning() -> None:
    with pytest.warns(
        PhrtWarning, match="no object has the tag 'glod'; there are building, coin, gold. Did you mean 'gold'"
    ):
        kept = changed(Controls(), {"attention": {"glod": 3.0}}, scene())
    assert kept.attention == {"glod": 3.0}
    with pytest.warns(PhrtWarning, match="no object has the tag 'gold'; no object has a tag"):
        changed(Controls(), {"attention": {"gold": 3.0}}, Scene("empty"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        changed(Controls(), {"attention": {"gold": 3.0}}, scene())
