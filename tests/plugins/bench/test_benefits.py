"""What items are worth: held against a renderer that traces just these items."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scene_kit import GLASS, LAMBERT, MIRROR, Stage, at, ball, box, floor, hall

import phrt
from phrt.clock import RayClock
from phrt.controls import ControlKey, Controls
from phrt.errors import OptionError
from phrt.frame import FrameResult
from phrt.interfaces.heuristic import PASSES, Candidates, FrameContext, Heuristic, Request
from phrt.output.tonemap import to_8bit
from phrt.scene import Scene
from phrt_plugins.bench import benefits
from phrt_plugins.bench.benefits import Judged, judge

SIZE = (64, 36)
EFFECTS = {
    "ambient_occlusion": {"samples": 2, "radius": 2.0},
    "shadows": {"fallback": "none"},
    "reflections": {"fallback": "environment"},
    "refractions": {"fallback": "alpha"},
}


class Just(Heuristic):
    """Traces so many passes of the candidates of given (object, effect name) pairs."""

    def __init__(self) -> None:
        self.wanted: dict[tuple[int, str], int] = {}
        self._left: list[Request] = []

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        names = [candidates.effect_names[number] for number in candidates.effect.tolist()]
        pairs = zip(candidates.object_id.tolist(), names, strict=True)
        self._left = [Request(row, self.wanted[pair]) for row, pair in enumerate(pairs) if pair in self.wanted]

    def next(self, remaining: float) -> Request | None:
        return self._left.pop() if self._left else None


def renderer_of(scene: Scene, **options: object) -> phrt.Renderer:
    given = {"size": SIZE, "gbuffer": "raycast", "threads": 2, "effects": EFFECTS, "remember_costs": False}
    return phrt.Renderer(scene, **(given | {"clock": RayClock(100.0)} | options))  # type: ignore[arg-type]


def mixed() -> Scene:
    """Few things, with effects that lie over one another: a mirror floor in shadow, glass before it."""
    shiny = phrt.model.Material("shiny", base_color=(0.7, 0.6, 0.5, 1.0), metallic=0.4, roughness=0.02)
    made = Stage(dome=(0.4, 0.5, 0.7)).add("/floor", floor(8.0), shiny, at(0, -0.5, 0))
    made.add("/glass", ball(0.5, 3), GLASS, at(0.7, 0, 0.4)).add("/mirror", ball(0.4, 3), MIRROR, at(-0.8, 0, 0))
    made.add("/box", box(0.6, 1.2, 0.6), LAMBERT, at(0, 0.1, -1.0), effects={"shadows": "always"})
    made.light("point", at(1, 3, 2), intensity=40.0).light("point", at(-2, 3, 1), intensity=20.0)
    return made.camera((0, 1.2, 4), (0, 0, -0.3), fov_y=0.7).scene


@pytest.fixture(scope="module")
def judged() -> Iterator[Judged]:
    with renderer_of(mixed()) as renderer:
        yield judge(renderer, 0.5, 7)


@pytest.fixture(scope="module")
def rendered() -> Iterator[RenderJust]:
    with renderer_of(mixed(), heuristic=(just := Just()), history=False) as renderer:
        yield RenderJust(renderer, just)


class RenderJust:
    """The same frame by a renderer that knows nothing of benefits."""

    def __init__(self, renderer: phrt.Renderer, just: Just) -> None:
        self._renderer, self._just = renderer, just

    def __call__(self, judged: Judged, chosen: np.ndarray) -> FrameResult:
        truth = judged.truth
        names = [truth.effect_names[number] for number in truth.effect.tolist()]
        passes = (chosen * PASSES if chosen.dtype == bool else chosen).tolist()
        pairs = zip(truth.object_id.tolist(), names, strict=True)
        self._just.wanted = {pair: count for pair, count in zip(pairs, passes, strict=True) if count}
        return self._renderer.render(0.5, frame_index=7)


def total_error(image: np.ndarray, reference: np.ndarray) -> float:
    """Sum over pixels of the mean absolute difference as a display shows it, 0 to 1."""
    off = np.abs(to_8bit(image).astype(float) - to_8bit(reference).astype(float))
    return float(off.mean(axis=-1).sum() / 255)


def only(judged: Judged, item: int) -> np.ndarray:
    return np.arange(len(judged.truth)) == item


def test_an_items_benefit_is_what_the_picture_gains_when_just_it_is_traced(
    judged: Judged, rendered: RenderJust
) -> None:
    truth = judged.truth
    nothing = np.zeros(len(truth), bool)
    floor_error = total_error(rendered(judged, nothing).image, judged.reference.image)
    assert truth.error_floor == pytest.approx(floor_error, rel=1e-12)
    assert len(truth) >= 8
    for item in range(len(truth)):
        frame = rendered(judged, only(judged, item))
        gained = floor_error - total_error(frame.image, judged.reference.image)
        assert truth.benefit[item] == pytest.approx(gained, abs=1e-9)
        assert truth.rays[item] == frame.rays.get(truth.effect_names[truth.effect[item]], 0)
        assert truth.ms[item] == pytest.approx(truth.rays[item] * 1e-4)
        assert truth.pixels[item] == frame.decisions.traced_pixels.sum()
    assert (truth.benefit > 1).sum() >= 5


def test_a_picture_of_any_choice_is_the_renderers_own(judged: Judged, rendered: RenderJust) -> None:
    random = np.random.default_rng(1)
    for _ in range(6):
        chosen = random.random(len(judged.truth)) < 0.5
        frame = rendered(judged, chosen)
        assert np.array_equal(judged.picture(chosen), frame.image)
        error = total_error(frame.image, judged.reference.image) / (SIZE[0] * SIZE[1])
        assert judged.error(frame.image) == pytest.approx(error, rel=1e-12)
        assert judged.truth.error_of(chosen) == pytest.approx(error, abs=1e-12)


def test_an_item_may_be_traced_in_part(judged: Judged, rendered: RenderJust) -> None:
    truth, random = judged.truth, np.random.default_rng(2)
    choices = [only(judged, item) * 1 for item in range(len(truth))]
    choices += [random.choice([0, 1, 4], len(truth)) for _ in range(6)]
    for passes in choices:
        frame = rendered(judged, passes)
        assert np.array_equal(judged.picture(passes), frame.image)
        error = total_error(frame.image, judged.reference.image) / (SIZE[0] * SIZE[1])
        assert truth.error_of(passes) == pytest.approx(error, abs=1e-12)
        sets = truth.parts.rows(truth.sets_of(passes))
        assert np.array_equal(truth.choice_of(sets), passes)
        assert sets.rays.sum() == sum(count for name, count in frame.rays.items() if name != "primary")
        assert sets.ms.sum() == pytest.approx(sets.rays.sum() * 1e-4)


def test_everything_is_the_reference_and_nothing_is_the_floor(judged: Judged) -> None:
    truth = judged.truth
    with renderer_of(mixed(), heuristic="all_trace", history=False) as renderer:
        reference = renderer.render(0.5, frame_index=7)
    with renderer_of(mixed(), heuristic="raster_only", history=False) as renderer:
        base = renderer.render(0.5, frame_index=7)
    assert np.array_equal(judged.picture(np.ones(len(truth), bool)), reference.image)
    assert np.array_equal(judged.picture(np.zeros(len(truth), bool)), base.image)
    assert truth.error_of(np.ones(len(truth), bool)) == 0
    assert truth.rays.sum() == sum(count for name, count in reference.rays.items() if name != "primary")
    assert truth.picture_pixels == SIZE[0] * SIZE[1]


def test_benefits_of_one_effect_add_up(judged: Judged, rendered: RenderJust) -> None:
    truth = judged.truth
    for effect in np.unique(truth.effect):
        frame = rendered(judged, truth.effect == effect)
        error = total_error(frame.image, judged.reference.image)
        assert truth.benefit[truth.effect == effect].sum() == pytest.approx(truth.error_floor - error, abs=1e-9)


def test_benefits_of_different_effects_do_not_add_up_but_those_of_sets_do(judged: Judged) -> None:
    truth = judged.truth
    everything = np.ones(len(truth), bool)
    assert abs(truth.benefit.sum() - truth.error_floor) > 0.01 * truth.error_floor
    assert truth.parts.benefit[truth.sets_of(everything)].sum() == pytest.approx(truth.error_floor, rel=1e-12)


def test_every_set_of_an_objects_effects_is_there_once(judged: Judged) -> None:
    truth, sets = judged.truth, judged.truth.sets
    wanted = []
    for object_id in np.unique(truth.object_id):
        own = truth.effect[truth.object_id == object_id]
        for number in range(1, 2 ** len(own)):
            mine = [int(e) for bit, e in enumerate(own) if number >> bit & 1]
            wanted.append((int(object_id), tuple(4 * (e in mine) for e in range(len(truth.effect_names)))))
    assert sorted(zip(sets.object_id.tolist(), map(tuple, sets.passes.tolist()), strict=True)) == sorted(wanted)
    for row in range(len(sets)):
        items = truth.choice_of(sets.rows(np.array([row]))) > 0
        assert sets.rays[row] == truth.rays[items].sum()
        assert sets.ms[row] == pytest.approx(truth.ms[items].sum())
        (found,) = truth.sets_of(items)
        assert truth.parts.benefit[found] == sets.benefit[row]


def test_relevance_is_the_frames_own(judged: Judged) -> None:
    candidates = judged.floor.decisions.candidates
    assert not judged.reference.decisions.candidates.was_selected.any()
    assert np.array_equal(judged.truth.relevance, candidates.visibility * candidates.importance_factor)


def test_how_the_renderer_was_set_up_does_not_matter(judged: Judged) -> None:
    scene = mixed()
    scene.settings.track = [ControlKey(0.0, Controls(budget="50rays"))]
    with renderer_of(scene, heuristic="gain", group_by="object", persistence=0.5) as renderer:
        renderer.render(0.4)
        other = judge(renderer, 0.5, 7).truth
        assert not renderer.measure_each
    truth = judged.truth
    assert np.array_equal(other.object_id, truth.object_id)
    assert other.effect_names == truth.effect_names
    assert np.array_equal(other.benefit, truth.benefit)
    assert np.array_equal(other.rays, truth.rays)


def test_items_pay_what_they_cost_together(judged: Judged) -> None:
    """Tracing an item alone takes longer than as one of many."""

    def ms(together: float) -> np.ndarray:
        return Judged(judged.frames, together, judged._workers).truth.ms

    alone = judged.reference.decisions.milliseconds
    assert ms(float(alone.sum()) / 2) == pytest.approx(alone / 2)
    assert ms(float(alone.sum()) * 2) == pytest.approx(alone)


def test_real_clocks_are_read_for_both() -> None:
    with renderer_of(hall(), clock=None) as renderer:
        made = judge(renderer, 0.0, 0)
        ms = made.truth.ms
    assert (ms > 0).all()
    assert ms.sum() <= made._together_ms * (1 + 1e-9)


def test_the_tone_map_is_what_errors_are_seen_through(judged: Judged) -> None:
    with renderer_of(mixed()) as renderer:
        clipped = judge(renderer, 0.5, 7, tone_map="srgb").truth
    off = np.abs(to_8bit(judged.floor.image, "srgb").astype(float) - to_8bit(judged.reference.image, "srgb"))
    assert clipped.error_floor == pytest.approx(off.sum() / 765, rel=1e-9)
    assert clipped.error_floor != judged.truth.error_floor


def test_one_sample_per_pixel_only() -> None:
    with renderer_of(mixed(), aa=2) as renderer, pytest.raises(OptionError, match="aa is 2; what items are worth"):
        judge(renderer, 0.0, 0)


def test_what_cannot_be_told_apart_is_refused() -> None:
    with pytest.raises(OptionError, match="effects 'a' and 'b' both write the layer 'visibility'"):
        benefits._check_layers(("a", "b"), ["visibility", "visibility"])
    with pytest.raises(OptionError, match="7 effects; what items are worth can be told for up to 6 effects"):
        benefits._check_layers(tuple("abcdefg"), list("abcdefg"))


def test_a_frame_without_items_has_nothing_to_choose_from() -> None:
    scene = Stage(dome=(1.0, 1.0, 1.0)).camera((0, 0, 4), (0, 0, 0)).scene
    with renderer_of(scene) as renderer:
        truth = judge(renderer, 0.0, 0).truth
    assert len(truth) == len(truth.sets) == 0
    assert truth.error_floor == 0
    assert truth.error_of(np.zeros(0, bool)) == 0
