"""Profiles: written and read back, edits told and kept, fitted to a scene, and everything that can be wrong with one."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scene_kit import MIRROR, Stage, at, ball, quad

from phrt.errors import InputError, OptionError, PhrtWarning, ProfileError
from phrt.profile import (
    EffectCost,
    Given,
    Measured,
    Probes,
    Profile,
    ProfiledScene,
    applied,
    check_fits,
    objects_hash,
    read_profile,
    warn_of_unknown,
)
from phrt.profile_edits import decisions_of, with_decisions
from phrt.profile_text import profile_text, write_profile
from phrt.scene import Scene

EFFECTS = ("shadows", "reflections")


def scene(**ball_switches: Any) -> Scene:
    made = Stage().add("/ball", ball(0.5, 1), MIRROR, at(0, 0, -3), **ball_switches).add("/wall", quad())
    made.scene.name = "Hall"
    made.scene.situations = ("default", "night")
    return made.scene


def measured(importance: dict[str, float], **values: Any) -> Measured:
    return Measured(kind="mirror", seen=3, area=0.25, visibility=1e-4, importance=importance, **values)


def profile(of: Scene | None = None, **objects: Given) -> Profile:
    """Of `scene()`: the ball gained 2, at night 3, and shadows change nothing about it. `objects`: /ball and /wall as given."""
    known = {
        "/ball": measured(
            {"default": 2.0, "night": 3.0},
            effects={"shadows": "never"},
            rays_per_pixel={"reflections": {"default": 2.5, "night": 2.25}},
            change={"reflections": {"default": 0.125, "night": 0.5}},
        ),
        "/wall": measured({"default": 0.5}, rays_per_pixel={"shadows": {"default": 1.5}}),
    }
    given = {path: Given(importance=found.importance, effects=found.effects) for path, found in known.items()}
    return Profile(
        phrt_profile=1,
        scene=ProfiledScene(name="Hall", objects={"default": objects_hash(of or scene())}),
        probes=Probes(frames=3, size=(160, 90), situations=["default"], tone_map="neutral", machine="here"),
        effects={"shadows": EffectCost(ms_per_item=0.02, ms_per_ray=1e-4, change=0.03)},
        objects=given | {f"/{name}": entry for name, entry in objects.items()},
        measured=known,
    )


def silently(function: Any, *arguments: Any) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return function(*arguments)


# Text


def test_what_is_written_is_what_is_read(tmp_path: Path) -> None:
    there = profile(
        wall=Given(importance={"default": 7.5}, note="the one: with a # and a\nline", edited=["importance"])
    )
    path = tmp_path / "hall.profile.yaml"
    write_profile(path, there)
    assert read_profile(path) == there
    assert [entry.name for entry in tmp_path.iterdir()] == ["hall.profile.yaml"], "nothing is left beside it"


def test_odd_names_survive(tmp_path: Path) -> None:
    odd = "a: b #c \"d\" 'e' [f] {g}, ü 漢 \t*&!|>%@`"
    there = profile().model_copy(update={"objects": {odd: Given(importance={odd: 1.0}, note=odd)}})
    path = tmp_path / "odd.yaml"
    write_profile(path, there)
    assert read_profile(path) == there


def test_an_object_is_one_line_with_a_remark() -> None:
    lines = profile_text(profile()).splitlines()
    section = lines[lines.index("objects:") + 1 : lines.index("measured:") - 1]
    assert [line.split("  #")[0].strip() for line in section] == [
        "/ball: {importance: {default: 2.0, night: 3.0}, effects: {shadows: never}}",
        "/wall: {importance: 0.5}",
    ]
    assert section[0].endswith("  # mirror; 25.0% in 3/3; reflections 50.0%")


def test_it_is_plain_yaml() -> None:
    data = yaml.safe_load(profile_text(profile()))
    assert data["phrt_profile"] == 1
    assert data["objects"]["/wall"] == {"importance": 0.5}
    assert data["measured"]["/ball"]["rays_per_pixel"] == {"reflections": {"default": 2.5, "night": 2.25}}


def test_sections_and_lines_may_be_empty(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(text_of(objects={"/ball": None, "/wall": {}}).replace("null", ""))
    assert read_profile(path).objects == {"/ball": Given(), "/wall": Given()}
    bare = profile().model_copy(update={"objects": {}, "measured": {}, "effects": {}})
    write_profile(path, bare)
    assert read_profile(path) == bare


def test_a_write_that_fails_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "there.yaml"
    path.mkdir()
    with pytest.raises(OptionError, match="cannot write"):
        write_profile(path, profile())
    assert [entry.name for entry in tmp_path.iterdir()] == ["there.yaml"]


# What is wrong with a file


def text_of(**changes: Any) -> str:
    """A valid profile with other values at its top level; None leaves one out."""
    data = yaml.safe_load(profile_text(profile())) | changes
    return yaml.safe_dump({key: value for key, value in data.items() if value is not None}, sort_keys=False)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "the file is empty; `phrt analyze` writes a profile"),
        ("prims: {}\n", "is not a profile, which begins with `phrt_profile: 1`"),
        ("- 1\n", "is not a profile"),
        ("a: [1\n", "p.yaml:2: not valid YAML"),
        ("phrt_profile: !!python/object/apply:os.system ['true']\n", "tag .* is not allowed; profiles are plain data"),
        ("phrt_profile: 1\n---\nphrt_profile: 1\n", "a second YAML document; a profile holds one"),
        (
            text_of(phrt_profile=0),
            "p.yaml:1: phrt_profile: given 0; this program reads version 1. `phrt analyze` writes",
        ),
        (text_of(phrt_profile=2), "phrt_profile: given 2; this program reads version 1"),
        (text_of(phrt_profile="one"), "phrt_profile: given 'one'; this program reads version 1"),
        (text_of(scene=None), "the key 'scene' is missing"),
        (text_of(object={}), "unknown key 'object'; allowed: .* Did you mean 'objects'"),
        (
            text_of(objects={"/ball": {"importanse": 2}}),
            r"unknown key 'importanse' in 'objects./ball'; .* 'importance'",
        ),
        (text_of(objects={"/ball": {"importance": -1}}), "objects./ball.importance.default: given -1; input should be"),
        (text_of(objects={"/ball": {"importance": "big"}}), "objects./ball.importance: given 'big'; wanted a mapping"),
        (text_of(objects={"/ball": {"effects": {"shadows": "nevr"}}}), "given 'nevr'; allowed: auto, always, never"),
        (text_of(objects={"/ball": {"importance": float("nan")}}), "given nan"),
        (text_of(objects=[1]), "objects: given \\[1\\]; wanted a mapping"),
    ],
)
def test_a_broken_file_is_told_with_its_line(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(text)
    with pytest.raises(ProfileError, match=told) as caught:
        read_profile(path)
    assert str(path) in str(caught.value)
    assert "scene file" not in str(caught.value)


def test_several_problems_are_told_at_once(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(text_of(objects={"/ball": {"importance": -1}, "/wall": {"effects": {"shadows": 3}}}))
    with pytest.raises(ProfileError, match="2 problems in the profile"):
        read_profile(path)


def test_bytes_that_are_no_text_and_files_that_are_not_there_are_told(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    path.write_bytes(b"phrt_profile: \xff\xfe")
    with pytest.raises(ProfileError, match="is not UTF-8 text"):
        read_profile(path)
    for wrong in (tmp_path / "nothing.yaml", tmp_path, tmp_path / ("x" * 5000)):
        with pytest.raises(ProfileError, match="cannot be read"):
            read_profile(wrong)


def test_a_huge_file_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "p.yaml"
    write_profile(path, profile())
    monkeypatch.setattr("phrt.profile.MAX_TEXT_BYTES", 100)
    with pytest.raises(ProfileError, match=r"\d+ bytes; a profile may have at most 100"):
        read_profile(path)


def test_a_profile_error_is_the_users_to_mend() -> None:
    assert issubclass(ProfileError, InputError)


# Edits


def test_a_fresh_profile_has_no_decisions() -> None:
    assert decisions_of(profile()) == []


@pytest.mark.parametrize(
    ("given", "values"),
    [
        (Given(), []),
        (Given(importance={"default": 2.0, "night": 3.0}), []),
        (Given(importance={"default": 2.0, "night": 3.0000000000001}), []),
        (Given(importance={"default": 2.0, "night": 3.1}), ["importance"]),
        (Given(importance={"default": 2.0}), ["importance"]),
        (Given(effects={"shadows": "never"}), []),
        (Given(effects={"shadows": "auto"}), ["effects.shadows"]),
        (Given(effects={"reflections": "auto"}), []),
        (Given(effects={"reflections": "always"}), ["effects.reflections"]),
        (Given(importance={"default": 2.0, "night": 3.0}, edited=["importance"]), ["importance"]),
        (Given(edited=["importance", "effects.shadows"]), []),
    ],
)
def test_decided_is_what_differs_or_is_named(given: Given, values: list[str]) -> None:
    assert [decision.value for decision in decisions_of(profile(ball=given))] == values


def test_decisions_and_notes_survive_another_analysis_and_the_rest_is_new() -> None:
    before = profile(ball=Given(importance={"default": 9.0}, note="hero"), wall=Given(effects={"shadows": "always"}))
    fresh = profile()
    fresh.measured["/ball"] = measured({"default": 4.0}, effects={"reflections": "never"})
    fresh.objects["/ball"] = Given(importance={"default": 4.0}, effects={"reflections": "never"})
    merged, kept = with_decisions(fresh, before)
    assert [(entry.path, entry.value) for entry in kept] == [("/ball", "importance"), ("/wall", "effects.shadows")]
    assert merged.objects["/ball"] == Given(
        importance={"default": 9.0}, effects={"reflections": "never"}, note="hero", edited=["importance"]
    )
    assert merged.objects["/wall"].importance == {"default": 0.5}
    assert merged.measured["/ball"].importance == {"default": 4.0}


def test_a_decision_outlives_an_analysis_that_comes_to_the_same_value() -> None:
    agreeing = profile()
    agreeing.measured["/ball"] = measured({"default": 9.0}, effects={"shadows": "never"})
    once, _ = with_decisions(agreeing, profile(ball=Given(importance={"default": 9.0})))
    twice, kept = with_decisions(profile(), once)
    assert [entry.value for entry in kept] == ["importance"]
    assert twice.objects["/ball"].importance == {"default": 9.0}


def test_decisions_survive_the_file(tmp_path: Path) -> None:
    path = tmp_path / "p.yaml"
    write_profile(path, profile())
    edited = path.read_text().replace("/wall: {importance: 0.5}", "/wall: {importance: 8, effects: {shadows: always}}")
    path.write_text(edited)
    merged, kept = with_decisions(profile(), read_profile(path))
    write_profile(path, merged)
    assert [entry.value for entry in kept] == ["importance", "effects.shadows"]
    assert (
        "/wall: {importance: 8.0, effects: {shadows: always}, edited: [importance, effects.shadows]}"
        in path.read_text()
    )
    assert len(decisions_of(read_profile(path))) == 2


def test_decisions_about_what_is_gone_are_kept_and_said_to_be() -> None:
    merged, _ = with_decisions(profile(), profile(ghost=Given(importance={"default": 3.0})))
    assert merged.objects["/ghost"].importance == {"default": 3.0}
    assert "  # not in the scene" in next(line for line in profile_text(merged).splitlines() if "/ghost" in line)


# Use


def test_a_scene_gets_what_was_measured_and_stays_as_it_was() -> None:
    there = scene()
    found = silently(applied, profile(), there)
    ball_, wall = found.objects
    assert (ball_.importance, ball_.effects) == ({"default": 2.0, "night": 3.0}, {"shadows": "never"})
    assert (wall.importance, wall.effects) == ({"default": 0.5}, {})
    assert there.objects[0].importance == {}
    assert found.meshes is there.meshes


def test_what_was_decided_is_stronger_than_what_was_measured() -> None:
    decided = profile(ball=Given(importance={"default": 9.0}, effects={"shadows": "auto", "reflections": "always"}))
    ball_ = silently(applied, decided, scene()).objects[0]
    assert ball_.importance == {"default": 9.0}
    assert ball_.effects == {"shadows": "auto", "reflections": "always"}


def test_a_value_that_was_deleted_is_as_measured() -> None:
    bare = profile().model_copy(update={"objects": {}})
    assert applied(bare, scene()).objects[0].importance == {"default": 2.0, "night": 3.0}
    assert applied(bare, scene()).objects[0].effects == {"shadows": "never"}


def test_the_scenes_own_switch_is_stronger_and_said_where_somebody_decided_otherwise() -> None:
    switched = scene(effects={"shadows": "always", "reflections": "never"})
    found = silently(applied, profile(switched), switched)
    assert found.objects[0].effects == {"shadows": "always", "reflections": "never"}
    decided = profile(switched, ball=Given(effects={"reflections": "always"}))
    with pytest.warns(
        PhrtWarning, match="hall: the scene's own switch is stronger than the profile's for /ball reflections"
    ):
        found = applied(decided, switched, "hall")
    assert found.objects[0].effects["reflections"] == "never"


def test_the_profile_of_another_scene_is_refused() -> None:
    other = Stage().add("/teapot", ball()).scene
    other.name = "Kitchen"
    with pytest.raises(
        ProfileError, match="p: is the profile of scene 'Hall'; scene 'Kitchen' has none of its objects"
    ):
        applied(profile(), other, "p")


def test_objects_that_came_since_are_named_and_take_defaults() -> None:
    grown = scene()
    grown.objects.append(Stage().add("/new", ball()).scene.objects[0])
    with pytest.warns(
        PhrtWarning, match="p: the scene has changed since it was analysed: it does not know /new; `phrt an"
    ):
        found = applied(profile(), grown, "p")
    assert found.objects[2].importance == {}


def test_a_scene_that_says_something_else_about_its_objects_is_told() -> None:
    with pytest.warns(PhrtWarning, match="has changed since it was analysed: its objects are not what they were"):
        check_fits(profile(), scene(importance={"default": 2.0}), "p")


def test_a_variant_that_was_not_analysed_is_no_change() -> None:
    night = scene(importance={"default": 2.0})
    night.situation = "night"
    silently(check_fits, profile(), night, "p")


def test_an_empty_scene_fits_every_profile() -> None:
    silently(check_fits, profile(), Scene("empty", situation="night"), "p")


@pytest.mark.parametrize(
    ("objects", "told"),
    [
        ({"bal": Given(importance={"default": 3.0})}, "there is no object /bal here. Did you mean '/ball'"),
        ({"ball": Given(effects={"shadow": "never"})}, "there is no effect shadow here. Did you mean 'shadows'"),
        ({"ball": Given(importance={"default": 1, "nihgt": 3})}, "no situation nihgt here. Did you mean 'night'"),
    ],
)
def test_what_nobody_knows_is_a_warning(objects: dict[str, Given], told: str) -> None:
    with pytest.warns(PhrtWarning, match=told):
        warn_of_unknown(profile(**objects), scene(), EFFECTS, "p")
    silently(warn_of_unknown, profile(), scene(), EFFECTS, "p")


def test_objects_have_a_hash_of_what_is_said_about_them() -> None:
    assert objects_hash(scene()) == objects_hash(scene())
    others = [scene(importance={"default": 2.0}), scene(tags=("gold",)), scene(effects={"shadows": "never"})]
    assert len({objects_hash(each) for each in [scene(), *others]}) == 4


def test_rays_per_pixel_are_those_of_the_situation_and_the_median_where_not_measured() -> None:
    table = profile().rays_per_pixel(scene(), ("shadows", "reflections", "refractions"))
    np.testing.assert_array_equal(table, [[1.5, 2.5, np.nan]] * 3)
    night = scene()
    night.situation = "night"
    np.testing.assert_array_equal(profile().rays_per_pixel(night, ("reflections",))[:, 0], [2.25] * 3)


def test_costs_are_handed_over_by_effect() -> None:
    assert profile().coefficients() == {"shadows": {"ms_per_item": 0.02, "ms_per_ray": 1e-4}}
