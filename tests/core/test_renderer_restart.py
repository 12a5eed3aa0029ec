"""Restart: the frames that follow are those of a new renderer, bit for bit, whatever was rendered before."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from history_kit import walking
from scene_kit import TRACERS, at, hall, need_tracer

import phrt
from phrt import cost_memory
from phrt.clock import RayClock
from phrt.errors import OptionError, PhrtWarning, PluginError
from phrt.experience import Experience
from phrt.frame import FrameResult
from phrt.history import History
from phrt.interfaces.effect import RayEffect
from phrt.interfaces.heuristic import Heuristic
from phrt.model import Track
from phrt.relevance import ObjectSight
from phrt.scene import Scene

SIZE = (60, 40)
HEURISTICS = ("gain", "selection_graph", "uniform", "round_robin")
BUDGETS = ("600rays", "rays:0.22ms", "0.24ms", "none")
PREPARED = {
    "reflections": {"fallback": "probe", "probe_size": 8},
    "shadows": {"fallback": "shadow_map", "map_size": 16},
}
STAYS: dict[str, Any] = {"effects": PREPARED, "size": SIZE, "gbuffer": "raycast", "threads": 1, "remember_costs": False}


def moving_hall() -> Scene:
    """`hall` in which a mirror ball and a box go to and fro, and come back to where they began after a second."""
    scene = hall()
    for name in ("/thing0", "/thing2"):
        entry = next(o for o in scene.objects if o.path == name)
        start = scene.nodes[entry.node].matrix[:3, 3]
        values = np.array([start, start + np.array([0.4, 0.2, 0.5]), start], np.float32)
        scene.tracks.append(Track(entry.node, "translation", np.array([0.0, 0.5, 1.0]), values))
    return scene


def renderer(scene: Scene | None = None, **options: Any) -> phrt.Renderer:
    return phrt.Renderer(scene or moving_hall(), **STAYS | options)


def step(made: phrt.Renderer, k: int, start: float = 0.3) -> FrameResult:
    """Frame `k` of a walk through the hall that begins at `start` seconds."""
    view = replace(walking(0.04)(k), width=SIZE[0], height=SIZE[1])
    return made.render(start + k / 15, camera=view)


def walk(made: phrt.Renderer, count: int = 4, start: float = 0.3) -> list[FrameResult]:
    """`count` frames of it; how fast things move counts."""
    made.control(view_speed=3.0)
    return [step(made, k, start) for k in range(count)]


def new(scene: Scene | None = None, clock: float = 100.0, **options: Any) -> list[FrameResult]:
    """The same of a new renderer."""
    with renderer(scene, clock=RayClock(clock), **options) as made:
        return walk(made)


def assert_same(one: Any, other: Any, what: str = "frame") -> None:
    """Everything in it is equal bit for bit, times that were really measured and the world itself apart."""
    assert type(one) is type(other), what
    if isinstance(one, np.ndarray):
        np.testing.assert_array_equal(one, other, err_msg=what)
    elif is_dataclass(one):
        for field in fields(one):
            if field.name not in ("stages", "world"):
                assert_same(getattr(one, field.name), getattr(other, field.name), f"{what}.{field.name}")
    elif isinstance(one, dict):
        assert list(one) == list(other), what
        for key, value in one.items():
            assert_same(value, other[key], f"{what}[{key}]")
    elif isinstance(one, list | tuple):
        assert len(one) == len(other), what
        for number, (a, b) in enumerate(zip(one, other, strict=True)):
            assert_same(a, b, f"{what}[{number}]")
    else:
        assert one == other or one is other or one != one, f"{what}: {one} is not {other}"


@pytest.fixture(scope="module")
def used() -> Iterator[phrt.Renderer]:
    """A renderer that every test leaves in some state; it is never made anew."""
    with renderer() as made:
        yield made


@pytest.mark.parametrize("budget", BUDGETS)
@pytest.mark.parametrize("heuristic", HEURISTICS)
def test_frames_after_a_restart_are_those_of_a_new_renderer(used: phrt.Renderer, heuristic: str, budget: str) -> None:
    options: dict[str, Any] = {"heuristic": heuristic, "budget": budget, "persistence": 0.1}
    walk(used, 2, start=0.1)
    used.restart(**options, clock=RayClock())
    found = walk(used)
    expected = new(**options)
    assert_same(found, expected)
    decisions = found[-1].decisions
    assert decisions.chosen.any()
    if budget != "none":
        assert (decisions.passes < 4).any(), "there was something to choose"
        assert decisions.candidates.frames_since_traced.min() == 1, "and something learnt"


@pytest.mark.parametrize("history", [False, True])
@pytest.mark.parametrize("cost_model", ["paper", "measured"])
@pytest.mark.parametrize("group_by", ["object", "object_effect_light", "object_effect"])
def test_items_cost_models_and_history_may_be_others(
    used: phrt.Renderer, group_by: Any, cost_model: Any, history: bool
) -> None:
    options: dict[str, Any] = {"group_by": group_by, "cost_model": cost_model, "history": history, "reserve_ms": 0.05}
    options |= {"heuristic": "gain", "budget": "rays:0.2ms"}
    used.restart(**options, clock=RayClock(80))
    assert_same(walk(used), new(**options, clock=80))


@pytest.mark.parametrize("tracer", TRACERS)
def test_what_was_moved_by_hand_is_back_where_it_was(tracer: str) -> None:
    options = {"heuristic": "gain", "budget": "1500rays", "effects": {}}
    with renderer(tracer=need_tracer(tracer), effects={}) as made:
        made.move("/thing1", at(0.2, 0.4, 0.9))
        made.move("/thing2", at(1.2, 0.4, 0.9))
        walk(made, 2)
        made.restart(heuristic="gain", budget="1500rays", clock=RayClock())
        assert_same(walk(made), new(**options, tracer=tracer))


def test_antialiased_frames_too() -> None:
    options = {"heuristic": "selection_graph", "budget": "3000rays"}
    with renderer(aa=3) as made:
        walk(made, 2)
        made.restart(**options, clock=RayClock())
        assert_same(walk(made), new(**options, aa=3))


# --- what must not be left ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "attribute"), [(History, "history"), (Experience, "experience"), (ObjectSight, "sight")]
)
def test_the_comparison_notices_what_is_not_forgotten(kind: type, attribute: str) -> None:
    """A mutant: restarted, but with one piece of the run before."""
    scene = moving_hall()
    options: dict[str, Any] = {"heuristic": "gain", "budget": "1500rays"}
    with renderer(scene, **options, clock=RayClock()) as made:
        walk(made, start=0.0)
        kept = getattr(made.run, attribute)
        assert isinstance(kept, kind)
        made.restart(**options, clock=RayClock())
        setattr(made.run, attribute, kept)
        mutant = walk(made)
    expected = new(scene, **options)
    with pytest.raises(AssertionError, match="frame"):
        assert_same(mutant, expected)


def test_controls_switches_and_the_count_of_frames_begin_anew() -> None:
    with renderer(heuristic="gain", budget="1500rays", persistence=2.0) as made:
        made.control(view_speed=3.0, parameters={"hurry": 1})
        made.measure_change = made.measure_each = True
        walk(made, 3)
        made.restart()
        assert (made.budget.kind, made.persistence, made.conditions.view_speed) == ("none", 0.0001, 0.0)
        assert made.controls.parameters is None
        assert (made.measure_change, made.measure_each) == (False, False)
        assert made.render().index == 0


def test_the_scenes_own_heuristic_is_the_default_again() -> None:
    scene = moving_hall()
    scene.settings.heuristic = "raster_only"
    with renderer(scene, heuristic="all_trace") as made:
        assert made.render().decisions.chosen.any()
        made.restart()
        assert not made.render().decisions.chosen.any()


# --- faults ---------------------------------------------------------------------------------------------------------


class Fails(Heuristic):
    """Raises in its second frame."""

    def __init__(self) -> None:
        self._frames = 0

    def begin_frame(self, candidates: Any, context: Any) -> None:
        self._frames += 1
        if self._frames == 2:
            raise ValueError("out of ideas")

    def next(self, remaining: float) -> int | None:
        return None


def test_a_heuristic_that_was_switched_off_does_not_switch_off_the_next_one() -> None:
    options = {"heuristic": "selection_graph", "budget": "1500rays"}
    with renderer(heuristic=Fails()) as made:
        with pytest.warns(PhrtWarning, match="out of ideas"):
            walk(made, 3)
        made.restart(**options, clock=RayClock())
        assert_same(walk(made), new(**options))


def test_an_effect_that_was_switched_off_is_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    with renderer() as made:
        shadows = next(effect for effect in made.effects if effect.name == "shadows")
        with monkeypatch.context() as patch:
            patch.setattr(shadows, "trace", None)
            with pytest.warns(PhrtWarning, match="effect 'shadows' failed in trace"):
                walk(made, 2)
        made.restart(heuristic="gain", budget="1500rays", clock=RayClock())
        assert_same(walk(made), new(heuristic="gain", budget="1500rays"))


def counted_preparations(made: phrt.Renderer, patch: pytest.MonkeyPatch) -> list[str]:
    """Filled with an effect's name whenever its fallback is prepared."""
    calls: list[str] = []

    def counting(effect: RayEffect) -> Any:
        original = effect.prepare_fallback

        def prepare(frame: Any) -> None:
            calls.append(effect.name)
            original(frame)

        return prepare

    for effect in made.effects:
        patch.setattr(effect, "prepare_fallback", counting(effect))
    return calls


def test_fallbacks_are_prepared_again_only_where_the_scene_changed(monkeypatch: pytest.MonkeyPatch) -> None:
    with renderer(heuristic="raster_only") as made:
        calls = counted_preparations(made, monkeypatch)
        made.render(0.3)
        once = len(calls)
        assert once == len(made.effects)
        made.restart(heuristic="raster_only")
        made.render(0.3)
        assert len(calls) == once
        made.restart(heuristic="raster_only")
        made.render(0.4)
        assert len(calls) == 2 * once


def test_a_fallback_that_could_not_be_prepared_is_prepared_again(monkeypatch: pytest.MonkeyPatch) -> None:
    still = hall()
    with renderer(still, heuristic="raster_only") as made:
        reflections = next(effect for effect in made.effects if effect.name == "reflections")
        with monkeypatch.context() as patch:
            patch.setattr(reflections, "prepare_fallback", None)
            with pytest.warns(PhrtWarning, match="effect 'reflections' failed in prepare_fallback"):
                walk(made, 2)
        made.restart(heuristic="raster_only", clock=RayClock())
        assert_same(walk(made), new(still, heuristic="raster_only"))


def test_without_lights_an_effect_that_was_left_out_is_prepared_when_it_is_back() -> None:
    scene = hall()
    scene.lights.clear()
    with renderer(scene, heuristic="raster_only", group_by="object_effect_light") as made:
        walk(made, 2)
        made.restart(heuristic="raster_only", clock=RayClock())
        assert_same(walk(made), new(scene, heuristic="raster_only"))


# --- what cannot be -------------------------------------------------------------------------------------------------


REFUSED: tuple[tuple[dict[str, Any], type[Exception], str], ...] = (
    ({"budget": "50mss"}, OptionError, "budget"),
    ({"reserve_ms": -1.0}, OptionError, r"reserve_ms is -1.0; it must be 0 or more"),
    ({"cost_model": "guess"}, OptionError, "cost_model is 'guess', allowed: measured, paper"),
    ({"group_by": "pixel"}, OptionError, "group_by is 'pixel', allowed: object, object_effect, object_effect_light"),
    ({"heuristic": "gian"}, PluginError, "Did you mean 'gain'"),
    ({"heuristic": "gain", "heuristic_options": {"nothing": 1}}, OptionError, "nothing"),
    ({"persistence": -1.0}, OptionError, "persistence is -1.0"),
)


def test_what_is_refused_leaves_the_run_as_it_was() -> None:
    given: dict[str, Any] = {"heuristic": "gain", "budget": "600rays"}
    with renderer(**given, clock=RayClock()) as made:
        made.control(view_speed=3.0)
        for k, frame in enumerate(new(**given)):
            assert_same(step(made, k), frame)
            for options, error, message in REFUSED:
                with pytest.raises(error, match=message):
                    made.restart(**options)


def test_a_frame_budget_is_refused_where_frames_have_several_samples() -> None:
    with renderer(aa=2) as made, pytest.raises(OptionError, match="a budget for the whole frame needs aa 1"):
        made.restart(budget="50ms")


def test_a_closed_renderer_cannot_be_restarted() -> None:
    with renderer() as made:
        pass
    with pytest.raises(RuntimeError, match="the renderer was closed"):
        made.restart()


# --- costs that are remembered --------------------------------------------------------------------------------------


def test_costs_are_read_once_and_written_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PHRT_CACHE", str(tmp_path))
    known = {name: {"ms_per_item": 0.5, "ms_per_ray": 0.25} for name in ("shadows", "reflections", "refractions")}
    read: list[str] = []
    written: list[dict[str, dict[str, float]]] = []

    def recall(key: str) -> dict[str, dict[str, float]]:
        read.append(key)
        return known

    monkeypatch.setattr(cost_memory, "recall", recall)
    monkeypatch.setattr(cost_memory, "remember", lambda key, costs: written.append(dict(costs)))
    with renderer(remember_costs=True, heuristic="all_trace", clock=RayClock()) as made:
        assert read == [], "where a ray has a price, nothing is to be known"
        assert made.costs()["shadows"] != known["shadows"]
        made.restart(heuristic="all_trace")
        assert made.costs()["shadows"] == known["shadows"]
        made.render()
        learnt = made.costs()
        assert learnt["shadows"] != known["shadows"]
        made.restart(heuristic="all_trace")
        assert made.costs()["shadows"] == known["shadows"], "not what the run before learnt"
        made.restart(clock=RayClock())
        assert made.costs()["shadows"] != known["shadows"]
        made.render()
        assert written == []
    assert len(read) == 1
    assert written == [learnt], "of the last run that learnt by real time"
