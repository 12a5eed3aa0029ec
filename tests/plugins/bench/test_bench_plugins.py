"""Plugins in a comparison: named in its config, loaded in every worker, and their code part of what results are kept by."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import needs
import pytest
from run_bench_kit import bench, cells, table, write_config

from phrt.errors import OptionError, PluginError
from phrt.interfaces.heuristic import Heuristic
from phrt.registry import HeuristicPlugin, get_registry, register
from phrt.registry.local import register_source
from phrt_plugins.bench import compare
from phrt_plugins.bench.checks import checked_plan
from phrt_plugins.bench.plan import Plan
from phrt_plugins.bench.plugin_code import Registrar, check_codes, code_of, codes_of
from phrt_plugins.bench.reading import read_config
from phrt_plugins.bench.references import reference_key

FIRST = """
import os
from phrt.interfaces.heuristic import Heuristic
from phrt.registry import HeuristicPlugin, hookimpl

class First(Heuristic):
    def __init__(self, options): open({note!r}, "a").write(f"{{os.getpid()}}\\n")
    def begin_frame(self, candidates, context): self.left = list(range(min({count}, len(candidates))))
    def next(self, remaining): return self.left.pop(0) if self.left else None

@hookimpl
def phrt_heuristics():
    return [HeuristicPlugin("first", "The first ones.", f"{{__name__}}:First")]
"""

EFFECT = """
import numpy as np
from phrt.interfaces.effect import EffectResult, LayerSpec, RayEffect
from phrt.registry import EffectPlugin, hookimpl

class Tint(RayEffect):
    name, reads = "tint", ()
    writes = LayerSpec("tint", 1, 0.0, "nothing")
    def __init__(self, options): pass
    def applies_to(self, world): return np.ones(len(world.materials), bool)
    def rays_per_pixel(self, world): return 1.0
    def trace(self, frame, pixels): return EffectResult(np.zeros((len(pixels), 1), np.float32), rays=0)
    def fallback(self, frame, pixels): return None  # {comment}

@hookimpl
def phrt_effects():
    return [EffectPlugin("tint", "Nothing.", f"{{__name__}}:Tint")]
"""


@pytest.fixture(autouse=True)
def forgotten(tmp_path: Path) -> Iterator[None]:
    """What was registered from here is gone afterwards."""
    yield
    registry = get_registry()
    for owner in {e.owner for e in registry.plugins() if e.owner.startswith(str(tmp_path)) or e.owner == __name__}:
        registry._forget(owner)


def first_plugin(folder: Path, count: int) -> Path:
    """Heuristic `first` in a file; every process that makes one writes its number down."""
    path = folder / "first.py"
    path.write_text(FIRST.format(note=str(folder / "processes"), count=count))
    return path


def plan_of(config: Path) -> Plan:
    return checked_plan(read_config(config))


def traced(cell: Path) -> list[int]:
    """How many items were traced in each frame of a cell."""
    return [row for block in sorted(cell.glob("block-*")) for row in table(block / "frames.parquet")["traced"]]


SMALL: dict[str, Any] = {
    "scenes": [{"scene": "balls.yaml", "frames": "0:4"}], "heuristics": ["first", "raster_only"], "plugins": ["first.py"],
    "metrics": ["error"], "warm_up": 0, "budgets": ["none"], "pictures": 0,
}  # fmt: skip


def test_worker_processes_load_the_plugins_of_the_config_and_resume_renders_what_was_changed(tmp_path: Path) -> None:
    config, run = write_config(tmp_path, **SMALL), tmp_path / "run"
    first_plugin(tmp_path, count=1)
    done = bench(config, run, "--jobs", "1")
    assert done.code == 0, done.said
    assert {int(line) for line in (tmp_path / "processes").read_text().split()} - {os.getpid()}
    old = cells(run)
    assert traced(old["first"]) == [1] * 4
    assert set(json.loads((old["first"] / "cell.json").read_text())["plugins"]) == {"heuristic/first"}
    untouched = {path: path.stat().st_mtime_ns for path in old["raster_only"].rglob("*.parquet")}

    first_plugin(tmp_path, count=2)
    done = bench(config, run, "--resume", "--jobs", "1")
    assert done.code == 0, done.said
    new = [path for path in (run / "cells").iterdir() if path not in old.values()]
    assert [traced(path) for path in new] == [[2] * 4]
    assert {path: path.stat().st_mtime_ns for path in old["raster_only"].rglob("*.parquet")} == untouched
    # What was rendered with the code of before is not summed up, nor shown.
    from phrt_plugins.bench.results import BenchRun

    assert [cell.id for cell in BenchRun.read(run).cells if cell.label == "first"] == [new[0].name]


def test_a_plugin_of_the_command_line_reaches_the_workers_too_wherever_it_is_named(tmp_path: Path) -> None:
    config = write_config(tmp_path, **{**SMALL, "plugins": [], "heuristics": ["first"]})
    plugin = first_plugin(tmp_path, count=1)
    done = bench(config, tmp_path / "run", "--jobs", "1", "--plugin", str(plugin))
    assert done.code == 0, done.said
    from cli_kit import phrt

    cache = ("--cache", str(tmp_path / "cache"), "--quiet", "--jobs", "1")
    done = phrt("--plugin", str(plugin), "bench", str(config), "-o", str(tmp_path / "again"), *cache)
    assert done.code == 0, done.said


def test_the_code_of_a_heuristic_is_in_its_cells_and_that_of_an_effect_in_the_references(tmp_path: Path) -> None:
    (tmp_path / "tint.py").write_text(EFFECT.format(comment="one"))
    first_plugin(tmp_path, count=1)
    scenes = [{"scene": "balls.yaml", "frames": "0:4", "effects": {"tint": {}}}]
    config = write_config(tmp_path, **{**SMALL, "scenes": scenes, "plugins": ["first.py", "tint.py"]})
    before = plan_of(config)
    (setup,) = before.setups
    assert set(setup.plugins) == {"effect/tint"}
    mine, shipped = before.cells
    assert set(mine.plugins) == {"heuristic/first"}
    assert shipped.plugins == {}
    key = reference_key(setup, setup.blocks()[0])

    first_plugin(tmp_path, count=2)
    other = plan_of(config)
    assert other.setups == before.setups
    assert other.cells[0].id != mine.id
    assert other.cells[1] == shipped

    (tmp_path / "tint.py").write_text(EFFECT.format(comment="two"))
    tinted = plan_of(config)
    assert reference_key(tinted.setups[0], setup.blocks()[0]) != key
    assert tinted.setups[0].id == setup.id
    assert [cell.id for cell in tinted.cells] == [cell.id for cell in other.cells]


def test_a_run_whose_effect_was_changed_cannot_be_resumed(tmp_path: Path) -> None:
    (tmp_path / "tint.py").write_text(EFFECT.format(comment="one"))
    scenes = [{"scene": "balls.yaml", "frames": "0:2", "effects": {"tint": {}}}]
    config = write_config(
        tmp_path, **{**SMALL, "scenes": scenes, "plugins": ["tint.py"], "heuristics": ["raster_only"]}
    )
    run = tmp_path / "run"
    assert bench(config, run, "--jobs", "1").code == 0
    (tmp_path / "tint.py").write_text(EFFECT.format(comment="two"))
    done = bench(config, run, "--resume", "--jobs", "1")
    assert done.code == 2
    assert "the code of effect/tint is not what it was" in done.said


def test_built_ins_have_no_code_of_their_own() -> None:
    assert codes_of([("heuristic", "gain"), ("tracer", "numpy"), ("effect", "no_such_effect")]) == {}


def test_a_worker_with_other_code_says_so(tmp_path: Path) -> None:
    register_source(str(first_plugin(tmp_path, count=1)))
    planned = codes_of([("heuristic", "first")])
    check_codes(planned)
    first_plugin(tmp_path, count=2)
    with pytest.raises(PluginError, match="heuristic 'first' is not the code that the benchmark began with"):
        check_codes(planned)


def test_a_file_that_was_changed_is_registered_again_and_one_that_was_not_is_not(tmp_path: Path) -> None:
    source, registrar = str(first_plugin(tmp_path, count=1)), Registrar()
    assert [registrar.register([source]), registrar.register([source])] == [True, False]
    first_plugin(tmp_path, count=2)
    assert registrar.register([source])


class Counting(Heuristic):
    """Of a notebook, as far as the registry can tell."""

    most = 1

    def __init__(self, options: object) -> None:
        self.left: list[int] = []

    def begin_frame(self, candidates: Any, context: Any) -> None:
        self.left = list(range(min(self.most, len(candidates))))

    def next(self, remaining: float) -> int | None:
        return self.left.pop() if self.left else None


def test_what_a_notebook_registers_is_compared_and_worker_processes_that_cannot_know_it_are_not_asked(
    tmp_path: Path,
) -> None:
    write_config(tmp_path)
    register(HeuristicPlugin("counting", "For a test.", f"{__name__}:Counting"))
    common: dict[str, Any] = {
        "size": (64, 36), "frames": "0:2", "clock": {"rays": 100}, "metrics": ["error"], "warm_up": 0, "pictures": 0,
        "tracers": ["embree"], "gbuffers": ["raycast"], "cache": tmp_path / "cache",
    }  # fmt: skip
    found = compare(tmp_path / "balls.yaml", ["counting", "raster_only"], **common)
    assert set(found[found.metric == "display_error"].label) == {"counting", "raster_only"}
    with pytest.raises(OptionError, match=r"heuristic 'counting' was registered in this process .*put it into a file"):
        compare(tmp_path / "balls.yaml", ["counting"], executor="local", **common)


def test_the_code_of_a_notebook_s_class_is_what_it_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a file: by the class, its constants and functions, wherever they are written."""
    import __main__ as notebook

    def defined(most: int, body: str) -> str:
        space: dict[str, Any] = {"__name__": "__main__"}
        exec(f"class Mine:\n    most = {most}\n    def next(self, remaining):\n        return {body}\n", space)
        monkeypatch.setattr(notebook, "Mine", space["Mine"], raising=False)
        register(HeuristicPlugin("mine", "For a test.", "__main__:Mine"))
        return code_of(get_registry().find("heuristic", "mine"))

    try:
        assert defined(1, "None") == defined(1, "None")
        assert len({defined(1, "None"), defined(2, "None"), defined(1, "self.most"), defined(1, "remaining")}) == 4
    finally:
        get_registry()._forget("__main__")


def test_a_dask_worker_loads_them_too_and_again_when_they_were_changed(tmp_path: Path) -> None:
    """One worker outlives both runs: it must not go on with what it imported for the first."""
    distributed = needs.package("distributed")
    config = write_config(
        tmp_path, **{**SMALL, "heuristics": ["first"], "scenes": [SMALL["scenes"][0] | {"frames": "0:2"}]}
    )
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
    ) as cluster:
        where = cluster.scheduler_address.replace("tcp://", "dask://")
        for count in (1, 2):
            first_plugin(tmp_path, count)
            done = bench(config, tmp_path / f"run-{count}", "--executor", where)
            assert done.code == 0, done.said
            assert traced(cells(tmp_path / f"run-{count}")["first"]) == [count] * 2
