"""What is left of a run in which a plugin failed: run.json, `phrt explain`, pictures that were finished, a benchmark's cells."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import needs
import numpy as np
import pytest
from cli_kit import phrt
from fault_kit import FAULTS, NAME, NO_RAYS, OFF, PACKAGE, Row, armed, own_producer, registered, renderer, step
from run_bench_kit import SCENE, bench, cells, table, write_config

from phrt.analysis.probes import probe
from phrt.errors import PhrtWarning, PluginError
from phrt.loading import load_scene
from phrt.recording import Recorder, read_run
from phrt.recording.reasons import explain_object
from phrt_plugins.bench import run as run_module
from phrt_plugins.bench import worker as worker_module
from phrt_plugins.bench.inline import InlineExecutor

needs.package("pyarrow")


def row_of(kind: str, member: str, what: str = "raises") -> Row:
    return next(row for row in FAULTS if (row.kind, row.member, row.what) == (kind, member, what))


@pytest.fixture(autouse=True)
def calm() -> Iterator[None]:
    yield
    armed[0] = False


@pytest.fixture
def fails_in_frame(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Arms the fault when a renderer begins the frame of a number, and disarms it in others."""
    from phrt.run_state import RunState

    begin = RunState.begin_frame

    def arm(number: int) -> None:
        def begin_frame(self: Any, index: int | None, time: float) -> int:
            found = begin(self, index, time)
            armed[0] = found >= number
            return found

        monkeypatch.setattr(RunState, "begin_frame", begin_frame)

    return arm


# run.json


@pytest.mark.parametrize(
    ("kind", "member", "done"),
    [("effect", "trace", OFF), ("heuristic", "next", "it is switched off, and what"), ("tracer", "occluded", NO_RAYS)],
)
def test_the_run_record_says_what_happened_as_soon_as_it_has(
    kind: str, member: str, done: str, tmp_path: Path, fails_in_frame: Any
) -> None:
    row = row_of(kind, member)
    fails_in_frame(100)
    folder = tmp_path / "run"
    with registered(row), own_producer(), renderer(row) as made, Recorder(folder, made) as recorder:
        recorder.add(step(made, 99))
        assert read_run(folder).faults == []
        with pytest.warns(PhrtWarning, match=f"{kind} '{NAME}' of {PACKAGE} failed"):
            frame = step(made, 100)
        recorder.add(frame)
        # While it goes on: a process that is killed now leaves it.
        (fault,) = read_run(folder).faults
        recorder.add(step(made, 101))
    run = read_run(folder)
    assert run.faults == [fault]
    assert (fault["frame"], fault["kind"], fault["name"], fault["package"]) == (100, kind, NAME, PACKAGE)
    assert fault["cause"] == f"failed in {member}(): RuntimeError: the cable came off"
    assert fault["done"].startswith(done)
    assert fault["message"] == str(frame.faults[0])
    told = [explain_object(run, number, "/floor", "shadows")[0].sentence for number in (99, 100, 101)]
    assert "were traced whole in frame 99" in told[0]
    after = {
        "effect": "were traced whole",
        "heuristic": "not traced in frame 101: the heuristic was switched off after an error in frame 100 (heuristic",
        "tracer": "not traced in frame 101: all ray tracing was switched off after an error of the tracer in frame 100",
    }
    assert after[kind] in told[2]
    if kind == "effect":
        why = explain_object(run, 101, "/floor", NAME)[0].sentence
        assert (
            f"{NAME} of /floor was not traced in frame 101: the effect was switched off after an error in frame 100"
            in why
        )
    assert fault["message"] in (why if kind == "effect" else told[2])


def test_a_run_that_ends_by_a_fault_says_so(tmp_path: Path) -> None:
    row = row_of("gbuffer", "render")

    def run() -> None:
        with registered(row), renderer(row) as made, Recorder(tmp_path / "run", made) as recorder:
            recorder.add(step(made, 99))
            armed[0] = True
            recorder.add(step(made, 100))

    with pytest.raises(PluginError, match=f"gbuffer '{NAME}' of {PACKAGE} failed in render"):
        run()
    found = read_run(tmp_path / "run")
    assert found.numbers.tolist() == [99]
    (fault,) = found.faults
    assert (fault["kind"], fault["frame"], fault["done"]) == ("gbuffer", 100, "")
    assert found.cut_short is not None
    assert "the cable came off" in found.cut_short


def test_explain_tells_the_faults_of_a_run(tmp_path: Path) -> None:
    row = row_of("effect", "trace")
    with registered(row), renderer(row) as made, Recorder(tmp_path / "run", made) as recorder:
        armed[0] = True
        with pytest.warns(PhrtWarning):
            frame = step(made, 100)
        recorder.add(frame)
    done = phrt("explain", str(tmp_path / "run"))
    assert f"fault: frame 100: effect '{NAME}' of {PACKAGE} failed in trace(): RuntimeError" in done.printed
    faults = json.loads(phrt("explain", str(tmp_path / "run"), "--json").printed)["faults"]
    assert [fault["name"] for fault in faults] == [NAME]


# phrt render


def scene_file(folder: Path) -> str:
    path = folder / "scene.yaml"
    path.write_text(SCENE, encoding="utf-8")
    return str(path)


ASKED = {
    "heuristic": ["--heuristic", NAME],
    "effect": ["--effect", f"{NAME}.enabled=true"],
    "tracer": ["--tracer", NAME],
}


@pytest.mark.parametrize(("kind", "member"), [("heuristic", "next"), ("effect", "trace"), ("tracer", "occluded")])
def test_a_sequence_is_finished_and_with_strict_ends_before_the_frame(
    kind: str, member: str, tmp_path: Path, fails_in_frame: Any
) -> None:
    row = row_of(kind, member)
    fails_in_frame(2)
    shot = ["--size", "48x27", "--frames", "0:4", "--gbuffer", "raycast"]
    arguments = ["render", scene_file(tmp_path), *shot, *ASKED[kind]]
    with registered(row):
        done = phrt(*arguments, "-o", str(tmp_path / "kept_%d.png"), "--json")
        assert done.code == 0, done.said
        assert len(list(tmp_path.glob("kept_*.png"))) == 4
        (told,) = json.loads(done.printed)["warnings"]
        assert told.startswith(f"{kind} '{NAME}' of {PACKAGE} failed in {member}(): RuntimeError: the cable came off; ")
        strict = phrt(*arguments, "-o", str(tmp_path / "strict_%d.png"), "--strict")
    assert strict.code == 2
    assert len(strict.errors) == 1
    assert f"{kind} '{NAME}' of {PACKAGE} failed in {member}()" in " ".join(strict.said.split())
    assert sorted(path.name for path in tmp_path.glob("strict_*")) == ["strict_0.png", "strict_1.png"]


def test_frames_that_were_finished_stay_whole_when_no_more_can_come(tmp_path: Path, fails_in_frame: Any) -> None:
    from PIL import Image

    fails_in_frame(2)
    arguments = ["render", scene_file(tmp_path), "--size", "48x27", "--frames", "0:4", "--gbuffer", NAME]
    with registered(row_of("gbuffer", "render")):
        done = phrt(*arguments, "-o", str(tmp_path / "out_%d.png"), "--record", str(tmp_path / "run"))
        video = phrt(*arguments, "-o", str(tmp_path / "out.mp4"))
    assert (done.code, video.code) == (2, 2)
    assert f"gbuffer '{NAME}' of {PACKAGE} failed in render(): RuntimeError: the cable came off" in " ".join(
        done.said.split()
    )
    left = sorted(path.name for path in tmp_path.iterdir() if path.name.startswith((".", "out")))
    assert left == ["out_0.png", "out_1.png"]
    for name in left:
        assert np.asarray(Image.open(tmp_path / name)).shape == (27, 48, 3)
    assert read_run(tmp_path / "run").numbers.tolist() == [0, 1]


# phrt analyze


def test_an_analysis_says_nothing_about_an_effect_that_fails(tmp_path: Path) -> None:
    scene = load_scene(scene_file(tmp_path))
    row = row_of("effect", "trace")
    with registered(row):
        scene.settings.effects[NAME] = {}
        sound = probe(scene, (32, 18), 1, "neutral")
        assert NAME in sound.effect_names
        armed[0] = True
        with pytest.warns(PhrtWarning, match=f"effect '{NAME}' of {PACKAGE} failed"):
            found = probe(scene, (32, 18), 1, "neutral")
        with pytest.raises(PluginError, match=f"effect '{NAME}' of {PACKAGE} failed"):
            probe(scene, (32, 18), 1, "neutral", strict=True)
    assert found.effect_names == tuple(name for name in sound.effect_names if name != NAME)
    kept = [column for column, name in enumerate(sound.effect_names) if name != NAME]
    np.testing.assert_array_equal(found.rays, sound.rays[:, kept])


# phrt bench


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tasks run in this process."""
    monkeypatch.setattr(run_module, "make_executor", lambda *arguments, **options: InlineExecutor())
    monkeypatch.setattr(run_module, "check_reachable", lambda *arguments: None)
    monkeypatch.setattr(worker_module, "_kept", worker_module._Kept())


def test_a_cell_whose_heuristic_fails_is_failed_with_package_and_reason(
    here: None, tmp_path: Path, fails_in_frame: Any
) -> None:
    fails_in_frame(6)
    with registered(row_of("heuristic", "next")):
        config = write_config(tmp_path, heuristics=["raster_only", NAME])
        done = bench(config, tmp_path / "run")
    found = cells(tmp_path / "run")
    failed = json.loads((found[NAME] / "failed.json").read_text())
    assert done.code == 1
    assert (failed["kind"], failed["block"]) == ("heuristic", 1)
    reason = f"heuristic '{NAME}' of {PACKAGE} failed in next(): RuntimeError: the cable came off"
    assert failed["reason"].startswith(reason)
    assert f"{NAME} failed: {reason}" in " ".join(done.printed.split())
    rows = table(tmp_path / "run" / "summary.parquet")
    states = dict(zip(rows["label"], rows["state"], strict=True))
    assert states == {"raster_only": "ok", NAME: "failed"}


@pytest.mark.parametrize(("kind", "member"), [("effect", "trace"), ("tracer", "occluded"), ("gbuffer", "render")])
def test_no_reference_is_made_with_a_plugin_that_fails(kind: str, member: str, here: None, tmp_path: Path) -> None:
    changes: dict[str, Any] = {
        "effect": {"scenes": [{"scene": "balls.yaml", "frames": "0:4", "effects": {NAME: {}}}]},
        "tracer": {"tracers": [NAME]},
        "gbuffer": {"gbuffers": [NAME]},
    }[kind]
    with registered(row_of(kind, member)):
        config = write_config(tmp_path, heuristics=["raster_only"], **changes)
        armed[0] = True
        done = bench(config, tmp_path / "run", "--json")
        assert done.code == 1
        said = json.loads(done.printed)
        # Without a reference there is nothing to sum up either.
        reasons = [problem["reason"] for problem in said["problems"] if problem["stage"] != "summary"]
        reasons += [failure["reason"] for failure in said["failed"].values()]
        assert reasons
        assert all(f"{kind} '{NAME}' of {PACKAGE} failed in {member}()" in reason for reason in reasons), reasons
        assert not list((tmp_path / "cache").rglob("*.npz"))
        armed[0] = False
        assert bench(config, tmp_path / "run", "--resume", "--retry-failed").code == 0


@pytest.mark.parametrize("member", ["of_shot", "of_run"])
def test_a_metric_that_fails_is_left_out_and_with_strict_a_failure(member: str, here: None, tmp_path: Path) -> None:
    with registered(row_of("metric", member)):
        config = write_config(tmp_path, heuristics=["raster_only"], metrics=["error", NAME])
        armed[0] = True
        done = bench(config, tmp_path / "run", "--json")
        assert done.code == 0, done.said
        told = [text for text in json.loads(done.printed)["warnings"] if PACKAGE in text]
        assert len(told) >= 1
        assert all(f"metric '{NAME}' of {PACKAGE} failed" in text for text in told)
        strict = bench(config, tmp_path / "strict", "--strict", "--json")
    assert strict.code == 1
    said = json.loads(strict.printed)
    reasons = [problem["reason"] for problem in said["problems"]] + [f["reason"] for f in said["failed"].values()]
    assert any(f"metric '{NAME}' of {PACKAGE} failed in {member}()" in reason for reason in reasons), reasons
