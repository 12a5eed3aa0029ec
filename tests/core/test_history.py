"""Earlier values in the frame loop: where they stand in, for how long, who is told, and how they are switched off."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from history_kit import SIZE, TraceIn, kept_share, run, walking, yard
from scene_kit import GLASS, LAMBERT, MIRROR, Stage, at, ball, floor

import phrt
from phrt.errors import PhrtWarning
from phrt.frame import MASK_FALLBACK, MASK_FILLED, MASK_HISTORY, MASK_TRACED, FrameResult
from phrt.history import History, eye_row, way_ends
from phrt.interfaces.effect import HistoryRule
from phrt.interfaces.heuristic import Request
from phrt.lights import light_table
from phrt.model import Light
from phrt.scene import Scene, SceneLight

LAYERS = ("visibility", "ambient_occlusion", "reflection")
LAYER_OF = {"shadows": "visibility", "ambient_occlusion": "ambient_occlusion", "reflections": "reflection"}


def frames(count: int, heuristic: Any, scene: Scene | None = None, **options: Any) -> list[FrameResult]:
    options = {"size": SIZE, "gbuffer": "raycast", "threads": 2, "strict": True} | options
    with phrt.Renderer(scene or yard(), heuristic=heuristic, **options) as renderer:
        return [renderer.render() for _ in range(count)]


def test_heuristics_are_told_how_much_stands_in_and_how_old_it_is() -> None:
    teller = TraceIn([0, 3])
    pairs = run(yard(), 6, heuristic=teller, view=walking())
    for k, (frame, _) in enumerate(pairs):
        work = teller.candidates[k]
        age = 0 if k == 0 else (k if k <= 3 else k - 3)
        held = work.history_share > 0
        assert held.any() == (k > 0)
        np.testing.assert_array_equal(work.history_age[~held], 0)
        if k:
            np.testing.assert_allclose(work.history_age[held], age, rtol=1e-6)
            assert np.average(work.history_share, weights=work.pixel_count) > 0.8
        if k in (1, 2, 4, 5):
            # Nothing is traced over: the masks of the finished frame are what was told.
            for effect, name in enumerate(work.effect_names):
                mine = np.flatnonzero(work.effect == effect)
                told = (work.history_share * work.pixel_count)[mine].sum()
                if name in LAYER_OF:
                    assert told == pytest.approx((frame.masks[LAYER_OF[name]] == MASK_HISTORY).sum(), rel=1e-5)


def test_what_is_traced_replaces_what_stood_in() -> None:
    pairs = run(yard(), 3, traced=(0, 2), view=walking())
    for frame, truth in (pairs[0], pairs[2]):
        for name in LAYERS:
            assert not (frame.masks[name] == MASK_HISTORY).any()
            np.testing.assert_array_equal(frame.layers[name], truth.layers[name])
        np.testing.assert_array_equal(frame.image, truth.image)


def test_small_gaps_between_earlier_values_are_filled_and_the_rest_falls_back() -> None:
    frame = run(yard(), 12, view=walking(0.06), effects={"shadows": {"fallback": "shadow_map"}})[-1][0]
    mask = frame.masks["visibility"]
    for code in (MASK_HISTORY, MASK_FILLED, MASK_FALLBACK):
        assert (mask == code).any()
    assert (mask == MASK_HISTORY).sum() > 2 * (mask == MASK_FILLED).sum()


class QuarterOnce(TraceIn):
    """One of four interleaved passes of everything in some frames."""

    def next(self, remaining: float) -> Any:
        item = super().next(remaining)
        return None if item is None else Request(item, passes=1)


def test_nothing_that_was_filled_or_fell_back_is_taken_for_traced() -> None:
    """A quarter is traced, the gaps are filled: only the quarter is kept."""
    first, second = frames(2, QuarterOnce([0]))
    for name in ("visibility", "reflection"):
        traced = first.masks[name] == MASK_TRACED
        assert (first.masks[name] == MASK_FILLED).any()
        np.testing.assert_array_equal(second.masks[name] == MASK_HISTORY, traced)
    plain = frames(3, "raster_only", effects={"shadows": {"fallback": "shadow_map"}})
    assert not any((frame.masks["visibility"] == MASK_HISTORY).any() for frame in plain)


@pytest.mark.parametrize("options", [{"history": False}, {"aa": 2}])
def test_it_can_be_switched_off_and_is_off_with_several_samples(options: dict[str, Any]) -> None:
    for frame in frames(3, TraceIn([0]), **options):
        assert not any((mask == MASK_HISTORY).any() for mask in frame.masks.values())


def test_every_effect_can_be_switched_off_alone() -> None:
    off: dict[str, Any] = {"history": False}
    names = {"shadows": "visibility", "reflections": "reflection", "ambient_occlusion": "ambient_occlusion"}
    for switched, layer in names.items():
        effects = {"ambient_occlusion": {"samples": 1}} | {switched: off}
        last = frames(2, TraceIn([0]), effects=effects)[-1]
        for name in LAYERS:
            assert (last.masks[name] == MASK_HISTORY).any() == (name != layer)


def test_nothing_is_looked_for_when_everything_is_traced_anyway(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[int] = []
    reproject = History.reproject

    def counted(*given: Any) -> Any:
        calls.append(1)
        return reproject(*given)

    monkeypatch.setattr(History, "reproject", counted)
    frames(3, "all_trace")
    assert not calls
    frames(3, "all_trace", budget="3000rays")
    assert len(calls) == 3


def test_threads_do_not_change_a_bit() -> None:
    one, four = (run(yard(), 5, traced=(0,), view=walking(), threads=count) for count in (1, 4))
    for (a, _), (b, _) in zip(one, four, strict=True):
        np.testing.assert_array_equal(a.image, b.image)
        for name in LAYERS:
            np.testing.assert_array_equal(a.masks[name], b.masks[name])


def test_an_object_that_casts_no_shadow_costs_only_its_own_values() -> None:
    def slide(renderer: phrt.Renderer, k: int) -> None:
        renderer.move("/mover", at(-0.8 + 0.2 * k, 0.9, 0.0))

    pairs = run(yard(casts_shadow=False), 4, move=slide)
    for frame, _ in pairs[1:]:
        held = frame.masks["visibility"] == MASK_HISTORY
        ids = frame.gbuffer.object_id
        assert not held[ids == 3].any()
        # All but what it uncovered.
        assert held[(ids > 0) & (ids != 3)].mean() > 0.9
        # A mirror shows it all the same.
        assert not (frame.masks["reflection"] == MASK_HISTORY).any()


def test_a_reflection_is_kept_only_while_the_eye_goes_round_a_little() -> None:
    """The ball is 3.7 m away: a step of 0.4 m turns the eye by 0.11 rad."""
    effects = {"reflections": {"fallback": "probe"}}
    for step, kept in ((0.02, True), (0.4, False)):
        frame = run(yard(), 2, view=walking(step), effects=effects)[1][0]
        assert (frame.masks["reflection"] == MASK_HISTORY).any() == kept
        assert kept_share(frame, "visibility") > 0.5


def test_refractions_are_kept_too() -> None:
    made = Stage(dome=(0.3, 0.4, 0.5)).add("/floor", floor(), LAMBERT).add("/glass", ball(0.5, 4), GLASS, at(0, 0.6, 0))
    made.light("point", at(1, 3, 2), intensity=30.0)
    first, second = frames(2, TraceIn([0]), made.camera((0, 1, 3), (0, 0.5, 0)).scene)
    held = second.masks["refraction"] == MASK_HISTORY
    np.testing.assert_array_equal(held, first.masks["refraction"] == MASK_TRACED)
    np.testing.assert_array_equal(second.layers["refraction"], first.layers["refraction"])
    assert held.any()


def test_values_are_kept_light_by_light_where_items_are() -> None:
    first, second = frames(2, TraceIn([0]), group_by="object_effect_light")
    np.testing.assert_array_equal(second.layers["visibility"], first.layers["visibility"])
    names = [name for name in second.masks if name.startswith("visibility@")]
    assert len(names) == 3
    for name in names:
        np.testing.assert_array_equal(second.masks[name] == MASK_HISTORY, first.masks[name] == MASK_TRACED)


def test_views_of_other_sizes_and_orthographic_ones_are_understood() -> None:
    with phrt.Renderer(yard(), size=SIZE, gbuffer="raycast", strict=True, heuristic=TraceIn([0])) as renderer:
        from dataclasses import replace

        view = walking()(0)
        wide = replace(view, width=180, height=120)
        flat = replace(view, orthographic=True, tan_half=(3.0, 2.0))
        renderer.render(camera=view)
        larger = renderer.render(camera=wide)
        assert 0.1 < kept_share(larger, "visibility") <= 1.0
        renderer.render(camera=flat)
    with phrt.Renderer(yard(), size=SIZE, gbuffer="raycast", strict=True, heuristic=TraceIn([0])) as renderer:
        first, second = renderer.render(camera=flat), renderer.render(camera=flat)
        np.testing.assert_array_equal(first.image, second.image)
        assert kept_share(second, "visibility") > 0.9


def test_an_effect_that_fails_shows_its_fallback_and_nothing_of_before(monkeypatch: pytest.MonkeyPatch) -> None:
    from phrt_plugins.effects.shadows import Shadows

    heuristic, effects = TraceIn([0, 2]), {"shadows": {"fallback": "none"}}
    with phrt.Renderer(yard(), size=SIZE, gbuffer="raycast", heuristic=heuristic, effects=effects) as renderer:
        renderer.render()
        renderer.render()

        def broken(*given: Any) -> Any:
            raise ValueError("no more")

        monkeypatch.setattr(Shadows, "trace", broken)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            after = [renderer.render() for _ in range(3)]
    assert [w.category for w in told] == [PhrtWarning]
    for frame in after:
        assert not (frame.masks["visibility"] == MASK_HISTORY).any()
        assert (frame.layers["visibility"] == 1.0).all()
        assert frame.masks["reflection"].any()


def test_ages_stop_counting_and_values_with_a_limit_are_dropped() -> None:
    made = Stage(dome=(0.3, 0.4, 0.5)).add("/floor", floor(), LAMBERT).add("/ball", ball(0.5, 3), MIRROR, at(0, 0.5, 0))
    made.light("point", at(1, 3, 2), intensity=30.0)
    teller = TraceIn([0])
    last = frames(262, teller, made.camera((0, 1, 3), (0, 0.5, 0)).scene, size=(16, 12))[-1]
    assert (last.masks["visibility"] == MASK_HISTORY).any()
    assert not (last.masks["reflection"] == MASK_HISTORY).any()
    names = teller.candidates[-1].effect_names
    shadows = teller.candidates[-1].effect == names.index("shadows")
    assert (teller.candidates[-1].history_age[shadows] == 255).all()
    assert (teller.candidates[200].history_age == 200).all()


def test_where_the_ways_of_a_value_end() -> None:
    lights = [
        Light("point", intensity=1.0),
        Light("sphere", intensity=1.0, radius=0.4),
        Light("directional", intensity=1.0, angle=0.2),
        Light("rect", intensity=1.0, size=(2.0, 1.0)),
        Light("point", intensity=1.0, casts_shadow=False),
    ]
    entries = [SceneLight(f"/{k}", k, light) for k, light in enumerate(lights)]
    table = light_table(entries, np.stack([at(k, 2, 0) for k in range(5)]))
    shadows = way_ends(HistoryRule("to_lights", lights=True), table)
    np.testing.assert_allclose(shadows[0], [0, 2, 0, 1, 0])
    np.testing.assert_allclose(shadows[1], [1, 2, 0, 1, 0.4])
    np.testing.assert_allclose(shadows[2], [0, 0, 1, 0, np.tan(0.1)], atol=1e-6)
    np.testing.assert_allclose(shadows[3], [3, 2, 0, 1, np.hypot(1.0, 0.5)], rtol=1e-6)
    assert len(shadows) == 4
    np.testing.assert_allclose(way_ends(HistoryRule("near", lights=False, radius=0.7), table), [[0, 0, 0, -1, 0.7]])
    assert len(way_ends(HistoryRule("any", lights=True), table)) == 0


def test_the_eye_of_a_view() -> None:
    from dataclasses import replace

    view = walking()(0)
    np.testing.assert_allclose(eye_row(view), [0.0, 1.6, 4.5, 1.0])
    row = eye_row(replace(view, orthographic=True))
    np.testing.assert_allclose(row[:3], view.world_from_view[:3, 2], rtol=1e-6)
    assert row[3] == 0
