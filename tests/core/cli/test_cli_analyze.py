"""`phrt analyze`, and `phrt render` with a profile and with controls: what is written, kept, said and refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cli_kit import Outcome, phrt, render

from phrt.profile import read_profile

SCENE = """
name: Table
prims:
  Floor: {type: Plane, size: [6, 6], tags: [wood]}
  Ball: {type: Sphere, radius: 0.5, material: /Mirror, tags: [toy], xform: {translate: [0, 0.5, 0]}}
  Mirror: {type: Material, metallic: 1, roughness: 0}
  Lamp: {type: SphereLight, intensity: 30, xform: {translate: [1, 3, 1]}}
  Sky: {type: DomeLight, intensity: 0.5}
  Eye: {type: Camera, look_at: {eye: [0, 1, 4], target: [0, 0.5, 0]}}
  Settings: {type: RenderSettings, size: [64, 36], frames: 4}
variants:
  night: {over: {/Lamp: {intensity: 3}, /Sky: {intensity: 0.01}}}
"""


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "table.yaml"
    path.write_text(SCENE)
    return path


def analyze(scene: Path, *arguments: str) -> Outcome:
    return phrt("analyze", str(scene), "--frames", "3", "--size", "32x18", "--threads", "1", *arguments)


def profile_of(scene: Path) -> Path:
    return scene.with_name("table.profile.yaml")


def test_the_profile_lies_beside_the_scene_and_says_what_was_found(scene: Path) -> None:
    done = analyze(scene)
    assert (done.code, done.printed, done.errors, done.warnings) == (0, "", [], [])
    assert "table.profile.yaml: 2 objects in 6 probes (default, night)" in done.said
    found = read_profile(profile_of(scene))
    assert set(found.measured) == {"/Floor", "/Ball"}
    assert (found.probes.frames, found.probes.size, found.probes.situations) == (3, (32, 18), ["default", "night"])
    assert found.measured["/Ball"].kind == "mirror"


def test_probes_have_the_proportions_of_the_picture(scene: Path) -> None:
    assert phrt("analyze", str(scene), "--frames", "1", "--situation", "night").code == 0
    found = read_profile(profile_of(scene))
    assert (found.probes.size, found.probes.situations) == ((160, 90), ["night"])


def test_json_is_one_object_on_standard_output(scene: Path) -> None:
    done = analyze(scene, "--json", "-o", str(scene.with_name("other.yml")))
    report = json.loads(done.printed)
    assert report["file"].endswith("other.yml")
    assert (report["scene"], report["objects"], report["probes"]) == ("Table", 2, 6)
    assert (report["situations"], report["kept"], report["warnings"]) == (["default", "night"], [], [])


def test_what_was_edited_survives_another_analysis_and_is_named(scene: Path) -> None:
    analyze(scene)
    path = profile_of(scene)
    lines = [
        "  /Ball: {importance: 8, effects: {reflections: always}, note: the hero}"
        if line.startswith("  /Ball: {imp")
        else line
        for line in path.read_text().splitlines()
    ]
    path.write_text("\n".join(lines))
    done = analyze(scene)
    assert done.code == 0
    assert "kept what was decided by hand: /Ball importance, /Ball effects.reflections" in done.said
    ball = read_profile(path).objects["/Ball"]
    assert (ball.importance, ball.effects, ball.note) == ({"default": 8.0}, {"reflections": "always"}, "the hero")
    assert ball.edited == ["importance", "effects.reflections"]
    report = json.loads(analyze(scene, "--json").printed)
    assert report["kept"] == ["/Ball importance", "/Ball effects.reflections"]


def test_an_analysis_that_finds_the_same_writes_the_same_but_times(scene: Path) -> None:
    analyze(scene)
    first = read_profile(profile_of(scene))
    analyze(scene)
    again = read_profile(profile_of(scene))
    assert again.model_copy(update={"effects": {}}) == first.model_copy(update={"effects": {}})


@pytest.mark.parametrize(
    ("there", "told"),
    [
        ("phrt_profile: 9\n", "phrt_profile: given 9; this program reads version 1"),
        ("my notes\n", "is not a profile"),
        (SCENE, "is not a profile"),
        ("a: [", "not valid YAML"),
    ],
)
def test_what_is_no_profile_is_never_overwritten(scene: Path, there: str, told: str) -> None:
    profile_of(scene).write_text(there)
    done = analyze(scene)
    assert done.code == 2
    assert told in done.errors[0]
    assert "It is left as it is: move it away, or name another file with -o" in done.said
    assert profile_of(scene).read_text() == there


def test_the_profile_of_another_scene_is_never_overwritten(scene: Path, tmp_path: Path) -> None:
    analyze(scene)
    before = profile_of(scene).read_text()
    other = tmp_path / "kitchen.yaml"
    other.write_text("name: Kitchen\nprims:\n  Pot: {type: Sphere}\n")
    done = analyze(other, "-o", str(profile_of(scene)))
    assert done.code == 2
    assert "is the profile of scene 'Table', and none of its objects is in 'Kitchen'" in done.errors[0]
    assert profile_of(scene).read_text() == before


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--frames", "0"], "--frames is 0, allowed: 1 to 10000"),
        (["--size", "big"], "--size is 'big', expected WIDTHxHEIGHT"),
        (["--situation", "nihgt"], "no situation 'nihgt'; the scene has default, night. Did you mean 'night'"),
        (["--camera", "7"], "no camera number 7"),
        (["--tone-map", "filmic"], "tone map 'filmic' is not one of srgb, aces, neutral"),
        (["-o", "profile.txt"], "'.txt' is not one of .yaml, .yml"),
        (["-o", "/no/such/folder/p.yaml"], "the folder '/no/such/folder' does not exist"),
    ],
)
def test_wrong_arguments_are_told_and_nothing_is_written(scene: Path, arguments: list[str], told: str) -> None:
    done = phrt("analyze", str(scene), *arguments)
    assert done.code == 2
    assert told in done.errors[0]
    assert not profile_of(scene).exists()


def test_help_says_what_a_profile_is_for() -> None:
    said = " ".join(phrt("analyze", "--help").printed.split())
    assert "Values that you change in it are kept when you analyse again" in said
    assert "without one, importance is what the scene says" in said


# Rendering with a profile, and with controls


def test_a_profile_steers_the_picture(scene: Path, tmp_path: Path) -> None:
    analyze(scene)
    path = profile_of(scene)
    path.write_text(
        path.read_text().replace("  /Ball: {importance", "  /Ball: {effects: {reflections: never}, importance")
    )
    out = tmp_path / "picture.exr"
    with_it = render(scene, out, "--profile", str(path))
    without = render(scene, out)
    assert with_it.code == without.code == 0
    assert not np.array_equal(with_it.image, without.image), "the ball is not traced any more"


def test_a_profile_that_only_spares_what_changes_nothing_changes_nothing(scene: Path, tmp_path: Path) -> None:
    analyze(scene)
    out = tmp_path / "picture.exr"
    np.testing.assert_array_equal(
        render(scene, out, "--profile", str(profile_of(scene))).image, render(scene, out).image
    )


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("phrt_profile: 0\n", "p.yaml:1: phrt_profile: given 0; this program reads version 1"),
        ("nonsense", "is not a profile"),
        ("", "the file is empty"),
    ],
)
def test_a_broken_profile_is_told(scene: Path, tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "p.yaml"
    path.write_text(text)
    done = render(scene, tmp_path / "picture.exr", "--profile", str(path))
    assert done.code == 2
    assert told in done.errors[0]
    assert not done.channels


def test_a_profile_that_is_not_there_is_told(scene: Path, tmp_path: Path) -> None:
    done = render(scene, tmp_path / "picture.exr", "--profile", str(tmp_path / "nothing.yaml"))
    assert done.code == 2
    assert "nothing.yaml: cannot be read: No such file or directory" in done.errors[0]


def test_controls_are_taken(scene: Path, tmp_path: Path) -> None:
    controls = ["--attention", "toy=3", "--attention", "wood=0.5", "--view-speed", "1", "--parameter", "hurry=0.5"]
    done = render(scene, tmp_path / "picture.exr", "--heuristic", "greedy_relevance", "--budget", "500rays", *controls)
    assert (done.code, done.warnings) == (0, [])


def test_attention_decides_what_is_traced(scene: Path, tmp_path: Path) -> None:
    """Within a budget for one of them, what is looked for is traced."""

    def rays(*arguments: str) -> dict[str, int]:
        done = render(scene, tmp_path / "picture.exr", "--json", "--heuristic", "greedy_relevance", *arguments)
        kinds: dict[str, int] = json.loads(done.printed)["frames"][0]["rays"]
        return {kind: count for kind, count in kinds.items() if kind != "primary" and count}

    assert set(rays()) == {"shadows", "reflections"}, "of the floor, and of the ball"
    limit = ["--budget", "1100rays"]
    assert set(rays(*limit, "--attention", "toy=1000")) == {"reflections"}
    assert set(rays(*limit, "--attention", "toy=0.001")) == {"shadows"}


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--attention", "toy"], "--attention is 'toy', expected TAG=FACTOR, as in gold=3"),
        (["--attention", "toy=much"], "--attention for 'toy' is 'much'; it must be 0 or more, and at most 1e+18"),
        (["--attention", "toy=-1"], "--attention for 'toy' is -1; it must be 0 or more"),
        (["--view-speed", "-1"], "--view-speed is -1.0; it must be 0 or more"),
        (["--view-speed", "nan"], "--view-speed is nan; it must be 0 or more, and at most 1e+18"),
        (["--parameter", "=3"], "--parameter is '=3', expected NAME=VALUE, as in hurry=0.5"),
        (["--persistence", "-1"], "--persistence is -1, allowed: 0 to"),
    ],
)
def test_wrong_controls_are_told(scene: Path, tmp_path: Path, arguments: list[str], told: str) -> None:
    done = render(scene, tmp_path / "picture.exr", *arguments)
    assert done.code == 2
    assert told in done.errors[0]


def test_attention_to_what_is_not_there_is_a_warning(scene: Path, tmp_path: Path) -> None:
    done = render(scene, tmp_path / "picture.exr", "--attention", "toi=3")
    assert done.code == 0
    assert done.warnings == [
        "warning: attention: no object has the tag 'toi'; there are toy, wood. Did you mean 'toy'?"
    ]


def test_a_situation_that_only_importance_maps_know_can_be_asked_for(scene: Path, tmp_path: Path) -> None:
    scene.write_text(SCENE.replace("tags: [toy],", "tags: [toy], importance: {default: 1, hunt: 0.001},"))
    options = ["--json", "--heuristic", "greedy_relevance", "--budget", "1100rays", "--attention", "toy=1000"]

    def traced(*situation: str) -> set[str]:
        rays = json.loads(render(scene, tmp_path / "picture.exr", *options, *situation).printed)["frames"][0]["rays"]
        return {kind for kind, count in rays.items() if kind != "primary" and count}

    assert traced() == {"reflections"}
    assert traced("--situation", "hunt") == {"shadows"}
    wrong = render(scene, tmp_path / "picture.exr", "--situation", "hnut")
    assert wrong.code == 2
    assert "the variant 'hnut' is not one of: default, night" in wrong.errors[0]


def test_a_track_holds_where_the_command_line_says_nothing(scene: Path, tmp_path: Path) -> None:
    scene.write_text(SCENE.replace("frames: 4}", "frames: 4, track: [{time: 0, budget: 0rays}]}"))
    out = tmp_path / "picture.exr"
    dark, lit = render(scene, out), render(scene, out, "--budget", "none")
    assert not np.array_equal(dark.image, lit.image)
    np.testing.assert_array_equal(dark.image, render(scene, out, "--budget", "0rays").image)
