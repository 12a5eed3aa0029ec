"""scenes/benchmarks: every config is valid, and compares what it is there to compare."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from phrt import World, load_scene
from phrt.errors import OptionError
from phrt.interfaces.tracer import Tracer
from phrt.rays import RayBatch
from phrt.registry import get_registry
from phrt_plugins.bench.checks import checked_plan
from phrt_plugins.bench.config import BenchConfig
from phrt_plugins.bench.plan import Plan
from phrt_plugins.bench.reading import read_config

FOLDER = Path(__file__).resolve().parents[3] / "scenes" / "benchmarks"
NEED_FILES = {"paper_reference", "generality_reference"}
NEED_MITSUBA = {"path_traced"}
NAMES = sorted(path.stem for path in FOLDER.glob("*.yaml"))


def config(name: str) -> BenchConfig:
    return read_config(FOLDER / f"{name}.yaml").config


def plan(name: str) -> Plan:
    return checked_plan(read_config(FOLDER / f"{name}.yaml"))


def mitsuba_is_here() -> bool:
    registry = get_registry()
    known = "mitsuba" in registry.names("tracer")
    return known and registry.find("tracer", "mitsuba").unavailable_reason() is None


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.filterwarnings("ignore:sponza_textured.glb")
def test_every_config_can_be_run(name: str, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    if name in NEED_FILES:
        monkeypatch.setenv("PHRT_ASSETS", str(request.getfixturevalue("assets")))
    if name in NEED_MITSUBA and not mitsuba_is_here():
        wanted = r"path_traced\.yaml:\d+: reference\.tracer: (there is no tracer 'mitsuba'|tracer 'mitsuba' is not available here)"
        with pytest.raises(OptionError, match=wanted):
            plan(name)
        return
    made = plan(name)
    said = config(name)
    assert said.name == name
    assert said.title
    assert (
        len(made.cells) == len(said.scenes) * len(said.sizes) * len(said.budgets) * len(said.heuristics) * said.repeats
    )
    # A last block that is much shorter than the others would count as much as they do.
    for setup in made.setups:
        lengths = [len(block.frames) for block in setup.blocks()]
        assert min(lengths) >= 0.6 * max(lengths)


@pytest.mark.parametrize("name", ["paper", "paper_reference"])
def test_paper_has_both_runs_with_and_without_simplified_objects(name: str) -> None:
    said = config(name)
    assert set(said.budgets) == {"none", "50ms"}
    assert {entry.heuristic for entry in said.heuristics} == {"all_trace", "selection_graph"}
    assert not any(entry.history for entry in said.heuristics)
    assert {entry.fps for entry in said.scenes} == {20}
    assert {entry.simplify for entry in said.scenes} == {None, 0.25}
    pairs = {(entry.scene, entry.frames): set() for entry in said.scenes}
    for entry in said.scenes:
        pairs[entry.scene, entry.frames].add(entry.simplify)
    assert all(shares == {None, 0.25} for shares in pairs.values())


def test_papers_walk_is_under_the_sky_and_then_under_the_roof() -> None:
    scene = load_scene(FOLDER.parent / "atrium.yaml")
    world = World(scene)
    tracer: Tracer = get_registry().create("tracer", "embree")
    tracer.build(world)
    for setup in plan("paper").setups:
        eyes = []
        for number in setup.path.numbers:
            world.advance(setup.path.time(number))
            eyes.append(world.view(64, 36).position)
        up = np.tile(np.float32([0, 1, 0]), (len(eyes), 1))
        above = tracer.closest_hit(RayBatch(np.float32(eyes), up, np.full(len(eyes), np.inf, np.float32))).distance
        roofed = np.isfinite(above)
        assert roofed.all() if setup.scene.startswith("indoors") else not roofed.any()


def test_smoke_depends_on_no_clock_and_is_small() -> None:
    made = plan("smoke")
    assert all(setup.clock and not setup.timed for setup in made.setups)
    assert sum(setup.path.count for setup in made.setups) * len(made.cells) / len(made.setups) <= 300
    assert all(setup.size[0] * setup.size[1] <= 10_000 for setup in made.setups)


def test_standard_compares_every_built_in_heuristic_at_equal_rays_and_equal_times() -> None:
    said = config("standard")
    built_in = {entry.name for entry in get_registry().plugins("heuristic") if entry.origin == "built-in"}
    assert {entry.heuristic for entry in said.heuristics} == built_in
    assert len(said.scenes) == 2
    assert "half" in said.budgets
    assert sum(budget.endswith("ms") for budget in said.budgets) == 2


def test_stress_walks_ten_thousand_frames_and_forgets_nothing_on_the_way() -> None:
    for setup in plan("stress").setups:
        assert setup.path.count >= 10_000
        assert setup.path.laps > 10
        assert len(setup.blocks()) == 1


def test_generality_has_at_least_five_scenes_that_need_no_files() -> None:
    said = config("generality")
    assert len({entry.scene for entry in said.scenes}) >= 5
    assert len({setup.content for setup in plan("generality").setups}) == len(said.scenes)


def test_ablation_changes_one_part_at_a_time() -> None:
    said = config("ablation")
    plain = {entry.heuristic: entry for entry in said.heuristics if entry.label is None}
    assert set(plain) == {"selection_graph", "gain"}
    varied = ("options", "persistence", "cost_model", "group_by", "history", "effects")
    changed = {
        name
        for entry in said.heuristics
        for name in varied
        if getattr(entry, name) != getattr(plain[entry.heuristic], name)
    }
    assert changed == set(varied)
