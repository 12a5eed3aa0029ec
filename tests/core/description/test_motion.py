"""Places, animations and camera paths: where things are at and between keyframes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phrt.animation import Animator, decompose
from phrt.description.motion import euler_matrix, interpolated, matrix_of, tangents
from phrt.description.prims import Xform
from phrt.scene import Scene

Load = Callable[..., Scene]

ANGLE = st.floats(-180, 180)
COORDINATE = st.floats(-100, 100)
KEYS = (
    "        - {time: 0, eye: [0, 1, 5], target: [0, 1, 0]}\n"
    "        - {time: 1, eye: [4, 2, 4], target: [0, 1, 0]}\n"
    "        - {time: 3, eye: [6, 1, -2], target: [1, 0, 0]}\n"
)


def camera_scene(load: Load, interpolation: str) -> Scene:
    return load(f"prims:\n  C:\n    type: Camera\n    path:\n      interpolation: {interpolation}\n      keys:\n{KEYS}")


def view_at(scene: Scene, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Eye and unit view direction of the first camera."""
    matrix = Animator(scene).world_from_node(time)[scene.cameras[0].node]
    return matrix[:3, 3], -matrix[:3, 2]


@pytest.mark.parametrize("interpolation", ["linear", "smooth", "step"])
def test_a_camera_path_passes_through_its_keys_and_looks_at_their_targets(load: Load, interpolation: str) -> None:
    scene = camera_scene(load, interpolation)
    assert scene.duration == 3
    for time, eye, target in ((0, (0, 1, 5), (0, 1, 0)), (1, (4, 2, 4), (0, 1, 0)), (3, (6, 1, -2), (1, 0, 0))):
        position, direction = view_at(scene, time)
        wanted = np.subtract(target, eye) / np.linalg.norm(np.subtract(target, eye))
        assert position == pytest.approx(np.array(eye), abs=1e-9)
        assert direction == pytest.approx(wanted, abs=1e-9)


def test_a_linear_path_is_straight_and_keeps_its_target_in_the_middle_between_keys(load: Load) -> None:
    scene = camera_scene(load, "linear")
    for time in np.linspace(0, 1, 41):
        position, direction = view_at(scene, time)
        eye = np.array([4 * time, 1 + time, 5 - time])
        wanted = (np.array([0, 1, 0]) - eye) / np.linalg.norm(np.array([0, 1, 0]) - eye)
        assert position == pytest.approx(eye, abs=1e-9)
        assert np.degrees(np.arccos(min(direction @ wanted, 1))) < 0.05


def test_a_smooth_path_has_no_corner_at_a_key(load: Load) -> None:
    scene = camera_scene(load, "smooth")
    step = 1e-4
    before = (view_at(scene, 1)[0] - view_at(scene, 1 - step)[0]) / step
    after = (view_at(scene, 1 + step)[0] - view_at(scene, 1)[0]) / step
    assert before == pytest.approx(after, abs=1e-2)
    # The Catmull-Rom slope at a key: the way between its neighbours over the time between them.
    assert before == pytest.approx(np.array([6, 0, -7]) / 3, abs=1e-2)


def test_the_horizon_stays_level_along_the_path(load: Load) -> None:
    scene = camera_scene(load, "smooth")
    for time in np.linspace(0, 3, 50):
        right = Animator(scene).world_from_node(time)[scene.cameras[0].node][:3, 0]
        assert abs(right[1]) < 1e-3


def test_a_camera_can_walk_by_translate_and_rotate(load: Load) -> None:
    scene = load(
        "prims:\n  C:\n    type: Camera\n    path:\n      interpolation: linear\n      keys:\n"
        "        - {time: 0, translate: [0, 0, 0], rotate: [0, 0, 0]}\n"
        "        - {time: 2, translate: [2, 0, 0], rotate: [0, 90, 0]}\n"
    )
    position, direction = view_at(scene, 1)
    assert position == pytest.approx([1, 0, 0], abs=1e-9)
    assert direction == pytest.approx([-(0.5**0.5), 0, -(0.5**0.5)], abs=1e-6)


def test_look_at_places_a_still_camera(load: Load) -> None:
    scene = load("prims:\n  C: {type: Camera, fov: 60, look_at: {eye: [3, 0, 0], target: [0, 0, 0]}}\n")
    position, direction = view_at(scene, 0)
    assert position.tolist() == [3, 0, 0]
    assert direction == pytest.approx([-1, 0, 0])
    assert scene.cameras[0].lens.fov_y == pytest.approx(np.pi / 3)


def test_an_animation_turns_whole_turns(load: Load) -> None:
    scene = load(
        "prims:\n  Wheel:\n    type: Box\n    xform:\n      scale: 2\n      animation:\n        keys:\n"
        "          - {time: 0, rotate: [0, 0, 0]}\n          - {time: 4, rotate: [0, 0, 360]}\n"
    )
    for time, corner in ((1, [0, 2, 0]), (2, [-2, 0, 0]), (3, [0, -2, 0])):
        assert Animator(scene).world_from_node(time)[0][:3, 0] == pytest.approx(corner, abs=1e-6)


def test_an_animated_child_moves_with_its_parent(load: Load) -> None:
    scene = load(
        "prims:\n  P:\n    xform: {translate: [0, 5, 0]}\n    children:\n      B:\n        type: Box\n        xform:\n"
        "          animation: {keys: [{time: 0, translate: [0, 0, 0]}, {time: 2, translate: [4, 0, 0]}]}\n"
    )
    node = next(k for k, entry in enumerate(scene.nodes) if entry.path == "/P/B")
    assert Animator(scene).world_from_node(1)[node][:3, 3].tolist() == [2, 5, 0]


def test_euler_angles_turn_about_x_first() -> None:
    # Y goes to Z by the turn about X, and stays there by the turn about Z.
    assert euler_matrix((90, 0, 90)) @ [0, 1, 0] == pytest.approx([0, 0, 1])
    # X goes to -Z by the turn about Y.
    assert euler_matrix((0, 90, 0)) @ [1, 0, 0] == pytest.approx([0, 0, -1])


@settings(max_examples=60, deadline=None)
@given(st.tuples(COORDINATE, COORDINATE, COORDINATE), st.tuples(ANGLE, ANGLE, ANGLE), st.floats(0.01, 100))
def test_an_xform_keeps_its_parts(
    translate: tuple[float, float, float], rotate: tuple[float, float, float], scale: float
) -> None:
    matrix = matrix_of(Xform(translate=translate, rotate=rotate, scale=(scale, scale, scale)))
    place, _, factor = decompose(matrix)
    assert place == pytest.approx(np.array(translate))
    assert factor == pytest.approx(np.full(3, scale))
    assert matrix[:3, :3] / scale == pytest.approx(euler_matrix(rotate), abs=1e-7)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.1, 5), COORDINATE), min_size=2, max_size=8), st.sampled_from(["linear", "smooth"])
)
def test_curves_pass_through_their_keys_whatever_the_spacing(keys: list[tuple[float, float]], how: str) -> None:
    times = np.cumsum([gap for gap, _ in keys])
    values = np.array([[value] for _, value in keys])
    assert interpolated(times, values, times, how) == pytest.approx(values, abs=1e-6)  # type: ignore[arg-type]


def test_catmull_rom_slopes_of_a_straight_line_are_its_slope() -> None:
    times = np.array([0.0, 1.0, 4.0, 4.5])
    assert tangents(times, times[:, None] * 3) == pytest.approx(np.full((4, 1), 3.0))
