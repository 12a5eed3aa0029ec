"""The oracle against every choice there is, its files, and shares of the sum of R."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recording_kit import SIZE, record, three_things
from scene_kit import hall

import phrt
from phrt.clock import RayClock
from phrt.output.tonemap import to_8bit
from phrt_plugins.bench import oracle
from phrt_plugins.bench.benefits import EffectSets, ItemTruth, judge
from phrt_plugins.bench.oracle import oracle_choice, oracle_frame, read_sets, relevance_share, write_oracle

EFFECTS = {"shadows": {"fallback": "none"}, "ambient_occlusion": {"samples": 2}}


def open_renderer(scene: Any = None, **options: Any) -> phrt.Renderer:
    given = {"size": SIZE, "gbuffer": "raycast", "threads": 2, "effects": EFFECTS, "clock": RayClock(100.0)}
    return phrt.Renderer(scene or three_things(), remember_costs=False, **(given | options))


@pytest.fixture(scope="module")
def truth() -> ItemTruth:
    with open_renderer() as renderer:
        return oracle_frame(renderer, 0.0, 3)


def every_choice(count: int) -> Iterator[np.ndarray]:
    for chosen in product((False, True), repeat=count):
        yield np.array(chosen, bool)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.3, 0.5, 0.8, 1.0])
@pytest.mark.parametrize("unit", ["rays", "ms"])
def test_no_choice_of_items_makes_a_better_picture(truth: ItemTruth, share: float, unit: str) -> None:
    cost = truth.ms if unit == "ms" else truth.rays
    capacity = float(cost.sum()) * share
    best = min(truth.error_of(c) for c in every_choice(len(truth)) if cost[c].sum() <= capacity * (1 + 1e-9))
    choice = oracle_choice(truth.sets, capacity, unit)
    chosen = truth.choice_of(choice.sets) > 0
    assert truth.error_of(chosen) == pytest.approx(best, abs=1e-12)
    assert choice.cost == pytest.approx(float(cost[chosen].sum()))
    assert choice.cost <= capacity * (1 + 1e-9)
    assert choice.benefit == pytest.approx(truth.error_floor - best * truth.picture_pixels, abs=1e-9)
    assert choice.gap == 0


@pytest.mark.parametrize("share", [0.05, 0.2, 0.5])
def test_no_choice_of_parts_makes_a_better_picture(truth: ItemTruth, share: float) -> None:
    parts, capacity = truth.parts, float(truth.rays.sum()) * share
    error, rays = {}, {}
    for passes in product((0, 1, 4), repeat=len(truth)):
        sets = parts.rows(truth.sets_of(np.array(passes)))
        error[passes], rays[passes] = truth.error_floor - float(sets.benefit.sum()), float(sets.rays.sum())
    choice = oracle_choice(parts, capacity, "rays")
    assert choice.cost <= capacity
    best = min(error[passes] for passes in error if rays[passes] <= capacity)
    assert truth.error_floor - choice.benefit == pytest.approx(best, abs=1e-9)
    assert choice.benefit > oracle_choice(truth.sets, capacity, "rays").benefit


def test_without_a_limit_the_oracle_shows_the_all_traced_picture() -> None:
    with open_renderer(hall(), heuristic="all_trace", history=False) as renderer:
        everything = renderer.render(0.0, frame_index=3).image
        judged = judge(renderer, 0.0, 3)
        for choice in (
            oracle_choice(judged.truth.sets, math.inf, "rays"), oracle_choice(judged.truth.sets, 0.0, "none")
        ):  # fmt: skip
            picture = judged.picture(judged.truth.choice_of(choice.sets))
            assert np.array_equal(to_8bit(picture), to_8bit(everything))


def test_with_nothing_to_spend_the_oracle_chooses_nothing(truth: ItemTruth) -> None:
    choice = oracle_choice(truth.sets, 0.0, "rays")
    assert (len(choice.sets), choice.benefit, choice.cost) == (0, 0.0, 0.0)


def test_what_two_effects_bring_together_counts() -> None:
    """Alone both make the picture worse; together they are the best there is."""
    sets = EffectSets(
        ("a", "b"),
        np.array([1, 1, 1, 2], np.int32),
        np.array([[4, 0], [0, 4], [4, 4], [4, 0]], np.uint8),
        np.array([-1.0, -1.0, 5.0, 4.0]),
        np.array([3, 3, 6, 6]),
        np.array([3.0, 3.0, 6.0, 6.0]),
    )
    assert oracle_choice(sets, 6, "rays").sets.benefit.tolist() == [5]
    assert oracle_choice(sets, 12, "ms").sets.benefit.tolist() == [5, 4]


def test_a_unit_that_is_none_is_refused(truth: ItemTruth) -> None:
    with pytest.raises(ValueError, match="unit is 'seconds'; it must be one of none, rays, ms"):
        oracle_choice(truth.sets, 1.0, "seconds")
    with pytest.raises(ValueError, match="the budget is nan"):
        oracle_choice(truth.sets, math.nan, "ms")


BUDGETS = [("none", "none", math.inf), ("900rays", "rays", 900.0), ("rays:0.08ms", "ms", 0.08), ("5ms", "ms", math.nan)]


def written(folder: Path, name: str) -> dict[str, list[Any]]:
    import pyarrow.parquet

    table: dict[str, list[Any]] = pyarrow.parquet.read_table(folder / "oracle" / "hall" / name).to_pydict()
    return table


def write(folder: Path) -> Path:
    with open_renderer(hall(), heuristic="gain", budget="500rays") as renderer:
        return write_oracle(folder, "hall", 4, renderer, [(10, 1 / 3), (15, 0.5)], BUDGETS)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("bench")
    assert write(made) == made / "oracle" / "hall" / "block-004.parquet"
    return made


def test_the_tables_hold_every_frame_budget_and_item(folder: Path) -> None:
    rows = written(folder, "block-004.parquet")
    assert set(rows) == set(oracle.BLOCK_COLUMNS)
    assert list(zip(rows["frame"], rows["budget"], strict=True)) == [(f, b[0]) for f in (10, 15) for b in BUDGETS]
    assert rows["capacity"][:3] == [math.inf, 900.0, 0.08]
    assert rows["unit"][:4] == ["none", "rays", "ms", "ms"]
    assert rows["error_oracle"][0] == 0
    assert 0 < rows["error_oracle"][1] < rows["error_floor"][1]
    assert rows["cost"][1] <= 900
    assert rows["gap"][:3] == [0, 0, 0]
    for floor, oracle_error, benefit in zip(
        rows["error_floor"], rows["error_oracle"], rows["benefit_oracle"], strict=True
    ):
        assert math.isnan(benefit) or benefit == pytest.approx(floor - oracle_error, abs=1e-12)
    items = written(folder, "items-004.parquet")
    assert {"frame", "object", "effect", "benefit", "rays", "ms", "relevance"} <= set(items)
    with open_renderer(hall()) as renderer:
        second = oracle_frame(renderer, 0.5, 15)
    mine = np.array(items["frame"]) == 15
    assert np.array_equal(np.array(items["benefit"])[mine], second.benefit)
    assert np.array_equal(np.array(items["rays"])[mine], second.rays)
    assert items["object"][0] == "/floor"
    assert set(items["effect"]) <= set(second.effect_names)


def test_an_additive_choice_is_never_better(folder: Path) -> None:
    rows = written(folder, "block-004.parquet")
    known = ~np.isnan(rows["error_items"])
    assert known.sum() == 6
    assert (np.array(rows["error_items"]) >= np.array(rows["error_oracle"]) - 1e-12)[known].all()
    assert (np.array(rows["error_parts"]) <= np.array(rows["error_oracle"]) + 1e-12)[known].all()
    assert rows["error_parts"][1] < rows["error_oracle"][1]


def test_a_capacity_that_was_not_known_is_told_later(folder: Path) -> None:
    rows = written(folder, "block-004.parquet")
    unknown = [row for row, capacity in enumerate(rows["capacity"]) if math.isnan(capacity)]
    assert [rows["budget"][row] for row in unknown] == ["5ms", "5ms"]
    assert all(math.isnan(rows["error_oracle"][row]) and rows["items"][row] == 0 for row in unknown)
    sets = read_sets(folder / "oracle" / "hall" / "sets-004.parquet")
    assert sorted(sets) == [10, 15]
    for row, frame in enumerate(rows["frame"]):
        if row not in unknown:
            choice = oracle_choice(sets[frame], rows["capacity"][row], rows["unit"][row])
            later = rows["error_floor"][row] - choice.benefit / rows["pixels"][row]
            assert later == pytest.approx(rows["error_oracle"][row], abs=1e-12)


def test_the_same_oracle_is_written_again(folder: Path, tmp_path: Path) -> None:
    write(tmp_path)
    for path in (folder / "oracle" / "hall").iterdir():
        assert path.read_bytes() == (tmp_path / "oracle" / "hall" / path.name).read_bytes()
    assert len(list((folder / "oracle" / "hall").iterdir())) == 3


def test_a_file_that_cannot_be_written_leaves_the_old_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "table.parquet"
    oracle.write_table(target, {"a": [1, 2]}, {"a": "int64"})
    before = target.read_bytes()

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(oracle.os, "fsync", full)
    with pytest.raises(OSError, match="No space left"):
        oracle.write_table(target, {"a": [3]}, {"a": "int64"})
    assert target.read_bytes() == before
    assert list(tmp_path.iterdir()) == [target]


def test_a_block_without_frames_is_empty(tmp_path: Path) -> None:
    with open_renderer() as renderer:
        path = write_oracle(tmp_path, "hall", 0, renderer, [], BUDGETS)
    for kind, columns in (
        ("block", oracle.BLOCK_COLUMNS), ("items", oracle.ITEMS_COLUMNS), ("sets", oracle.SETS_COLUMNS)
    ):  # fmt: skip
        assert written(tmp_path, f"{kind}-000.parquet") == {name: [] for name in columns}
    assert read_sets(path.with_name("sets-000.parquet")) == {}


def test_shares_of_r_by_hand() -> None:
    candidates = {
        "frame": [1, 1, 1, 2, 2, 3],
        "relevance": [5.0, 4.0, 3.0, 1.0, 2.0, 0.0],
        "predicted_cost": [5.0, 4.0, 3.0, 1.0, 1.0, 1.0],
        "traced_pixels": [0, 10, 5, 0, 8, 0],
        "pixel_count": [10, 10, 10, 8, 8, 4],
    }
    found = relevance_share(candidates, {"frame": [1, 2, 3, 4], "budget": [8.0, math.inf, 1.0, 1.0]})
    assert found.frame.tolist() == [1, 2, 3, 4]
    assert found.sum_chosen.tolist() == [5.5, 2.0, 0.0, 0.0]
    assert found.sum_best.tolist() == [8.0, 3.0, 0.0, 0.0]
    assert found.share[:2].tolist() == pytest.approx([5.5 / 8, 2 / 3])
    assert np.isnan(found.share[2:]).all()
    some = relevance_share(candidates, {"frame": [1, 2, 3, 4], "budget": [8.0, math.inf, 1.0, 1.0]}, only=[2])
    assert (some.frame.tolist(), some.sum_best.tolist()) == ([2], [3.0])


@pytest.mark.parametrize("heuristic", ["greedy_ratio", "random"])
def test_shares_of_a_recorded_run(tmp_path: Path, heuristic: str) -> None:
    import pyarrow.parquet

    options = {"heuristic": heuristic, "budget": "900rays", "history": False, "remember_costs": False}
    record(tmp_path, 4, hall(), **options)
    candidates = pyarrow.parquet.read_table(tmp_path / "candidates.parquet")
    frames = pyarrow.parquet.read_table(tmp_path / "frames.parquet")
    found = relevance_share(candidates, frames)
    rows = candidates.to_pylist()
    for frame, best, chosen in zip(found.frame, found.sum_best, found.sum_chosen, strict=True):
        mine = [row for row in rows if row["frame"] == frame]
        assert 10 <= len(mine) <= 14
        value, price = (np.array([row[name] for row in mine], np.float64) for name in ("relevance", "predicted_cost"))
        most = max(value[c].sum() for c in every_choice(len(mine)) if price[c].sum() <= 900)
        assert best == pytest.approx(most, rel=2e-4)
        got = sum(row["relevance"] * row["traced_pixels"] / row["pixel_count"] for row in mine)
        assert chosen == pytest.approx(got, rel=1e-6)
    assert (found.share > 0).all()
    assert (found.share < 1.2).all()
