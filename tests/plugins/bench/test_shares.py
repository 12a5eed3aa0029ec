"""Shares of what was possible: frame by frame they are what they are over the path."""

from pathlib import Path

import needs
import numpy as np
import pytest
from bench_kit import setup_id, write_bench

from phrt_plugins.bench.results import BenchRun
from phrt_plugins.bench.shares import FRAME_COLUMNS, contestant_shares, spread
from phrt_plugins.bench.summary import summarise

parquet = needs.package("pyarrow.parquet")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = write_bench(tmp_path_factory.mktemp("shares") / "run", repeats=2, pictures=False)
    summarise(made)
    return made


def test_a_frame_s_share_is_what_was_taken_off_by_what_could_be(folder: Path) -> None:
    run = BenchRun.read(folder)
    oracle = {(row["frame"], row["budget"]): row for row in run.oracle(setup_id("court")).to_pylist()}
    cells = run.groups()[setup_id("court"), "50ms", "gain"]
    errors: dict[int, list[float]] = {}
    for cell in cells:
        for row in run.measures(cell).to_pylist():
            errors.setdefault(row["frame"], []).append(row["display_error"])
    rows = [
        r
        for r in parquet.read_table(folder / "shares.parquet").to_pylist()
        if (r["budget"], r["label"]) == ("50ms", "gain")
    ]
    assert [row["frame"] for row in rows] == sorted(errors)
    for row in rows:
        best = oracle[row["frame"], "50ms"]
        took = best["error_floor"] - np.mean(errors[row["frame"]])
        assert row["oracle_share"] == pytest.approx(took / (best["error_floor"] - best["error_oracle"]))
        assert row["parts_share"] == pytest.approx(took / (best["error_floor"] - best["error_parts"]))


def test_a_share_over_the_path_lies_between_those_of_its_frames(folder: Path) -> None:
    run = BenchRun.read(folder)
    for cells in run.groups().values():
        for share in contestant_shares(run, cells):
            known = [value for value in share.by_frame().values() if value == value]
            if known:
                assert min(known) - 1e-9 <= share.interval().value <= max(known) + 1e-9


def test_both_files_hold_every_contestant(folder: Path) -> None:
    table = parquet.read_table(folder / "shares.parquet")
    assert tuple(table.column_names) == FRAME_COLUMNS
    contestants = {(row["budget"], row["label"]) for row in table.to_pylist()}
    assert contestants == {(budget, label) for _, budget, label in BenchRun.read(folder).groups()}
    lines = (folder / "shares.csv").read_text().splitlines()
    assert lines[0] == ",".join(FRAME_COLUMNS)
    assert len(lines) == 1 + table.num_rows


def test_of_many_frames_some_evenly_spread_are_looked_at() -> None:
    assert spread(np.arange(5), 10) == [0, 1, 2, 3, 4]
    assert spread(np.arange(101), 3) == [0, 50, 100]
