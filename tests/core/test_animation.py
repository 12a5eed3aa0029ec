"""Keyframes and hierarchies, against glTF's formulas and closed answers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scene_kit import at, turned

from phrt.animation import Animator, compose, decompose, quaternion_of, rotation_matrix, sample, slerp
from phrt.model import Track
from phrt.scene import Scene, SceneNode

TIMES = np.array([1.0, 2.0, 4.0])
PLACES = np.array([[0.0, 0, 0], [1, 2, 3], [5, 2, -1]])


def quaternion(axis: str, degrees: float) -> np.ndarray:
    half = np.radians(degrees) / 2
    result = np.array([0.0, 0, 0, np.cos(half)])
    result["xyz".index(axis)] = np.sin(half)
    return result


def track(
    target: Any = "translation", values: np.ndarray = PLACES, interpolation: Any = "linear", node: int = 0
) -> Track:
    return Track(node, target, TIMES[: len(values)], values, interpolation)


@pytest.mark.parametrize(
    ("time", "expected"),
    [(0, [0, 0, 0]), (1, [0, 0, 0]), (1.5, [0.5, 1, 1.5]), (2, [1, 2, 3]), (3, [3, 2, 1]), (4, [5, 2, -1]), (9, [5, 2, -1])],
)  # fmt: skip
def test_linear_tracks_go_straight_and_hold_at_their_ends(time: float, expected: list[float]) -> None:
    np.testing.assert_allclose(sample(track(), time), expected)


@pytest.mark.parametrize(("time", "key"), [(0.0, 0), (1.999, 0), (2.0, 1), (3.999, 1), (4.0, 2), (5.0, 2)])
def test_step_tracks_keep_the_last_key(time: float, key: int) -> None:
    np.testing.assert_array_equal(sample(track(interpolation="step"), time), PLACES[key])


def test_cubic_tracks_are_hermite_splines() -> None:
    # Keys and slopes taken from a cubic polynomial: a Hermite spline gives it back exactly, between keys too.
    def curve(t: Any) -> np.ndarray:
        return np.stack([t**3 - 2 * t, 4 - t**2, 0.5 * t**3 + t], axis=-1)

    def slope(t: Any) -> np.ndarray:
        return np.stack([3 * t**2 - 2, -2 * t, 1.5 * t**2 + 1], axis=-1)

    values = np.stack([slope(TIMES), curve(TIMES), slope(TIMES)], axis=1)
    spline = track(values=values, interpolation="cubic")
    for time in np.linspace(1, 4, 13):
        np.testing.assert_allclose(sample(spline, time), curve(time), atol=1e-9)
    np.testing.assert_allclose(sample(spline, 0.0), curve(1.0))
    np.testing.assert_allclose(sample(spline, 7.0), curve(4.0))


def test_in_and_out_tangents_are_not_confused() -> None:
    values = np.zeros((2, 3, 3))
    values[0, 2] = 3.0  # out of the first key
    values[1, 0] = 100.0  # into the second
    values[0, 0] = values[1, 2] = 1e6  # outside of the span: of no effect
    # Hermite at s = 1/2 over one second: (s^3 - 2 s^2 + s) = 1/8 and (s^3 - s^2) = -1/8.
    np.testing.assert_allclose(sample(track(values=values, interpolation="cubic"), 1.5), np.full(3, 3 / 8 - 100 / 8))


def test_cubic_rotations_stay_unit() -> None:
    keys = np.stack([quaternion("y", 0), quaternion("y", 90)])
    values = np.stack([np.ones_like(keys), keys, np.ones_like(keys)], axis=1)
    for time in (1.0, 1.3, 1.9):
        assert np.linalg.norm(sample(track("rotation", values, "cubic"), time)) == pytest.approx(1)


@pytest.mark.parametrize("degrees", [1.0, 60.0, 170.0])
def test_rotations_turn_evenly(degrees: float) -> None:
    keys = np.stack([quaternion("z", 0), quaternion("z", degrees)])
    for fraction in (0.0, 0.25, 0.5, 0.9):
        found = rotation_matrix(sample(track("rotation", keys), 1 + fraction))
        np.testing.assert_allclose(found, turned("z", degrees * fraction)[:3, :3], atol=1e-6)


def test_slerp_takes_the_short_way_round() -> None:
    a, b = quaternion("x", 10), -quaternion("x", 50)
    np.testing.assert_allclose(rotation_matrix(slerp(a, b, 0.5)), turned("x", 30)[:3, :3], atol=1e-12)


@pytest.mark.parametrize("axis", "xyz")
@pytest.mark.parametrize("degrees", [0, 30, 90, 180, 200, 359])
def test_quaternions_and_matrices_agree(axis: str, degrees: float) -> None:
    matrix = turned(axis, degrees)[:3, :3]
    np.testing.assert_allclose(rotation_matrix(quaternion(axis, degrees)), matrix, atol=1e-12)
    np.testing.assert_allclose(rotation_matrix(quaternion_of(matrix)), matrix, atol=1e-12)


@pytest.mark.parametrize("scale", [(1, 1, 1), (2, 0.5, 3), (-1, 2, 1), (1, -2, 1), (-1, -1, -1), (0, 1, 1)])
def test_a_matrix_survives_being_taken_apart(scale: tuple[float, float, float]) -> None:
    matrix = at(1, 2, 3) @ turned("y", 40) @ turned("x", 70) @ np.diag([*scale, 1.0])
    if 0 in scale:
        assert np.isfinite(compose(*decompose(matrix))).all()
    else:
        np.testing.assert_allclose(compose(*decompose(matrix)), matrix, atol=1e-9)


def nodes() -> Scene:
    """A still node, a turning one below it, a still one below that, and a bystander."""
    scene = Scene("test")
    scene.nodes = [
        SceneNode("/a", -1, at(10, 0, 0)),
        SceneNode("/a/b", 0, at(0, 1, 0) @ np.diag([2.0, 2, 2, 1])),
        SceneNode("/a/b/c", 1, at(1, 0, 0)),
        SceneNode("/d", -1, at(0, 0, 7)),
    ]
    keys = np.stack([quaternion("z", 0), quaternion("z", 90)])
    scene.tracks = [Track(1, "rotation", np.array([0.0, 1.0]), keys)]
    return scene


def test_children_follow_their_parents_and_untouched_properties_stay() -> None:
    animator = Animator(nodes())
    start, end = animator.world_from_node(0.0), animator.world_from_node(1.0)
    np.testing.assert_allclose(start[2][:3, 3], [12, 1, 0], atol=1e-12)
    np.testing.assert_allclose(end[2][:3, 3], [10, 3, 0], atol=1e-12)
    np.testing.assert_allclose(end[1], at(10, 1, 0) @ turned("z", 90) @ np.diag([2.0, 2, 2, 1]), atol=1e-12)
    for still in (0, 3):
        np.testing.assert_array_equal(start[still], end[still])


def test_several_tracks_of_one_node_act_together() -> None:
    scene = nodes()
    scene.tracks.append(Track(1, "scale", np.array([0.0, 1.0]), np.array([[2.0, 2, 2], [4, 4, 4]])))
    scene.tracks.append(Track(1, "translation", np.array([0.0, 1.0]), np.array([[0.0, 1, 0], [0, 0, 5]])))
    found = Animator(scene).world_from_node(1.0)[1]
    np.testing.assert_allclose(found, at(10, 0, 5) @ turned("z", 90) @ np.diag([4.0, 4, 4, 1]), atol=1e-12)


def test_answers_are_fresh_arrays() -> None:
    animator = Animator(nodes())
    animator.world_from_node(0.5)[:] = np.nan
    assert np.isfinite(animator.world_from_node(0.5)).all()


def test_a_track_without_keys_changes_nothing() -> None:
    scene = nodes()
    scene.tracks = [Track(1, "translation", np.zeros(0), np.zeros((0, 3)))]
    np.testing.assert_allclose(Animator(scene).world_from_node(3.0)[1], scene.nodes[0].matrix @ scene.nodes[1].matrix)
    assert scene.duration == 0
