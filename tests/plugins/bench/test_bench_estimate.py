"""How long a benchmark will take, and what is said while it runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from run_bench_kit import write_config

from phrt.cli.console import terminal
from phrt_plugins.bench import estimate as module
from phrt_plugins.bench.checks import checked_plan
from phrt_plugins.bench.estimate import WRITING_S, Cost, Estimate, measured_cost, spoken
from phrt_plugins.bench.plan import STAGES, Plan
from phrt_plugins.bench.progress import RunProgress
from phrt_plugins.bench.reading import read_config
from phrt_plugins.bench.references import References
from phrt_plugins.bench.scenes import open_renderer
from phrt_plugins.metrics.measure import make_metrics

COST = Cost(load=2.0, floor=0.02, full=0.12, judge=0.5, rays=100_000)


def plan_of(folder: Path, **changes: object) -> Plan:
    return checked_plan(read_config(write_config(folder, **changes)))


@pytest.mark.parametrize(
    ("budget", "wall", "rays"),
    [
        ("none", 0.12, 0.12),
        ("half", 0.07, 0.07),
        ("20000rays", 0.04, 0.04),
        ("9000000rays", 0.12, 0.12),
        ("50ms", 0.05, 0.12),
        ("500ms", 0.12, 0.12),
        ("rays:30ms", 0.05, 0.12),
        ("rays:2ms", 0.022, 0.04),
    ],
)
def test_a_frame_takes_what_its_budget_lets_it(tmp_path: Path, budget: str, wall: float, rays: float) -> None:
    for clock, expected in (("wall", wall), ({"rays": 100}, rays)):
        made = plan_of(tmp_path, budgets=[budget], clock=clock)
        assert COST.frame(made.cells[0], made.setups[0]) == pytest.approx(expected)
    bare = plan_of(tmp_path, budgets=[budget], heuristics=["raster_only"])
    assert COST.frame(bare.cells[0], bare.setups[0]) == 0.02


def test_everything_is_multiplied_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "measured_cost", lambda setup, metrics: COST)
    made = plan_of(tmp_path, budgets=["none"], heuristics=["all_trace", "raster_only"], repeats=2)
    estimate = Estimate(made, tmp_path / "cache", ["error"])
    tasks = [task for stage in STAGES for task in made.tasks(stage)]
    # Three blocks of 4 frames and 2 of warming up, 2 of them judged, 4 pictured.
    reference = 3 * (4 * 0.12 + 2 * (0.02 + 0.5))
    cells = 2 * 3 * (6 * 0.12 + 6 * 0.02 + 2 * (2 * 0.5 + WRITING_S))
    assert estimate.total(tasks) == pytest.approx(2.0 + reference + cells)
    assert estimate.total(tasks, jobs=2) == pytest.approx((2.0 + reference + cells) / 2)


def test_costs_are_measured_on_the_scene(tmp_path: Path) -> None:
    (setup,) = plan_of(tmp_path).setups
    cost = measured_cost(setup, make_metrics(["error"]))
    assert min(cost.load, cost.floor, cost.full, cost.judge) > 0
    with open_renderer(setup) as renderer:
        renderer.restart(heuristic="all_trace", history=False)
        frame = renderer.render(setup.path.time(6), frame_index=6)
    assert cost.rays == sum(count for kind, count in frame.rays.items() if kind != "primary")


def test_a_reference_that_is_kept_is_only_judged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "measured_cost", lambda setup, metrics: COST)
    made = plan_of(tmp_path)
    estimate = Estimate(made, tmp_path / "cache", ["error"])
    task = made.tasks("reference")[0]
    before = estimate.seconds(task)
    References(tmp_path / "cache").folder(task.setup, task.block).mkdir(parents=True)
    assert before - estimate.seconds(task) == pytest.approx(4 * 0.12 + 2 * 0.02)


def test_what_cannot_be_rendered_does_not_stop_the_estimate(tmp_path: Path) -> None:
    made = plan_of(tmp_path)
    (tmp_path / "balls.yaml").unlink()
    estimate = Estimate(made, tmp_path / "cache", ["error"])
    assert estimate.cost(made.setups[0]) is None
    assert estimate.total(made.tasks("cells")) == 0


def test_times_are_spoken() -> None:
    assert [spoken(s) for s in (0.42, 42, 600, 9000)] == ["0.4 s", "42 s", "10 min", "2.5 h"]


def test_the_time_that_is_left_is_said_and_every_warning_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from phrt_plugins.bench import progress

    monkeypatch.setattr(progress, "LINE_EVERY_S", 0.0)
    monkeypatch.setattr(terminal, "warned", [])
    monkeypatch.setattr(terminal, "quiet", False)
    tasks = plan_of(tmp_path).tasks("cells")
    with RunProgress(tasks, None) as shown:
        for task in tasks:
            shown.ended(task, ["it was slow"])
    lines = capsys.readouterr().err.splitlines()
    assert lines.count("warning: it was slow") == 1
    said = [line for line in lines if "done" in line]
    assert said[0].startswith("1 of 3 done, ")
    assert said[0].endswith(" left: balls 64x36, repeat 1, block 1")
    assert said[-1] == "3 of 3 done, 0.0 s left: summing up"
