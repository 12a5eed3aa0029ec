"""The frame loop: reproducible frames, honest accounts of them, and errors that say what is allowed."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pytest
from candidate_kit import candidates
from scene_kit import GLASS, LAMBERT, MIRROR, PLAIN_FALLBACKS, Stage, at, ball, box, floor, quad, turned

import phrt
from phrt.camera import CameraView, look_at
from phrt.errors import OptionError, PluginError
from phrt.frame import MASK_FILLED, MASK_TRACED, Decisions
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic, Outcome, Request
from phrt.ledger import over_samples
from phrt.model import Material, Track
from phrt.scene import Scene

SIZE = (48, 32)
SOFT = {"shadows": {"samples": 3}, "ambient_occlusion": {"samples": 3}, "reflections": {"samples": 3}}


def room(order: tuple[int, ...] = (0, 1, 2, 3)) -> Scene:
    """A mirror ball, a glass ball and a glossy box on a floor, under a sphere light and a dome, objects in any order."""
    made = Stage(dome=(0.3, 0.4, 0.6))
    things: list[tuple[Any, ...]] = [
        ("/floor", floor(), LAMBERT, at(0, -0.5, 0)),
        ("/mirror", ball(0.5, 3), MIRROR, at(-1.1, 0, 0)),
        ("/glass", ball(0.5, 3), GLASS, at(0, 0, 0)),
        (
            "/box",
            box(0.8, 0.8, 0.8),
            Material(base_color=(0.8, 0.2, 0.1, 1), roughness=0.2),
            at(1.1, -0.1, 0) @ turned("y", 30),
        ),
    ]
    for index in order:
        made.add(*things[index])
    made.light("sphere", at(1, 3, 2), intensity=40.0, radius=0.3)
    made.camera((0, 1.2, 4), (0, 0, 0), fov_y=0.8)
    return made.scene


def renderer(scene: Scene, **options: Any) -> phrt.Renderer:
    return phrt.Renderer(scene, **({"size": SIZE, "gbuffer": "raycast", "threads": 2, "strict": True} | options))


def image(scene: Scene, **options: Any) -> np.ndarray:
    with renderer(scene, **options) as made:
        return made.render().image


# --- same question, same picture ------------------------------------------------------------------------------------


@pytest.mark.parametrize("effects", [{}, SOFT])
def test_the_image_is_the_same_bit_for_bit_whatever_the_threads(effects: dict[str, Any]) -> None:
    one, four = (image(room(), threads=count, effects=effects) for count in (1, 4))
    np.testing.assert_array_equal(one, four)
    assert np.isfinite(one).all()


def test_the_image_does_not_depend_on_the_order_of_objects() -> None:
    np.testing.assert_allclose(image(room()), image(room((3, 1, 0, 2))), atol=1e-6)


def test_a_frame_index_seeds_the_same_frame_and_another_one_another() -> None:
    with renderer(room(), effects=SOFT) as made:
        first, second, again = (made.render(frame_index=k).image.copy() for k in (0, 1, 0))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, second)


class Backward(Heuristic):
    """Takes every item, last first."""

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self.left = list(range(len(candidates)))

    def next(self, remaining: float) -> int | None:
        return self.left.pop() if self.left else None


def test_the_image_does_not_depend_on_the_order_items_are_traced_in() -> None:
    np.testing.assert_array_equal(
        image(room(), effects=SOFT), image(room(), effects=SOFT, heuristic=Backward(), tracer="embree")
    )


def test_a_frame_that_is_kept_is_not_overwritten_by_the_next() -> None:
    with renderer(room()) as made:
        first = made.render()
        copies = first.image.copy(), first.gbuffer.depth.copy(), first.layers["visibility"].copy()
        made.move("/box", at(0.5, 0.5, 1.5))
        second = made.render()
        assert not np.array_equal(second.image, first.image)
        for kept, copy in zip((first.image, first.gbuffer.depth, first.layers["visibility"]), copies, strict=True):
            np.testing.assert_array_equal(kept, copy)


# --- what heuristics choose -----------------------------------------------------------------------------------------


def test_raster_only_traces_nothing_and_looks_different() -> None:
    with (
        renderer(room()) as all_trace,
        renderer(room(), heuristic="raster_only", effects=PLAIN_FALLBACKS) as raster_only,
    ):
        full, plain = all_trace.render(), raster_only.render()
    assert full.decisions.chosen.all()
    assert not plain.decisions.chosen.any()
    assert sum(count for name, count in plain.rays.items() if name != "primary") == 0
    assert np.abs(full.image - plain.image).mean() > 0.01
    np.testing.assert_array_equal(full.gbuffer.object_id, plain.gbuffer.object_id)


class Only(Heuristic):
    """Takes the items of one object."""

    def __init__(self, object_id: int) -> None:
        self.object_id = object_id

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self.left = np.flatnonzero(candidates.object_id == self.object_id).tolist()

    def next(self, remaining: float) -> int | None:
        return self.left.pop() if self.left else None


@pytest.mark.parametrize("object_id", [1, 2, 3, 4])
def test_a_traced_object_looks_as_in_all_trace_and_the_others_as_in_raster_only(object_id: int) -> None:
    with renderer(room(), heuristic=Only(object_id)) as made:
        frame = made.render()
    mine = frame.gbuffer.object_id == object_id
    assert mine.any()
    np.testing.assert_array_equal(frame.image[mine], image(room())[mine])
    np.testing.assert_array_equal(frame.image[~mine], image(room(), heuristic="raster_only")[~mine])


class Coarse(Heuristic):
    """Takes `passes` of each item's interleaved passes, `waves` times over."""

    def __init__(self, passes: int, waves: int = 1) -> None:
        self.passes, self.waves = passes, waves

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        one_wave = [*(Request(item, self.passes) for item in range(len(candidates))), None]
        self.left: list[Request | None] = one_wave * self.waves

    def next(self, remaining: float) -> Request | None:
        return self.left.pop(0) if self.left else None


@pytest.mark.parametrize("effects", [{}, SOFT])
def test_the_passes_of_all_items_together_make_the_whole_picture(effects: dict[str, Any]) -> None:
    np.testing.assert_array_equal(
        image(room(), effects=effects, heuristic=Coarse(1, waves=4)), image(room(), effects=effects)
    )


def test_a_quarter_of_the_rays_gives_a_coarser_picture_without_stripes_or_holes() -> None:
    with renderer(room(), heuristic=Coarse(1)) as coarse, renderer(room()) as full:
        quarter, whole = coarse.render(), full.render()
    for name, mask in whole.masks.items():
        where = mask == MASK_TRACED
        if not where.any():
            continue
        found = quarter.masks[name]
        assert np.isin(found[where], (MASK_TRACED, MASK_FILLED)).mean() > 0.99, name
        rows, columns = np.nonzero(found == MASK_TRACED)
        assert np.all((rows % 2 == 0) & (columns % 2 == 0)), "one pixel of each 2x2 block"
        traced = found == MASK_TRACED
        np.testing.assert_array_equal(quarter.layers[name][traced], whole.layers[name][traced])
    assert quarter.rays["shadows"] < 0.3 * whole.rays["shadows"]
    plain = image(room(), heuristic="raster_only", effects=PLAIN_FALLBACKS)
    assert np.abs(quarter.image - whole.image).mean() < 0.7 * np.abs(plain - whole.image).mean()


def test_candidates_are_the_visible_objects_with_the_effects_that_change_them() -> None:
    with renderer(room()) as made:
        frame = made.render()
    candidates, ids = frame.decisions.candidates, frame.gbuffer.object_id
    found = {
        (made.scene.objects[o - 1].path, candidates.effect_names[e]): int(n)
        for o, e, n in zip(candidates.object_id, candidates.effect, candidates.pixel_count, strict=True)
    }
    pixels = {entry.path: int((ids == k).sum()) for k, entry in enumerate(made.scene.objects, start=1)}
    assert found == {
        ("/floor", "shadows"): pixels["/floor"],
        ("/box", "shadows"): pixels["/box"],
        ("/box", "reflections"): pixels["/box"],
        ("/mirror", "reflections"): pixels["/mirror"],
        ("/glass", "reflections"): pixels["/glass"],
        ("/glass", "refractions"): pixels["/glass"],
    }
    np.testing.assert_allclose(candidates.area, candidates.pixel_count / ids.size, rtol=1e-6)


# --- time and motion ------------------------------------------------------------------------------------------------


def test_a_moved_object_is_seen_where_it_was_put_and_goes_back() -> None:
    place = at(-0.3, 0.9, 1.0)
    moved_scene = room()
    moved_scene.nodes[moved_scene.objects[1].node].matrix = place
    with renderer(room()) as made:
        before = made.render(frame_index=0).image
        made.move("/mirror", place)
        there = made.render(frame_index=0).image
        made.move("/mirror", None)
        back = made.render(frame_index=0).image
    np.testing.assert_allclose(there, image(moved_scene), atol=1e-6)
    np.testing.assert_allclose(back, before, atol=1e-5)
    assert np.abs(there - before).max() > 0.1


def test_an_animated_scene_is_the_still_scene_of_each_moment() -> None:
    scene = room()
    keys = np.array([[-1.1, 0, 0], [0.0, 1.5, 0]], np.float32)
    scene.tracks = [Track(scene.objects[1].node, "translation", np.array([0.0, 2.0]), keys)]
    still = room()
    still.nodes[still.objects[1].node].matrix = at(-0.55, 0.75, 0)
    with renderer(scene, heuristic="raster_only") as made:
        made.render(0.0)
        half_way = made.render(1.0).image
    np.testing.assert_allclose(half_way, image(still, heuristic="raster_only"), atol=1e-5)


def test_probes_and_shadow_maps_are_made_again_when_something_moved() -> None:
    fallbacks = {"shadows": {"fallback": "shadow_map"}, "reflections": {"fallback": "probe"}}
    moved_scene = room()
    moved_scene.nodes[moved_scene.objects[3].node].matrix = at(0.4, 0.6, 1.0)
    with renderer(room(), heuristic="raster_only", effects=fallbacks) as made:
        made.render()
        made.move("/box", at(0.4, 0.6, 1.0))
        # A probe a frame.
        for _ in range(4):
            frame = made.render()
    np.testing.assert_allclose(frame.image, image(moved_scene, heuristic="raster_only", effects=fallbacks), atol=1e-5)


def test_a_view_of_ones_own_and_a_camera_by_name_see_the_same() -> None:
    scene = room()
    view = CameraView(*SIZE, look_at((0, 1.2, 4), (0, 0, 0)), (np.tan(0.4) * 1.5, np.tan(0.4)))
    with renderer(scene) as made:
        own, named, numbered = (made.render(camera=c, frame_index=0).image for c in (view, "/camera0", 0))
    np.testing.assert_allclose(own, named, atol=1e-5)
    np.testing.assert_array_equal(named, numbered)


# --- accounts -------------------------------------------------------------------------------------------------------


def test_stages_sum_to_the_frame_and_rays_are_counted() -> None:
    with renderer(room()) as made:
        frame = made.render()
    assert frame.milliseconds == pytest.approx(sum(frame.stages.values()))
    assert {"update", "gbuffer", "direct", "candidates", "rays", "composite"} <= set(frame.stages)
    assert min(frame.stages.values()) >= 0
    assert frame.rays["primary"] == SIZE[0] * SIZE[1]
    by_effect: dict[str, int] = {}
    for effect, count in zip(frame.decisions.candidates.effect, frame.decisions.rays, strict=True):
        name = frame.decisions.candidates.effect_names[effect]
        by_effect[name] = by_effect.get(name, 0) + int(count)
    for name, count in by_effect.items():
        assert frame.rays[name] == pytest.approx(count, abs=3)
        assert count > 0


def test_antialiasing_gives_an_edge_the_share_of_samples_that_it_covers() -> None:
    from phrt.sampling import jitter_pattern

    made = Stage().camera((0, 0, 2), (0, 0, 0), ortho_height=4.0)
    # Four pixels of a metre; the square ends 0.3 into the third column and 0.6 into the third row.
    made.add("/square", quad(20, 20), Material(unlit=True), at(-9.7, 9.4, 0))
    frame = made.render((4, 4), aa=16)
    jitter = np.array(jitter_pattern(16)) + 0.5
    across, down = jitter[:, 0] < 0.3, jitter[:, 1] < 0.6
    expected = np.zeros((4, 4))
    expected[:2, :2], expected[:2, 2], expected[2, :2] = 1, across.mean(), down.mean()
    expected[2, 2] = (across & down).mean()
    np.testing.assert_allclose(frame.image[..., 0], expected, atol=1e-6)
    assert frame.rays["primary"] == 16 * 16


def test_antialiasing_averages_the_layers_too() -> None:
    with renderer(room(), aa=4) as made, renderer(room()) as single:
        smooth, hard = made.render(), single.render()
    assert set(np.unique(hard.layers["visibility"])) == {0, 1}
    quarters = np.unique(smooth.layers["visibility"])
    np.testing.assert_allclose(quarters * 4, np.round(quarters * 4), atol=1e-5)
    assert len(quarters) == 5
    assert smooth.rays["primary"] == 4 * hard.rays["primary"]


def test_sub_pixel_samples_are_spread_evenly_around_the_centre() -> None:
    from phrt.sampling import jitter_pattern

    assert jitter_pattern(1) == [(0.0, 0.0)]
    for count in (4, 16, 64):
        pattern = np.array(jitter_pattern(count))
        assert len(np.unique(pattern, axis=0)) == count
        assert np.abs(pattern).max() <= 0.5
        np.testing.assert_allclose(pattern.mean(axis=0), 0, atol=0.5 / np.sqrt(count))


def test_an_empty_scene_shows_the_dome_or_black() -> None:
    made = Stage(dome=(0.1, 0.2, 0.3)).camera((0, 0, 1), (0, 0, 0))
    np.testing.assert_allclose(made.render((4, 4)).image, np.broadcast_to(np.float32([0.1, 0.2, 0.3]), (4, 4, 3)))
    made.scene.dome.visible = False
    assert not made.render((4, 4)).image.any()


@pytest.mark.parametrize("size", [(1, 1), (3, 1), (1, 7), (33, 17)])
def test_any_size_renders(size: tuple[int, int]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        picture = image(room(), size=size, effects=SOFT)
    assert picture.shape == (size[1], size[0], 3)
    assert np.isfinite(picture).all()


# --- what cannot be ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"size": (0, 10)}, "size is 0x10; each side must be 1 to 16384 pixels"),
        ({"size": (10, 99999)}, "size is 10x99999; each side must be 1 to 16384 pixels"),
        (
            {"size": (16384, 4097)},
            r"size is 16384x4097, 67,125,248 pixels; it must have at most 67,108,864 \(8192x8192\)",
        ),
        (
            {"effects": {"shadows": {"enabled": "no"}}},
            "effect 'shadows': option 'enabled' is 'no', allowed: true or false",
        ),
        ({"effects": {"shadows": {"enabled": 0}}}, "effect 'shadows': option 'enabled' is 0, allowed: true or false"),
        ({"aa": 0}, "aa is 0; it must be 1 to 1024 samples per pixel"),
        ({"threads": 0}, "threads is 0; it must be 1 to 1024"),
        ({"budget": "50"}, "budget is '50' without a unit"),
        ({"effects": {"shadows": {"samples": -1}}}, "samples"),
        ({"effects": {"shadows": {"sample": 4}}}, "sample"),
    ],
)
def test_options_out_of_range_say_what_is_allowed(options: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        renderer(room(), **options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"tracer": "embre"}, "Did you mean 'embree'"),
        ({"gbuffer": "raycst"}, "Did you mean 'raycast'"),
        ({"heuristic": "all_trac"}, "Did you mean 'all_trace'"),
        ({"effects": {"shadow": {}}}, "Did you mean 'shadows'"),
    ],
)
def test_a_misspelt_plugin_is_named_with_the_nearest_one(options: dict[str, Any], message: str) -> None:
    with pytest.raises(PluginError, match=message):
        renderer(room(), **options)


def test_times_objects_and_cameras_that_do_not_exist_are_named() -> None:
    with renderer(room()) as made:
        with pytest.raises(OptionError, match="time is nan; it must be a finite number of seconds"):
            made.render(float("nan"))
        with pytest.raises(OptionError, match=r"no camera number 3; the scene has 1, counted from 0"):
            made.render(camera=3)
        with pytest.raises(OptionError, match=r"no camera '/camera1'; the scene has /camera0. Did you mean '/camera0'"):
            made.render(camera="/camera1")
        with pytest.raises(OptionError, match=r"no object '/miror' in scene 'test'. Did you mean '/mirror'"):
            made.move("/miror", None)


def skewed(row: int, column: int, value: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[row, column] = value
    return matrix


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.eye(3), r"the matrix of '/box' is of shape \(3, 3\); it must be 4 x 4 numbers, world_from_local"),
        ("here", "the matrix of '/box' is str; it must be 4 x 4 numbers"),
        ([[1, 0], [0]], "the matrix of '/box' is list; it must be 4 x 4 numbers"),
        (skewed(0, 3, np.nan), "the matrix of '/box' holds NaN or infinity"),
        (skewed(1, 1, np.inf), "the matrix of '/box' holds NaN or infinity"),
        (at(1, 2, 3).T, r"the last row of the matrix of '/box' is \[1.0, 2.0, 3.0, 1.0\]; it must be 0 0 0 1"),
    ],
)
def test_a_place_that_is_none_is_refused_and_nothing_moves(matrix: Any, message: str) -> None:
    with renderer(room()) as made:
        before = made.render(frame_index=0).image
        with pytest.raises(OptionError, match=message):
            made.move("/box", matrix)
        np.testing.assert_array_equal(made.render(frame_index=0).image, before)


def test_a_place_may_change_afterwards_without_moving_the_object() -> None:
    with renderer(room()) as made:
        before = made.render(frame_index=0).image
        place = made.world.object_matrix[4].copy()
        made.move("/box", place)
        place[:3, 3] += 1
        np.testing.assert_allclose(made.render(frame_index=0).image, before, atol=1e-5)


def test_a_closed_renderer_says_so_and_may_be_closed_again() -> None:
    made = renderer(room())
    made.close()
    made.close()
    with pytest.raises(RuntimeError, match="the renderer was closed"):
        made.render()
    with pytest.raises(RuntimeError, match="the renderer was closed"):
        made.move("/box", None)


def test_a_channel_that_is_not_there_is_told_with_those_that_are() -> None:
    with renderer(room()) as made:
        frame = made.render()
    message = r"the G-buffer has no channel 'motion'; this one holds depth, position_world, .*, emissive$"
    with pytest.raises(AttributeError, match=message):
        _ = frame.gbuffer.motion


# --- sub-pixel samples ----------------------------------------------------------------------------------------------


class Diary(Backward):
    """Keeps what it is told."""

    def __init__(self) -> None:
        self.contexts: list[FrameContext] = []
        self.rays: dict[tuple[int, int], int] = {}

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        super().begin_frame(candidates, context)
        self.contexts.append(context)
        self.candidates = candidates

    def report(self, item: int, outcome: Outcome) -> None:
        key = int(self.candidates.object_id[item]), int(self.candidates.effect[item])
        self.rays[key] = self.rays.get(key, 0) + outcome.rays


def test_a_heuristic_is_told_each_sub_pixel_sample_and_decisions_sum_over_them() -> None:
    diary = Diary()
    with renderer(room(), heuristic=diary, aa=4) as made:
        frame = made.render(2.0, frame_index=7)
    assert [(c.frame_index, c.time, c.sample, c.samples) for c in diary.contexts] == [(7, 2.0, k, 4) for k in range(4)]
    assert {(c.budget, c.budget_unit) for c in diary.contexts} == {(float("inf"), "none")}
    decisions = frame.decisions
    keys = zip(decisions.candidates.object_id, decisions.candidates.effect, decisions.rays, strict=True)
    assert {(int(o), int(e)): int(rays) for o, e, rays in keys} == diary.rays
    assert int(decisions.rays.sum()) == pytest.approx(frame.rays["shadows"] + sum(
        frame.rays[name] for name in ("reflections", "refractions")
    ), abs=24)  # fmt: skip
    assert np.all(decisions.milliseconds > 0)


def decided(objects: list[int], rays: list[int]) -> Decisions:
    count = len(objects)
    ids, zeros = np.array(objects, np.int32), np.zeros(count, np.int32)
    work = candidates(rays, effect_names=("one",), object_id=ids)
    return Decisions(work, zeros > 0, zeros, zeros, zeros, zeros, np.array(rays), np.array(rays) / 2)


def test_samples_that_see_other_objects_are_summed_by_object() -> None:
    total = over_samples([decided([1, 2, 4], [10, 20, 40]), decided([4, 3], [5, 6]), decided([3, 1, 4], [1, 2, 3])])
    assert total.candidates.object_id.tolist() == [3, 1, 4]
    assert total.rays.tolist() == [7, 12, 48]
    assert total.milliseconds.tolist() == [3.5, 6, 24]
