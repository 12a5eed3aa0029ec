"""Configs are checked before anything runs: every problem is told at once, with file, line and key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from run_bench_kit import CONFIG, SCENE, write_config

from phrt.errors import OptionError
from phrt_plugins.bench.checks import checked_plan
from phrt_plugins.bench.reading import config_of, read_config, with_frames

MINIMAL = """name: least
scenes: [balls.yaml]
heuristics: [gain]
"""


def problem(folder: Path, text: str) -> str:
    """What is said of config `text`."""
    (folder / "balls.yaml").write_text(SCENE)
    path = folder / "config.yaml"
    path.write_text(text)
    with pytest.raises(OptionError) as told:
        checked_plan(read_config(path))
    return str(told.value)


def test_the_least_config_has_defaults_for_the_rest(tmp_path: Path) -> None:
    (tmp_path / "balls.yaml").write_text(SCENE)
    (tmp_path / "config.yaml").write_text(MINIMAL)
    file = read_config(tmp_path / "config.yaml")
    config = file.config
    assert (config.sizes, config.budgets, config.warm_up, config.block) == (["640x360"], ["none"], 10, 50)
    assert (config.judge_every, config.pictures, config.repeats, config.metrics) == (5, 3, 1, None)
    (setup,) = checked_plan(file).setups
    assert setup.path.count == 24
    assert setup.timed
    assert setup.tracer != "auto"
    assert setup.gbuffer != "auto"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("budget: [50ms]", "config.yaml:4: unknown key 'budget'; allowed: "),
        ("budgets: [50ms, 12]", "config.yaml:4: budgets[1]: budget is 12 without a unit, expected a frame time"),
        ("budgets: [soon]", "config.yaml:4: budgets[0]: budget is 'soon', expected a frame time"),
        ("sizes: [64 by 36]", "config.yaml:4: sizes[0]: given '64 by 36', expected WIDTHxHEIGHT in pixels"),
        ("sizes: [64x6]", "config.yaml:4: sizes[0]: given '64x6'; metrics need 7 pixels a side and more"),
        ("repeats: 0", "config.yaml:4: repeats: given 0; input should be greater than or equal to 1"),
        ("clock: fast", "config.yaml:4: clock: given 'fast'; allowed: wall, or {rays: NANOSECONDS}"),
        ("clock: {rays: -1}", "config.yaml:4: clock.rays: given -1; input should be greater than 0"),
        ("tracers: [embre]", "config.yaml:4: tracers[0]: there is no tracer 'embre'. Known: "),
        ("gbuffers: [ray]", "config.yaml:4: gbuffers[0]: there is no gbuffer 'ray'. Known: "),
        ("metrics: [flop]", "config.yaml:4: metrics[0]: there is no metric 'flop'. Known: "),
        ("metrics: []", "config.yaml:4: metrics: given []; allowed: all, or a list of names"),
        ("plugins: [missing.py]", "config.yaml:4: plugins[0]: plugin file '"),
        ("budgets: [50ms, 50ms]", "config.yaml:1: budgets: '50ms' is given twice"),
        ("judge_every: 2.5", "config.yaml:4: judge_every: given 2.5; wanted a whole number"),
        ("phrt_bench: 2", "config.yaml:4: phrt_bench: given 2; allowed: 1."),
    ],
)
def test_a_wrong_line_is_named(tmp_path: Path, line: str, said: str) -> None:
    assert said in problem(tmp_path, MINIMAL + line + "\n")


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("gane", "heuristics[0].heuristic: there is no heuristic 'gane'. Known: "),
        ("gane", "Did you mean 'gain'?"),
        (
            "{heuristic: random, options: {sead: 3}}",
            "heuristics[0].options: heuristic 'random': unknown option 'sead'.",
        ),
        ("{heuristic: gain, lable: x}", "unknown key 'lable' in 'heuristics[0]'; allowed: heuristic, label"),
        ("{heuristic: gain, effects: {shadow: {}}}", "heuristics[0].effects: there is no effect 'shadow'."),
        ("{heuristic: gain, group_by: light}", "heuristics[0].group_by: given 'light'; allowed: object, object_effect"),
        ("gain, gain", "heuristics: two are called 'gain'; give one of them a `label`"),
        ("{heuristic: gain, label: a/b}", "heuristics[0].label: given 'a/b'; a name has 1 to 64 characters"),
    ],
)
def test_a_wrong_contestant_is_named(tmp_path: Path, entry: str, said: str) -> None:
    assert said in problem(tmp_path, MINIMAL.replace("[gain]", f"[{entry}]"))


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("ball.yaml", "config.yaml:2: scenes[0].scene: there is no scene file 'ball.yaml'; looked in: "),
        ("{scene: balls.yaml, frames: '0:25'}", "scenes[0].frames: given '0:25'; the scene has frames 0:24 at 30"),
        ("{scene: balls.yaml, frames: '9:3'}", "scenes[0].frames: given '9:3', expected FIRST below STOP"),
        ("{scene: balls.yaml, camera: /Nowhere}", "scenes[0].camera: no camera '/Nowhere'; the scene has /Eye."),
        ("{scene: balls.yaml, camera: 4}", "scenes[0].camera: no camera number 4; the scene has 1, counted from 0"),
        ("{scene: balls.yaml, variant: night}", "the variant 'night' is not one of: default."),
        ("{scene: balls.yaml, effects: {shadows: {sample: 4}}}", "effects: effect 'shadows': unknown option 'sample'."),
        ("{scene: balls.yaml, simplify: 1.5}", "scenes[0].simplify: given 1.5; input should be less than 1"),
        ("balls.yaml, balls.yaml", "scenes[1]: two scenes are called 'balls'; give one of them a `name`"),
    ],
)
def test_a_wrong_scene_is_named(tmp_path: Path, entry: str, said: str) -> None:
    assert said in problem(tmp_path, MINIMAL.replace("[balls.yaml]", f"[{entry}]"))


def test_simplifying_needs_its_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from phrt_plugins.bench import checks

    monkeypatch.setattr(checks, "simplification_reason", lambda: "fast-simplification is not installed")
    said = problem(tmp_path, MINIMAL.replace("[balls.yaml]", "[{scene: balls.yaml, simplify: 0.5}]"))
    assert "scenes[0].simplify: meshes cannot be simplified here: fast-simplification is not installed" in said


def test_all_problems_are_told_at_once(tmp_path: Path) -> None:
    said = problem(tmp_path, "name: bad\nscenes: [balls.yaml]\nheuristics: [gane]\ntracers: [embre]\nmetrics: [flop]\n")
    assert said.startswith("3 problems in the config:")
    assert [line.split(": ")[0].rpartition(":")[2] for line in said.splitlines()[1:]] == ["3", "4", "5"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the file is empty; a benchmark needs at least `name:`"),
        ("- 1\n", "a benchmark is a mapping with phrt_bench, name"),
        ("name: [", "not valid YAML"),
        ("name: x\nname: y\n", "config.yaml:2: the key 'name' is given twice"),
        ("name: x\n", "the key 'scenes' is missing"),
    ],
)
def test_what_is_no_config_is_said_to_be_none(tmp_path: Path, text: str, said: str) -> None:
    found = problem(tmp_path, text)
    assert said in found
    assert "scene file" not in found


def test_a_file_that_is_not_there() -> None:
    with pytest.raises(OptionError, match=r"nowhere\.yaml: there is no such file"):
        read_config("nowhere.yaml")


def test_values_can_be_changed_from_the_command_line(tmp_path: Path) -> None:
    path = write_config(tmp_path)
    changes = ["repeats=3", "scenes.0.frames='4:8'", "budgets=[10ms]", "heuristics.1.heuristic=random", "clock.rays=50"]
    config = read_config(path, changes).config
    assert (config.repeats, config.budgets, config.scenes[0].frames) == (3, ["10ms"], "4:8")
    assert [entry.heuristic for entry in config.heuristics] == ["gain", "random"]
    assert config.clock is not None
    assert config.clock.rays == 50


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("repeats", "--set is 'repeats', expected KEY=VALUE"),
        ("scenes.7.frames=3", "'7' is no entry; there are 1, counted from 0"),
        ("repeat=3", "--set repeat=3: unknown key 'repeat'"),
    ],
)
def test_a_wrong_change_is_named(tmp_path: Path, change: str, said: str) -> None:
    with pytest.raises(OptionError) as told:
        read_config(write_config(tmp_path), [change])
    assert said in str(told.value)


def test_frames_are_set_for_every_scene(tmp_path: Path) -> None:
    file = with_frames(read_config(write_config(tmp_path)), "3:9")
    assert [entry.frames for entry in file.config.scenes] == ["3:9"]
    (setup,) = checked_plan(file).setups
    assert list(setup.path.numbers) == list(range(3, 9))


def test_a_config_can_be_plain_data(tmp_path: Path) -> None:
    write_config(tmp_path)
    values: dict[str, Any] = CONFIG | {"scenes": [{"scene": str(tmp_path / "balls.yaml")}]}
    assert len(checked_plan(config_of(values)).cells) == 2
    with pytest.raises(OptionError, match="config: unknown key 'budget'"):
        config_of(values | {"budget": "50ms"})


def test_scenes_are_found_in_asset_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_config(tmp_path / "assets")
    path = write_config(tmp_path / "configs")
    (tmp_path / "configs" / "balls.yaml").unlink()
    monkeypatch.setenv("PHRT_ASSETS", str(tmp_path / "assets"))
    (setup,) = checked_plan(read_config(path)).setups
    assert setup.file == str(tmp_path / "assets" / "balls.yaml")
