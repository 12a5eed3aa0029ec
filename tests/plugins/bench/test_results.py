"""What `phrt bench` wrote is read back: only what is whole, only what is asked for."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from bench_kit import Plan, cell_of, setup_id, write_bench

from phrt.errors import OptionError
from phrt_plugins.bench import results
from phrt_plugins.bench.results import BenchRun

SETUP = setup_id("court")


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bench(tmp_path_factory.mktemp("bench") / "run")


@pytest.fixture
def copied(finished: Path, tmp_path: Path) -> Path:
    """A run that may be changed."""
    return Path(shutil.copytree(finished, tmp_path / "run"))


def gain(run: BenchRun, budget: str = "50ms") -> results.Cell:
    return run.groups()[SETUP, budget, "gain"][0]


def test_every_cell_is_read_with_its_settings(finished: Path) -> None:
    run = BenchRun.read(finished)
    assert (run.name, run.title, run.state, run.setups) == ("made_up", "A made-up comparison", "finished", (SETUP,))
    assert [(c.budget, c.label, c.state) for c in run.cells] == [
        (budget, label, "ok") for budget in ("50ms", "2000rays") for label in ("gain", "raster_only", "selection_graph")
    ]
    cell = gain(run)
    assert (cell.size, cell.budget_kind, cell.budget_amount, cell.blocks) == ((64, 36), "frame_ms", 50.0, (0, 1))
    assert cell.settings == json.loads((cell.folder / "cell.json").read_text())
    assert run.cell(cell.id) is cell
    with pytest.raises(OptionError, match=r"no cell 'nobody' in .* there are: court-64x36-50ms-gain"):
        run.cell("nobody")


def test_blocks_are_joined_in_order(finished: Path) -> None:
    run = BenchRun.read(finished)
    cell = gain(run)
    frames = run.frames(cell)
    assert frames.column("frame").to_pylist() == list(range(40))
    assert frames.column("block").to_pylist() == [0] * 20 + [1] * 20
    assert frames.column("step").to_pylist() == [*range(20)] * 2
    assert run.measures(cell, ["frame"]).column("frame").to_pylist() == list(range(0, 40, 2))
    counted = np.bincount(run.candidates(cell, ["frame"]).column("frame").to_numpy())
    assert counted.tolist() == frames.column("candidates").to_pylist()


def test_columns_that_are_asked_for_are_what_is_read(finished: Path) -> None:
    run = BenchRun.read(finished)
    cell = gain(run)
    assert run.frames(cell, ["frame", "rays_shadows", "stage_rays_ms"]).column_names == [
        "block",
        "frame",
        "rays_shadows",
        "stage_rays_ms",
    ]
    assert run.measures(cell, ["flip", "not_measured"]).column_names == ["block", "flip"]
    assert run.candidates(cell, ["chosen"]).column_names == ["block", "chosen"]
    blocks = dict(run.candidate_blocks(cell, ["chosen"]))
    assert sorted(blocks) == [0, 1]
    assert blocks[0].column_names == ["chosen"]
    whole = run.frames(cell)
    assert whole.column("stage_rays_ms").to_pylist() == pytest.approx(whole.column("ray_ms").to_pylist())


def test_a_kind_of_rays_that_a_block_does_not_have_is_none_of_them(copied: Path) -> None:
    import pyarrow.parquet as parquet

    path = gain(BenchRun.read(copied)).folder / "block-001" / "frames.parquet"
    table = parquet.read_table(path)
    rows = [{**row, "rays": [("primary", 7)]} for row in table.to_pylist()]
    parquet.write_table(type(table).from_pylist(rows, table.schema), path)
    run = BenchRun.read(copied)
    shadows = run.frames(gain(run), ["rays_shadows"]).column("rays_shadows").to_pylist()
    assert min(shadows[:20]) > 0
    assert shadows[20:] == [0] * 20


def test_unfinished_work_is_not_read(tmp_path: Path) -> None:
    run = BenchRun.read(write_bench(tmp_path / "run", unfinished="gain", failed="selection_graph", budgets=("50ms",)))
    states = {cell.label: (cell.state, cell.blocks) for cell in run.cells}
    assert states == {"gain": ("partial", (0,)), "selection_graph": ("failed", (0,)), "raster_only": ("ok", (0, 1))}
    assert run.state == "running"
    assert (gain(run).folder / "block-001.part").is_dir()
    assert run.frames(gain(run), ["frame"]).column("frame").to_pylist() == list(range(20))
    failure = run.groups()[SETUP, "50ms", "selection_graph"][0].failure
    assert failure is not None
    assert (failure.block, failure.kind) == (1, "PluginError")
    assert "ZeroDivisionError" in failure.reason


def test_a_planned_cell_that_was_not_begun_is_there_without_blocks(copied: Path) -> None:
    shutil.rmtree(gain(BenchRun.read(copied)).folder)
    run = BenchRun.read(copied)
    cell = gain(run)
    assert (cell.state, cell.blocks, cell.planned_blocks) == ("partial", (), 2)
    assert run.frames(cell).num_rows == 0
    assert run.measures(cell, ["frame", "flip"]).column_names == ["block", "frame", "flip"]
    assert run.pictures(cell) == {}


def test_settings_that_are_not_whole_are_not_there_yet(copied: Path) -> None:
    cell = gain(BenchRun.read(copied))
    about = json.loads((copied / "bench.json").read_text())
    del about["plan"]
    (copied / "bench.json").write_text(json.dumps(about))
    (cell.folder / "cell.json").write_text('{"setup": "co')
    run = BenchRun.read(copied)
    assert len(run.cells) == 5
    assert cell.id not in {c.id for c in run.cells}
    assert {c.planned_blocks for c in run.cells} == {2}, "as many as the furthest of the setup"


def test_no_limit_is_infinite(tmp_path: Path) -> None:
    run = BenchRun.read(write_bench(tmp_path / "run", budgets=("none",), heuristics=("gain",), blocks=1))
    assert [(c.budget_kind, c.budget_amount) for c in run.cells] == [("none", np.inf)]


def test_pictures_and_references(finished: Path) -> None:
    run = BenchRun.read(finished)
    assert list(run.pictures(gain(run))) == [0, 18, 20, 38]
    reference = run.references[SETUP]
    assert list(run.pictures(reference)) == list(run.pictures(reference, "floor")) == [0, 18, 20, 38]
    assert run.pictures(reference, "floor")[18].name == "floor-000018.png"
    assert all(path.is_file() for path in run.pictures(reference).values())
    assert run.frames(reference, ["frame"]).num_rows == 40
    assert run.measures(reference, ["flip"]).num_rows == 20


def test_the_oracle(finished: Path) -> None:
    run = BenchRun.read(finished)
    oracle = run.oracle(SETUP)
    assert oracle.num_rows == 40, "20 judged frames, two budgets"
    assert set(oracle.column("budget").to_pylist()) == {"50ms", "2000rays"}
    items = run.oracle_items(SETUP, ["frame", "benefit"])
    assert items.column_names == ["block", "frame", "benefit"]
    assert set(items.column("frame").to_pylist()) == set(range(0, 40, 2))
    assert run.oracle("elsewhere").num_rows == 0


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (None, "there is no bench.json in it"),
        ("{", "bench.json cannot be read"),
        ("[1]", "its bench.json was not written by phrt"),
        ('{"phrt_bench": 2}', "was written with version 2 of bench folders; this phrt reads version 1"),
    ],
)
def test_a_folder_that_is_none_is_refused(tmp_path: Path, content: str | None, why: str) -> None:
    if content is not None:
        (tmp_path / "bench.json").write_text(content)
    with pytest.raises(OptionError, match=why):
        BenchRun.read(tmp_path)


def test_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionError, match=r"'.*nowhere' is no folder of phrt bench: there is no such folder"):
        BenchRun.read(tmp_path / "nowhere")


def test_a_broken_table_is_named(copied: Path) -> None:
    run = BenchRun.read(copied)
    path = gain(run).folder / "block-001" / "measures.parquet"
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(OptionError, match=r"block-001/measures.parquet' cannot be read"):
        run.measures(gain(run))


def test_made_up_runs_are_the_same_every_time(tmp_path: Path, finished: Path) -> None:
    again = BenchRun.read(write_bench(tmp_path / "again"))
    first = BenchRun.read(finished)
    cell = gain(first)
    wanted = ["frame", "flip"]
    assert again.measures(again.cell(cell.id), wanted).equals(first.measures(cell, wanted))
    assert cell_of(Plan(), "court", "50ms", "gain", 0)["id"] == cell.id
