"""Nothing is called better when the interval says otherwise, and the verdict says who is, where, and by how much."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bench_kit import setup_id, write_bench, write_table

from phrt.errors import OptionError
from phrt_plugins.bench.leaderboard import Board, Entry, leaderboard, metric_name, paired, verdict
from phrt_plugins.bench.results import BenchRun
from phrt_plugins.bench.statistics import NOTHING
from phrt_plugins.bench.summary import summary_rows

SETUP = setup_id("court")


def boards_of(folder: Path, metric: str = "flip") -> list[Board]:
    run = BenchRun.read(folder)
    return leaderboard(summary_rows(run), run, metric)


def ranks(board: Board) -> list[tuple[int | None, str]]:
    return [(entry.rank, entry.label) for entry in board.entries]


def rewrite(folder: Path, label: str, values: Any, column: str = "flip") -> None:
    """Replace a column of the measures of every cell called `label`: values(frame, what was there)."""
    import pyarrow.parquet as parquet

    for cell in BenchRun.read(folder).cells:
        for block in cell.blocks if cell.label == label else ():
            path = cell.block_folder(block) / "measures.parquet"
            table = parquet.read_table(path).to_pydict()
            table[column] = [values(f, old) for f, old in zip(table["frame"], table[column], strict=True)]
            write_table(path, {name: np.array(column) for name, column in table.items()})


@pytest.fixture(scope="module")
def clear(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bench(tmp_path_factory.mktemp("bench") / "run", pictures=False, scenes=("court", "hall"))


def one_board(path: Path, **plan: Any) -> Path:
    return write_bench(path, budgets=("50ms",), pictures=False, oracle=False, **plan)


def test_the_better_are_first(clear: Path) -> None:
    boards = boards_of(clear)
    assert [(board.scene, board.budget) for board in boards] == [
        ("court", "50ms"), ("court", "2000rays"), ("hall", "50ms"), ("hall", "2000rays"),
    ]  # fmt: skip
    for board in boards:
        assert ranks(board) == [(1, "gain"), (2, "selection_graph"), (3, "raster_only")]
        assert (board.metric, board.better, board.frames) == ("flip", "lower", 20)
        assert [entry.label for entry in board.first] == ["gain"]
    entry = boards[0].entries[1]
    assert entry.against["gain"].verdict == "worse"
    assert entry.against["gain"].difference.low > 0.0
    assert entry.against["raster_only"].verdict == "better"
    assert entry.main == entry.value("flip")
    assert entry.value("fps").known
    assert str(entry.value("never_measured")) == str(NOTHING)


def test_where_more_is_better_the_most_is_first(clear: Path) -> None:
    board = boards_of(clear, "ssim")[0]
    assert ranks(board) == [(1, "gain"), (2, "selection_graph"), (3, "raster_only")]
    assert board.entries[1].against["gain"].difference.high < 0.0
    assert "gain has the highest SSIM in all 4 comparisons" in verdict(boards_of(clear, "ssim"))


def test_who_is_not_shown_to_differ_shares_a_rank(tmp_path: Path) -> None:
    folder = one_board(tmp_path / "run", quality={"selection_graph": 0.0355})
    board = boards_of(folder)[0]
    assert [rank for rank, _ in ranks(board)] == [1, 1, 3]
    assert board.entries[1].against[board.entries[0].label].verdict == "no difference shown"
    said = "gain and selection_graph share the first place in court at 50ms, none shown to differ from the lowest FLIP."
    assert verdict([board]) == said


def test_equal_pictures_share_a_rank(tmp_path: Path) -> None:
    folder = one_board(tmp_path / "run")
    for label in ("gain", "selection_graph", "raster_only"):
        rewrite(folder, label, lambda frame, old: 0.0)
    board = boards_of(folder)[0]
    assert [rank for rank, _ in ranks(board)] == [1, 1, 1]
    assert verdict([board]).startswith("gain, raster_only and selection_graph share the first place")
    more = Board(**{**vars(board), "entries": (*board.entries, replace(board.entries[0], label="x"))})
    assert verdict([more]).startswith("gain, raster_only and 2 others share the first place")


def test_a_rank_is_shared_with_its_first_not_with_its_last(tmp_path: Path) -> None:
    """Three in a row, neighbours alike and the ends not: the third is shown to be worse than the first, and so begins a rank."""
    folder = one_board(tmp_path / "run")
    rewrite(folder, "gain", lambda frame, old: 1.0)
    rewrite(folder, "selection_graph", lambda frame, old: 1.02 + (0.1 if frame < 20 else -0.1))
    rewrite(folder, "raster_only", lambda frame, old: 1.04)
    board = boards_of(folder)[0]
    assert ranks(board) == [(1, "gain"), (1, "selection_graph"), (3, "raster_only")]
    assert board.entries[2].against["selection_graph"].verdict == "no difference shown"


def test_who_failed_has_no_rank_and_says_why(tmp_path: Path) -> None:
    board = boards_of(one_board(tmp_path / "run", failed="gain"))[0]
    assert ranks(board) == [(1, "selection_graph"), (2, "raster_only"), (None, "gain")]
    failed = board.entries[-1]
    assert "ZeroDivisionError: division by zero" in failed.reason
    assert (failed.state, failed.against, failed.main.frames) == ("failed", {}, 0)
    assert "gain" not in board.entries[0].against
    assert re.fullmatch(
        r"selection_graph has the lowest FLIP in court at 50ms, by 0\.\d+ \[0\.\d+, 0\.\d+\] over raster_only; "
        r"of 3 entries 1 failed\.",
        verdict([board]),
    )


def test_the_unfinished_are_ranked_on_the_frames_that_all_have(tmp_path: Path) -> None:
    """The second block is the easy one for who has it; that must not help."""
    folder = one_board(tmp_path / "run", unfinished="gain")
    rewrite(folder, "selection_graph", lambda frame, old: old if frame < 20 else 1e-4)
    board = boards_of(folder)[0]
    assert ranks(board)[0] == (1, "gain")
    graph = board.entries[1]
    assert board.frames == graph.main.frames == 10
    assert graph.value("flip").value < board.entries[0].value("flip").value < graph.main.value
    assert verdict([board]).endswith("; of 3 entries 1 not finished.")


def test_verdicts_count_and_name_the_range(clear: Path, tmp_path: Path) -> None:
    said = verdict(boards_of(clear))
    lead = r"0\.\d+ \[0\.\d+, 0\.\d+\] over selection_graph"
    place = r"\((court|hall) at (50ms|2000rays)\)"
    assert re.match(rf"gain has the lowest FLIP in all 4 comparisons, by {lead} {place} to {lead} {place}", said)
    leads = [float(lead) for lead in re.findall(r"(0\.\d+) \[", said)]
    assert leads == sorted(leads)


def test_different_winners_are_all_named(clear: Path, tmp_path: Path) -> None:
    folder = write_bench(tmp_path / "run", pictures=False, oracle=False)
    run = BenchRun.read(folder)
    cell = run.groups()[SETUP, "50ms", "raster_only"][0]
    for block in cell.blocks:
        frames = run.measures(cell).filter(run.measures(cell).column("block").to_numpy() == block)
        write_table(
            cell.block_folder(block) / "measures.parquet",
            {"frame": frames.column("frame").to_numpy(), "flip": np.full(frames.num_rows, 0.001)},
        )
    said = verdict(boards_of(folder))
    assert "gain has the lowest FLIP in court at 2000rays" in said
    assert "raster_only has the lowest FLIP in court at 50ms" in said


def test_being_first_by_being_late_is_said(tmp_path: Path) -> None:
    import pyarrow.parquet as parquet

    folder = one_board(tmp_path / "run")
    run = BenchRun.read(folder)
    cell = run.groups()[SETUP, "50ms", "gain"][0]
    for block in cell.blocks:
        path = cell.block_folder(block) / "frames.parquet"
        table = parquet.read_table(path)
        write_table(path, [{**row, "late": row["step"] % 2 == 0} for row in table.to_pylist()], table.schema)
    board = boards_of(folder)[0]
    assert board.at_cost == "50.0 % of its frames late against 0.0 %"
    assert verdict([board]).endswith(
        "over selection_graph, with 50.0 % of its frames late against 0.0 % (court at 50ms)."
    )


def test_setups_that_differ_in_effects_only_are_one_contest(tmp_path: Path) -> None:
    folder = one_board(tmp_path / "run")
    about = json.loads((folder / "bench.json").read_text())
    setup = about["plan"]["setups"][0]
    about["plan"]["setups"] = [setup | {"effects": {}}, setup | {"id": "other", "effects": {"shadows": {"samples": 4}}}]
    run = BenchRun.read(folder)
    path = run.groups()[SETUP, "50ms", "selection_graph"][0].folder / "cell.json"
    cell = json.loads(path.read_text()) | {"setup": "other"}
    path.write_text(json.dumps(cell))
    (folder / "bench.json").write_text(json.dumps(about))
    boards = boards_of(folder)
    assert len(boards) == 1
    assert (boards[0].contest, set(boards[0].setups)) == (SETUP, {SETUP, "other"})
    assert ranks(boards[0]) == [(1, "gain"), (2, "selection_graph"), (3, "raster_only")]


def test_without_flip_another_metric_decides(tmp_path: Path) -> None:
    folder = one_board(tmp_path / "run")
    run = BenchRun.read(folder)
    for cell in run.cells:
        for block in cell.blocks:
            path = cell.block_folder(block) / "measures.parquet"
            import pyarrow.parquet as parquet

            kept = parquet.read_table(path, columns=["frame", "psnr"])
            parquet.write_table(kept, path)
    board = boards_of(folder)[0]
    assert (board.metric, board.better, board.unit) == ("psnr", "higher", "dB")
    assert ranks(board)[0] == (1, "gain")
    with pytest.raises(OptionError, match="there is nothing to rank by: 'ssim' was not measured"):
        boards_of(folder, "ssim")


def test_boards_can_be_of_frame_times(tmp_path: Path) -> None:
    folder = one_board(tmp_path / "run")
    board = boards_of(folder, "frame_ms_p95")[0]
    assert board.frames == 40
    assert ranks(board)[0] == (1, "raster_only")
    assert [entry.main == entry.value("frame_ms_p95") for entry in board.entries] == [True] * 3
    assert board.entries[1].against["raster_only"].verdict == "worse"
    for cell in BenchRun.read(folder).cells:
        for block in cell.blocks:
            write_table(cell.block_folder(block) / "measures.parquet", {"frame": np.zeros(0, np.int64)})
    assert boards_of(folder)[0].metric == "frame_ms_p50", "where no pictures were judged"


def test_pairs_of_any_column(clear: Path) -> None:
    run = BenchRun.read(clear)
    gain, raster = (run.groups()[SETUP, "50ms", label] for label in ("gain", "raster_only"))
    assert paired(run, gain, raster, "flip", "lower").verdict == "better"
    assert paired(run, gain, raster, "ssim", "higher").verdict == "better"
    slower = paired(run, gain, raster, "frame_ms_p95", "lower")
    assert slower.verdict == "worse"
    times = [run.frames(cells[0]).column("clock_ms").to_numpy() for cells in (gain, raster)]
    assert slower.difference.value == pytest.approx(np.percentile(times[0], 95) - np.percentile(times[1], 95))
    assert paired(run, gain, gain, "flip", "lower").verdict == "no difference shown"
    assert paired(run, gain, raster, "never_measured", "lower").difference.frames == 0


def test_nothing_to_compare_is_said() -> None:
    assert verdict([]) == "Nothing can be compared: no two contestants have judged frames."
    alone = Entry("gain", "gain", "ok", 1, NOTHING, {}, {})
    board = Board(
        "c", ("c",), "court", "64x36", "embree", "raycast", "wall", "50ms", "frame_ms", "flip", "", "lower", (alone,), 3
    )
    assert verdict([board]) == "Nothing can be compared: no two contestants have judged frames."


def test_few_frames_are_said_to_be_few(tmp_path: Path) -> None:
    few = boards_of(one_board(tmp_path / "few", block=4))
    assert few[0].frames == 4
    assert [rank for rank, _ in ranks(few[0])] == [1, 1, 1]
    assert verdict(few) == "Nothing is shown: that takes 6 judged frames that all contestants have."
    enough = boards_of(one_board(tmp_path / "enough"))
    assert verdict([*enough, *few]).endswith(
        "; in 1 of 2 comparisons there are too few judged frames to show anything."
    )


def test_metrics_have_readable_names() -> None:
    assert [metric_name(name) for name in ("flip", "flip_changeable", "display_error", "psnr", "relmse")] == [
        "FLIP", "FLIP changeable", "display error", "PSNR", "relMSE",
    ]  # fmt: skip
