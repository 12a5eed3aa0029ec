"""A whole analysis of small scenes: what pays is found, what changes nothing is ruled out, and counts are counts."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scene_kit import GLASS, LAMBERT, MIRROR, PLAIN_FALLBACKS, Stage, at, ball, floor, quad

import phrt
from phrt.analysis.analyze import ProbeOptions, analyze
from phrt.analysis.probes import LeaveOut, probe, probe_times
from phrt.model import Material
from phrt.profile import Profile
from phrt.profile_edits import decisions_of
from phrt.scene import Scene

OPTIONS = ProbeOptions(frames=4, size=(64, 64), threads=2)


def scene(night: bool = False) -> Scene:
    """A mirror and a chalk ball of the same size beside each other on a floor under a bright sky, a glowing sign behind them, and a
    ball that nobody sees. By night the mirror is covered with cloth."""
    made = Stage(dome=(1.0, 0.2, 0.1)).add("/floor", floor(8), LAMBERT)
    made.add("/mirror", ball(0.5), LAMBERT if night else MIRROR, at(-0.7, 0.5, 0), tags=("toy",))
    made.add("/chalk", ball(0.5), LAMBERT, at(0.7, 0.5, 0), effects={"shadows": "always"})
    made.add("/sign", quad(2, 0.5), Material("sign", unlit=True), at(0, 1.4, -1.5))
    made.add("/hidden", ball(0.5), replace(MIRROR), at(0, 0.5, 30), tags=("toy",))
    made.light("point", at(0, 4, 1), intensity=30.0)
    made.camera((0, 1.0, 4), (0, 0.6, 0))
    result = made.scene
    result.settings.frames = 4
    result.settings.effects = PLAIN_FALLBACKS
    result.situations = ("default", "night")
    result.situation = "night" if night else "default"
    return result


@pytest.fixture(scope="module")
def profile() -> Profile:
    return analyze(lambda situation: scene(situation == "night"), ["default", "night"], OPTIONS)


def test_probes_are_spread_over_the_scenes_frames() -> None:
    long = Scene("long")
    long.settings.frames, long.settings.fps = 300, 30.0
    assert probe_times(long, 3) == [(50, 50 / 30), (150, 5.0), (250, 250 / 30)]
    long.settings.frames = 2
    assert probe_times(long, 12) == [(0, 0.0), (1, 1 / 30)]


def test_a_mirror_gains_more_than_chalk_and_only_where_it_is_one(profile: Profile) -> None:
    mirror, chalk = profile.measured["/mirror"], profile.measured["/chalk"]
    assert mirror.importance["default"] > 2 * chalk.importance["default"]
    assert mirror.importance["night"] < mirror.importance["default"] / 2
    assert (mirror.kind, chalk.kind, profile.measured["/sign"].kind) == ("mirror", "rough", "unlit")


def test_changes_are_those_between_pictures_with_and_without_the_effect(profile: Profile) -> None:
    change = profile.measured["/mirror"].change
    assert change["reflections"]["default"] > 0.02
    assert {effect: set(values) for effect, values in change.items()} == {
        "reflections": {"default"},
        "shadows": {"night"},
    }
    assert profile.measured["/floor"].change["shadows"]["default"] > 0


def test_rays_are_counted_object_by_object(profile: Profile) -> None:
    # One light, and the floor faces it everywhere; a ball's underside does not, and takes no shadow ray.
    assert profile.measured["/floor"].rays_per_pixel["shadows"]["default"] == pytest.approx(1.0)
    chalk = profile.measured["/chalk"].rays_per_pixel["shadows"]["default"]
    assert 0.3 < chalk < 0.9
    assert profile.measured["/mirror"].rays_per_pixel["reflections"]["default"] >= 1.0


def test_area_and_visibility_are_means(profile: Profile) -> None:
    with phrt.Renderer(scene(), size=(64, 64), threads=2) as renderer:
        frame = renderer.render()
    work = frame.decisions.candidates
    row = int(np.flatnonzero(work.object_id == 1)[0])
    assert profile.measured["/floor"].area == pytest.approx(float(work.area[row]), rel=1e-6)
    assert profile.measured["/floor"].visibility == pytest.approx(float(work.visibility[row]), rel=1e-6)
    assert profile.measured["/floor"].seen == 8


def test_what_no_probe_shows_takes_after_its_like(profile: Profile) -> None:
    hidden = profile.measured["/hidden"]
    assert (hidden.seen, hidden.area, hidden.visibility, hidden.change) == (0, 0.0, 0.0, {})
    assert hidden.importance["default"] == pytest.approx(profile.measured["/mirror"].importance["default"], rel=0.2)


def test_those_that_gain_most_come_first_and_the_unseen_last(profile: Profile) -> None:
    order = list(profile.objects)
    assert order[-1] == "/hidden"
    assert order.index("/mirror") < order.index("/sign")


def test_a_fresh_profile_decides_nothing_and_fits_its_scene(profile: Profile) -> None:
    assert decisions_of(profile) == []
    with phrt.Renderer(scene(), size=(32, 32), threads=2, profile=profile) as renderer:
        renderer.render()
    assert renderer.scene.objects[1].importance == profile.measured["/mirror"].importance


def test_times_of_effects_are_measured(profile: Profile) -> None:
    cost = profile.effects["shadows"]
    assert cost.ms_per_ray >= 0
    assert cost.ms_per_item >= 0
    assert cost.ms_per_item + cost.ms_per_ray > 0


def lonely(**switches: str) -> Scene:
    """A floor with nothing on it: nothing can cast a shadow there."""
    made = Stage(dome=(0.2, 0.2, 0.2)).add("/floor", floor(8), LAMBERT, effects=switches)
    made.light("point", at(0, 4, 1), intensity=30.0).camera((0, 1.5, 4), (0, 0, 0))
    made.scene.settings.frames = 3
    return made.scene


def test_an_effect_that_changes_nothing_is_ruled_out_and_the_picture_stays_the_same() -> None:
    found = analyze(lambda _: lonely(), ["default"], OPTIONS)
    assert found.measured["/floor"].effects == {"shadows": "never"}
    with (
        phrt.Renderer(lonely(), size=(48, 48), threads=2) as plain,
        phrt.Renderer(lonely(), size=(48, 48), threads=2, profile=found) as spared,
    ):
        first, second = plain.render(), spared.render()
    np.testing.assert_array_equal(first.image, second.image)
    assert first.rays["shadows"] > 0
    assert second.rays.get("shadows", 0) == 0


def test_what_the_scene_switches_is_not_ruled_out() -> None:
    found = analyze(lambda _: lonely(shadows="auto"), ["default"], OPTIONS)
    assert found.measured["/floor"].effects == {}


def test_too_few_probes_rule_nothing_out() -> None:
    found = analyze(lambda _: lonely(), ["default"], replace(OPTIONS, frames=2))
    assert found.measured["/floor"].effects == {}


def test_what_the_scene_says_about_importance_is_taken_in() -> None:
    def said(importance: dict[str, float]) -> Scene:
        made = scene()
        made.objects[1].importance = importance
        return made

    plain = analyze(lambda _: said({}), ["default"], OPTIONS).measured["/mirror"].importance
    twice = analyze(lambda _: said({"default": 2.0, "hunt": 6.0}), ["default"], OPTIONS).measured["/mirror"].importance
    assert twice["default"] == pytest.approx(2 * plain["default"], rel=0.06)
    assert twice["hunt"] == pytest.approx(6 * plain["default"], rel=0.06)


def test_an_empty_scene_has_an_empty_profile() -> None:
    made = Stage().camera((0, 0, 4), (0, 0, 0))
    found = analyze(lambda _: made.scene, ["default"], OPTIONS)
    assert (found.measured, found.objects, found.effects) == ({}, {}, {})


def test_a_scene_without_light_has_a_profile_without_nan() -> None:
    made = Stage().add("/ball", ball(0.5, 2), GLASS).camera((0, 0, 4), (0, 0, 0))
    found = analyze(lambda _: made.scene, ["default"], OPTIONS)
    assert found.measured["/ball"].importance == {"default": 1.0}


def test_leaving_an_effect_out_leaves_out_its_items_alone() -> None:
    heuristic = LeaveOut()
    heuristic.left_out = frozenset(["reflections"])
    with phrt.Renderer(scene(), size=(48, 48), heuristic=heuristic, threads=2) as renderer:
        decisions = renderer.render().decisions
    names = np.array(decisions.candidates.effect_names)[decisions.candidates.effect]
    np.testing.assert_array_equal(decisions.chosen, names != "reflections")


def test_what_probes_cost_is_not_what_the_next_run_begins_with(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PHRT_CACHE", str(tmp_path))
    found = probe(lonely(), (16, 16), 2, "neutral", threads=1)
    assert found.coefficients["shadows"]["ms_per_ray"] > 0
    assert list(tmp_path.iterdir()) == []


def test_probing_says_when_a_probe_is_done() -> None:
    done: list[int] = []
    probe(lonely(), (16, 16), 3, "neutral", threads=1, done=lambda: done.append(1))
    assert len(done) == 3
