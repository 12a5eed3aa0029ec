"""What is run and in which order: frames of a path, blocks, turns, ids."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from run_bench_kit import write_config

from phrt_plugins.bench import plan as plans
from phrt_plugins.bench.checks import checked_plan
from phrt_plugins.bench.plan import Block, Plan, rotated
from phrt_plugins.bench.reading import read_config


def plan_of(folder: Path, **changes: object) -> Plan:
    return checked_plan(read_config(write_config(folder, **changes)))


def test_a_path_is_walked_there_and_back() -> None:
    path = plans.Path(first=10, length=4, fps=10.0, laps=3)
    assert list(path.numbers) == list(range(10, 20))
    assert [round(path.time(n) * 10) for n in path.numbers] == [10, 11, 12, 13, 12, 11, 10, 11, 12, 13]


def test_a_path_of_one_frame_stands_still() -> None:
    path = plans.Path(first=3, length=1, fps=1.0, laps=5)
    assert list(path.numbers) == [3]
    assert path.time(17) == 3.0


@given(st.integers(1, 40), st.integers(1, 60), st.integers(0, 30), st.integers(1, 4))
def test_the_view_never_jumps_and_warm_up_ends_beside_the_block(
    length: int, size: int, warm_up: int, laps: int
) -> None:
    path = plans.Path(0, length, 1.0, laps)
    block = Block(0, path.numbers[len(path.numbers) // 2], path.numbers.stop)
    numbers = [*block.warm_up(warm_up), *block.frames]
    places = [path.time(number) for number in numbers]
    assert all(abs(a - b) <= 1 for a, b in pairwise(places))
    assert all(0 <= place < length for place in places)
    assert len(numbers) == warm_up + len(block.frames)


@given(st.integers(1, 50), st.integers(1, 60))
def test_judged_frames_have_the_one_before_in_their_block(count: int, every: int) -> None:
    block = Block(2, 100, 100 + count)
    judged = block.judged(every)
    assert judged == sorted(set(judged))
    assert len(judged) == max(1, count // every)
    assert set(judged) <= set(block.frames)
    if every > 1 and count > 1:
        assert {n - 1 for n in judged} <= set(block.pictured(every))


def test_blocks_cover_the_path_once(tmp_path: Path) -> None:
    (setup,) = plan_of(tmp_path, scenes=[{"scene": "balls.yaml", "frames": "2:15"}], block=5).setups
    assert [(block.first, block.stop) for block in setup.blocks()] == [(2, 7), (7, 12), (12, 15)]
    (setup,) = plan_of(tmp_path, scenes=[{"scene": "balls.yaml", "frames": "0:11"}], block=5).setups
    # One frame is no block: the path's rest belongs to the one before.
    assert [(block.first, block.stop) for block in setup.blocks()] == [(0, 5), (5, 11)]


def test_pictures_are_spread_over_the_path(tmp_path: Path) -> None:
    (setup,) = plan_of(tmp_path, pictures=2).setups
    assert setup.kept_pictures() == {3, 9}
    (setup,) = plan_of(tmp_path, pictures=100).setups
    assert setup.kept_pictures() == {1, 3, 5, 7, 9, 11}
    (setup,) = plan_of(tmp_path, pictures=0).setups
    assert setup.kept_pictures() == set()


def test_everybody_is_first_equally_often(tmp_path: Path) -> None:
    made = plan_of(tmp_path, heuristics=["gain", "random", "raster_only"], repeats=3)
    tasks = made.tasks("cells")
    assert len(tasks) == 3 * 3
    assert all(len(task.cells) == 3 for task in tasks)
    assert set(Counter(task.cells[0].label for task in tasks).values()) == {3}
    assert all({cell.repeat for cell in task.cells} == {task.repeat} for task in tasks)


def test_turning_a_list_keeps_its_members() -> None:
    assert rotated((), 3) == ()
    assert rotated(("a", "b", "c"), 4) == ("b", "c", "a")  # type: ignore[arg-type, comparison-overlap]


def test_everything_is_compared_with_everything(tmp_path: Path) -> None:
    made = plan_of(
        tmp_path, sizes=["64x36", "32x18"], budgets=["half", "2ms", "none"], tracers=["embree", "numpy"], repeats=2
    )
    assert len(made.setups) == 4
    assert len(made.cells) == 4 * 3 * 2 * 2
    ids = [cell.id for cell in made.cells]
    assert len(set(ids)) == len(ids)
    assert all(cell.setup in {setup.id for setup in made.setups} for cell in made.cells)


def test_ids_hold_on_another_machine(tmp_path: Path) -> None:
    one, other = plan_of(tmp_path / "here"), plan_of(tmp_path / "there" / "deep")
    assert [cell.id for cell in one.cells] == [cell.id for cell in other.cells]
    assert one.cells[0].id.startswith("balls-64x36-half-gain-r0-")
    changed = plan_of(tmp_path, heuristics=[{"heuristic": "gain", "persistence": 0.5}])
    assert changed.cells[0].id != one.cells[0].id
    assert changed.cells[0].id[:-6] == one.cells[0].id[:-6]


def test_effects_of_a_contestant_make_a_setup_with_the_same_reference(tmp_path: Path) -> None:
    from phrt_plugins.bench.references import reference_key

    entry = {"heuristic": "gain", "label": "flat", "effects": {"shadows": {"fallback": "none"}}}
    made = plan_of(tmp_path, heuristics=["gain", entry])
    plain, own = made.setups
    assert own.effects == {"shadows": {"fallback": "none"}}
    assert own.base_effects == plain.effects == {}
    block = plain.blocks()[0]
    assert reference_key(plain, block) == reference_key(own, block)
    other = plan_of(tmp_path, scenes=[{"scene": "balls.yaml", "frames": "0:12", "effects": entry["effects"]}])
    assert reference_key(other.setups[0], block) != reference_key(plain, block)


@pytest.mark.parametrize(
    ("budget", "kind", "amount"),
    [("50ms", "frame_ms", 50.0), ("rays:2ms", "ray_ms", 2.0), ("300rays", "rays", 300.0), ("none", "none", None)],
)
def test_cell_json_says_what_the_budget_is(tmp_path: Path, budget: str, kind: str, amount: float | None) -> None:
    said = plan_of(tmp_path, budgets=[budget]).cells[0].settings()
    assert (said["budget"], said["budget_kind"], said["budget_amount"]) == (budget, kind, amount)


def test_half_is_known_once_the_references_are(tmp_path: Path) -> None:
    cell = plan_of(tmp_path).cells[0]
    assert cell.settings()["budget_amount"] is None
    assert cell.settings(1234.0)["budget_amount"] == 1234.0
