"""The scheduler: what a heuristic asks for is traced, once, and a broken effect does not end the frame."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from candidate_kit import candidates, units_of

from phrt.candidates import WorkItems
from phrt.costs import CostModels
from phrt.errors import PhrtWarning, PluginError
from phrt.experience import Experience
from phrt.faults import Faults
from phrt.frame import MASK_FALLBACK, MASK_FILLED, MASK_TRACED
from phrt.interfaces.effect import EffectResult, LayerSpec, RayEffect
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic, Outcome, Request
from phrt.layers import LayerSet, apply_fallbacks
from phrt.ledger import Ledger, Parts
from phrt.runs import merged, unit_parts
from phrt.scheduler import MOST_FOR_BEGINNING, BudgetScheduler, _Plan
from phrt.workers import Workers

SIZES = (300, 200, 100)
"""Pixels of the three objects; effect 0 applies to all, effect 1 to the last two."""


class Painter(RayEffect):
    """Writes each pixel's index; remembers what it was asked for."""

    reads = ()

    def __init__(self, name: str, fallback: float | None = None) -> None:
        self.name, self.writes = name, LayerSpec(f"{name}_layer", 1, 0.0, "")
        self._fallback = fallback
        self.asked: list[np.ndarray] = []

    def applies_to(self, world: Any) -> np.ndarray:
        return np.ones(1, bool)

    def rays_per_pixel(self, world: Any) -> float:
        return 2.0

    def trace(self, frame: Any, pixels: np.ndarray) -> EffectResult:
        self.asked.append(pixels)
        return EffectResult(pixels[:, None].astype(np.float32), 2 * len(pixels))

    def fallback(self, frame: Any, pixels: np.ndarray) -> np.ndarray | None:
        return None if self._fallback is None else np.full((len(pixels), 1), self._fallback, np.float32)


class Raising(Painter):
    def trace(self, frame: Any, pixels: np.ndarray) -> EffectResult:
        raise RuntimeError("the cable came off")


class HalfRaising(Painter):
    """Fails on the pixels of the last object."""

    def trace(self, frame: Any, pixels: np.ndarray) -> EffectResult:
        if pixels.max() >= 500:
            raise RuntimeError("the cable came off")
        return super().trace(frame, pixels)


class WrongShape(Painter):
    def trace(self, frame: Any, pixels: np.ndarray) -> EffectResult:
        return EffectResult(np.zeros((len(pixels), 3), np.float32), 0)


class WrongType(Painter):
    def trace(self, frame: Any, pixels: np.ndarray) -> EffectResult:
        return EffectResult(np.zeros((len(pixels), 1), np.float64), 0)


class WrongTraced(Painter):
    def trace(self, frame: Any, pixels: np.ndarray) -> EffectResult:
        return EffectResult(np.zeros((len(pixels), 1), np.float32), 0, np.ones(1, np.uint8))


class NoFallback(Painter):
    def fallback(self, frame: Any, pixels: np.ndarray) -> np.ndarray | None:
        raise RuntimeError("the map is torn")


class WrongFallback(Painter):
    def fallback(self, frame: Any, pixels: np.ndarray) -> np.ndarray | None:
        return np.zeros((1, 1), np.float32)


class WrongAt(Painter):
    def applies_at(self, frame: Any, pixels: np.ndarray) -> np.ndarray | None:
        return np.ones(len(pixels), np.int32)


class NothingWorks(Raising, NoFallback):
    pass


class Picks(Heuristic):
    """Asks for a fixed list of items; None in the list ends a wave."""

    def __init__(self, items: list[Any]) -> None:
        self.items = items
        self.calls: list[str] = []
        self.outcomes: dict[int, Outcome] = {}

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self.calls.append("begin")
        self.left = list(self.items)

    def next(self, remaining: float) -> int | Request | None:
        return self.left.pop(0) if self.left else None

    def report(self, item: int, outcome: Outcome) -> None:
        self.calls.append(f"report {item}")
        self.outcomes[item] = outcome

    def end_frame(self) -> None:
        self.calls.append("end")


def work_items() -> WorkItems:
    first = np.concatenate([[0], np.cumsum(SIZES)[:-1]])
    pixels = np.arange(600, dtype=np.int32)
    counts = np.array([*SIZES, *SIZES[1:]], np.int32)
    items = candidates(
        2.0 * counts,
        effect_names=("one", "two"),
        object_id=np.array([1, 2, 3, 2, 3], np.int32),
        effect=np.array([0, 0, 0, 1, 1], np.int32),
        pixel_count=counts,
        ray_estimate=np.full(5, 2.0, np.float32),
        area=(counts / 600).astype(np.float32),
    )
    return WorkItems(items, units_of(items, [*first, 0, 200]), [pixels, pixels[300:]], 30)


def run(
    effects: list[Painter],
    heuristic: Heuristic,
    faults: Faults | None = None,
    budget: float = math.inf,
    work: WorkItems | None = None,
) -> tuple[Any, LayerSet]:
    layers = LayerSet({}, {})
    for effect in effects:
        layers.arrays[effect.writes.name] = np.full((600, 1), effect.writes.clear, np.float32)
        layers.masks[effect.writes.name] = np.zeros(600, np.uint8)
    frame: Any = SimpleNamespace(
        world=SimpleNamespace(lights=[]),
        workers=Workers(2),
        view=SimpleNamespace(width=30, height=20),
        surfaces=SimpleNamespace(object_id=np.repeat(np.array([1, 2, 3], np.uint32), SIZES)),
    )
    context = FrameContext(frame.world, 0, 0.0, budget, "rays" if math.isfinite(budget) else "none")
    work = work or work_items()
    faults = faults or Faults()
    names = [effect.name for effect in effects]
    scheduler = BudgetScheduler(CostModels(names), Experience(3, [2.0 for _ in names]), faults)
    decisions = scheduler.run(frame, effects, work, heuristic, context, layers)  # type: ignore[arg-type]
    apply_fallbacks(frame, effects, work, decisions, layers, faults)  # type: ignore[arg-type]
    frame.workers.close()
    return decisions, layers


def painters() -> list[Painter]:
    return [Painter("one"), Painter("two", fallback=-1.0)]


def test_everything_asked_for_is_traced_and_nothing_else() -> None:
    effects = painters()
    decisions, layers = run(effects, Picks([0, 2, 3]))
    assert decisions.chosen.tolist() == [True, False, True, True, False]
    assert decisions.traced_pixels.tolist() == [300, 0, 100, 200, 0]
    one, two = (layers.arrays[f"{name}_layer"][:, 0] for name in ("one", "two"))
    np.testing.assert_array_equal(one, np.where((np.arange(600) < 300) | (np.arange(600) >= 500), np.arange(600), 0))
    np.testing.assert_array_equal(two[300:], [*range(300, 500), *[-1.0] * 100])
    masks = layers.masks["two_layer"]
    assert np.unique(masks[:300]).tolist() == [0], "the effect does not apply there"
    assert np.unique(masks[300:500]).tolist() == [MASK_TRACED]
    assert np.unique(masks[500:]).tolist() == [MASK_FALLBACK]
    assert sorted(np.concatenate(effects[0].asked).tolist()) == [*range(300), *range(500, 600)]


def test_rays_are_shared_out_by_pixels_and_reported_between_begin_and_end() -> None:
    heuristic = Picks([4, 0, 1])
    decisions, layers = run(painters(), heuristic)
    assert heuristic.calls == ["begin", "report 4", "report 0", "report 1", "end"]
    assert decisions.rays.tolist() == [600, 400, 0, 0, 200]
    assert layers.rays == {"one": 1000, "two": 200}
    outcome = heuristic.outcomes[0]
    assert (outcome.pixels, outcome.rays, outcome.complete) == (300, 600, True)
    assert np.all(decisions.milliseconds[[0, 1, 4]] > 0)


def test_a_heuristic_may_answer_in_several_waves() -> None:
    heuristic = Picks([0, None, 3, None, 1])
    decisions, _ = run(painters(), heuristic)
    assert decisions.chosen.tolist() == [True, True, False, True, False]
    assert heuristic.calls == ["begin", "report 0", "report 3", "report 1", "end"]


def test_a_heuristic_that_wants_nothing_leaves_every_fallback() -> None:
    effects = painters()
    decisions, layers = run(effects, Picks([]))
    assert not decisions.chosen.any()
    assert not effects[0].asked
    assert np.all(layers.arrays["two_layer"][300:] == -1)


@pytest.mark.parametrize("items", [[0, 0], [5], [-1], [2, None, 2]])
def test_an_item_twice_or_out_of_range_is_the_heuristics_fault(items: list[int | None]) -> None:
    with pytest.raises(PluginError, match=r"heuristic Picks returned item -?\d: not one of 5, or twice"):
        run(painters(), Picks(items), Faults(strict=True))


def test_a_heuristic_that_fails_is_switched_off_with_one_warning_and_the_frame_comes_out() -> None:
    effects, faults = painters(), Faults()
    with pytest.warns(PhrtWarning, match="heuristic Picks returned item 7.*; it is switched off, and what") as caught:
        decisions, layers = run(effects, Picks([0, None, 7, 1]), faults)
    assert len(caught) == 1
    assert decisions.chosen.tolist() == [True, False, False, False, False]
    assert np.all(layers.arrays["two_layer"][300:] == -1)
    for budget in (math.inf, 1e6):
        later, _ = run(effects, Picks([0, 1]), faults, budget)
        assert not later.chosen.any()


def test_a_heuristic_that_fails_under_a_budget_leaves_what_it_chose() -> None:
    with pytest.warns(PhrtWarning, match="heuristic Picks returned item 7"):
        decisions, _ = run(painters(), Picks([0, None, 7, 1]), budget=1e6)
    assert decisions.chosen.tolist() == [True, False, False, False, False]


@pytest.mark.parametrize(
    ("broken", "reason"),
    [
        (Raising, r"failed in trace\(\): RuntimeError: the cable came off"),
        (WrongShape, r"returned float32\(\d+, 3\) from trace\(\), expected float32\(\d+, 1\)"),
        (WrongType, r"returned float64\(\d+, 1\) from trace\(\), expected float32\(\d+, 1\)"),
        (WrongTraced, r"returned traced as uint8\(1,\) from trace\(\), expected uint8\(\d+,\)"),
    ],
)
def test_a_broken_effect_is_switched_off_with_one_warning_and_the_frame_goes_on(
    broken: type[Painter], reason: str
) -> None:
    effects, faults = [broken("one", fallback=7.0), Painter("two")], Faults()
    match = f"effect 'one' {reason}; it is switched off, and its pixels take the fallback"
    with pytest.warns(PhrtWarning, match=match) as caught:
        decisions, layers = run(effects, Picks([0, 1, 2, 3, 4]), faults)
    assert len(caught) == 1
    assert decisions.chosen.tolist() == [False, False, False, True, True]
    assert np.all(layers.arrays["one_layer"] == 7)
    np.testing.assert_array_equal(layers.arrays["two_layer"][300:, 0], np.arange(300, 600))
    # For the rest of the run it stays off, without another word (a warning would be an error here).
    decisions, layers = run(effects, Picks([0, 1, 2, 3, 4]), faults)
    assert decisions.chosen.tolist() == [False, False, False, True, True]
    assert np.all(layers.arrays["one_layer"] == 7)


@pytest.mark.parametrize("fallback", [None, 7.0])
def test_what_a_broken_effect_traced_before_it_broke_is_not_shown(fallback: float | None) -> None:
    with pytest.warns(PhrtWarning, match="effect 'one' failed"):
        _, layers = run([HalfRaising("one", fallback), Painter("two")], Picks([0, None, 2]))
    assert np.all(layers.arrays["one_layer"] == (fallback or 0.0))
    assert np.all(layers.masks["one_layer"] == (MASK_FALLBACK if fallback else 0))


@pytest.mark.parametrize(
    ("broken", "reason"),
    [
        (NoFallback, r"failed in fallback\(\): RuntimeError: the map is torn"),
        (WrongFallback, r"returned float32\(1, 1\) from fallback\(\), expected float32\(300, 1\)"),
        (WrongAt, r"returned int32\(300,\) from applies_at\(\), expected bool\(300,\)"),
    ],
)
def test_an_effect_whose_fallback_fails_is_switched_off_and_its_pixels_are_clear(
    broken: type[Painter], reason: str
) -> None:
    effects, faults = [broken("one"), Painter("two")], Faults()
    effects[0].writes = LayerSpec("one_layer", 1, 0.5, "")
    match = f"effect 'one' {reason}; it is switched off, and its pixels take the layer's clear value 0.5"
    with pytest.warns(PhrtWarning, match=match) as caught:
        decisions, layers = run(effects, Picks([1, 2, 3, 4]), faults)
    assert len(caught) == 1
    assert decisions.chosen.tolist() == [False, True, True, True, True]
    assert np.all(layers.arrays["one_layer"][:300] == 0.5)
    np.testing.assert_array_equal(layers.arrays["one_layer"][300:, 0], np.arange(300, 600))
    # From the next frame on it is off, without another word (a warning would be an error here).
    decisions, layers = run(effects, Picks([1, 2, 3, 4]), faults)
    assert decisions.chosen.tolist() == [False, False, False, True, True]
    assert np.all(layers.arrays["one_layer"] == 0.5)


def test_an_effect_that_fails_in_everything_is_told_once_for_each() -> None:
    effects, faults = [NothingWorks("one"), Painter("two")], Faults()
    with pytest.warns(PhrtWarning) as caught:
        run(effects, Picks([0, 3]), faults)
    _, layers = run(effects, Picks([0, 3]), faults)
    assert [str(warning.message).rpartition(": ")[2].partition(";")[0] for warning in caught] == [
        "the cable came off",
        "the map is torn",
    ]
    assert not layers.arrays["one_layer"].any()


def test_preparing_a_fallback_that_fails_leaves_the_clear_value() -> None:
    class Unprepared(Painter):
        def prepare_fallback(self, frame: Any) -> None:
            raise MemoryError("no room for the map")

    effects, faults = [Unprepared("one", fallback=7.0), Painter("two")], Faults()
    with pytest.warns(
        PhrtWarning, match="MemoryError: no room for the map; it is switched off.*clear value 0"
    ) as caught:
        faults.prepare_fallback(effects[0], None)  # type: ignore[arg-type]
    faults.prepare_fallback(effects[0], None)  # type: ignore[arg-type]
    assert len(caught) == 1
    _, layers = run(effects, Picks([0]), faults)
    assert not layers.arrays["one_layer"].any()


class Failing(Picks):
    """Raises in one of its calls."""

    def __init__(self, call: str) -> None:
        super().__init__([0])

        def fail(*_: Any) -> Any:
            raise KeyError("lost")

        setattr(self, call, fail)


@pytest.mark.parametrize("call", ["begin_frame", "next", "report", "end_frame"])
def test_a_heuristic_that_raises_is_named_with_the_call_and_the_cause(call: str) -> None:
    with pytest.raises(PluginError, match=rf"heuristic Failing failed in {call}\(\): KeyError: 'lost'") as caught:
        run(painters(), Failing(call), Faults(strict=True))
    assert isinstance(caught.value.__cause__, KeyError)


@pytest.mark.parametrize("answer", ["first", 1.0, Request(0.5), Request(0, "all")])  # type: ignore[arg-type]
def test_an_answer_that_is_no_item_is_the_heuristics_fault(answer: Any) -> None:
    with pytest.raises(PluginError, match=r"heuristic Picks returned .* from next\(\): expected an item's number"):
        run(painters(), Picks([answer]), Faults(strict=True))


def test_with_strict_an_effects_error_is_an_error_that_names_it() -> None:
    with pytest.raises(
        PluginError, match=r"effect 'one' failed in trace\(\): RuntimeError: the cable came off$"
    ) as raised:
        run([Raising("one"), Painter("two")], Picks([0]), Faults(strict=True))
    assert isinstance(raised.value.__cause__, RuntimeError)


def test_items_that_lie_next_to_each_other_become_one_run() -> None:
    work = work_items()
    everything = merged(work, 0, np.array([2, 0, 1]))
    assert everything.base is not None
    np.testing.assert_array_equal(everything, np.arange(600))
    np.testing.assert_array_equal(merged(work, 0, np.array([2, 0])), [*range(300), *range(500, 600)])
    assert len(merged(work, 0, np.array([], np.int64))) == 0


def test_part_of_an_item_is_one_pixel_of_each_block_and_its_gaps_are_filled() -> None:
    effects = painters()
    decisions, layers = run(effects, Picks([Request(0, 1), 1]))
    asked = np.concatenate(effects[0].asked)
    x, y = asked % 30, asked // 30
    first = asked[asked < 300]
    assert np.all((x % 2 == 0)[asked < 300] & (y % 2 == 0)[asked < 300])
    assert len(first) == 300 // 4
    mask = layers.masks["one_layer"]
    assert np.unique(mask[:300]).tolist() == [MASK_TRACED, MASK_FILLED]
    assert np.unique(mask[300:500]).tolist() == [MASK_TRACED]
    # A filled pixel lies among its neighbours' values, which are their own indices here.
    assert layers.arrays["one_layer"][31, 0] == np.mean([0, 2, 60, 62])
    assert decisions.passes.tolist() == [1, 4, 0, 0, 0]


def test_the_passes_of_an_item_make_the_whole_item_without_repeats() -> None:
    effects = painters()
    heuristic = Picks([Request(0, 1), None, Request(0, 2), None, Request(0, 4)])
    decisions, layers = run(effects, heuristic)
    assert sorted(np.concatenate(effects[0].asked).tolist()) == list(range(300))
    np.testing.assert_array_equal(layers.arrays["one_layer"][:300, 0], np.arange(300))
    assert decisions.rays[0] == 600
    assert heuristic.outcomes[0].complete
    with pytest.raises(PluginError, match="or twice"):
        run(painters(), Picks([0, Request(0, 1)]), Faults(strict=True))


# --- budgets -------------------------------------------------------------------------------------------------------


class Frugal(Painter):
    """Takes one ray a pixel where two were expected."""

    def trace(self, frame: Any, pixels: np.ndarray) -> EffectResult:
        return EffectResult(super().trace(frame, pixels).values, len(pixels))


class Dear(Painter):
    """Takes four rays a pixel where two were expected."""

    def trace(self, frame: Any, pixels: np.ndarray) -> EffectResult:
        return EffectResult(super().trace(frame, pixels).values, 4 * len(pixels))


class Watched(Picks):
    """Remembers what was left each time it was asked."""

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        super().begin_frame(candidates, context)
        self.remaining: list[float] = []

    def next(self, remaining: float) -> int | Request | None:
        self.remaining.append(remaining)
        return super().next(remaining)


def test_what_an_item_is_predicted_to_take_is_off_the_budget_at_once() -> None:
    heuristic = Watched([0, Request(1, 1), 3])
    decisions, layers = run(painters(), heuristic, budget=1200)
    assert heuristic.remaining[:4] == [1200, 600, 500, 100]
    assert decisions.rays.tolist() == [600, layers.rays["one"] - 600, 0, 400, 0]
    assert (decisions.budget, decisions.budget_unit) == (1200, "rays")


def test_an_item_that_is_predicted_to_pass_what_is_left_is_not_started() -> None:
    effects = painters()
    decisions, layers = run(effects, Picks([0, 1, 2, 3, 4]), budget=850)
    assert decisions.chosen.tolist() == [True, False, True, False, False]
    assert layers.rays == {"one": 800}
    assert np.all(layers.masks["one_layer"][300:500] == 0)
    assert not effects[1].asked


def test_an_item_may_take_exactly_what_is_left() -> None:
    decisions, _ = run(painters(), Picks([0, 1, 2]), budget=1000)
    assert decisions.chosen.tolist() == [True, True, False, False, False]


@pytest.mark.parametrize(
    ("kind", "left", "chosen"),
    [(Frugal, [700.0], [True, True, True, False, False]), (Dear, [], [True, False, False, False, False])],
)
def test_what_a_wave_really_took_replaces_the_prediction(
    kind: type[Painter], left: list[float], chosen: list[bool]
) -> None:
    heuristic = Watched([0, None, 1, 2])
    decisions, _ = run([kind("one"), Painter("two")], heuristic, budget=1000)
    assert heuristic.remaining[2:3] == left, "with nothing left it is not asked"
    assert decisions.chosen.tolist() == chosen


def test_a_wave_under_a_budget_is_bounded() -> None:
    work = work_items()
    large = work.candidates.predicted_cost * np.float32(100)
    work = replace(work, candidates=replace(work.candidates, predicted_cost=large))
    heuristic = Watched([0, 1, 2, 3, 4])
    run(painters(), heuristic, budget=190_000, work=work)
    # 180,000 rays are more than the 171,000 that a wave holds: 55 of the 100 pixels of the last item are in the first one, which
    # takes 2 rays a pixel after all, and the 9,000 rays of the others are off the budget of the second.
    asked = [190_000, 130_000, 90_000, 70_000, 30_000, 190_000 - 2 * 855 - 9_000]
    assert heuristic.remaining[:6] == asked
    assert heuristic.calls == ["begin", *(f"report {item}" for item in (0, 1, 2, 3, 4, 4)), "end"]
    assert heuristic.outcomes[4].complete


def test_small_items_share_what_they_took_together_by_prediction() -> None:
    class Uneven(Painter):
        def trace(self, frame: Any, pixels: np.ndarray) -> EffectResult:
            return EffectResult(
                super().trace(frame, pixels).values, int((pixels < 300).sum() * 3 + (pixels >= 300).sum())
            )

    decisions, _ = run([Uneven("one"), Painter("two")], Picks([0, 1]), budget=2000)
    assert decisions.rays.tolist() == [660, 440, 0, 0, 0]


def test_an_item_that_was_refused_is_not_asked_for_forever() -> None:
    with pytest.raises(PluginError, match="heuristic Picks returned item 0: not one of 5, or twice"):
        run(painters(), Picks([0] * 20), Faults(strict=True), budget=500)


def test_no_budget_at_all_traces_nothing() -> None:
    decisions, _ = run(painters(), Picks([0, 1, 2, 3, 4]), budget=0)
    assert not decisions.chosen.any()


@pytest.mark.parametrize(("begin_ms", "pixels"), [(0.0, 400), (1.0, 300), (100.0, 120)])
def test_what_an_effect_takes_before_its_first_ray_is_off_the_time_for_rays(begin_ms: float, pixels: int) -> None:
    work = work_items()
    price = work.candidates.pixel_count * np.float32(0.01)
    work = replace(work, candidates=replace(work.candidates, predicted_cost=price))
    plan = _Plan(left=4.0, largest=4.0, begin=np.minimum([begin_ms, begin_ms], MOST_FOR_BEGINNING * 4.0))
    named = Parts(np.array([0, 1]), np.zeros(2, np.int64), np.array([300, 200]))
    now, later = plan.cut(named, Ledger(work))
    assert (now.stop - now.start).sum() == pytest.approx(pixels, abs=1)
    assert (later.stop - later.start).sum() == 500 - (now.stop - now.start).sum()


def test_parts_of_an_item_that_follow_each_other_are_traced_in_the_order_of_the_picture() -> None:
    work = work_items()
    one = Parts(np.array([0, 2, 0]), np.array([0, 0, 75]), np.array([75, 100, 300]))
    whole = unit_parts(work, one, 1e6)
    assert whole.unit.tolist() == [0, 2]
    np.testing.assert_array_equal(whole.pixels(work)[0], [*range(300), *range(500, 600)])
    half = unit_parts(work, Parts(np.array([0]), np.array([40]), np.array([110])), 1e6).pixels(work)[0]
    assert len(half) == 70
    assert np.all(np.diff(half) > 0)
    order = np.argsort(_pass_of(np.arange(300)), kind="stable")
    assert sorted(half.tolist()) == sorted(order[40:110].tolist())


def _pass_of(pixels: np.ndarray) -> np.ndarray:
    right, down = pixels % 30 % 2, pixels // 30 % 2
    return np.where(right == down, down, 2 + down)
