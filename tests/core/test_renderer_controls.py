"""Controls at work: what `Renderer.control`, the scene's track and a profile change in the next frame, and in no earlier one."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scene_kit import LAMBERT, MIRROR, Stage, at, ball

import phrt
from phrt.budget import Budget
from phrt.controls import ControlKey, Controls
from phrt.errors import OptionError, PhrtWarning, ProfileError
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.machine import machine_name
from phrt.profile import EffectCost, Given, Measured, Probes, Profile, ProfiledScene, objects_hash
from phrt.profile_text import write_profile
from phrt.scene import Scene


class Listener(Heuristic):
    """Traces nothing, and keeps what it was told."""

    def __init__(self) -> None:
        self.candidates: list[Candidates] = []
        self.contexts: list[FrameContext] = []

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self.candidates.append(candidates)
        self.contexts.append(context)

    def next(self, remaining: float) -> int | None:
        return None

    def factor(self, object_id: int) -> float:
        """K of an object in the latest frame."""
        work = self.candidates[-1]
        return float(work.importance_factor[work.object_id == object_id][0])


def two_balls() -> Scene:
    """A gold mirror ball, three times as important by night, and a plain one; the eye walks to the right by 1 m a second."""
    made = Stage(dome=(0.5, 0.5, 0.5))
    made.add("/gold", ball(0.5, 2), MIRROR, at(-0.7, 0, -4), tags=("gold",), importance={"default": 1.0, "night": 3.0})
    made.add("/plain", ball(0.5, 2), LAMBERT, at(0.7, 0, -4), tags=("clay",))
    made.light("point", at(0, 5, 0), intensity=10.0).camera((0, 0, 0), (0, 0, -1))
    return made.scene


def renderer(scene: Scene | None = None, **options: Any) -> tuple[phrt.Renderer, Listener]:
    listener = Listener()
    options = {"size": (64, 32), "gbuffer": "raycast", "threads": 1, "heuristic": listener} | options
    return phrt.Renderer(scene or two_balls(), **options), listener


def test_the_situation_can_change_at_any_frame_and_k_follows() -> None:
    made, heard = renderer()
    with made:
        made.render(0.0)
        assert (heard.factor(1), heard.factor(2)) == (1.0, 1.0)
        made.control(situation="night")
        made.render(0.1)
        assert (heard.factor(1), heard.factor(2)) == (1.5, 0.5)
        made.control(situation=None)
        made.render(0.2)
        assert (heard.factor(1), heard.factor(2)) == (1.0, 1.0)
    assert [context.situation for context in heard.contexts] == ["default", "night", "default"]


def test_attention_multiplies_k() -> None:
    made, heard = renderer()
    with made:
        made.control(attention={"gold": 4.0})
        made.render()
        assert (heard.factor(1), heard.factor(2)) == (4.0, 1.0)
        assert heard.contexts[-1].attention == {"gold": 4.0}
        made.control(attention={"clay": 0.0})
        made.render()
        assert (heard.factor(1), heard.factor(2)) == (1.0, 0.0)


def test_parameters_reach_heuristics_as_they_are() -> None:
    made, heard = renderer()
    with made:
        made.render()
        made.control(parameters={"hurry": 0.5, "mood": ["calm"]})
        made.render()
    assert [context.parameters for context in heard.contexts] == [{}, {"hurry": 0.5, "mood": ["calm"]}]


def views(scene: Scene, *x: float) -> list[Any]:
    from phrt.camera import CameraView, look_at

    lens = scene.cameras[0].lens
    return [CameraView.from_lens(lens, look_at((at_x, 0, 0), (at_x, 0, -1)), 64, 32) for at_x in x]


def test_view_speed_lowers_v_by_what_moves_and_is_told_to_heuristics() -> None:
    first, second = views(two_balls(), 0.0, 0.1)
    plain, slow = (renderer(), renderer())
    with plain[0], slow[0]:
        slow[0].control(view_speed=2.0)
        for made, _ in (plain, slow):
            made.render(0.0, camera=first)
            made.render(0.1, camera=second)
    fast, lowered = plain[1].candidates[-1], slow[1].candidates[-1]
    # 0.1 m in 0.1 s at 4 m, where the picture is 2 * 4 * tan(fov / 2) * aspect metres wide.
    speed = 1.0 / (2 * 4 * first.tan_half[0])
    np.testing.assert_allclose(lowered.visibility, fast.visibility / (1 + 2 * speed), rtol=1e-5)
    assert plain[1].contexts[0].view_speed == 0.0
    assert plain[1].contexts[1].view_speed == pytest.approx(speed, rel=0.1)


def test_sub_pixel_samples_of_a_frame_see_the_same_speed() -> None:
    first, second = views(two_balls(), 0.0, 0.1)
    made, heard = renderer(aa=4)
    with made:
        made.render(0.0, camera=first)
        made.render(0.1, camera=second)
    speeds = [context.view_speed for context in heard.contexts]
    assert speeds[:4] == [0.0] * 4
    assert len(set(speeds[4:])) == 1
    assert speeds[4] > 0


def test_the_budget_can_change_at_any_frame() -> None:
    with phrt.Renderer(two_balls(), size=(64, 32), threads=1, budget="0rays") as made:
        assert not made.render().decisions.chosen.any()
        made.control(budget="none")
        every = made.render().decisions
        assert every.chosen.all()
        limit = int(every.rays.min())
        made.control(budget=f"{limit}rays")
        few = made.render()
    assert few.decisions.rays.sum() == limit
    assert few.budget == Budget(limit, "rays")


def with_track(*keys: ControlKey) -> Scene:
    scene = two_balls()
    scene.settings.track = list(keys)
    return scene


def test_a_track_steers_by_time_and_the_caller_is_stronger() -> None:
    track = (
        ControlKey(0.0, Controls(budget=Budget(100.0, "rays"))),
        ControlKey(1.0, Controls(situation="night", attention={"gold": 2.0})),
    )
    made, heard = renderer(with_track(*track))
    with made:
        for time in (0.0, 1.0, 0.5, 1.5):
            made.render(time)
        made.control(situation="default", budget="7rays")
        made.render(1.5)
    assert [context.situation for context in heard.contexts] == ["default", "night", "default", "night", "default"]
    assert [context.budget for context in heard.contexts] == [100.0] * 4 + [7.0]
    assert [len(context.attention) for context in heard.contexts] == [0, 1, 0, 1, 1]


def test_arguments_of_the_renderer_are_stronger_than_the_track() -> None:
    track = ControlKey(0.0, Controls(budget=Budget(100.0, "rays"), persistence=0.5))
    made, heard = renderer(with_track(track), budget="none", persistence=0.25)
    with made:
        made.render()
    assert heard.contexts[0].budget_unit == "none"
    assert heard.candidates[0].persistence == 0.25


def test_what_cannot_be_is_told_and_changes_nothing() -> None:
    made, heard = renderer()
    with made:
        for changes, told in (
            ({"situation": "nihgt"}, "no situation 'nihgt'; the scene has default, night. Did you mean 'night'"),
            ({"speed": 1}, "no control 'speed'"),
            ({"attention": {"gold": -1}}, "attention for 'gold' is -1"),
            ({"situation": "night", "view_speed": -1}, "view_speed is -1"),
        ):
            with pytest.raises(OptionError, match=told):
                made.control(**changes)
        with pytest.warns(PhrtWarning, match="no object has the tag 'glod'"):
            made.control(attention={"glod": 2.0})
        made.render()
    assert heard.contexts[0].situation == "default"
    assert heard.factor(1) == 1.0


def test_a_frame_budget_needs_one_sample_wherever_it_comes_from() -> None:
    told = "budget is 20ms and aa is 4; a budget for the whole frame needs aa 1"
    with pytest.raises(OptionError, match=told):
        phrt.Renderer(with_track(ControlKey(3.0, Controls(budget=Budget(20.0, "frame_ms")))), aa=4)
    made, _ = renderer(aa=4)
    with made, pytest.raises(OptionError, match=told):
        made.control(budget="20ms")


# Profiles


def profile(**given: Given) -> Profile:
    scene = two_balls()
    measured = {
        "/gold": Measured(
            kind="mirror", importance={"default": 3.0, "night": 8.0}, rays_per_pixel={"reflections": {"default": 2.5}}
        ),
        "/plain": Measured(
            kind="rough",
            importance={"default": 1.0},
            effects={"shadows": "never"},
            rays_per_pixel={"shadows": {"default": 0.75}},
        ),
    }
    return Profile(
        phrt_profile=1,
        scene=ProfiledScene(name=scene.name, objects={"default": objects_hash(scene)}),
        probes=Probes(frames=1, size=(8, 8), situations=["default"], tone_map="srgb", machine=machine_name()),
        effects={"shadows": EffectCost(ms_per_item=0.25, ms_per_ray=0.5, change=0.1)},
        objects={f"/{name}": entry for name, entry in given.items()},
        measured=measured,
    )


def test_a_profile_gives_importance_by_situation_and_rules_effects_out() -> None:
    made, heard = renderer(profile=profile())
    with made:
        made.render()
        assert (heard.factor(1), len(heard.candidates[-1])) == (1.5, 1)
        made.control(situation="night")
        made.render()
        assert heard.factor(1) == pytest.approx(8 / 4.5)


def test_q_of_a_profile_is_what_predictions_start_from() -> None:
    made, heard = renderer(profile=profile(plain=Given(effects={"shadows": "auto"})))
    with made:
        made.render()
    work = heard.candidates[0]
    by_object = dict(zip(work.object_id.tolist(), work.ray_estimate.tolist(), strict=True))
    assert by_object == {1: 2.5, 2: 0.75}
    np.testing.assert_allclose(work.predicted_rays, np.ceil(work.pixel_count * work.ray_estimate))
    np.testing.assert_allclose(work.cost, work.visibility * work.ray_estimate)


def test_q_of_an_effect_with_other_options_than_the_scenes_is_its_own_estimate() -> None:
    scene = two_balls()
    given = profile(plain=Given(effects={"shadows": "auto"}))
    made, heard = renderer(scene, profile=given, effects={"shadows": {"samples": 4}})
    with made:
        made.render()
    work = heard.candidates[0]
    assert dict(zip(work.object_id.tolist(), work.ray_estimate.tolist(), strict=True)) == {1: 2.5, 2: 1.0}


def test_light_by_light_the_lights_share_q_and_cost_the_same() -> None:
    scene = two_balls()
    scene.lights.append(scene.lights[0])
    given = profile(plain=Given(effects={"shadows": "auto"}))
    made, heard = renderer(scene, profile=given, group_by="object_effect_light")
    with made:
        made.render()
    work = heard.candidates[0]
    plain = work.ray_estimate[work.object_id == 2]
    assert plain.tolist() == [0.375, 0.375]


def test_times_of_a_profile_count_on_its_own_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PHRT_CACHE", str(tmp_path))
    made, _ = renderer(profile=profile())
    with made:
        assert made.costs()["shadows"] == pytest.approx({"ms_per_item": 0.25, "ms_per_ray": 0.5})
    monkeypatch.setattr("phrt.profile_use.machine_name", lambda: "another")
    made, _ = renderer(profile=profile())
    with made:
        assert made.costs()["shadows"]["ms_per_ray"] < 0.01


def test_a_mandatory_effect_of_a_profile_is_mandatory() -> None:
    made, heard = renderer(profile=profile(gold=Given(effects={"reflections": "always"})))
    with made:
        made.render()
    assert heard.candidates[0].mandatory.tolist() == [True]


def test_a_profile_is_read_from_its_file(tmp_path: Path) -> None:
    path = tmp_path / "balls.profile.yaml"
    write_profile(path, profile())
    made, heard = renderer(profile=path)
    with made:
        made.render()
    assert heard.factor(1) == 1.5


def test_a_profile_that_cannot_be_used_is_an_error_and_nothing_is_left_running(tmp_path: Path) -> None:
    path = tmp_path / "balls.profile.yaml"
    path.write_text("phrt_profile: 7\n")
    with pytest.raises(ProfileError, match="given 7; this program reads version 1"):
        renderer(profile=path)
    with pytest.raises(ProfileError, match="cannot be read"):
        renderer(profile=tmp_path / "nothing.yaml")
    other = Stage().add("/teapot", ball()).camera((0, 0, 3), (0, 0, 0)).scene
    with pytest.raises(ProfileError, match="none of its objects"):
        renderer(other, profile=profile())


def test_what_a_profile_says_of_unknown_things_is_a_warning() -> None:
    with pytest.warns(PhrtWarning, match="the profile: there is no effect shadow here. Did you mean 'shadows'"):
        made, _ = renderer(profile=profile(gold=Given(effects={"shadow": "never"})))
    made.close()


def test_the_callers_scene_stays_as_it_was() -> None:
    scene = two_balls()
    made, _ = renderer(scene, profile=profile())
    with made:
        made.render()
    assert scene.objects[0].importance == {"default": 1.0, "night": 3.0}
    assert scene.objects[1].effects == {}
