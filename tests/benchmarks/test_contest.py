"""Contests measure what they say they do: who was late, what flipped, how far predictions were off. No test looks at a time."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import candidate_kit
import needs
import numpy as np
import pytest

import phrt
from phrt.budget import Budget
from phrt.output.tonemap import to_8bit

needs.package("flip_evaluator")
needs.package("skimage")

SIZE = (48, 32)
NAMES = ["all_trace", "raster_only", "random", "selection_graph"]
EFFECTS = {"reflections": {"fallback": "environment"}}


def decided(chosen: Sequence[bool], objects: Sequence[int] | None = None, **columns: object) -> SimpleNamespace:
    """Decisions on items of 10, 20, 30, ... pixels, all traced whole where chosen."""
    n = len(chosen)
    pixels = np.arange(1, n + 1, dtype=np.int32) * 10
    work = candidate_kit.candidates(np.full(n, 5.0), pixel_count=pixels)
    if objects is not None:
        work = replace(work, object_id=np.array(objects, np.int32))
    picked = np.array(chosen, bool)
    made = {
        "candidates": work,
        "chosen": picked,
        "traced_pixels": np.where(picked, pixels, 0),
        "rays": np.where(picked, 100, 0),
        "milliseconds": np.where(picked, 2.0, 0.0),
    }
    return SimpleNamespace(**(made | columns))


def test_flips_are_items_of_both_frames_that_changed_and_their_share_of_the_pixels(module):
    flips = module("contest").flips
    before, after = decided([True, False, True, True]), decided([True, True, True, False])
    assert flips(before, after) == {"flips": 2.0, "flipped_area": pytest.approx((20 + 40) / 100)}
    assert flips(before, before) == {"flips": 0.0, "flipped_area": 0.0}
    assert flips(None, after) == {"flips": 0.0, "flipped_area": 0.0}


def test_flips_do_not_count_items_that_one_frame_alone_sees(module):
    flips = module("contest").flips
    before, after = decided([True, False], objects=[1, 2]), decided([True, False], objects=[2, 3])
    assert flips(before, after) == {"flips": 1.0, "flipped_area": 1.0}
    assert flips(before, decided([True, True], objects=[8, 9])) == {"flips": 0.0, "flipped_area": 0.0}


def test_prediction_errors_are_relative_to_what_it_took_and_to_what_was_traced(module):
    made = decided([True, True, False, True])
    work = replace(
        made.candidates,
        predicted_rays=np.array([100, 50, 7, 200], np.float32),
        predicted_ms_paper=np.array([4, 2, 9, 2], np.float32),
        predicted_ms_measured=np.array([2, 2, 9, 4], np.float32),
    )
    # Of the last item half is traced: half of its prediction counts.
    pixels = np.array([10, 20, 0, 20])
    totals, items = module("contest").prediction_errors(
        SimpleNamespace(**(vars(made) | {"candidates": work, "traced_pixels": pixels}))
    )
    assert totals["error_rays"] == pytest.approx((300 - 250) / 300)
    assert totals["error_paper"] == pytest.approx((7 - 6) / 6)
    assert totals["error_measured"] == pytest.approx(0.0)
    assert items["rays"] == pytest.approx([0.0, 0.5, 0.0])
    assert items["paper"] == pytest.approx([1.0, 0.0, 0.5])
    assert items["measured"] == pytest.approx([0.0, 0.0, 0.0])


def test_a_frame_without_rays_has_no_prediction_error(module):
    totals, items = module("contest").prediction_errors(decided([False, False]))
    assert all(math.isnan(value) for value in totals.values())
    assert all(len(found) == 0 for found in items.values())


def test_the_path_counts_every_frame_once_after_walking_up_to_its_start(module):
    contest = module("contest")
    path = contest.Path(120, 30.0, every=7)
    warm = path.warm_up()
    frames = [frame for block in path.blocks() for frame in block]
    assert [index for index, _ in warm + frames] == list(range(contest.WARM_UP + 120))
    assert [at for _, at in frames] == pytest.approx(np.arange(120) / 30)
    steps = np.diff([at for _, at in warm + frames])
    assert np.abs(steps) == pytest.approx(1 / 30)
    assert (steps[: len(warm)] < 0).all()
    assert [index - contest.WARM_UP for index, _ in frames if path.keeps(index)] == list(range(0, 120, 7))


@pytest.fixture(scope="module")
def spheres() -> phrt.Scene:
    return phrt.load_scene(Path(__file__).resolve().parents[2] / "scenes" / "spheres.yaml")


@pytest.fixture
def held(module, spheres, monkeypatch):
    contest = module("contest")
    monkeypatch.setattr(contest, "WARM_UP", 3)
    monkeypatch.setattr(contest, "BLOCK", 2)

    def hold(budget: Budget | None, frames: int = 5, names: Sequence[str] = NAMES):
        rules = contest.Rules("a contest", "default", budget, EFFECTS, history=False)
        return contest.hold(spheres, rules, names, contest.Path(frames, 30.0, every=2), size=SIZE)

    return hold


def test_half_the_rays_is_half_of_what_all_trace_takes(held):
    found = held(None)
    rays = found.reference.samples["rays"]
    assert found.budget.kind == "rays"
    assert found.budget.amount == pytest.approx(rays[0] / 2, rel=0.02)
    by_name = {entrant.name: entrant.samples for entrant in found.rivals}
    assert (by_name["raster_only"]["rays"] == 0).all()
    for name in ("random", "selection_graph", "all_trace"):
        assert (by_name[name]["rays"] <= found.budget.amount * 1.1).all()
        over = by_name[name]["rays"] - found.budget.amount
        assert by_name[name]["overrun"] == pytest.approx(np.maximum(over, 0))


def test_pictures_are_compared_with_all_trace_at_the_same_places(held, module, spheres):
    quality = module("quality")
    found = held(Budget(0.0, "rays"), names=["raster_only", "all_trace"])
    pictures = []
    for heuristic in ("all_trace", "raster_only"):
        with phrt.Renderer(
            spheres, size=SIZE, gbuffer="raycast", tracer="embree", heuristic=heuristic, effects=EFFECTS
        ) as renderer:
            pictures.append([to_8bit(renderer.render(i / 30, frame_index=3 + i).image) for i in (0, 2, 4)])
    expected = [quality.compare(*pair) for pair in zip(*pictures, strict=True)]
    assert expected[0].flip > 0.01
    assert found.rivals[0].quality == expected
    # Without a ray to spend everybody shows the same.
    assert found.rivals[1].quality == expected
    assert not found.reference.pictures


def test_a_budget_that_holds_everything_is_at_no_distance(held):
    found = held(Budget(10_000_000, "rays"), names=["selection_graph"])
    assert [entry.flip for entry in found.rivals[0].quality] == [0.0, 0.0, 0.0]


def test_standings_sum_up_the_samples(held, module):
    budgets = module("budgets")
    found = held(Budget(1e-6, "frame_ms"), frames=4)
    reference, *rivals = budgets.standings(found)
    assert math.isnan(reference.misses)
    assert math.isnan(reference.flip)
    assert [entry.heuristic for entry in rivals] == NAMES
    samples = found.rivals[2].samples
    random = rivals[2]
    assert random.misses == 1.0
    assert random.frames == 4
    assert random.fps == pytest.approx(1e3 / samples["frame_ms"].mean())
    assert random.frame_p50 == pytest.approx(np.median(samples["frame_ms"]))
    assert random.flip == pytest.approx(np.mean([entry.flip for entry in found.rivals[2].quality]))
    stages = budgets.stage_means(found.rivals[2])
    assert sum(stages.values()) <= random.frame_mean * 1.01
    assert stages["to_8bit"] > 0
    assert held(Budget(3.6e6, "frame_ms"), frames=2).rivals[0].samples["overrun"].max() == 0


def standing(module, name: str, **figures: float):
    budgets = module("budgets")
    zero = dict.fromkeys(budgets.Standing.__dataclass_fields__, 0.0) | {"overrun_unit": "ms"}
    return budgets.Standing(**(zero | {"heuristic": name, "frames": 4} | figures))


def rows_of(module, number: int, entries) -> dict[str, tuple[float, bool | None]]:
    budgets = module("budgets")
    rows = {6: budgets._rays_rows, 7: budgets._rich_rows, 8: budgets._hard_rows}[number](None, entries)
    assert {row.number for row in rows} == {number}
    return {row.what: (row.median, row.met) for row in rows}


def test_row_6_holds_gain_to_its_bar_and_to_the_papers_heuristic(module):
    flips = {"all_trace": 0.3, "raster_only": 0.2, "selection_graph": 0.07, "gain": 0.03}
    rows = rows_of(
        module, 6, [standing(module, "the reference"), *(standing(module, n, flip=f) for n, f in flips.items())]
    )
    assert rows["half the rays, mean FLIP: gain"] == (0.03, True)
    assert rows["half the rays, mean FLIP: raster_only"] == (0.2, None)
    assert rows["  gain / selection_graph"] == (pytest.approx(3 / 7), True)
    assert "half the rays, mean FLIP: all_trace" not in rows


def test_row_7_compares_frame_times_of_the_best_picture_with_all_trace(module):
    entries = [
        standing(module, "the reference", frame_mean=200.0, rays=1000.0),
        standing(module, "a", frame_mean=30.0, flip=0.08),
        standing(module, "b", frame_mean=50.0, flip=0.05, misses=0.03, rays=250.0),
    ]
    assert rows_of(module, 7, entries) == {
        "rich, 50 ms: all-trace / b, frame times": (4.0, True),
        "  mean FLIP of b, the best": (0.05, True),
        "  its frames over budget": (3.0, None),
        "  its rays, of all-trace's": (25.0, None),
    }


def test_row_8_counts_late_frames_and_takes_one_wave_off_the_overrun(module):
    entries = [
        standing(module, "the reference"),
        standing(module, "a", flip=0.04, misses=0.02, overrun_worst=4.0, overrun_past_wave=1.5),
        standing(module, "b", flip=0.06),
    ]
    assert rows_of(module, 8, entries) == {
        "hard, 33 ms: frames over budget, a": (2.0, False),
        "  worst ray-phase overrun": (4.0, None),
        "  the same less one wave": (1.5, True),
        "  mean FLIP of a, the best": (0.04, True),
        "  its rays, of all-trace's": (0.0, None),
    }


def test_a_contest_as_json_and_as_tables_has_every_heuristic(held, module):
    budgets = module("budgets")
    found = held(None, frames=3)
    told = json.loads(json.dumps(budgets.as_json(found), allow_nan=False))
    assert [entry["heuristic"] for entry in told["standings"]] == [found.reference.name, *NAMES]
    assert told["standings"][0]["flip"] is None
    assert set(told["samples"]) == set(told["stages_mean_ms"]) == {found.reference.name, *NAMES}
    assert len(told["samples"]["random"]["frame_ms"]) == 3
    assert told["pictures_compared"] == 2
    assert [table.row_count for table in budgets.tables(found)] == [5, 5, 5]
    assert [row.number for row in budgets.contest_rows(6, found)] == [6, 6, 6]


def test_a_heuristic_that_fails_ends_the_contest(held, monkeypatch):
    from phrt_heuristics.random_order import RandomOrder

    def broken(self, candidates, context):
        raise RuntimeError("no luck")

    monkeypatch.setattr(RandomOrder, "begin_frame", broken)
    with pytest.raises(phrt.errors.PluginError, match="no luck"):
        held(None, frames=1, names=["random"])


def test_every_heuristic_takes_part_the_simple_ones_first(module):
    names = module("budgets").in_table_order(["zebra", *module("contest").heuristics_here()])
    assert names[:3] == ["all_trace", "raster_only", "random"]
    assert set(names) == {"zebra", *module("contest").heuristics_here()}


def test_the_watch_sees_waves_only_inside_of_the_ray_phase(module, spheres):
    with phrt.Renderer(
        spheres,
        size=SIZE,
        threads=2,
        gbuffer="raycast",
        tracer="embree",
        heuristic="selection_graph",
        budget="20000rays",
    ) as renderer:
        kind = type(renderer.heuristic)
        watch = module("watch").watch(renderer)
        result = renderer.render(0.0)
        assert type(renderer.heuristic) is kind
        renderer.workers.map(abs, [1, 2])
        phase = watch.phase
    assert len(phase.waves_ms) == result.decisions.waves > 0
    assert 0 < phase.heuristic_ms < phase.whole_ms
    assert phase.scheduler_ms == pytest.approx(phase.whole_ms - phase.heuristic_ms - sum(phase.waves_ms))
