"""`phrt bench` from config to folder: what is in it, what is rendered when, and what happens when something goes wrong."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_kit import phrt
from run_bench_kit import bench, cells, results, table, write_config
from scene_kit import PLAIN_FALLBACKS

from phrt.registry import HeuristicPlugin, get_registry, register
from phrt.renderer import Renderer
from phrt_plugins.bench import blocks as block_module
from phrt_plugins.bench import run as run_module
from phrt_plugins.bench import store as store_module
from phrt_plugins.bench.executors import make_executor
from phrt_plugins.bench.inline import InlineExecutor

HEURISTIC = """
from phrt.interfaces.heuristic import Heuristic
class Breaks(Heuristic):
    def __init__(self, options): pass
    def begin_frame(self, candidates, context): self.frame, self.left = context.frame_index, len(candidates)
    def next(self, remaining):
        if self.frame == 6: raise RuntimeError("out of ideas")
        return None
    def end_frame(self): pass
"""


@pytest.fixture(scope="module", autouse=True)
def here() -> Iterator[None]:
    """Tasks run in this process, where tests can reach them, and where nothing has to start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_module, "make_executor", lambda *arguments, **options: InlineExecutor())
        yield


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run; its config is beside it."""
    folder = tmp_path_factory.mktemp("bench")
    config = write_config(folder, oracle=True, heuristics=["gain", {"heuristic": "selection_graph", "history": False}])
    done = bench(config, folder / "run")
    assert done.code == 0, done.said
    return folder / "run"


def test_every_cell_has_every_block_whole(finished: Path) -> None:
    found = cells(finished)
    assert set(found) == {"gain", "selection_graph"}
    for folder in found.values():
        assert sorted(path.name for path in folder.iterdir()) == ["block-000", "block-001", "block-002", "cell.json"]
        for number in range(3):
            block = folder / f"block-{number:03d}"
            frames = table(block / "frames.parquet")["frame"]
            assert frames == list(range(4 * number, 4 * number + 4))
            assert table(block / "measures.parquet")["frame"] == [4 * number + 1, 4 * number + 3]
            assert set(table(block / "candidates.parquet")["frame"]) == set(frames)


def test_bench_json_says_what_was_run(finished: Path) -> None:
    about = json.loads((finished / "bench.json").read_text())
    assert about["state"] == "finished"
    assert about["failed"] == []
    assert about["config"]["judge_every"] == 2
    (setup,) = about["plan"]["setups"]
    assert about["plan"]["blocks"] == {setup["id"]: [[0, 4], [4, 8], [8, 12]]}
    assert {cell["label"] for cell in about["plan"]["cells"]} == {"gain", "selection_graph"}
    assert 0 < about["time"]["render_s"] < about["time"]["wall_s"]
    assert 0 < about["time"]["overhead_share"] < 1
    assert about["versions"]["phrt"]
    assert about["machine"]["cores"] >= 1


def test_half_is_half_of_what_all_trace_takes(finished: Path) -> None:
    (reference,) = (finished / "references").iterdir()
    rays = [
        sum(count for kind, count in row if kind != "primary")
        for block in sorted(reference.iterdir())
        for row in table(block / "frames.parquet")["rays"]
    ]
    settings = json.loads((cells(finished)["gain"] / "cell.json").read_text())
    assert settings["budget_kind"] == "rays"
    assert settings["budget_amount"] == round(np.mean(rays) / 2)
    used = table(cells(finished)["gain"] / "block-001" / "frames.parquet")["budget"]
    assert used == [settings["budget_amount"]] * 4


def test_pictures_lie_where_reports_look(finished: Path) -> None:
    (reference,) = (finished / "references").iterdir()
    chosen = {path.name for path in reference.rglob("frame-*.png")}
    assert len(chosen) == 2
    assert {path.name.replace("floor", "frame") for path in reference.rglob("floor-*.png")} == chosen
    # Of every block the worst frame as well.
    mine = cells(finished)["gain"]
    worst = set()
    for block in mine.glob("block-*"):
        measures = table(block / "measures.parquet")
        worst.add(f"frame-{measures['frame'][int(np.argmax(measures['display_error']))]:06d}.png")
    assert {path.name for path in mine.rglob("*.png")} == chosen | worst


def test_without_earlier_frames_nobody_beats_the_oracle(finished: Path) -> None:
    (folder,) = (finished / "oracle").iterdir()
    for number in range(3):
        oracle = table(folder / f"block-{number:03d}.parquet")
        mine = table(cells(finished)["selection_graph"] / f"block-{number:03d}" / "measures.parquet")
        assert oracle["frame"] == mine["frame"]
        assert oracle["budget"] == ["half", "half"]
        # Items that are traced in part are not among the oracle's choices.
        assert (np.array(oracle["error_oracle"]) <= np.array(mine["display_error"]) + 2e-4).all()
        assert (np.array(oracle["error_oracle"]) < np.array(oracle["error_floor"])).all()


def test_tracing_everything_leaves_no_error(tmp_path: Path) -> None:
    scenes = [{"scene": "balls.yaml", "frames": "0:12", "effects": PLAIN_FALLBACKS}]
    config = write_config(tmp_path, scenes=scenes, budgets=["none"], heuristics=["all_trace", "raster_only"])
    assert bench(config, tmp_path / "run").code == 0
    found = cells(tmp_path / "run")
    best = table(found["all_trace"] / "block-001" / "measures.parquet")
    worst = table(found["raster_only"] / "block-001" / "measures.parquet")
    assert best["display_error"] == [0.0, 0.0]
    assert best["difference_error"] == [0.0, 0.0]
    assert min(worst["display_error"]) > 0.002
    (reference,) = (tmp_path / "run" / "references").iterdir()
    floor = table(reference / "block-001" / "measures.parquet")
    assert floor["display_error"] == worst["display_error"]


def test_resuming_what_is_finished_renders_nothing(finished: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = results(finished)
    monkeypatch.setattr(Renderer, "render", forbidden)
    done = bench(finished.parent / "config.yaml", finished, "--resume")
    assert done.code == 0, done.said
    assert results(finished) == before


def forbidden(*arguments: Any, **options: Any) -> Any:
    raise AssertionError("a frame was rendered")


def test_a_filled_folder_is_refused(finished: Path, tmp_path: Path) -> None:
    done = bench(finished.parent / "config.yaml", finished)
    assert done.code == 2
    assert "it holds a benchmark already (--resume goes on with it)" in done.said
    (tmp_path / "notes.txt").write_text("mine")
    done = bench(finished.parent / "config.yaml", tmp_path, "--resume")
    assert done.code == 2
    assert "it is not empty, and holds no benchmark" in done.said
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_another_config_is_refused_with_what_differs(finished: Path) -> None:
    before = results(finished)
    config = finished.parent / "config.yaml"
    done = bench(config, finished, "--resume", "--set", "warm_up=3", "--set", "scenes.0.fps=25")
    assert done.code == 2
    assert "warm_up is 3, was 2" in done.said
    assert "scenes[0].fps is 25.0, was None" in done.said
    assert results(finished) == before


def test_a_changed_scene_is_refused(tmp_path: Path) -> None:
    config = write_config(tmp_path, heuristics=["raster_only"], scenes=[{"scene": "balls.yaml", "frames": "0:2"}])
    assert bench(config, tmp_path / "run").code == 0
    scene = tmp_path / "balls.yaml"
    scene.write_text(scene.read_text().replace("intensity: 50", "intensity: 51"))
    done = bench(config, tmp_path / "run", "--resume")
    assert done.code == 2
    assert "the scene 'balls'" in done.said
    assert "is not what it was" in done.said


def test_other_versions_are_told_of(finished: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from phrt_plugins.bench import runner

    with monkeypatch.context() as other:
        other.setattr(runner, "versions", lambda: {"phrt": "0.0.1"})
        done = bench(finished.parent / "config.yaml", finished, "--resume")
    assert done.code == 0
    assert f"warning: '{finished}' was begun with other versions of " in done.said
    with monkeypatch.context() as other:
        other.setattr(runner, "code_digest", lambda: "edited")
        again = bench(finished.parent / "config.yaml", finished, "--resume")
    assert again.code == 0
    assert "was begun with other versions of " in again.said
    assert bench(finished.parent / "config.yaml", finished, "--resume").code == 0


def test_a_run_in_a_folder_keeps_others_out(finished: Path) -> None:
    with store_module.Store(finished).locked():
        done = bench(finished.parent / "config.yaml", finished, "--resume")
    assert done.code == 2
    assert "is in use by another `phrt bench`" in done.said


def test_a_dry_run_shows_cells_and_writes_nothing(tmp_path: Path) -> None:
    config = write_config(tmp_path, repeats=2)
    done = phrt("bench", str(config), "--dry-run", "--json", "--cache", str(tmp_path / "cache"))
    assert done.code == 0, done.said
    said = json.loads(done.printed)
    assert len(said["cells"]) == 4
    assert {cell["frames"] for cell in said["cells"]} == {12}
    assert said["seconds"] > 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["balls.yaml", "config.yaml"]
    shown = phrt("bench", str(config), "--dry-run", "--cache", str(tmp_path / "cache")).printed
    assert "4 cells, 48 frames, about" in shown
    assert "selection_graph" in shown


def test_a_heuristic_that_breaks_fails_its_cell_and_the_others_go_on(tmp_path: Path) -> None:
    (tmp_path / "breaks.py").write_text(
        "from phrt.registry import HeuristicPlugin, hookimpl\n" + HEURISTIC + "@hookimpl\ndef phrt_heuristics():\n"
        '    return [HeuristicPlugin(name="breaks", summary="Breaks.", factory=f"{__name__}:Breaks")]\n'
    )
    config = write_config(tmp_path, heuristics=["breaks", "raster_only"], plugins=["breaks.py"])
    done = bench(config, tmp_path / "run")
    found = cells(tmp_path / "run")
    failed = json.loads((found["breaks"] / "failed.json").read_text())
    assert done.code == 1
    assert failed["kind"] == "heuristic"
    assert failed["block"] in (0, 1)
    assert "out of ideas" in failed["reason"]
    assert not (found["breaks"] / "block-001").exists()
    assert not list((tmp_path / "run").rglob("*.part"))
    assert (found["raster_only"] / "block-002" / "measures.parquet").exists()
    about = json.loads((tmp_path / "run" / "bench.json").read_text())
    assert about["failed"] == [found["breaks"].name]
    # It stays failed until it is asked for again, and the exit code goes on saying so.
    assert bench(config, tmp_path / "run", "--resume").code == 1


def test_failed_cells_can_be_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    register(HeuristicPlugin(name="moody", summary="Moody.", factory=f"{__name__}:Moody"), "moody")
    try:
        config = write_config(tmp_path, heuristics=["moody"])
        monkeypatch.setattr(Moody, "broken", True)
        assert bench(config, tmp_path / "run").code == 1
        monkeypatch.setattr(Moody, "broken", False)
        assert bench(config, tmp_path / "run", "--resume").code == 1
        assert bench(config, tmp_path / "run", "--resume", "--retry-failed").code == 0
        assert not list((tmp_path / "run").rglob("failed.json"))
    finally:
        get_registry()._forget("moody")


class Moody:
    """Raises as long as it is `broken`."""

    broken = False

    def __new__(cls, options: Any) -> Any:
        from phrt_heuristics.raster_only import RasterOnly

        class Made(RasterOnly):
            def begin_frame(self, candidates: Any, context: Any) -> None:
                if Moody.broken:
                    raise RuntimeError("not today")

        return Made(options)


def test_a_full_disk_fails_the_cell_and_the_others_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = write_config(tmp_path)
    write = block_module.write_measures

    def refused(path: Path, *arguments: Any) -> None:
        if "selection-graph" in str(path) and "block-001" in str(path):
            raise OSError(28, "No space left on device")
        write(path, *arguments)

    monkeypatch.setattr(block_module, "write_measures", refused)
    done = bench(config, tmp_path / "run")
    found = cells(tmp_path / "run")
    failed = json.loads((found["selection_graph"] / "failed.json").read_text())
    assert done.code == 1
    assert failed["block"] == 1
    assert failed["kind"] == "disk"
    assert "No space left on device" in failed["reason"]
    assert not list((tmp_path / "run").rglob("*.part"))
    assert (found["selection_graph"] / "block-000" / "measures.parquet").exists()
    assert (found["gain"] / "block-002" / "measures.parquet").exists()
    # With room on the disk again, it ends as a run that never met a full one.
    monkeypatch.setattr(block_module, "write_measures", write)
    assert bench(config, tmp_path / "run", "--resume", "--retry-failed").code == 0
    assert bench(config, tmp_path / "other").code == 0
    assert results(tmp_path / "run") == results(tmp_path / "other")


def test_a_disk_that_takes_nothing_at_all_is_told_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = write_config(tmp_path, heuristics=["raster_only"])
    write, written = store_module.write_json, []

    def full(path: Path, values: Any) -> None:
        if written:
            raise OSError(28, "No space left on device")
        written.append(path)
        write(path, values)

    monkeypatch.setattr(store_module, "write_json", full)
    done = bench(config, tmp_path / "run")
    assert done.code == 1
    assert [path.name for path in written] == ["bench.json"]
    assert "bench.json cannot be written: No space left on device" in done.said
    assert "failed, which cannot be written down" in done.said
    monkeypatch.setattr(store_module, "write_json", write)
    assert bench(config, tmp_path / "run", "--resume").code == 0
    assert json.loads((tmp_path / "run" / "bench.json").read_text())["state"] == "finished"


def test_a_recording_that_cannot_be_written_fails_the_cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from phrt.recording import stream

    config = write_config(tmp_path, heuristics=["raster_only"])
    write = stream.TableStream.write

    def refused(self: Any, batch: Any) -> None:
        if "cells" in str(self._file.name):
            raise OSError(28, "No space left on device")
        write(self, batch)

    monkeypatch.setattr(stream.TableStream, "write", refused)
    done = bench(config, tmp_path / "run")
    assert done.code == 1
    assert "nothing more can be written: No space left on device" in done.said


def test_a_scene_that_no_longer_loads_fails_its_cells_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = write_config(
        tmp_path, scenes=[{"scene": "balls.yaml", "frames": "0:2"}, {"scene": "gone.yaml", "frames": "0:2"}]
    )
    gone = tmp_path / "gone.yaml"
    gone.write_text((tmp_path / "balls.yaml").read_text())
    from phrt_plugins.bench import runner

    begin = runner.BenchRunner.begin

    def then_lose_it(self: Any, **options: Any) -> None:
        begin(self, **options)
        gone.unlink()

    monkeypatch.setattr(runner.BenchRunner, "begin", then_lose_it)
    done = bench(config, tmp_path / "run")
    assert done.code == 1
    about = json.loads((tmp_path / "run" / "bench.json").read_text())
    assert about["state"] == "finished"
    assert [cell.startswith("gone-") for cell in about["failed"]] == [True, True]
    failed = json.loads((tmp_path / "run" / "cells" / about["failed"][0] / "failed.json").read_text())
    assert failed["kind"] == "scene"
    assert "there is no such file" in failed["reason"]
    assert len(list((tmp_path / "run" / "cells").glob("balls-*/block-000/measures.parquet"))) == 2


def test_a_scene_that_is_edited_meanwhile_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from phrt_plugins.bench import runner

    config = write_config(tmp_path, heuristics=["raster_only"])
    begin = runner.BenchRunner.begin

    def then_edit_it(self: Any, **options: Any) -> None:
        begin(self, **options)
        scene = tmp_path / "balls.yaml"
        scene.write_text(scene.read_text().replace("intensity: 50", "intensity: 51"))

    monkeypatch.setattr(runner.BenchRunner, "begin", then_edit_it)
    done = bench(config, tmp_path / "run")
    assert done.code == 1
    assert "is not what it was when the benchmark began" in done.said
    assert not list((tmp_path / "cache").glob("*"))


def test_effects_of_a_contestant_are_its_own(tmp_path: Path) -> None:
    entries = ["all_trace", {"heuristic": "all_trace", "label": "dull", "effects": {"reflections": {"enabled": False}}}]
    config = write_config(
        tmp_path, budgets=["none"], heuristics=entries, scenes=[{"scene": "balls.yaml", "frames": "0:4"}]
    )
    assert bench(config, tmp_path / "run").code == 0
    found = cells(tmp_path / "run")
    errors = {label: table(path / "block-000" / "measures.parquet")["display_error"] for label, path in found.items()}
    assert errors["all_trace"] == [0.0, 0.0]
    # Judged by the reference of the scene, not by one without reflections.
    assert min(errors["dull"]) > 0.001


def test_a_budget_of_time_runs_on_a_real_clock(tmp_path: Path) -> None:
    config = write_config(
        tmp_path, clock="wall", budgets=["40ms"], oracle=True, scenes=[{"scene": "balls.yaml", "frames": "0:4"}]
    )
    assert bench(config, tmp_path / "run").code == 0
    settings = json.loads((cells(tmp_path / "run")["gain"] / "cell.json").read_text())
    assert settings["clock"] == "wall"
    assert (settings["budget_kind"], settings["budget_amount"]) == ("frame_ms", 40.0)
    frames = table(cells(tmp_path / "run")["gain"] / "block-000" / "frames.parquet")
    assert all(0 <= budget <= 40 for budget in frames["budget"])
    (folder,) = (tmp_path / "run" / "oracle").iterdir()
    capacities = table(folder / "block-000.parquet")["capacity"]
    both = [table(path / "block-000" / "frames.parquet")["budget"] for path in cells(tmp_path / "run").values()]
    assert capacities == [pytest.approx(np.median(both))] * 2


def test_worker_processes_come_to_the_same(finished: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_module, "make_executor", make_executor)
    done = bench(finished.parent / "config.yaml", tmp_path / "run", "--jobs", "2")
    assert done.code == 0, done.said
    assert results(tmp_path / "run") == results(finished)


def test_a_heuristic_that_ends_its_process_fails_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "deadly.py").write_text(
        "import os\nfrom phrt.registry import HeuristicPlugin, hookimpl\n"
        + HEURISTIC.replace('raise RuntimeError("out of ideas")', "os._exit(7)")
        + "@hookimpl\ndef phrt_heuristics():\n"
        '    return [HeuristicPlugin(name="deadly", summary="Deadly.", factory=f"{__name__}:Breaks")]\n'
    )
    config = write_config(tmp_path, heuristics=["raster_only", "deadly"], plugins=["deadly.py"])
    monkeypatch.setattr(run_module, "make_executor", make_executor)
    done = bench(config, tmp_path / "run", "--jobs", "1")
    assert done.code == 1, done.said
    assert "its 2 cells are tried again one by one" in done.said
    found = cells(tmp_path / "run")
    failed = json.loads((found["deadly"] / "failed.json").read_text())
    assert failed["block"] == 1
    assert "ended with exit code 7" in failed["reason"]
    assert (found["raster_only"] / "block-002" / "measures.parquet").exists()
    assert not (found["raster_only"] / "failed.json").exists()


def test_an_oracle_that_fails_is_told_and_costs_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from phrt_plugins.bench import oracle

    config = write_config(tmp_path, oracle=True, heuristics=["raster_only"])

    def fails(*arguments: Any, **options: Any) -> None:
        raise ValueError("no future")

    with monkeypatch.context() as broken:
        broken.setattr(oracle, "write_oracle", fails)
        done = bench(config, tmp_path / "run", "--json")
    said = json.loads(done.printed)
    assert done.code == 1
    assert said["failed"] == {}
    assert {problem["stage"] for problem in said["problems"]} == {"oracle"}
    assert "ValueError: no future" in said["problems"][0]["reason"]
    assert (cells(tmp_path / "run")["raster_only"] / "block-002").is_dir()
    assert bench(config, tmp_path / "run", "--resume").code == 0
    assert len(list((tmp_path / "run" / "oracle").rglob("block-*.parquet"))) == 3


def test_a_worker_that_outlived_its_run_leaves_the_folder_alone(tmp_path: Path) -> None:
    from phrt_plugins.bench.checks import checked_plan
    from phrt_plugins.bench.reading import read_config
    from phrt_plugins.bench.store import Store
    from phrt_plugins.bench.worker import Work, do

    config = write_config(tmp_path)
    store = Store(tmp_path / "run")
    assert bench(config, store.root).code == 0
    gone = next(iter((store.root / "cells").iterdir())) / "block-001"
    gone.rename(tmp_path / "kept")
    task = checked_plan(read_config(config)).tasks("cells")[1]
    work = Work(str(store.root), str(tmp_path / "cache"), ("error", "temporal"), token="of an earlier run")
    late = do(work, task)
    assert (late.blocks, late.failures) == (0, [])
    assert not gone.exists()
    store.take_over(work.token)
    assert do(work, task).blocks == 1
    assert (gone / "measures.parquet").read_bytes() == (tmp_path / "kept" / "measures.parquet").read_bytes()
