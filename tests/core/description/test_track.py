"""A scene's track: controls at rising times, and every way to get one wrong."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from phrt.budget import Budget
from phrt.controls import ControlKey, Controls
from phrt.description.document import schema
from phrt.errors import PhrtWarning
from phrt.scene import Scene

ErrorOf = Callable[..., str]

SCENE = """
prims:
  Ball: {{type: Sphere, tags: [gold], importance: {{default: 1, hunt: 5}}}}
  Settings:
    type: RenderSettings
    track:
{track}
variants:
  night: {{over: {{/Ball: {{tags: [moonlit]}}}}}}
"""


def scene_with(*keys: str) -> str:
    return SCENE.format(track="\n".join(f"      - {{{key}}}" for key in keys))


def test_a_track_becomes_controls_at_times(load: Callable[..., Scene]) -> None:
    scene = load(
        scene_with(
            "time: 0, budget: 33ms",
            "time: 1.5, situation: night, attention: {gold: 3}, parameters: {hurry: [1, 2]}",
            "time: 4, budget: 200_000rays, persistence: 0.5, view_speed: 2, situation: hunt",
        )
    )
    assert scene.settings.track == [
        ControlKey(0.0, Controls(budget=Budget(33.0, "frame_ms"))),
        ControlKey(1.5, Controls(situation="night", attention={"gold": 3.0}, parameters={"hurry": [1, 2]})),
        ControlKey(4.0, Controls(Budget(200_000.0, "rays"), 0.5, "hunt", view_speed=2.0)),
    ]
    assert scene.situations == ("default", "night")


def test_a_scene_without_a_track_has_an_empty_one(load: Callable[..., Scene]) -> None:
    assert load("prims:\n  Ball: {type: Sphere}\n").settings.track == []


@pytest.mark.parametrize(
    ("key", "told"),
    [
        ("budget: 33ms", "the key 'track[1].time' is missing"),
        ("time: -1", "track[1].time: given -1; input should be greater than or equal to 0"),
        ("time: 2, budget: 50", "track[1].budget: budget is 50 without a unit, expected a frame time (50ms)"),
        ("time: 2, budget: fast", "track[1].budget: budget is 'fast', expected a frame time (50ms)"),
        ("time: 2, budget: -3ms", "track[1].budget: budget is '-3ms'; it must be 0 or more"),
        ("time: 2, persistence: -1", "track[1].persistence: given -1; input should be greater than or equal to 0"),
        ("time: 2, attention: {gold: -1}", "track[1].attention.gold: given -1; input should be greater than"),
        ("time: 2, attention: {gold: .inf}", "track[1].attention.gold: given inf; wanted a finite number"),
        ("time: 2, view_speed: quick", "track[1].view_speed: given 'quick'; wanted a number"),
        ("time: 2, situaton: night", "unknown key 'situaton' in 'track[1]'; allowed: time, situation, budget"),
        (
            "time: 2, situation: nihgt",
            "track[1].situation: there is no situation 'nihgt'; the scene has default, night, hunt. Did you mean 'night'?",
        ),
    ],
)
def test_a_wrong_key_is_told_with_file_line_and_prim(error_of: ErrorOf, key: str, told: str) -> None:
    message = error_of(scene_with("time: 1", key))
    assert message.startswith(f"scene.yaml:8: /Settings: {told}")


def test_times_must_rise(error_of: ErrorOf) -> None:
    message = error_of(scene_with("time: 2", "time: 2"))
    assert message == "scene.yaml:6: /Settings: track: keys must be at rising times; 2 follows 2"


def test_a_tag_that_no_object_has_is_a_warning_with_its_line(load: Callable[..., Scene]) -> None:
    with pytest.warns(
        PhrtWarning, match=r"scene\.yaml:8: /Settings: track\[1\]\.attention: no object has the tag 'gol'"
    ):
        load(scene_with("time: 1", "time: 2, attention: {gol: 3}"))


def test_the_schema_knows_tracks() -> None:
    assert schema()["$defs"]["TrackKey"]["properties"]["budget"]["anyOf"][0]["type"] == "string"
