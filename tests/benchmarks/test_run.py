"""The benchmarks measure what they say they do. No test here looks at a time."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import phrt

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
SIZE = (48, 32)


@pytest.fixture(scope="module")
def spheres() -> phrt.Scene:
    return phrt.load_scene(BENCHMARKS.parent / "scenes" / "spheres.yaml")


@pytest.fixture
def renderer(spheres: phrt.Scene):
    with phrt.Renderer(
        spheres, size=SIZE, threads=2, gbuffer="raycast", tracer="embree", heuristic="all_trace"
    ) as made:
        yield made


def test_recording_holds_every_ray_of_the_ray_phase_and_no_primary_ray(module, renderer):
    queries = module("frames").record_queries(renderer, 0.0)
    rays = renderer.render(0.0, frame_index=0).rays
    assert sum(len(query.rays) for query in queries) == sum(rays.values()) - rays["primary"] > 0
    assert {query.name for query in queries} == {"closest_hit", "occluded"}


def test_recording_leaves_renderer_and_picture_as_they_were(module, renderer):
    frames = module("frames")
    tracer = renderer.run.tracer
    before = renderer.render(0.0, frame_index=0).image.copy()
    frames.record_queries(renderer, 0.0)
    frames.record_surfaces(renderer, 0.0)
    assert renderer.run.tracer is tracer
    assert frames.raycast.surface is frames.surface
    assert np.array_equal(renderer.render(0.0, frame_index=0).image, before)


def test_recorded_batches_are_copies_with_their_hint(module):
    frames = module("frames")

    class Answers:
        capabilities = None

        def occluded(self, rays):
            rays.origin.fill(7.0)
            return np.zeros(len(rays), bool)

    recorder = frames.RecordingTracer(Answers())
    ones = np.ones((2, 3), np.float32)
    recorder.occluded(phrt.rays.RayBatch(ones, ones.copy(), ones[:, 0].copy(), coherent=True))
    (query,) = recorder.queries
    assert (query.rays.origin == 1.0).all()
    assert query.rays.coherent
    query.ask(Answers())
    assert (query.rays.origin == 7.0).all()


def test_surfaces_again_writes_the_g_buffer_anew(module, renderer):
    frames = module("frames")
    calls = frames.record_surfaces(renderer, 0.0)
    result = renderer.render(0.0)
    kernel, arguments = calls[0]
    assert kernel is frames.surface
    out = arguments[-2]
    expected = result.gbuffer.flat("base_color").copy()
    assert expected.any()
    out.base_color.fill(-1.0)
    frames.surfaces_again(calls, renderer.workers)
    assert np.array_equal(out.base_color, expected)


def test_frame_rows_come_from_paired_samples(module, spheres):
    frames = module("frames")
    said: list[str] = []
    times = frames.measure(spheres, [0.0, 0.5], 2, size=SIZE, progress=said.append)
    rows = times.rows()
    assert [row.number for row in rows] == [1, 2, 3, 4, 4, 5, 5]
    assert [row.limit for row in rows] == [0.75, 4.0, 12.0, 28.0, None, 75.0, None]
    assert all(len(row.samples) == 4 and min(row.samples) > 0 for row in rows)
    traced = times.frames["raycast", "all_trace"]
    assert rows[0].samples[3] == pytest.approx(times.bare[3] / traced.stages["rays"][3])
    assert rows[1].samples[2] == pytest.approx(traced.stages["composite"][2] + traced.tone[2])
    assert rows[5].samples == pytest.approx(traced.whole)
    assert rows[6].samples == pytest.approx(traced.processor)
    assert traced.ray_counts()["primary"] == SIZE[0] * SIZE[1]
    assert sum(value for stage, value in traced.medians().items() if stage != "whole frame") > 0
    assert "frames: round 2 of 2" in said


def test_row_compares_its_median_with_the_bar_in_its_sense(module):
    rows = module("rows")
    assert rows.row(2, "", "ms", [1, 4, 90], "<=", 4.0).met is True
    assert rows.row(2, "", "ms", [1, 5, 90], "<=", 4.0).met is False
    assert rows.row(1, "", "", [0.1, 0.75, 0.8], ">=", 0.75).met is True
    assert rows.row(1, "", "", [0.1, 0.74, 0.8], ">=", 0.75).met is False
    assert rows.row(10, "", "s", [1.0], "<=", None).met is None
    with pytest.raises(ValueError, match="row 3, surface: no samples"):
        rows.row(3, "surface", "ms", [], "<=", 12.0)


def test_row_as_json_has_what_the_table_shows(module):
    row = module("rows").row(4, "raster-only frame", "ms", (30.0, 20.0, 25.0), "<=", 28.0)
    told = json.loads(json.dumps(row.as_json()))
    assert (told["median"], told["min"], told["max"], told["met"]) == (25.0, 20.0, 30.0, True)
    assert told["samples"] == [30.0, 20.0, 25.0]


def test_load_is_measured_in_a_process_that_does_not_carry_its_parents_memory(module):
    ballast = np.ones(100_000_000)  # 0.8 GB
    load = module("loads").fresh(BENCHMARKS.parent / "scenes" / "spheres.yaml", SIZE, 1)
    assert load.lit
    assert load.triangles > 0
    assert load.objects > 0
    assert load.load_s > load.scene_s > 0
    assert 0.02 < load.peak_gb < 0.8
    assert len(ballast)


def test_load_of_a_missing_scene_says_why(module):
    with pytest.raises(RuntimeError, match="there is no such file"):
        module("loads").fresh(Path("nowhere.yaml"), SIZE, 1)


def test_machine_names_processor_and_versions(module):
    machine = module("machine")
    info = machine.machine()
    assert info["cpu"]
    assert info["cores"] >= 1
    assert info["versions"]["numpy"] == np.__version__
    quiet, busy = info | {"load_average": 0.1}, info | {"load_average": 3.0}
    assert len(machine.lines(busy)) == len(machine.lines(quiet)) + 1


def test_tracer_row_keeps_every_ratio(module):
    run, tracers = module("run"), module("tracers")
    rate = tracers.RateRow("Sponza", 1000, "shadow", 2, {"embree": 4.0, "embreex run": 2.0}, 2.0, 1.8, (1.0, 2.0, 3.0))
    row = run.tracer_row(rate)
    assert row.number == 13
    assert row.samples == (1.0, 2.0, 3.0)
    assert row.met


def test_report_of_frames_is_one_json_object(module, assets, monkeypatch):
    run = module("run")
    monkeypatch.setattr(run, "gbuffers_here", lambda: ("raycast",))
    report = run.run_benchmarks(run.Plan(assets, [2, 5], 1, size=SIZE, places=2))
    told = json.loads(json.dumps(report.as_json()))
    assert [row["number"] for row in told["rows"]] == [2, 5, 5]
    assert [len(row["samples"]) for row in told["rows"]] == [2, 2, 2]
    assert told["tracers"] == []
    assert told["frames"]["raycast all_trace"]["rays"]["shadows"] > 0
    assert told["frames"]["tracer_rays"] > 0


def bench(*arguments: str, assets: str | None) -> subprocess.CompletedProcess[str]:
    environment = {"PATH": "/usr/bin:/bin"} | ({} if assets is None else {"PHRT_ASSETS": assets})
    command = [sys.executable, str(BENCHMARKS / "run.py"), *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("arguments", "with_assets", "message"),
    [
        ((), False, "PHRT_ASSETS is not set; it must name the folder of the real scenes"),
        ((), True, "where these are missing: sponza/sponza_textured.glb"),
        (("--rows", "4,14"), True, "given 14; rows are 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13"),
        (("--repeats", "0"), True, "given 0; wanted a whole number from 1"),
        (("--size", "640"), True, "given 640; wanted WIDTHxHEIGHT"),
    ],
)
def test_wrong_command_line_ends_with_one_clear_message(arguments, with_assets, message, tmp_path):
    done = bench(*arguments, assets=str(tmp_path) if with_assets else None)
    assert done.returncode == 2
    assert message in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr


def test_a_package_that_is_missing_is_told_before_the_first_frame(module, assets, monkeypatch, capsys):
    run = module("run")
    packages = {"numpy": "numpy", "no_such_module": "no-such-package"}
    monkeypatch.setattr("phrt_plugins.packages.PACKAGES", packages)
    monkeypatch.setattr("quality.NEEDED", tuple(packages))
    monkeypatch.setenv("PHRT_ASSETS", str(assets))
    with pytest.raises(SystemExit) as ended:
        run.arguments_of(["--rows", "4,7"])
    assert ended.value.code == 2
    assert "rows 6 to 8 compare pictures with no-such-package" in capsys.readouterr().err
    assert run.arguments_of(["--rows", "4"]).rows == [4]


@pytest.mark.parametrize(
    ("given", "message"),
    [("gain,luck", "given luck; heuristics are "), (",", "given nothing; heuristics are ")],
)
def test_an_unknown_heuristic_is_told_with_those_there_are(module, assets, monkeypatch, capsys, given, message):
    monkeypatch.setenv("PHRT_ASSETS", str(assets))
    with pytest.raises(SystemExit) as ended:
        module("run").arguments_of(["--heuristics", given])
    assert ended.value.code == 2
    assert message in " ".join(capsys.readouterr().err.split())


def test_rows_of_budgets_selection_and_path_come_in_one_report(module, assets, monkeypatch, tmp_path):
    run, contest, longpath, selection = (module(name) for name in ("run", "contest", "longpath", "selection"))
    monkeypatch.setattr(contest, "WARM_UP", 1)
    monkeypatch.setattr(selection, "COUNTS", (10, 100))
    monkeypatch.setattr(run.budgets, "RULES", {6: run.budgets.RULES[6]})
    monkeypatch.setattr(longpath, "lap_times", lambda scene: [0.0, 0.1])
    names = ["selection_graph", "gain"]
    plan = run.Plan(assets, [6, 9, 12], 1, size=SIZE, frames=2, every=1, long=4, heuristics=names)
    report = run.run_benchmarks(plan)
    told = json.loads(json.dumps(report.as_json(), allow_nan=False))
    assert {row["number"] for row in told["rows"]} == {6, 12}
    assert [entry["heuristic"] for entry in told["budgets"][0]["standings"]] == ["all-trace, no budget", *names]
    assert [(entry["heuristic"], entry["count"]) for entry in told["selection"]] == [
        (name, count) for count in (10, 100) for name in names
    ]
    assert {len(laps) for laps in told["long_path"]["laps"].values()} == {2}
    with (tmp_path / "shown.txt").open("w") as file:
        run.show(report, run.Console(file=file, width=150))
    shown = (tmp_path / "shown.txt").read_text()
    assert "half the rays, mean FLIP: gain" in shown
    assert "Long path: gain" in shown


def test_bare_rates_of_a_small_geometry_hold_every_contender_and_ratio(module, monkeypatch):
    tracers = module("tracers")
    monkeypatch.setattr(tracers, "WIDTH", 32)
    monkeypatch.setattr(tracers, "HEIGHT", 16)
    room = tracers.trimesh.creation.box(extents=(40.0, 40.0, 40.0))
    geometry = tracers.Geometry.from_meshes("room", [room])
    rates = tracers.measure(geometry, 2, 3)
    assert [rate.kind for rate in rates] == ["primary", "shadow", "random"]
    assert [rate.bar for rate in rates] == [1.8, 1.8, None]
    for rate in rates:
        assert {"embree", "embreex run"} <= set(rate.mega_rays)
        assert min(rate.mega_rays.values()) > 0
        assert len(rate.ratios) == 3
        assert rate.ratio == np.median(rate.ratios)
