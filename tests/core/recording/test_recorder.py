"""A run is recorded: every frame, every candidate, every letter; the folder is treated with care."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import warnings
from dataclasses import fields, make_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_kit import SIZE, record, renderer_of, three_things

from phrt.clock import RecordingClock, WallClock
from phrt.errors import OptionError, PhrtWarning
from phrt.frame import REASONS, Decisions
from phrt.interfaces.heuristic import Candidates
from phrt.recording import Recorder, read_run
from phrt.recording.config import options_of
from phrt.recording.folder import check_folder, plain
from phrt.recording.recorder import check_recording
from phrt.recording.rows import arrays_of, view_numbers, view_of
from phrt.registry import get_registry


def test_every_array_of_candidates_and_decisions_is_there_as_it_was(tmp_path: Path) -> None:
    frames = record(tmp_path / "run", 3, heuristic="selection_graph", budget="1500rays")
    run = read_run(tmp_path / "run")
    assert run.cut_short is None
    for frame in frames:
        items, candidates = run.items(frame.index), frame.decisions.candidates
        count = len(candidates)
        assert len(items["frame"]) == count > 3
        for table in (candidates, frame.decisions):
            arrays = arrays_of(table, count)
            assert len(arrays) >= 7
            for name, values in arrays.items():
                if name == "effect":
                    values = np.array(candidates.effect_names, object)[values]
                elif name == "reason":
                    values = np.array(REASONS, object)[values]
                elif values.dtype != bool:
                    assert items[name].dtype == values.dtype, name
                np.testing.assert_array_equal(items[name], values, err_msg=name)
        paths = np.array(["", *(entry.path for entry in frame.world.scene.objects)], object)
        np.testing.assert_array_equal(items["object"], paths[candidates.object_id])
        assert set(items["persistence"]) == {candidates.persistence}
    assert {"selected", "not_asked"} <= {reason for f in frames for reason in run.items(f.index)["reason"]}


def test_no_array_of_the_interfaces_is_overlooked(tmp_path: Path) -> None:
    record(tmp_path / "run", 1)
    recorded = set(read_run(tmp_path / "run").candidates.column_names)
    typed = [f.name for table in (Candidates, Decisions) for f in fields(table) if str(f.type) == "np.ndarray"]
    assert len(typed) > 25
    assert [name for name in typed if name not in recorded] == []


def test_a_letter_that_is_added_later_is_recorded_without_a_change() -> None:
    newer = make_dataclass("Newer", ["urgency", "note"], bases=(Candidates,), frozen=True, kw_only=True)
    values = {f.name: np.zeros(2) for f in fields(Candidates)} | {"urgency": np.array([3.0, 4.0]), "note": "x"}
    assert arrays_of(newer(**values), 2)["urgency"].tolist() == [3.0, 4.0]


def test_the_row_of_a_frame_says_what_it_took_and_what_it_might_take(tmp_path: Path) -> None:
    made = record(tmp_path / "run", 2, heuristic="selection_graph", budget="3000rays")[1]
    row = read_run(tmp_path / "run").frame(1)
    assert row["time"] == made.time == 1 / 30
    assert row["milliseconds"] == pytest.approx(made.milliseconds)
    assert {name: row[f"stage_{name}_ms"] for name in made.stages} == made.stages
    assert {name: row[f"rays_{name}"] for name in made.rays} == made.rays
    assert made.rays["shadows"] > 0
    assert (row["frame_budget"], row["budget"], row["budget_unit"]) == ("3000rays", 3000.0, "rays")
    assert (row["left"], row["ray_ms"], row["headroom_ms"]) == (made.decisions.left, made.decisions.ray_ms, 0.0)
    assert row["deadline_ms"] == math.inf
    assert (row["heuristic"], row["situation"], row["warnings"], row["late"]) == (
        "selection_graph",
        "default",
        [],
        False,
    )
    assert row["candidates"] == len(made.decisions.candidates)
    assert row["traced"] == int(made.decisions.chosen.sum())
    assert row["overrun_ms"] == 0.0


def test_a_frame_budget_has_a_deadline(tmp_path: Path) -> None:
    made = record(tmp_path / "run", 2, budget="5000ms")[1]
    row = read_run(tmp_path / "run").frame(1)
    assert (row["deadline_ms"], row["frame_budget"], row["budget_unit"]) == (5000.0, "5000ms", "ms")
    assert (row["headroom_ms"], row["clock_ms"], row["late"]) == (made.headroom_ms, made.clock_ms, False)


def test_readings_of_a_recording_clock_are_kept_by_frame(tmp_path: Path) -> None:
    clock = RecordingClock(WallClock())
    with renderer_of(clock=clock, budget="5000ms") as renderer, Recorder(tmp_path / "run", renderer) as recorder:
        recorder.add(renderer.render())
        recorder.add(renderer.render())
    first, second = read_run(tmp_path / "run").frames.column("clock").to_pylist()
    assert len(first) > 3
    assert sorted(first) != []
    assert max(first) < max(second)


def test_warnings_are_kept_with_their_frame_and_still_shown(tmp_path: Path) -> None:
    with (
        warnings.catch_warnings(record=True) as shown,
        renderer_of() as renderer,
        Recorder(tmp_path / "run", renderer) as recorder,
    ):
        warnings.simplefilter("always")
        recorder.add(renderer.render())
        warnings.warn("the lamp flickers", PhrtWarning, stacklevel=1)
        recorder.add(renderer.render())
        recorder.add(renderer.render())
    assert read_run(tmp_path / "run").frames.column("warnings").to_pylist() == [[], ["the lamp flickers"], []]
    assert [str(each.message) for each in shown] == ["the lamp flickers"]


def test_the_way_warnings_are_shown_is_given_back(tmp_path: Path) -> None:
    before = warnings.showwarning
    record(tmp_path / "run", 1)
    assert warnings.showwarning is before


def test_every_sample_is_recorded(tmp_path: Path) -> None:
    (made,) = record(tmp_path / "run", 1, aa=2)
    table = read_run(tmp_path / "run").candidates.to_pydict()
    assert len(made.samples) == 2
    for number, decisions in enumerate(made.samples):
        mine = [rays for rays, sample in zip(table["rays"], table["sample"], strict=True) if sample == number]
        assert mine == decisions.rays.tolist()


def test_a_frame_without_candidates_is_recorded(tmp_path: Path) -> None:
    scene = three_things()
    for entry in scene.objects:
        entry.effects = dict.fromkeys(("shadows", "reflections", "refractions"), "never")
    record(tmp_path / "run", 2, scene)
    run = read_run(tmp_path / "run")
    assert run.numbers.tolist() == [0, 1]
    assert run.candidates.num_rows == 0
    assert len(run.items(1)["object"]) == 0


def test_a_run_without_a_frame_can_be_read(tmp_path: Path) -> None:
    record(tmp_path / "run", 0)
    run = read_run(tmp_path / "run")
    assert (run.numbers.tolist(), run.cut_short, run.candidates.num_rows) == ([], None, 0)
    with pytest.raises(OptionError, match=r"frame 0 is not in '.*run'; recorded: none"):
        run.items(0)


def test_the_configuration_is_resolved(tmp_path: Path) -> None:
    scene = three_things(effects={"reflections": "always"}, importance={"default": 2.0}, tags=("ball",))
    options: dict[str, Any] = {"heuristic": "selection_graph", "heuristic_options": {"n_pointers": 8}}
    record(tmp_path / "run", 1, scene, **options, budget="9000rays", effects={"shadows": {"samples": 2}})
    run = read_run(tmp_path / "run")
    config = run.config
    assert config["size"] == list(SIZE)
    assert config["heuristic"]["name"] == "selection_graph"
    assert config["heuristic"]["options"] == {"n_pointers": 8, "refresh_pointers": True}
    assert (config["budget"], config["clock"], config["cost_model"]) == ("9000rays", "WallClock", "measured")
    assert (config["gbuffer"]["name"], config["threads"], config["aa"]) == ("raycast", 2, 1)
    assert config["tracer"]["description"]
    assert config["effects"]["shadows"] | {"samples": 2, "layer": "visibility"} == config["effects"]["shadows"]
    mirror = config["scene"]["objects"][1]
    assert mirror["path"] == "/World/Balls/Mirror"
    assert (mirror["effects"], mirror["tags"]) == ({"reflections": "always"}, ["ball"])
    assert mirror["applies"] == ["reflections"]
    assert {"phrt", "python", "numpy", "numba", "embreex", "pyarrow"} <= set(run.about["versions"])
    assert run.about["machine"]["cores"] >= 1
    assert (run.about["state"], run.about["frames"], run.about["phrt_run"]) == ("finished", 1, 1)
    assert run.about["started"] <= run.about["finished"]


@pytest.mark.parametrize("kind", ["heuristic", "effect"])
def test_options_of_every_plugin_that_has_some_are_found(kind: str) -> None:
    registry = get_registry()
    entries = [e for e in registry.plugins(kind) if e.origin == "built-in" and e.plugin.options.model_fields]
    assert entries
    for entry in entries:
        found = options_of(registry.create(kind, entry.name))
        assert set(found) == set(entry.plugin.options.model_fields), entry.name


def test_an_exception_ends_the_run_early_and_loses_nothing(tmp_path: Path) -> None:
    def fails() -> None:
        with renderer_of() as renderer, Recorder(tmp_path / "run", renderer) as recorder:
            recorder.add(renderer.render())
            raise KeyError("oops")

    with pytest.raises(KeyError):
        fails()
    run = read_run(tmp_path / "run")
    assert run.numbers.tolist() == [0]
    assert run.cut_short == "the run ended early, after 1 frames: KeyError: 'oops'"
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == [
        "candidates.parquet",
        "frames.parquet",
        "run.json",
    ]


def test_what_is_added_after_the_end_is_ignored(tmp_path: Path) -> None:
    with renderer_of() as renderer:
        recorder = Recorder(tmp_path / "run", renderer)
        recorder.close()
        recorder.add(renderer.render())
        recorder.close()
    assert read_run(tmp_path / "run").numbers.tolist() == []


def test_a_run_can_be_read_while_it_is_recorded(tmp_path: Path) -> None:
    with renderer_of() as renderer, Recorder(tmp_path / "run", renderer) as recorder:
        for number in range(3):
            made = renderer.render()
            recorder.add(made)
            run = read_run(tmp_path / "run")
            assert run.numbers.tolist() == list(range(number + 1))
            assert run.items(number)["rays"].tolist() == made.decisions.rays.tolist()
            assert "still being recorded" in str(run.cut_short)


def test_a_frame_number_that_comes_twice_means_the_last(tmp_path: Path) -> None:
    with renderer_of() as renderer, Recorder(tmp_path / "run", renderer) as recorder:
        recorder.add(renderer.render(0.0, frame_index=5))
        recorder.add(replace(renderer.render(1.0, frame_index=5), time=1.0))
    run = read_run(tmp_path / "run")
    assert run.frame(5)["time"] == 1.0
    assert set(run.items(5)["step"]) == {1}


# The folder


def test_folders_above_are_made(tmp_path: Path) -> None:
    record(tmp_path / "a" / "b" / "run", 1)
    assert read_run(tmp_path / "a" / "b" / "run").numbers.tolist() == [0]


def test_a_folder_with_something_else_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    for overwrite in (False, True):
        with pytest.raises(
            OptionError, match=r"cannot record into '.*': it is not empty, and what is in it is no recorded run"
        ):
            check_folder(tmp_path, overwrite)
    (tmp_path / "run.json").write_text('{"somebody": "else"}')
    with pytest.raises(OptionError, match="no recorded run"):
        check_folder(tmp_path, True)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_run_is_replaced_only_when_that_is_asked_for(tmp_path: Path) -> None:
    record(tmp_path / "run", 2)
    (tmp_path / "run" / "notes.txt").write_text("mine")
    with renderer_of() as renderer:
        with pytest.raises(OptionError, match=r"it holds a run already \(--overwrite replaces it\)"):
            Recorder(tmp_path / "run", renderer)
        assert read_run(tmp_path / "run").numbers.tolist() == [0, 1]
        Recorder(tmp_path / "run", renderer, overwrite=True).close()
    assert read_run(tmp_path / "run").numbers.tolist() == []
    assert (tmp_path / "run" / "notes.txt").exists()


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "run").write_text("")
    with pytest.raises(OptionError, match="it is a file, not a folder"):
        check_recording(tmp_path / "run")


def test_checking_makes_nothing(tmp_path: Path) -> None:
    check_recording(tmp_path / "a" / "run")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "there is no run.json in it"),
        ("{", "run.json cannot be read"),
        ("[]", "was not written by phrt"),
        ('{"state": "finished"}', "was not written by phrt"),
        ('{"phrt_run": 99}', "was recorded with version 99 of run folders; this phrt reads version 1"),
    ],
)
def test_what_is_no_run_is_refused(tmp_path: Path, text: str | None, message: str) -> None:
    if text is not None:
        (tmp_path / "run.json").write_text(text)
    with pytest.raises(OptionError, match=message):
        read_run(tmp_path)


def test_a_folder_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"'.*nowhere' is no recorded run: there is no such folder"):
        read_run(tmp_path / "nowhere")


def test_a_broken_table_is_an_error_that_names_the_folder(tmp_path: Path) -> None:
    record(tmp_path / "run", 1)
    (tmp_path / "run" / "frames.parquet").write_bytes(b"PAR1 no")
    with pytest.raises(OptionError, match=r"'.*run' cannot be read"):
        read_run(tmp_path / "run")


# Small things


def test_a_view_comes_back_bit_for_bit() -> None:
    with renderer_of() as renderer:
        view = renderer.render(0.3).view
    again = view_of(view_numbers(view), SIZE)
    np.testing.assert_array_equal(again.world_from_view, view.world_from_view)
    assert (again.tan_half, again.near, again.far) == (view.tan_half, view.near, view.far)
    assert (again.orthographic, again.exposure) == (view.orthographic, view.exposure)


def test_json_holds_what_json_cannot() -> None:
    given = {"a": math.inf, "b": np.float32(0.5), "c": Path("x"), "d": (1, np.array([1, 2])), 3: None}
    assert json.dumps(plain(given), allow_nan=False) == '{"a": "inf", "b": 0.5, "c": "x", "d": [1, [1, 2]], "3": null}'


def test_without_pyarrow_the_extra_is_named() -> None:
    code = (
        "import sys; sys.modules['pyarrow'] = None\n"
        "from phrt.recording.recorder import check_recording\n"
        "from phrt.errors import OptionError\n"
        "try:\n    check_recording('somewhere')\nexcept OptionError as error:\n    print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, timeout=120)
    assert "recordings need pyarrow" in done.stdout
    assert "pip install 'phrt[record]'" in done.stdout


def test_neither_phrt_nor_its_recordings_import_pyarrow_before_it_is_used() -> None:
    code = "import phrt, phrt.recording, sys; assert 'pyarrow' not in sys.modules"
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, timeout=120)
