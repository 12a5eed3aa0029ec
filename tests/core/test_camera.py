"""Cameras: fields of view, projections, jitter and looking at things."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scene_kit import at, turned

from phrt.camera import CameraView, look_at, rigid
from phrt.model import CameraLens


def view_of(width: int = 200, height: int = 100, matrix: np.ndarray | None = None, **lens: float) -> CameraView:
    return CameraView.from_lens(CameraLens(**lens), np.eye(4) if matrix is None else matrix, width, height)  # type: ignore[arg-type]


def pixel_of(view: CameraView, point: tuple[float, float, float]) -> np.ndarray:
    """Pixel coordinates and clip depth (z / w) of a world point."""
    clip = view.clip_from_world() @ [*point, 1.0]
    x, y, z = clip[:3] / clip[3]
    return np.array([(x + 1) / 2 * view.width, (1 - y) / 2 * view.height, z])


def test_the_vertical_field_of_view_is_kept_at_any_aspect() -> None:
    for size in ((200, 100), (100, 200), (50, 50)):
        view = view_of(*size, fov_y=1.2)
        assert view.tan_half[1] == pytest.approx(math.tan(0.6))
        assert view.tan_half[0] / view.tan_half[1] == pytest.approx(size[0] / size[1])


@pytest.mark.parametrize(("size", "half_y"), [((200, 100), 1.0), ((300, 100), 1.0), ((100, 100), 2.0)])
def test_a_stated_aspect_is_never_cut(size: tuple[int, int], half_y: float) -> None:
    view = view_of(*size, fov_y=math.pi / 2, aspect=2.0)
    assert view.tan_half[1] == pytest.approx(half_y)
    assert view.tan_half[0] >= 2.0 - 1e-9


@pytest.mark.parametrize("far", [math.inf, 40.0])
def test_perspective_puts_points_where_similar_triangles_say(far: float) -> None:
    view = view_of(fov_y=math.pi / 2, near=0.5, far=far)
    np.testing.assert_allclose(pixel_of(view, (0, 0, -3))[:2], [100, 50])
    np.testing.assert_allclose(pixel_of(view, (0, 3, -3))[:2], [100, 0], atol=1e-9)
    np.testing.assert_allclose(pixel_of(view, (3, -1.5, -3))[:2], [150, 75])
    assert pixel_of(view, (0, 0, -0.5))[2] == pytest.approx(-1)
    if math.isfinite(far):
        assert pixel_of(view, (0, 0, -far))[2] == pytest.approx(1)
    else:
        assert pixel_of(view, (0, 0, -1e9))[2] == pytest.approx(1, abs=1e-6)


def test_orthographic_height_is_the_pictures_height_at_any_distance() -> None:
    view = view_of(ortho_height=4.0, near=1.0, far=11.0)
    assert view.orthographic
    for z in (-1.0, -11.0):
        np.testing.assert_allclose(pixel_of(view, (4, 2, z))[:2], [200, 0], atol=1e-9)
    assert pixel_of(view, (0, 0, -1))[2] == pytest.approx(-1)
    assert pixel_of(view, (0, 0, -11))[2] == pytest.approx(1)


@pytest.mark.parametrize("lens", [{"fov_y": 1.0}, {"ortho_height": 4.0}])
def test_a_sample_to_the_right_and_down_sees_what_lies_there(lens: dict[str, float]) -> None:
    view = view_of(**lens)
    still, jittered = pixel_of(view, (0.2, 0.1, -3)), pixel_of(view.with_jitter(0.25, -0.5), (0.2, 0.1, -3))
    np.testing.assert_allclose(jittered[:2], still[:2] - [0.25, -0.5], atol=1e-9)


def test_pixel_spread_is_a_pixels_width_at_one_metre() -> None:
    assert view_of(fov_y=math.pi / 2).pixel_spread == pytest.approx(2 / 100)
    assert view_of(ortho_height=5.0).pixel_spread == pytest.approx(5 / 100)


def test_view_from_world_undoes_world_from_view() -> None:
    view = view_of(matrix=look_at((1, 2, 3), (-2, 0, 5)))
    np.testing.assert_allclose(view.view_from_world() @ view.world_from_view, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(view.position, [1, 2, 3])


@pytest.mark.parametrize("target", [(0, 0, 0), (5, 1, -2), (1, 9, 3), (1, -9, 3), (1, 2, 3)])
def test_look_at_is_rigid_and_looks_there(target: tuple[float, float, float]) -> None:
    eye = (1.0, 2.0, 3.0)
    matrix = look_at(eye, target)
    np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1)
    np.testing.assert_array_equal(matrix[:3, 3], eye)
    ahead = np.subtract(target, eye)
    if np.linalg.norm(ahead):
        np.testing.assert_allclose(-matrix[:3, 2], ahead / np.linalg.norm(ahead), atol=1e-12)
        assert matrix[1, 1] >= -1e-12, "not upside down"


def test_scale_and_shear_of_a_cameras_node_are_ignored() -> None:
    pose = at(1, 2, 3) @ turned("y", 40) @ turned("x", -20)
    np.testing.assert_allclose(rigid(pose @ np.diag([3.0, 0.5, 2.0, 1.0])), pose, atol=1e-12)
    shear = np.eye(4)
    shear[0, 1] = 0.5
    result = rigid(pose @ shear)
    np.testing.assert_allclose(result[:3, :3] @ result[:3, :3].T, np.eye(3), atol=1e-12)
