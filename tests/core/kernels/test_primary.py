"""Eye rays, the order of pixels and motion vectors."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_kit import random_view

from phrt.kernels.motion import motion_vectors
from phrt.kernels.primary import eye_rays, row_order, tile_order


@pytest.mark.parametrize("orthographic", [False, True])
def test_eye_rays_start_near_end_far_and_project_back_onto_their_pixels(orthographic: bool) -> None:
    view = random_view(np.random.default_rng(1), 31, 17, orthographic=orthographic)
    pixels = np.random.default_rng(2).permutation(31 * 17).astype(np.int32)[:200]
    origin, direction = np.empty((200, 3), np.float32), np.empty((200, 3), np.float32)
    t_max = np.empty(200, np.float32)
    eye_rays(
        pixels, 31, 17, view.world_from_view.astype(np.float32), np.array(view.tan_half, np.float32),
        np.array(view.jitter, np.float32), orthographic, np.float32(view.near), np.float32(view.far),
        origin, direction, t_max,
    )  # fmt: skip
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1, atol=1e-6)
    for share, depth in ((0.0, view.near), (0.3, None), (1.0, view.far)):
        point = origin + direction * (t_max * share)[:, None]
        local = np.c_[point, np.ones(200)] @ view.view_from_world().T
        if depth is not None:
            np.testing.assert_allclose(-local[:, 2], depth, rtol=1e-4)
        # The rasterizer's projection is an independent statement of where a pixel's sample lies: its centre.
        clip = local @ view.clip_from_view().T
        ndc = clip[:, :2] / clip[:, 3:]
        x, y = (ndc[:, 0] + 1) / 2 * 31, (1 - ndc[:, 1]) / 2 * 17
        np.testing.assert_allclose(np.c_[x, y], np.c_[pixels % 31, pixels // 31] + 0.5, atol=2e-3)


@pytest.mark.parametrize("size", [(16, 8), (37, 23), (1, 5), (640, 360)])
def test_tile_order_holds_every_pixel_once(size: tuple[int, int]) -> None:
    order = tile_order(*size)
    np.testing.assert_array_equal(np.sort(order), np.arange(size[0] * size[1]))
    assert order.dtype == np.int32
    assert not order.flags.writeable


def test_tile_order_keeps_sixteen_neighbours_together() -> None:
    y, x = np.divmod(tile_order(64, 32).reshape(-1, 16), 64)
    assert np.all(np.ptp(x, axis=1) == 3)
    assert np.all(np.ptp(y, axis=1) == 3)
    y, x = np.divmod(tile_order(64, 32).reshape(-1, 64), 64)
    assert np.all(np.ptp(x, axis=1) == 7)
    assert np.all(np.ptp(y, axis=1) == 7)


@pytest.mark.parametrize("size", [7, 64, 5000])
def test_row_order_goes_through_each_run_of_tiles_row_by_row(size: int) -> None:
    pixels, order = tile_order(37, 23), row_order(37, 23, size)
    assert order.dtype == np.int32
    for first in range(0, len(pixels), size):
        run = pixels[first : first + size]
        np.testing.assert_array_equal(run[order[first : first + size]], np.sort(run))


def test_motion_is_where_the_point_was_minus_where_it_is() -> None:
    rng = np.random.default_rng(3)
    now, before = random_view(rng, 40, 30), random_view(rng, 40, 30)
    # Points in front of both eyes.
    target = (now.position + before.position) / 2 - (now.world_from_view[:3, 2] + before.world_from_view[:3, 2]) * 20
    position = (target + rng.uniform(-1, 1, (50, 3))).astype(np.float32)
    ids = rng.integers(0, 3, 50).astype(np.uint32)
    delta = np.tile(np.eye(4, dtype=np.float32), (3, 1, 1))
    delta[2, :3, 3] = 0.3, -0.2, 0.1
    motion = np.full((50, 2), np.nan, np.float32)
    clip, previous = (v.clip_from_world() for v in (now, before))
    size = np.array([40, 30], np.float32)
    motion_vectors(position, ids, delta, clip.astype(np.float32), previous.astype(np.float32), size, motion)

    def pixel(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
        c = np.c_[points, np.ones(len(points))] @ matrix.T
        return np.c_[(c[:, 0] / c[:, 3] + 1) / 2 * 40, (1 - c[:, 1] / c[:, 3]) / 2 * 30]

    expected = pixel(previous, position + delta[ids, :3, 3]) - pixel(clip, position)
    expected[ids == 0] = 0
    assert np.abs(expected).max() > 1
    np.testing.assert_allclose(motion, expected, rtol=1e-3, atol=1e-2)
