"""The long path: laps are closed, counts repeat, and what is flat is told from what rises. No test looks at a time."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import needs
import numpy as np
import pytest

import phrt
from phrt.budget import Budget

SIZE = (32, 18)


@pytest.fixture(scope="module")
def spheres() -> phrt.Scene:
    scene = phrt.load_scene(Path(__file__).resolve().parents[2] / "scenes" / "spheres.yaml")
    scene.settings.fps, scene.settings.frames = 10.0, 4
    return scene


def lap(module, number: int, **figures: float):
    longpath = module("longpath")
    columns = dict.fromkeys(longpath.Lap.__dataclass_fields__, 10.0)
    return longpath.Lap(**(columns | {"lap": number, "frames": 6, "objects": 1000} | figures))


def test_a_lap_goes_to_the_end_and_back_and_meets_its_start(module, spheres):
    times = module("longpath").lap_times(spheres)
    assert times == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.2, 0.1])
    assert np.abs(np.diff([*times, times[0]])) == pytest.approx(0.1)


def test_held_bytes_count_shared_things_once_and_arrays_whole(module):
    held_bytes = module("longpath").held_bytes
    array = np.zeros(100_000, np.float64)
    assert 800_000 <= held_bytes([array]) < 801_000
    assert held_bytes([array, array]) - held_bytes([array]) < 100
    assert held_bytes([array[:10]]) >= 800_000
    assert held_bytes({"a": [1] * 1000, "b": int}) > 8000
    assert held_bytes([int, np]) < 200


def test_laps_count_what_the_renderer_decided(module, spheres, monkeypatch):
    longpath = module("longpath")
    monkeypatch.setattr(longpath, "NANOSECONDS_PER_RAY", 1000.0)
    done: list[int] = []
    laps = longpath.run_laps(
        spheres, "selection_graph", {}, Budget(0.6, "ray_ms"), 13, size=SIZE, advance=lambda: done.append(1)
    )
    assert [entry.lap for entry in laps] == [0, 1, 2]
    assert [entry.frames for entry in laps] == [6, 6, 6]
    assert len(done) == 18
    assert 0 < laps[0].chosen < laps[0].candidates
    # What is neither traced nor mandatory waits in the next graph. (By fitted time, some that are selected are not reached.)
    by_rays = longpath.run_laps(spheres, "selection_graph", {}, Budget(300, "rays"), 13, size=SIZE)
    assert 0 < by_rays[1].moved == pytest.approx(by_rays[1].candidates - by_rays[1].chosen)
    assert laps[1].moved <= laps[1].candidates - laps[1].chosen
    assert 0 < laps[0].kilorays <= 0.6 * 1.2
    # By a RayClock another run counts the same.
    again = longpath.run_laps(spheres, "selection_graph", {}, Budget(0.6, "ray_ms"), 13, size=SIZE, threads=1)
    for name in ("candidates", "chosen", "moved", "kilorays"):
        assert [getattr(entry, name) for entry in again] == [getattr(entry, name) for entry in laps]


def test_drift_is_the_rise_over_the_run_and_single_slow_laps_do_not_move_it(module):
    drift = module("longpath").drift
    assert drift([100.0] * 9) == 0.0
    assert drift(np.linspace(95, 105, 11)) == pytest.approx(10.0)
    assert drift([100.0, 100, 100, 900, 100, 100, 100]) == 0.0
    assert drift(np.linspace(105, 95, 11)) == pytest.approx(-10.0)
    assert drift([5.0]) == 0.0
    assert drift([0.0, 0.0]) == 0.0


def test_row_12_is_met_by_flat_laps_and_missed_by_rising_ones(module):
    longpath = module("longpath")
    # The first lap, where all is new, does not count.
    flat = [lap(module, 0, resident_mb=1.0, chosen=1.0)] + [lap(module, k) for k in range(1, 6)]
    rising = [lap(module, k, resident_mb=100.0 + k, chosen=10.0 - 0.1 * k, frame_ms=10.0 + k) for k in range(6)]
    found = longpath.LongPath("a scene", SIZE, Budget(1.0, "ray_ms"), {"flat": flat, "rising": rising})
    rows = longpath.path_rows(found)
    assert {row.number for row in rows} == {12}
    assert [row.met for row in rows[:6]] == [True] * 5 + [None]
    verdicts = {row.what.strip(): row.met for row in rows[6:]}
    assert verdicts == {
        "36 frames, rising: memory rises by": False,
        "frame time rises by": False,
        "selection time rises by": True,
        "what the heuristic holds on to rises by": True,
        "items chosen: trend, up or down": False,
        "items chosen: spread over the laps": None,
    }


def test_laps_are_written_as_csv_json_and_a_plot(module, tmp_path):
    needs.package("matplotlib")
    longpath = module("longpath")
    laps = [lap(module, k, chosen=4.0 + k) for k in range(3)]
    found = longpath.LongPath("a scene", SIZE, Budget(1.0, "ray_ms"), {"one": laps, "two": laps[:2]})
    longpath.write_csv(found, tmp_path / "laps.csv")
    with (tmp_path / "laps.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert [(line["runner"], line["lap"], line["chosen"]) for line in lines][3:] == [
        ("two", "0", "4.0"),
        ("two", "1", "5.0"),
    ]
    told = json.loads(json.dumps(found.as_json(), allow_nan=False))
    assert told["laps"]["one"][2]["chosen"] == 6.0
    assert told["drift_percent"]["one"]["chosen"] == pytest.approx(100 / 5.5)
    longpath.plot(found, tmp_path / "a.svg")
    longpath.plot(found, tmp_path / "b.svg")
    drawn = (tmp_path / "a.svg").read_text()
    assert "items chosen a frame" in drawn
    assert drawn == (tmp_path / "b.svg").read_text()
    assert len(drawn) < 200_000
    assert [table.row_count for table in longpath.tables(found)] == [3, 2]


def test_every_runner_walks_under_the_same_budget(module, spheres, monkeypatch):
    longpath = module("longpath")
    monkeypatch.setattr(longpath, "RUNNERS", {"a": ("random", {"seed": 1}), "b": ("nobody", {}), "c": ("uniform", {})})
    steps: list[object] = []
    found = longpath.measure(spheres, 6, size=SIZE, tell=steps.append)
    assert list(found.laps) == ["a", "c"]
    assert steps.count(longpath.Step("a", 6)) == steps.count(longpath.Step("c", 6)) == 6
    rays = longpath.mean_rays(spheres, SIZE, 2)
    assert found.budget == Budget(pytest.approx(rays * 0.4 * 1e-4, abs=1e-4), "ray_ms")


def test_no_lap_is_cut_short(module, spheres):
    laps = module("longpath").run_laps(spheres, "raster_only", {}, Budget(), 1, size=SIZE)
    assert [entry.frames for entry in laps] == [6]
    assert laps[0].chosen == 0
    assert replace(laps[0], lap=1).moved == 0
