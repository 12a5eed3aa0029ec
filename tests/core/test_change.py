"""Measured change: what the sample says is what pictures with and without an effect differ by."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scene_kit import GLASS, LAMBERT, MIRROR, Stage, at, ball, floor

import phrt
from phrt.change import measure_change
from phrt.clock import RayClock
from phrt.exploration import MeasuredChange
from phrt.frame import FrameResult
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.kernels.change import display_change
from phrt.sample import learn_change

SIZE = (48, 32)  # so few pixels that all are sampled
EFFECTS = ("shadows", "reflections", "refractions")
PLAIN = {
    "shadows": {"fallback": "none"},
    "reflections": {"fallback": "environment"},
    "refractions": {"fallback": "alpha"},
}
"""Fallbacks that leave much to be changed."""


class Only(Heuristic):
    """Traces whole the items of some effects and objects (all without `objects`), and looks at what that changes."""

    wants_change = True

    def __init__(self, *effects: str, objects: tuple[int, ...] = ()) -> None:
        self._effects, self._objects = effects, objects
        self._left: list[int] = []
        self.seen: list[Candidates] = []

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self.seen.append(candidates)
        wanted = np.isin(np.array(candidates.effect_names)[candidates.effect], self._effects)
        if self._objects:
            wanted &= np.isin(candidates.object_id, self._objects)
        self._left = np.flatnonzero(wanted).tolist()

    def next(self, remaining: float) -> int | None:
        return self._left.pop(0) if self._left else None


def room() -> Stage:
    """A floor, a mirror ball and a glass ball under a light."""
    return (
        Stage(dome=(0.3, 0.4, 0.5))
        .add("/floor", floor(8.0), LAMBERT)
        .add("/mirror", ball(0.6), MIRROR, at(-0.8, 0.6, 0.0))
        .add("/glass", ball(0.6), GLASS, at(0.8, 0.6, 0.0))
        .light("point", at(1.0, 4.0, 1.0), intensity=30.0)
        .camera((0.0, 1.6, 4.0), (0.0, 0.4, 0.0))
    )


def options(**more: Any) -> dict[str, Any]:
    settings: dict[str, Any] = {
        "size": SIZE, "gbuffer": "raycast", "threads": 2, "strict": True, "history": False, "budget": "100000000rays",
        "effects": PLAIN,
    }  # fmt: skip
    return settings | more


def frames(heuristic: Heuristic, count: int, **more: Any) -> list[FrameResult]:
    with phrt.Renderer(room().scene, heuristic=heuristic, **options(**more)) as renderer:
        return [renderer.render() for _ in range(count)]


def column(heuristic: Only, name: str, effect: str, object_id: int) -> float:
    """What the latest candidates say."""
    work = heuristic.seen[-1]
    (row,) = np.flatnonzero((work.object_id == object_id) & (work.effect == work.effect_names.index(effect)))
    return float(getattr(work, name)[row])


def difference(one: FrameResult, other: FrameResult, object_id: int) -> np.ndarray:
    """(k,) what a display shows differently at the pixels of an object."""
    row = np.flatnonzero(one.gbuffer.object_id.reshape(-1) == object_id).astype(np.int32)
    change = np.empty(len(row), np.float32)
    display_change(row, one.image.reshape(-1, 3), other.image.reshape(-1, 3)[row], change)
    return change.astype(np.float64)


@pytest.mark.parametrize(("effect", "object_id"), [("shadows", 1), ("reflections", 2), ("refractions", 3)])
def test_measured_change_is_what_the_picture_lacks_without_the_effect(effect: str, object_id: int) -> None:
    heuristic = Only(*EFFECTS)
    everything = frames(heuristic, 4)[-1]
    without = frames(Only(*[name for name in EFFECTS if name != effect]), 1)[0]
    expected = difference(everything, without, object_id)
    assert expected.mean() > 0.01
    assert column(heuristic, "measured_change", effect, object_id) == pytest.approx(expected.mean(), rel=1e-3)
    strength = (expected**2).mean() / expected.mean()
    assert column(heuristic, "measured_strength", effect, object_id) == pytest.approx(strength, rel=1e-3)


def test_change_is_against_the_fallback_in_use() -> None:
    plain, mapped = Only(*EFFECTS), Only(*EFFECTS)
    frames(plain, 4)
    frames(mapped, 4, effects={"shadows": {"fallback": "shadow_map"}})
    without = column(plain, "measured_change", "shadows", 1)
    assert column(mapped, "measured_change", "shadows", 1) < 0.5 * without


def test_what_was_not_traced_is_not_measured() -> None:
    heuristic = Only("shadows", "reflections", objects=(1,))
    frames(heuristic, 4)
    assert column(heuristic, "measured_change", "shadows", 1) > 0
    assert np.isnan(column(heuristic, "measured_change", "refractions", 3))
    assert np.isnan(column(heuristic, "measured_change", "reflections", 2))


def test_a_mirror_has_more_detail_than_a_floor() -> None:
    heuristic = Only(*EFFECTS)
    frames(heuristic, 4)
    assert 0 < column(heuristic, "measured_detail", "shadows", 1) < column(heuristic, "measured_change", "shadows", 1)
    assert column(heuristic, "measured_detail", "reflections", 2) > column(heuristic, "measured_detail", "shadows", 1)


class Unconcerned(Only):
    """The same, and does not look."""

    wants_change = False


@pytest.mark.parametrize("heuristic", [Unconcerned(*EFFECTS), Only(*EFFECTS)])
def test_nothing_is_measured_for_nobody(heuristic: Only) -> None:
    """Neither for a heuristic that does not look, nor without a budget."""
    frames(heuristic, 4, **({"budget": None} if heuristic.wants_change else {}))
    assert np.isnan(heuristic.seen[-1].measured_change).all()


def test_it_is_measured_when_somebody_asks() -> None:
    heuristic = Unconcerned(*EFFECTS)
    with phrt.Renderer(room().scene, heuristic=heuristic, **options(budget=None)) as renderer:
        renderer.measure_change = True
        for _ in range(4):
            renderer.render()
    assert np.isfinite(heuristic.seen[-1].measured_change).all()


@pytest.mark.parametrize("group_by", ["object", "object_effect_light"])
def test_items_of_other_sizes_are_measured_too(group_by: Any) -> None:
    names = ("all", "shadows@/light0", "reflections", "refractions")
    heuristic, plain = Only(*names), Only(*EFFECTS)
    frames(heuristic, 5, group_by=group_by)
    frames(plain, 4)
    known = heuristic.seen[-1]
    floor_row = int(np.flatnonzero(known.object_id == 1)[0])
    # The only effect on the floor is the shadow of the only light.
    assert known.measured_change[floor_row] == pytest.approx(column(plain, "measured_change", "shadows", 1), rel=1e-4)


def test_drift_is_the_change_against_the_value_of_an_earlier_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    """A light that jumps: what a shadow lacks is measured against where it was. The renderer would not keep such a value."""
    found: list[MeasuredChange] = []
    scene = room().scene
    with phrt.Renderer(scene, heuristic=Only(*EFFECTS), **options()) as renderer:
        faults = renderer.run.faults

        def spy(_: Any, frame: Any, work: Any, sample: Any, decisions: Any, layers: Any, image: Any) -> None:
            effect = renderer.effects[sample.effect]
            if effect.name != "shadows":
                return
            earlier = np.ones_like(sample.earlier)  # lit everywhere, as without shadows
            sample = type(sample)(
                sample.effect, sample.rows, sample.unit, earlier, np.full(len(sample.rows), 3, np.float32)
            )
            traced = decisions.chosen[work.units.item]
            found.append(measure_change(frame, effect, sample, traced, layers, image, 1.0, faults))
            fresh = type(sample)(sample.effect, sample.rows, sample.unit, earlier, np.zeros_like(sample.age))
            found.append(measure_change(frame, effect, fresh, traced, layers, image, 1.0, faults))

        monkeypatch.setattr("phrt.sample.learn_change", spy)
        for _ in range(3):
            renderer.render()
    aged, fresh = found
    assert aged.drift == pytest.approx(fresh.change), "the fallback is lit everywhere, too"
    assert aged.drift.sum() > 1
    assert aged.aged_frames == pytest.approx(3 * fresh.pixels)
    assert aged.pixels.sum() == aged.change.sum() == fresh.drift.sum() == 0


def test_effects_take_turns_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    turns: list[str] = []
    with phrt.Renderer(room().scene, heuristic=Only(*EFFECTS), **options()) as renderer:

        def spy(made: Any, frame: Any, work: Any, sample: Any, *rest: Any) -> None:
            turns.append(made.effects[sample.effect].name)
            learn_change(made, frame, work, sample, *rest)

        monkeypatch.setattr("phrt.sample.learn_change", spy)
        for _ in range(4):
            renderer.render()
    assert turns == ["reflections", "refractions", "shadows", "reflections"]


def test_an_empty_picture_has_no_sample() -> None:
    empty = Stage().camera((0, 0, 0), (0, 0, -1))
    with phrt.Renderer(empty.scene, heuristic="gain", **options()) as renderer:
        frame = renderer.render()
        assert len(frame.decisions.candidates) == 0


def test_gain_decides_the_same_whatever_the_number_of_threads() -> None:
    def decided(threads: int) -> list[tuple[list[int], bytes]]:
        clock = RayClock()
        with phrt.Renderer(
            room().scene, heuristic="gain", **options(threads=threads, budget="2000rays", clock=clock, size=(96, 64))
        ) as renderer:
            shots = [renderer.render() for _ in range(8)]
        return [(shot.decisions.passes.tolist(), shot.image.tobytes()) for shot in shots]

    assert decided(1) == decided(3)


def test_gain_comes_nearer_to_all_trace_than_the_papers_rule() -> None:
    with phrt.Renderer(room().scene, **options(size=(160, 96), budget=None)) as renderer:
        whole = renderer.render()
    budget = f"{sum(whole.rays[name] for name in EFFECTS) // 2}rays"

    def error(heuristic: str) -> float:
        with phrt.Renderer(room().scene, heuristic=heuristic, **options(size=(160, 96), budget=budget)) as renderer:
            shot = [renderer.render() for _ in range(6)][-1]
        return float(np.mean([difference(whole, shot, object_id).mean() for object_id in (1, 2, 3)]))

    assert error("gain") < 0.5 * error("selection_graph")
    assert error("gain") <= error("uniform")
