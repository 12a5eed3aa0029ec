"""The paper's letters: hand-computed on a scene with two spheres, and finite wherever an object is."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scene_kit import LAMBERT, MIRROR, Stage, at, ball, box, quad

import phrt
from phrt.camera import CameraView, look_at
from phrt.controls import Conditions
from phrt.interfaces.heuristic import Candidates
from phrt.relevance import ObjectSight, center_closeness, importance_factors, observer_distance, slowed
from phrt.scene import Scene, SceneObject
from phrt.world import World

FOV = 2 * math.atan(0.5)
"""Half the picture's height is half of the distance."""


def two_spheres(**near_switches: Any) -> Stage:
    """A mirror ball of radius 0.5 in the view's axis, 4 m away, and one of radius 0.25, 2 m away and 0.5 m to the right."""
    made = Stage(dome=(0.5, 0.5, 0.5))
    made.add("/far", ball(0.5, 4), MIRROR, at(0, 0, -4))
    made.add("/near", ball(0.25, 4), MIRROR, at(0.5, 0, -2), **near_switches)
    made.light("point", at(0, 5, 0), intensity=10.0)
    return made.camera((0, 0, 0), (0, 0, -1), fov_y=FOV)


def letters(scene: Scene, frames: int = 1, **options: Any) -> Candidates:
    """The candidates of the last of some frames at 200x100, where tan of the half fields of view are 1 and 0.5."""
    options = {"size": (200, 100), "gbuffer": "raycast", "threads": 2, "strict": True} | options
    with phrt.Renderer(scene, **options) as renderer:
        for _ in range(frames):
            frame = renderer.render()
    return frame.decisions.candidates


def row(work: Candidates, object_id: int, effect: str) -> int:
    (found,) = np.flatnonzero((work.object_id == object_id) & (work.effect == work.effect_names.index(effect)))
    return int(found)


def test_every_letter_of_two_spheres() -> None:
    scene = two_spheres(importance={"default": 3.0}).scene
    work = letters(scene, frames=2, persistence=0.25)
    far, near = row(work, 1, "reflections"), row(work, 2, "reflections")
    # A of a ball in the axis: its silhouette is a circle of tangent r / sqrt(d^2 - r^2) in a picture of 2 x 1.
    tangent = 0.5 / math.sqrt(16 - 0.25)
    assert work.area[far] == pytest.approx(math.pi * tangent**2 / 2, rel=0.02)
    # P: the near ball's centre is at a tangent of 0.25, a quarter of the way to the right border.
    assert work.center_closeness[[far, near]] == pytest.approx([1.0, 0.75], abs=1e-6)
    assert work.distance[[far, near]] == pytest.approx([4.0, math.sqrt(4.25)], rel=1e-6)
    # K: importances 1 and 3 are 0.5 and 1.5 times their mean.
    assert work.importance_factor[[far, near]] == pytest.approx([0.5, 1.5])
    # Q: one reflected ray, and a shadow ray at what it meets where the light is in front of that: of two balls, about half.
    expected = work.ray_estimate[far]
    assert expected == pytest.approx(1.5, abs=0.05)
    assert work.ray_estimate[near] == expected
    visible = work.area[[far, near]] * [1.0, 0.75] / [4.0, math.sqrt(4.25)]
    assert work.visibility[[far, near]] == pytest.approx(visible, rel=1e-5)
    assert work.cost[[far, near]] == pytest.approx(expected * visible, rel=1e-5)
    # S: all were traced in the first frame.
    assert work.was_selected.all()
    assert work.relevance[[far, near]] == pytest.approx((0.25 + visible) * [0.5, 1.5], rel=1e-5)


def test_area_from_object_ids_is_that_of_the_projected_disc() -> None:
    """At 800x400 the mirror ball's silhouette is counted to a hundredth of it, and the near ball hides nothing of it."""
    work = letters(two_spheres().scene, size=(800, 400))
    radius = 0.5 / math.sqrt(16 - 0.25) * 400
    assert work.area[row(work, 1, "reflections")] * 800 * 400 == pytest.approx(math.pi * radius**2, rel=0.01)
    # A small cone off the axis covers its solid angle / cos^3 of the plane at distance 1, where the picture is 2 x 1.
    angle = math.asin(0.25 / math.sqrt(4.25))
    solid = 2 * math.pi * (1 - math.cos(angle))
    cosine = 2 / math.sqrt(4.25)
    assert work.area[row(work, 2, "reflections")] * 2 == pytest.approx(solid / cosine**3, rel=0.03)


def test_nothing_was_selected_before_the_first_frame_nor_after_one_without_rays() -> None:
    scene = two_spheres().scene
    assert not letters(scene).was_selected.any()
    work = letters(scene, frames=2, heuristic="raster_only")
    assert not work.was_selected.any()
    np.testing.assert_array_equal(work.relevance, work.visibility)


def test_area_counts_the_object_and_not_only_the_pixels_an_effect_applies_to() -> None:
    made = two_spheres().add("/behind", ball(), LAMBERT, at(0, 0, 9))
    made.scene.meshes[0].triangle_material[::2] = 2
    work = letters(made.scene)
    shadows, reflections = row(work, 1, "shadows"), row(work, 1, "reflections")
    assert work.area[shadows] == work.area[reflections] == pytest.approx(0.0249, abs=0.001)
    assert work.pixel_count[[shadows, reflections]].sum() == round(float(work.area[shadows]) * 200 * 100)
    assert (work.pixel_count[[shadows, reflections]] > 100).all()


def view(orthographic: bool = False) -> CameraView:
    return CameraView(200, 100, look_at((1, 2, 3), (1, 2, 0)), (1.0, 0.5), orthographic=orthographic, near=0.1)


@pytest.mark.parametrize(
    ("center", "closeness"),
    [
        ((1, 2, -7), 1.0),
        ((6, 2, -7), 0.5),
        ((1, 4.5, -7), 0.5),
        ((6, 4.5, -7), 0.5),
        ((11, 2, -7), 0.0),
        ((1, -3, -7), 0.0),
        ((41, 2, -7), 0.0),
        ((1, 2, 13), 0.0),
        ((1, 2, 3), 0.0),
        ((2, 2, 3), 0.0),
    ],
)
def test_center_closeness_falls_linearly_from_the_centre_to_the_border(
    center: tuple[float, float, float], closeness: float
) -> None:
    assert center_closeness(np.array([center], float), view()) == pytest.approx([closeness], abs=1e-6)


def test_center_closeness_of_an_orthographic_view_does_not_depend_on_depth() -> None:
    centers = np.array([[1.5, 2, 0], [1.5, 2, -50], [1, 2.25, -5], [1, 2, 5]], float)
    np.testing.assert_allclose(center_closeness(centers, view(orthographic=True)), [0.5, 0.5, 0.5, 0.0], atol=1e-6)


def test_distance_is_at_least_the_near_plane() -> None:
    centers = np.array([[1, 2, 3], [1, 2, 2.99], [1, 2, 13], [4, 6, 3]], float)
    np.testing.assert_allclose(observer_distance(centers, view()), [0.1, 0.1, 10.0, 5.0], rtol=1e-6)


@pytest.mark.parametrize("place", [(0, 0, 0), (0, 0, 5), (0, 0, -1e-9), (1e-3, 0, 0)])
def test_objects_around_behind_and_at_the_eye_have_finite_letters(place: tuple[float, float, float]) -> None:
    """A room around the observer covers the view; its centre is at the eye, behind it, or beside it."""
    made = Stage(dome=(1, 1, 1))
    inside = replace(MIRROR, double_sided=True)
    made.add("/room", box(20, 20, 20), inside, at(*place)).add("/behind", quad(), MIRROR, at(0, 0, 3))
    made.light("point", at(0, 1, 0), intensity=1.0).camera((0, 0, 0), (0, 0, -1))
    work = letters(made.scene)
    assert len(work) > 0
    for name in ("area", "center_closeness", "distance", "visibility", "cost", "importance_factor", "relevance"):
        values = getattr(work, name)
        assert values.dtype == np.float32, name
        assert np.isfinite(values).all(), name
        assert (values >= 0).all(), name
    assert work.area[0] == 1.0
    assert (work.predicted_cost >= 1).all()


def entry(**importance: float) -> SceneObject:
    return SceneObject("/o", 0, 0, importance=importance)


@pytest.mark.parametrize(
    ("situation", "factors"),
    [("default", [0, 0.5, 2.0, 0.5]), ("night", [0, 2.0, 0.8, 0.2])],
)
def test_importance_is_of_the_situation_and_relative_to_the_mean(situation: str, factors: list[float]) -> None:
    objects = [entry(night=10.0), entry(default=4.0), entry(default=1.0)]
    scene = Scene("s", objects=objects, situation=situation)
    np.testing.assert_allclose(importance_factors(scene), factors, rtol=1e-6)


def tagged(*tags: str) -> SceneObject:
    return SceneObject("/o", 0, 0, tags=tags)


def test_attention_multiplies_importance_by_the_factor_of_every_tag_of_an_object() -> None:
    scene = Scene("s", objects=[tagged("gold", "coin"), tagged("gold"), tagged("coin"), tagged(), tagged("wall")])
    found = importance_factors(scene, attention={"gold": 3.0, "coin": 2.0, "wall": 0.0})
    np.testing.assert_allclose(found, [0, 6, 3, 2, 1, 0])
    np.testing.assert_allclose(importance_factors(scene, attention={}), [0, 1, 1, 1, 1, 1])


def test_importance_stays_finite_whatever_is_looked_for() -> None:
    many = [f"t{k}" for k in range(30)]
    scene = Scene("s", objects=[tagged(*many), tagged(*many, "not"), entry(default=1e18)])
    found = importance_factors(scene, attention=dict.fromkeys(many, 1e18) | {"not": 0.0})
    assert np.isfinite(found).all()
    assert (found >= 0).all()


def test_another_situation_than_the_scenes_can_be_asked_for() -> None:
    scene = Scene("s", objects=[entry(night=10.0), entry(default=4.0)])
    np.testing.assert_allclose(importance_factors(scene), [0, 0.4, 1.6], rtol=1e-6)
    np.testing.assert_allclose(importance_factors(scene, "night"), [0, 20 / 14, 8 / 14], rtol=1e-6)


def test_speed_halves_visibility_at_one_picture_width_a_second_and_strength_one() -> None:
    visible, speed = np.ones(4, np.float32), np.array([0.0, 0.5, 1.0, 3.0], np.float32)
    np.testing.assert_allclose(slowed(visible, speed, 1.0), [1, 2 / 3, 0.5, 0.25], rtol=1e-6)
    np.testing.assert_allclose(slowed(visible, speed, 0.0), [1, 1, 1, 1])
    np.testing.assert_allclose(slowed(visible, speed, 2.0), [1, 0.5, 1 / 3, 1 / 7], rtol=1e-6)


def seen(sight: ObjectSight, world: World, frames: list[tuple[float, float]], conditions: Conditions) -> Any:
    """The letters of the last of frames (time, x of the eye); both balls cover a tenth of the picture."""
    for time, x in frames:
        at_x = CameraView(200, 100, look_at((x, 0, 0), (x, 0, -1)), (1.0, 0.5))
        sight.begin_frame(world, at_x, time, conditions)
        found = sight.letters(world, at_x, np.array([16000, 2000, 2000]))
    return found


def test_letters_follow_the_situation_the_attention_and_the_speed_of_the_frame() -> None:
    scene = two_spheres(importance={"default": 3.0, "night": 1.0}, tags=("gold",)).scene
    world, sight = World(scene), ObjectSight(World(scene))
    still = seen(sight, world, [(0.0, 0.0)], Conditions())
    np.testing.assert_allclose(still.importance_factor, [0, 0.5, 1.5])
    assert seen(sight, world, [(0.1, 0.0)], Conditions(situation="night")).importance_factor.tolist() == [0, 1, 1]
    looked_for = seen(sight, world, [(0.2, 0.0)], Conditions(attention={"gold": 4.0}))
    np.testing.assert_allclose(looked_for.importance_factor, [0, 0.5, 6.0])
    np.testing.assert_allclose(seen(sight, world, [(0.3, 0.0)], Conditions()).importance_factor, [0, 0.5, 1.5])


def test_a_step_aside_lowers_the_visibility_of_near_things_more() -> None:
    world = World(two_spheres().scene)
    frames = [(0.0, -0.1), (0.5, 0.0)]
    still = seen(ObjectSight(world), world, frames, Conditions())
    slow = seen(ObjectSight(world), world, frames, Conditions(view_speed=2.0))
    # 0.1 m in half a second, in pictures of 8 m and of 4 m: 0.025 and 0.05 widths a second.
    np.testing.assert_allclose(still.speed[1:], [0.025, 0.05], rtol=1e-5)
    np.testing.assert_allclose(slow.visibility[1:], still.visibility[1:] / [1.05, 1.1], rtol=1e-5)


def test_letters_need_no_frame_to_have_begun() -> None:
    world = World(two_spheres().scene)
    found = ObjectSight(world).letters(world, view(), np.array([20000, 0, 0]))
    assert np.isfinite(found.visibility).all()
    assert found.speed.tolist() == [0, 0, 0]


def test_importance_of_nothing_is_nothing() -> None:
    assert importance_factors(Scene("s")).tolist() == [0.0]
    assert importance_factors(Scene("s", objects=[entry(default=0.0)] * 2)).tolist() == [0.0, 0.0, 0.0]
