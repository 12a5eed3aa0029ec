"""Speeds in the picture against hand-computed ones, and where there is none: first frames, cuts, time that does not pass."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scene_kit import turned

from phrt.camera import CameraView
from phrt.view_motion import ViewMotion, picture_place


def view(matrix: np.ndarray | None = None, **changes: Any) -> CameraView:
    """200x100, tangents of the half fields of view 1 and 0.5: a picture is 2 m wide at 1 m."""
    return CameraView(200, 100, np.eye(4) if matrix is None else matrix, (1.0, 0.5), **changes)


def moved(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def speeds(
    before: list[tuple[float, float, float]],
    now: list[tuple[float, float, float]],
    then_view: CameraView,
    now_view: CameraView,
    seconds: float = 0.5,
    distance: float = 4.0,
) -> tuple[np.ndarray, float]:
    motion = ViewMotion()
    motion.advance(np.array(before, float).reshape(-1, 3), then_view, 1.0, distance)
    return motion.advance(np.array(now, float).reshape(-1, 3), now_view, 1.0 + seconds, distance)


def test_places_are_in_half_widths_and_half_heights() -> None:
    place, ahead = picture_place(np.array([(2.0, 0, -4), (0, 1.0, -4), (0, 0, 4.0)]), view())
    np.testing.assert_allclose(place[:2], [(0.5, 0), (0, 0.5)])
    assert ahead.tolist() == [True, True, False]


def test_an_objects_own_movement_counts_for_it_and_not_for_the_view() -> None:
    # 1 m to the right at 4 m, where the picture is 8 m wide: an eighth of it in half a second. Up is as far as right.
    centers = [(0.0, 0.0, -4.0)] * 3
    found, whole = speeds(centers, [(1.0, 0, -4), (0, 1.0, -4), (0, 0, -4)], view(), view())
    assert found == pytest.approx([0.25, 0.25, 0.0])
    assert whole == 0.0


def test_a_step_aside_moves_near_things_more_and_the_view_as_what_is_typically_far() -> None:
    found, whole = speeds([(0, 0, -2), (0, 0, -8)], [(0, 0, -2), (0, 0, -8)], view(), view(moved(x=0.5)))
    assert found == pytest.approx([0.25, 0.0625])
    assert whole == pytest.approx(0.125)


def test_a_turn_moves_everything_alike_near_the_axis() -> None:
    degrees = 2.0
    found, whole = speeds([(0, 0, -3), (0, 0, -900)], [(0, 0, -3), (0, 0, -900)], view(), view(turned("y", degrees)))
    expected = math.tan(math.radians(degrees)) / 2 / 0.5
    assert found == pytest.approx([expected, expected])
    assert whole == pytest.approx(expected, rel=0.2), "what is off the axis moves a little more"


def test_a_walk_ahead_moves_the_view_although_its_centre_stands_still() -> None:
    found, whole = speeds([(0, 0, -4)], [(0, 0, -4)], view(), view(moved(z=-1.0)))
    assert found == pytest.approx([0.0])
    # Points at 4 m ahead now were at 5 m: their places moved out by a fifth of 0.5 half widths or half heights.
    offsets = [math.hypot(x * 0.1 * 0.5, y * 0.1 * 0.25) for x in (-1, 0, 1) for y in (-1, 0, 1)]
    assert whole == pytest.approx(np.mean(offsets) / 0.5)


def test_with_nothing_in_view_only_turning_counts() -> None:
    assert speeds([], [], view(), view(moved(x=3.0)), distance=math.inf)[1] == pytest.approx(0.0, abs=1e-5)
    assert speeds([], [], view(), view(turned("x", 2.0)), distance=math.inf)[1] > 0.03


def test_an_orthographic_view_moves_by_its_width() -> None:
    flat = view(orthographic=True)
    found, whole = speeds([(0, 0, -4)], [(0, 0, -4)], flat, view(moved(x=0.5), orthographic=True))
    assert found == pytest.approx([0.5])
    assert whole == pytest.approx(0.5)


def test_speed_does_not_depend_on_the_frame_rate() -> None:
    fast = speeds([(0, 0, -4)], [(0.1, 0, -4)], view(), view(), seconds=0.01)[0]
    slow = speeds([(0, 0, -4)], [(1.0, 0, -4)], view(), view(), seconds=0.1)[0]
    assert fast == pytest.approx(slow)


def test_the_first_frame_stands_still() -> None:
    found, whole = ViewMotion().advance(np.zeros((3, 3)), view(), 7.0, 4.0)
    assert (found.tolist(), whole) == ([0, 0, 0], 0.0)


@pytest.mark.parametrize("seconds", [0.0, -0.5])
def test_time_that_stands_still_or_goes_back_has_no_speeds(seconds: float) -> None:
    found, whole = speeds([(0, 0, -4)], [(1, 0, -4)], view(), view(moved(x=0.5)), seconds)
    assert (found.tolist(), whole) == ([0.0], 0.0)


def test_after_time_went_back_speeds_are_measured_again() -> None:
    motion = ViewMotion()
    motion.advance(np.array([(0.0, 0, -4)]), view(), 5.0, 4.0)
    motion.advance(np.array([(0.0, 0, -4)]), view(), 1.0, 4.0)
    assert motion.advance(np.array([(1.0, 0, -4)]), view(), 1.5, 4.0)[0] == pytest.approx([0.25])


@pytest.mark.parametrize("cut", [turned("y", 180), turned("y", 80), moved(x=40.0), moved(0, -9.0, 2.0)])
def test_a_cut_is_no_movement(cut: np.ndarray) -> None:
    found, whole = speeds([(0, 0, -4), (1, 0, -4)], [(0, 0, -4), (1, 0, -4)], view(), view(cut))
    assert (found.tolist(), whole) == ([0.0, 0.0], 0.0)


def test_an_object_that_jumps_has_no_speed_while_others_have() -> None:
    found, _ = speeds([(-20, 0, -4), (0, 0, -4)], [(0, 0, -4), (1, 0, -4)], view(), view())
    assert found == pytest.approx([0.0, 0.25])


def test_objects_at_and_behind_the_eye_have_finite_speeds() -> None:
    before = [(0, 0, 0), (0, 0, 4), (0, 0, -1e-9), (1e-9, 0, -1e-15), (5, 5, 1e-15)]
    now = [(0, 0, -4), (0, 0, -4), (1e-9, 0, -1e-9), (0, 0, 0), (-5, 0, -1e-9)]
    found, whole = speeds([*map(tuple, before)], [*map(tuple, now)], view(), view())  # type: ignore[list-item]
    assert found.dtype == np.float32
    assert np.isfinite(found).all()
    assert math.isfinite(whole)


def test_what_is_handed_in_may_change_afterwards() -> None:
    motion, centers = ViewMotion(), np.array([(0.0, 0, -4)])
    motion.advance(centers, view(), 0.0, 4.0)
    centers[0, 0] = 1.0
    assert motion.advance(centers, view(), 0.5, 4.0)[0] == pytest.approx([0.25])
