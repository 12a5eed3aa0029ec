"""The summary says what the tables say, with intervals, repeats pooled, and hides nothing that failed."""

from __future__ import annotations

import csv
import json
import math
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_kit import setup_id, write_bench, write_table

from phrt.errors import OptionError, PhrtWarning
from phrt_plugins.bench import series as series_module
from phrt_plugins.bench.results import BenchRun
from phrt_plugins.bench.series import RunColumn, common, frame_series, frames_of, judged_series, segments_of
from phrt_plugins.bench.statistics import paired_interval
from phrt_plugins.bench.summary import COLUMNS, clock_text, read_summary, summarise, summary_rows

SETUP = setup_id("court")
Rows = Mapping[tuple[str, str, str], dict[str, Any]]


@pytest.fixture(scope="module")
def repeated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of two repeats, summarised."""
    folder = write_bench(tmp_path_factory.mktemp("bench") / "run", repeats=2, pictures=False)
    assert summarise(folder) == folder / "summary.parquet"
    return folder


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """A run of one contestant, one block and one budget, that may be changed."""
    return write_bench(tmp_path / "run", budgets=("2000rays",), heuristics=("gain",), blocks=1, pictures=False)


def by_metric(rows: list[dict[str, Any]]) -> Rows:
    return {(row["budget"], row["label"], row["metric"]): row for row in rows}


def block_of(folder: Path) -> Path:
    return next((folder / "cells").iterdir()) / "block-000"


def test_there_is_a_row_per_contestant_and_metric(repeated: Path) -> None:
    rows = read_summary(repeated)
    found = by_metric(rows)
    assert len(found) == len(rows) == 6 * 30
    assert tuple(rows[0]) == COLUMNS
    row = found["50ms", "gain", "flip"]
    assert {name: row[name] for name in ("contest", "setup", "scene", "size", "clock", "cells", "state")} == {
        "contest": SETUP,
        "setup": SETUP,
        "scene": "court",
        "size": "64x36",
        "clock": "wall",
        "cells": 2,
        "state": "ok",
    }
    assert (row["better"], found["50ms", "gain", "psnr"]["unit"]) == ("lower", "dB")
    assert math.isnan(row["persistence"])


def test_values_are_those_of_the_tables(repeated: Path) -> None:
    run, found = BenchRun.read(repeated), by_metric(read_summary(repeated))
    cells = run.groups()[SETUP, "50ms", "gain"]
    flip = np.concatenate([run.measures(cell).column("flip").to_numpy() for cell in cells])
    times = np.concatenate([run.frames(cell).column("clock_ms").to_numpy() for cell in cells])
    late = np.concatenate([run.frames(cell).column("late").to_numpy() for cell in cells])
    wanted = {
        "flip": flip.mean(),
        "frame_ms_p95": np.percentile(times, 95),
        "fps": 1e3 / times.mean(),
        "late_share": late.mean(),
    }
    for metric, value in wanted.items():
        row = found["50ms", "gain", metric]
        assert row["value"] == pytest.approx(value)
        assert row["low"] <= row["value"] <= row["high"]
        assert row["low"] < row["high"]
    assert found["50ms", "gain", "flip"]["frames"] == 20, "of the path; repeats are no further frames"
    assert found["50ms", "gain", "frame_ms_p95"]["frames"] == 40


def test_what_is_no_statistic_of_frames_has_no_interval(repeated: Path) -> None:
    row = by_metric(read_summary(repeated))["50ms", "gain", "late_streak"]
    assert row["value"] >= 0.0
    assert math.isnan(row["low"])
    assert math.isnan(row["high"])
    assert row["frames"] == 40


@pytest.mark.parametrize("metric", ["decision_flips", "flips_area", "error_paper", "error_measured", "rays"])
def test_what_frames_have_one_by_one_has_an_interval(repeated: Path, metric: str) -> None:
    row = by_metric(read_summary(repeated))["2000rays", "gain", metric]
    assert row["low"] <= row["value"] <= row["high"]
    assert row["frames"] == (38 if "flips" in metric else 40), "a block's first frame follows none"


def test_what_does_not_apply_is_of_no_frames(repeated: Path) -> None:
    row = by_metric(read_summary(repeated))["2000rays", "gain", "late_share"]
    assert math.isnan(row["value"])
    assert row["frames"] == 0


def test_a_metric_that_means_something_else_gets_no_interval(small: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    double = RunColumn("rate", lambda frames: 2.0 * np.asarray(frames.columns["clock_ms"]))
    monkeypatch.setitem(series_module.RUN_COLUMNS, "fps", double)
    found = by_metric(list(summary_rows(BenchRun.read(small))))
    run = BenchRun.read(small)
    cell = run.cells[0]
    assert found["2000rays", "gain", "fps"]["value"] == pytest.approx(
        1e3 / run.frames(cell).column("clock_ms").to_numpy().mean()
    )
    assert math.isnan(found["2000rays", "gain", "fps"]["low"])
    assert not math.isnan(found["2000rays", "gain", "rays"]["low"])


@pytest.mark.parametrize(("share", "of"), [("oracle_share", "error_oracle"), ("parts_share", "error_parts")])
def test_shares_of_the_oracles_are_ratios_of_sums(repeated: Path, share: str, of: str) -> None:
    run, found = BenchRun.read(repeated), by_metric(read_summary(repeated))
    oracle = {(r["frame"], r["budget"]): r for r in run.oracle(SETUP).to_pylist()}
    took = possible = 0.0
    for cell in run.groups()[SETUP, "50ms", "selection_graph"]:
        for row in run.measures(cell).to_pylist():
            best = oracle[row["frame"], "50ms"]
            took += best["error_floor"] - row["display_error"]
            possible += best["error_floor"] - best[of]
    row = found["50ms", "selection_graph", share]
    assert row["value"] == pytest.approx(took / possible)
    assert row["low"] < row["value"] < row["high"]
    assert (row["better"], row["frames"]) == ("higher", 20)


def test_the_share_of_r_is_of_the_best_that_fits(small: Path) -> None:
    """Two items of R 3 and 1 and price 10, a budget of 10 rays: the smaller was chosen in every second frame, the larger else."""
    frames = list(range(20))
    candidates = {
        "frame": np.repeat(np.array(frames, np.int64), 2),
        "relevance": np.tile([3.0, 1.0], 20),
        "predicted_cost": np.full(40, 10.0),
        "traced_pixels": np.array([pixels for f in frames for pixels in ((5, 0) if f % 4 else (0, 5))]),
        "pixel_count": np.full(40, 5),
    }
    path = block_of(small) / "frames.parquet"
    import pyarrow.parquet as parquet

    table = parquet.read_table(path)
    rows = [{**row, "budget": 10.0} for row in table.to_pylist()]
    write_table(path, rows, table.schema)
    write_table(block_of(small) / "candidates.parquet", candidates)
    with pytest.warns(PhrtWarning, match="metric '(flips|costs)' failed"):
        found = by_metric(list(summary_rows(BenchRun.read(small))))
    # Judged are the even frames: 3 and 1 in turns, of 3 each.
    assert found["2000rays", "gain", "relevance_share"]["value"] == pytest.approx(4 / 6)


def test_without_an_oracle_there_is_no_share_of_it(tmp_path: Path) -> None:
    folder = write_bench(tmp_path / "run", budgets=("none",), heuristics=("gain",), oracle=False, pictures=False)
    metrics = {row["metric"] for row in summary_rows(BenchRun.read(folder))}
    assert "oracle_share" not in metrics
    assert "relevance_share" in metrics


def test_failed_and_unfinished_contestants_are_said_to_be(tmp_path: Path) -> None:
    folder = write_bench(
        tmp_path / "run", failed="selection_graph", unfinished="gain", budgets=("50ms",), repeats=2, pictures=False
    )
    run = BenchRun.read(folder)
    shutil.rmtree(run.groups()[SETUP, "50ms", "raster_only"][0].folder)
    found = by_metric(list(summary_rows(BenchRun.read(folder))))
    states = {label: found["50ms", label, "flip"]["state"] for label in ("gain", "selection_graph", "raster_only")}
    assert states == {"gain": "partial", "selection_graph": "failed", "raster_only": "partial"}
    assert found["50ms", "gain", "flip"]["frames"] == 10
    assert found["50ms", "raster_only", "flip"]["frames"] == 20, "of the repeat that is there"


def test_a_contestant_without_frames_has_rows_all_the_same(small: Path) -> None:
    shutil.rmtree(block_of(small))
    run = BenchRun.read(small)
    assert run.cells[0].blocks == ()
    found = by_metric(list(summary_rows(run)))
    row = found["2000rays", "gain", "fps"]
    assert (row["state"], row["frames"]) == ("partial", 0)
    assert math.isnan(row["value"])


def test_columns_of_metrics_that_are_not_here(small: Path) -> None:
    import pyarrow.parquet as parquet

    path = block_of(small) / "measures.parquet"
    table = parquet.read_table(path)
    parquet.write_table(table.append_column("sharpness", [np.arange(10.0)]), path)
    assert by_metric(list(summary_rows(BenchRun.read(small))))["2000rays", "gain", "sharpness"]["better"] == "neither"
    about = json.loads((small / "bench.json").read_text())
    about["config"]["metrics"] = ["flip", "sharpness_of_ours"]
    about["columns"] = [
        {"name": "sharpness", "summary": "how sharp", "unit": "1/px", "better": "higher", "statistic": "max"}
    ]
    (small / "bench.json").write_text(json.dumps(about))
    with pytest.warns(PhrtWarning, match="nothing is said of the columns of metric 'sharpness_of_ours'"):
        found = by_metric(list(summary_rows(BenchRun.read(small))))
    row = found["2000rays", "gain", "sharpness"]
    assert (row["better"], row["unit"], row["value"]) == ("higher", "1/px", 9.0)
    assert ("2000rays", "gain", "fps") not in found, "pacing was not asked for"


def test_the_csv_says_the_same(repeated: Path) -> None:
    with open(repeated / "summary.csv", newline="") as file:
        lines = list(csv.DictReader(file))
    rows = read_summary(repeated)
    assert [line["metric"] for line in lines] == [row["metric"] for row in rows]
    assert [float(line["value"] or "nan") for line in lines] == pytest.approx([r["value"] for r in rows], nan_ok=True)
    assert lines[0]["persistence"] == ""


def test_the_same_run_has_the_same_summary(repeated: Path) -> None:
    before = (repeated / "summary.csv").read_bytes()
    summarise(repeated)
    assert (repeated / "summary.csv").read_bytes() == before


def test_a_summary_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"there is no '.*summary.parquet'; it is written when `phrt bench` ends"):
        read_summary(tmp_path)


def test_series_are_compared_on_frames_and_repeats_that_both_have(repeated: Path) -> None:
    run = BenchRun.read(repeated)
    gain, graph = (run.groups()[SETUP, "50ms", label] for label in ("gain", "selection_graph"))
    a = judged_series(run, gain, ["flip"])["flip"]
    b = judged_series(run, graph[1:], ["flip"])["flip"]
    assert (a.repeats, b.repeats, a.values.shape) == ((0, 1), (1,), (20, 2))
    segments, ours, theirs = common(a, b)
    assert segments.tolist() == [0] * 20, "the path goes on from block to block"
    assert ours.tolist() == a.values[:, 1:].tolist()
    assert theirs.tolist() == b.values.tolist()
    assert paired_interval(ours, theirs, segments).high < 0.0
    times = frame_series(frames_of(run, gain), "jitter")
    assert np.isnan(times.values[[0, 20]]).all(), "nothing is before a block's first"
    assert np.isfinite(np.delete(times.values, [0, 20], axis=0)).all()


def test_a_missing_block_is_a_gap() -> None:
    assert segments_of(np.array([0, 0, 1, 2, 2, 4, 4, 5, 9])).tolist() == [0, 0, 0, 0, 0, 1, 1, 1, 2]
    assert len(segments_of(np.zeros(0, np.int64))) == 0


def test_clocks_are_named() -> None:
    assert [clock_text(clock) for clock in ("wall", None, {"rays": 100.0})] == ["wall", "wall", "100 ns a ray"]
