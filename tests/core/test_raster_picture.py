"""The raster picture: what heuristics are given of it is what was rasterized, and it costs nothing where nobody asks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from candidate_kit import context
from recording_kit import renderer_of, three_things
from scene_kit import GLASS, LAMBERT, Stage, at, ball, floor, hall, render

from phrt import raster_picture
from phrt.errors import OptionError, PhrtWarning, PluginError
from phrt.frame import FrameResult
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.kernels.picture import sum_by_object
from phrt.raster_picture import places, sampled_pixels, small_height
from phrt.scene import Scene

SIZE = (64, 36)


class Looks(Heuristic):
    """Looks at the picture in every frame, and traces every `step`-th item."""

    def __init__(self, width: int = 32, step: int = 2) -> None:
        self._width, self._step = width, step
        self.pictures: list[np.ndarray] = []
        self.means: list[np.ndarray] = []

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self.pictures.append(context.picture(self._width))
        self.means.append(context.object_means(self.pictures[-1][..., 1]))
        self._left = list(range(0, len(candidates), self._step))

    def next(self, remaining: float) -> int | None:
        return self._left.pop(0) if self._left else None


def looked_at(scene: Scene, width: int = 32, **options: Any) -> tuple[Looks, FrameResult]:
    looks = Looks(width)
    frame = render(scene, SIZE, heuristic=looks, **options)
    return looks, frame


def flat_stage() -> Stage:
    """Without mirrors and glass: a raster picture of it is right."""
    made = Stage(dome=(0.3, 0.4, 0.6)).add("/floor", floor(), LAMBERT, at(0, -0.5, 0))
    made.add("/ball", ball(0.5, 3), LAMBERT).light("point", at(1, 3, 2), intensity=40.0)
    return made.camera((0, 1.0, 4), (0, 0, 0), fov_y=0.7)


# The picture


def test_at_full_size_it_is_the_raster_picture() -> None:
    options: dict[str, Any] = {"effects": {"ambient_occlusion": {"enabled": False}, "shadows": {"fallback": "none"}}}
    looks, _ = looked_at(flat_stage().scene, SIZE[0], **options)
    plain = render(flat_stage().scene, SIZE, heuristic="raster_only", **options)
    np.testing.assert_allclose(looks.pictures[0], plain.image, rtol=1e-5, atol=1e-6)


def test_a_small_one_is_the_mean_of_two_pixels_in_every_part() -> None:
    large, _ = looked_at(hall(), SIZE[0])
    small, _ = looked_at(hall(), SIZE[0] // 2)
    # Of every 2x2 pixels those on the diagonal; of every 4x4 the same of its inner ones.
    full = large.pictures[0]
    np.testing.assert_allclose(small.pictures[0], (full[::2, ::2] + full[1::2, 1::2]) / 2, rtol=1e-5, atol=1e-6)
    quarter, _ = looked_at(hall(), SIZE[0] // 4)
    assert quarter.pictures[0].shape == (9, 16, 3)
    np.testing.assert_allclose(quarter.pictures[0], (full[1::4, 1::4] + full[3::4, 3::4]) / 2, rtol=1e-5, atol=1e-6)


def test_it_is_never_larger_than_the_frame_and_keeps_its_shape() -> None:
    looks, _ = looked_at(flat_stage().scene, 1000)
    assert looks.pictures[0].shape == (36, 64, 3)
    assert looks.pictures[0].dtype == np.float32
    assert small_height(640, 360, 160) == 90
    assert small_height(1000, 10, 20) == 1


def test_it_carries_the_exposure() -> None:
    brighter = flat_stage().scene
    brighter.settings.exposure *= 4
    plain, bright = looked_at(flat_stage().scene)[0], looked_at(brighter)[0]
    np.testing.assert_allclose(bright.pictures[0], 4 * plain.pictures[0], rtol=1e-5)


def test_glass_shows_the_dome_behind_it_and_not_blackness() -> None:
    made = Stage(dome=(0.2, 0.4, 0.8)).add("/glass", ball(1.0, 4), GLASS).camera((0, 0, 4), (0, 0, 0), fov_y=0.4)
    looks, _ = looked_at(made.scene)
    centre = looks.pictures[0][9, 16]
    # What reflects and what passes through show the same dome: together, all of it.
    np.testing.assert_allclose(centre, [0.2, 0.4, 0.8], rtol=1e-3)


def test_it_does_not_depend_on_what_was_traced_or_on_threads() -> None:
    pictures = []
    for step, threads in ((1, 1), (1000, 3)):
        looks = Looks(step=step)
        with renderer_of(hall(), heuristic=looks, threads=threads) as renderer:
            frames = [renderer.render(number / 30) for number in range(3)]
        assert any(frame.decisions.chosen.all() for frame in frames) == (step == 1)
        pictures.append(looks.pictures)
    for one, other in zip(*pictures, strict=True):
        np.testing.assert_array_equal(one, other)


def test_every_sub_pixel_sample_has_its_own() -> None:
    looks, _ = looked_at(hall(), 64, aa=2)
    assert len(looks.pictures) == 2
    assert (looks.pictures[0] != looks.pictures[1]).any()


def test_an_orthographic_view_has_one_too() -> None:
    made = flat_stage().add("/glass", ball(0.4, 3), GLASS, at(-0.5, 0.5, 0.5))
    made.camera((0, 1.0, 4), (0, 0, 0), ortho_height=3.0)
    looks = Looks()
    with renderer_of(made.scene, heuristic=looks, strict=True) as renderer:
        renderer.render(camera=1)
    assert np.isfinite(looks.pictures[0]).all()
    assert looks.pictures[0].std() > 0.01


def test_it_is_made_once_and_only_when_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    composed: list[int] = []
    real = raster_picture.compose

    def counted(*arguments: Any) -> None:
        composed.append(len(arguments[5]))
        real(*arguments)

    monkeypatch.setattr(raster_picture, "compose", counted)
    render(hall(), SIZE, heuristic="all_trace")
    assert composed == []

    class Twice(Looks):
        def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
            super().begin_frame(candidates, context)
            assert context.picture(self._width) is self.pictures[-1]

    render(hall(), SIZE, heuristic=Twice(32))
    assert sum(composed) == 2 * 32 * 18


def test_it_cannot_be_changed() -> None:
    looks, _ = looked_at(flat_stage().scene)
    with pytest.raises(ValueError, match="read-only"):
        looks.pictures[0][0, 0, 0] = 1.0


# Sums by object


def test_means_are_those_of_the_objects_pixels() -> None:
    looks, frame = looked_at(hall(), 16)
    ids = frame.gbuffer.object_id
    spread = looks.pictures[0][..., 1].repeat(4, axis=0).repeat(4, axis=1)
    for number, mean in enumerate(looks.means[0]):
        seen = spread[ids == number]
        assert mean == pytest.approx(float(seen.mean()) if len(seen) else 0.0, rel=1e-5)
    assert len(looks.means[0]) == len(frame.world.scene.objects) + 1
    assert (np.bincount(ids.ravel(), minlength=9) > 0).sum() > 5


def test_a_map_may_have_any_size() -> None:
    found: list[np.ndarray] = []

    class Asks(Looks):
        def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
            super().begin_frame(candidates, context)
            found.extend(context.object_means(np.full(shape, 3.0)) for shape in ((1, 1), (7, 5), (100, 300)))

    frame = render(hall(), SIZE, heuristic=Asks())
    seen = np.bincount(frame.gbuffer.object_id.ravel(), minlength=9) > 0
    for means in found:
        np.testing.assert_allclose(means, np.where(seen, 3.0, 0.0), rtol=1e-6)


def test_sums_by_object_are_those_of_numpy() -> None:
    random = np.random.default_rng(3)
    ids, values = random.integers(0, 5, (11, 23)).astype(np.uint32), random.random((4, 6), np.float32)
    sums, counts = np.zeros(5), np.zeros(5, np.int64)
    column, row = places(23, 6), places(11, 4)
    sum_by_object(ids, column, row, values, sums, counts)
    spread = values[row][:, column]
    np.testing.assert_allclose(sums, np.bincount(ids.ravel(), weights=spread.ravel(), minlength=5), rtol=1e-6)
    np.testing.assert_array_equal(counts, np.bincount(ids.ravel(), minlength=5))


def test_places_and_samples_lie_evenly() -> None:
    assert places(8, 4).tolist() == [0, 0, 1, 1, 2, 2, 3, 3]
    assert places(5, 2).tolist() == [0, 0, 1, 1, 1]
    pixels, points = sampled_pixels(8, 4, 2, 1)
    assert points == 2
    assert pixels.tolist() == [1 * 8 + 1, 3 * 8 + 3, 1 * 8 + 5, 3 * 8 + 7]
    pixels, points = sampled_pixels(3, 2, 2, 2)
    assert (points, pixels.tolist()) == (1, [0, 2, 3, 5])
    pixels, points = sampled_pixels(5, 1, 5, 1)
    assert (points, pixels.tolist()) == (1, [0, 1, 2, 3, 4])


# Where there is none, and replay


@pytest.mark.parametrize("width", [0, -3])
def test_a_width_below_one_is_refused(width: int) -> None:
    with pytest.warns(PhrtWarning, match=f"the raster picture cannot be {width} pixels wide; it must be 1 or more"):
        looked_at(flat_stage().scene, width, strict=False)


def test_a_map_that_is_none_is_refused() -> None:
    class Asks(Looks):
        def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
            for values in (np.zeros(7), np.zeros((0, 3)), np.zeros((2, 3, 3))):
                with pytest.raises(OptionError, match=r"takes values \(h, w\), not an array of shape"):
                    context.object_means(values)
            super().begin_frame(candidates, context)

    render(flat_stage().scene, SIZE, heuristic=Asks())


def test_a_context_made_by_hand_says_that_it_has_none() -> None:
    bare = context(raster=None)
    for ask in (bare.picture, lambda: bare.object_means(np.zeros((2, 2)))):
        with pytest.raises(PluginError, match=r"made by hand and has no raster picture; give it raster="):
            ask()


def test_contexts_of_the_conformance_kit_have_a_picture_whose_objects_are_stripes() -> None:
    made = context()
    picture = made.picture(64)
    assert picture.shape == (36, 64, 3)
    means = made.object_means(picture[..., 0])
    assert len(means) == 33
    np.testing.assert_allclose(means[1:], picture[0, ::2, 0], rtol=1e-6)


def test_a_frame_that_is_replayed_has_the_same_picture(tmp_path: Path) -> None:
    from phrt.recording import Recorder, replay
    from phrt.recording.replay import Replay

    looks = Looks()
    with renderer_of(heuristic=looks) as renderer, Recorder(tmp_path / "run", renderer) as recorder:
        for number in range(3):
            recorder.add(renderer.render(number / 30))
    again: list[np.ndarray] = []

    class LooksAgain(Replay):
        def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
            super().begin_frame(candidates, context)
            again.append(context.picture(32))

    frames = list(replay(tmp_path / "run", three_things(), threads=1))
    with renderer_of(heuristic=LooksAgain(tmp_path / "run"), threads=1) as renderer:
        for number, frame in enumerate(frames):
            made = renderer.render(number / 30)
            np.testing.assert_array_equal(made.image, frame.image)
    for one, other in zip(looks.pictures, again, strict=True):
        np.testing.assert_array_equal(one, other)


def test_it_is_there_for_every_grouping() -> None:
    for grouping in ("object", "object_effect", "object_effect_light"):
        looks, frame = looked_at(hall(), group_by=grouping)
        assert isinstance(frame, FrameResult)
        assert looks.means[0][frame.decisions.candidates.object_id].min() > 0
