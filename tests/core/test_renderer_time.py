"""Frames under a budget of time: held by an injected clock, and sane with the real one."""

from __future__ import annotations

import gc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from candidate_kit import rows
from scene_kit import hall

import phrt
from phrt.budget import Budget
from phrt.clock import RayClock, RecordingClock, ReplayClock, WallClock
from phrt.errors import PhrtWarning
from phrt.frame import CUT, FrameResult
from phrt.interfaces.heuristic import Candidates
from phrt.pace import LEAST_MS
from phrt.registry import Options
from phrt.registry.manager import Registry
from phrt_heuristics.greedy_relevance import GreedyRelevance

SIZE = (96, 64)


def frames(count: int, **options: Any) -> list[FrameResult]:
    given = {"size": SIZE, "gbuffer": "raycast", "threads": 2, "strict": True, "heuristic": "greedy_relevance"}
    with phrt.Renderer(hall(), **(given | options)) as renderer:
        return [renderer.render() for _ in range(count)]


def decided(frame: FrameResult) -> list[np.ndarray]:
    work = frame.decisions
    order = np.argsort(work.candidates.keys())
    letters = rows(work.candidates, order)
    return [letters.predicted_cost, *(a[order] for a in (work.reason, work.order, work.traced_pixels, work.rays))]


def assert_same(one: list[FrameResult], other: list[FrameResult]) -> None:
    for a, b in zip(one, other, strict=True):
        for x, y in zip(decided(a), decided(b), strict=True):
            np.testing.assert_array_equal(x, y)
        np.testing.assert_array_equal(a.image, b.image)


@pytest.mark.parametrize("budget", ["rays:0.3ms", "0.4ms"])
@pytest.mark.parametrize("heuristic", ["selection_graph", "uniform", "round_robin"])
@pytest.mark.parametrize("cost_model", ["measured", "paper"])
def test_with_a_price_per_ray_one_and_four_threads_decide_the_same_bit_for_bit(
    budget: str, heuristic: str, cost_model: str
) -> None:
    options = {"budget": budget, "heuristic": heuristic, "cost_model": cost_model}
    one = frames(5, threads=1, clock=RayClock(100.0), **options)
    assert_same(one, frames(5, threads=4, clock=RayClock(100.0), **options))
    assert one[-1].decisions.chosen.sum() > 0
    assert one[-1].decisions.budget_unit == "ms"


@pytest.mark.parametrize("heuristic", ["selection_graph", "uniform", "gain"])
def test_with_a_price_per_ray_the_order_of_plugins_does_not_matter(
    heuristic: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = Registry.names
    one = frames(5, clock=RayClock(100.0), budget="rays:0.3ms", heuristic=heuristic)
    monkeypatch.setattr(Registry, "names", lambda registry, kind: names(registry, kind)[::-1])
    other = frames(5, clock=RayClock(100.0), budget="rays:0.3ms", heuristic=heuristic)
    assert one[0].decisions.candidates.effect_names == other[0].decisions.candidates.effect_names[::-1]
    assert_same(one, other)


def test_the_ray_phase_holds_its_time_by_the_clock() -> None:
    made = frames(12, budget="rays:0.4ms", heuristic="uniform", clock=RayClock(100.0))
    for frame in made[4:]:
        assert 0.3 < frame.decisions.ray_ms <= 0.42
        assert frame.decisions.overrun_ms <= 0.02
    milliseconds = [frame.decisions.milliseconds.sum() for frame in made]
    np.testing.assert_allclose(milliseconds, [frame.decisions.ray_ms for frame in made])


def test_an_item_dearer_than_predicted_is_cut_off_and_stays_a_coarser_effect() -> None:
    """At first a ray is thought to take a tenth of what it does."""
    frame = frames(1, size=(256, 170), budget="rays:5ms", heuristic="all_trace", clock=RayClock(1000.0))[0]
    decisions = frame.decisions
    assert (decisions.reason == CUT).sum() == 1
    (cut,) = np.flatnonzero(decisions.reason == CUT)
    assert 0 < decisions.traced_pixels[cut] < decisions.candidates.pixel_count[cut]
    assert np.isfinite(frame.image).all()


def test_a_run_is_replayed_from_the_readings_of_its_clock() -> None:
    clock = RecordingClock(WallClock())
    options = {"budget": "rays:2ms", "heuristic": "uniform", "remember_costs": False}
    first = frames(4, clock=clock, **options)
    assert_same(first, frames(4, clock=ReplayClock(clock.take()), **options))


def test_a_run_starts_from_what_the_last_one_learnt_of_costs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PHRT_CACHE", str(tmp_path))
    cold = frames(1, budget="rays:50ms")[0].decisions.candidates.predicted_ms_measured
    frames(3, budget="rays:50ms")
    warm = frames(1, budget="rays:50ms")[0].decisions.candidates.predicted_ms_measured
    assert not np.array_equal(cold, warm)
    for options in ({"remember_costs": False}, {"clock": RayClock()}):
        again = frames(1, budget="rays:50ms", **options)[0].decisions.candidates.predicted_ms_measured
        np.testing.assert_array_equal(cold, again)


def test_a_frame_budget_that_is_large_enough_traces_everything() -> None:
    last = frames(3, budget="30s", heuristic="all_trace")[-1]
    assert last.decisions.chosen.all()
    assert not last.late
    assert last.budget == Budget(30_000, "frame_ms")
    assert last.headroom_ms > 0
    assert last.clock_ms == pytest.approx(last.milliseconds, rel=0.2)
    np.testing.assert_array_equal(last.image, frames(1, heuristic="all_trace")[0].image)


def test_a_frame_budget_below_the_raster_stages_warns_once_and_shows_fallbacks() -> None:
    with pytest.warns(
        PhrtWarning, match=r"the frame budget of 0.001ms leaves nothing for rays: the rest of the"
    ) as told:
        made = frames(14, budget="0.001ms")
    assert len(told) == 1
    assert not made[-1].decisions.chosen.any()
    assert made[-1].late
    np.testing.assert_array_equal(made[-1].image, frames(1, heuristic="raster_only")[0].image)


def test_what_the_host_reserves_is_not_spent_on_rays() -> None:
    with pytest.warns(PhrtWarning, match="leaves nothing for rays"):
        last = frames(14, budget="30s", reserve_ms=29_999.9)[-1]
    assert last.decisions.budget == LEAST_MS
    assert last.late


def test_a_budget_can_change_at_every_frame() -> None:
    with phrt.Renderer(hall(), size=SIZE, heuristic="uniform", clock=RayClock(100.0)) as renderer:
        spent = []
        for budget in ("none", "rays:0.2ms", "0rays", "2000rays", "none"):
            renderer.control(budget=budget)
            rays = renderer.render().rays
            spent.append(sum(count for effect, count in rays.items() if effect != "primary"))
    assert spent[0] == spent[4] > spent[3] > 0
    assert spent[2] == 0
    assert 0 < spent[1] < spent[0]


def test_no_garbage_is_collected_while_a_frame_is_made() -> None:
    seen: list[bool] = []

    class Looks(GreedyRelevance):
        def begin_frame(self, candidates: Candidates, context: Any) -> None:
            seen.append(gc.isenabled())
            super().begin_frame(candidates, context)

    assert gc.isenabled()
    frames(2, heuristic=Looks(Options()))
    assert seen == [False, False]
    assert gc.isenabled()
    gc.disable()
    try:
        frames(1)
        assert not gc.isenabled(), "where it was off, it stays off"
    finally:
        gc.enable()
