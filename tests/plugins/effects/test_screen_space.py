"""Screen-space ambient occlusion: right where it can be computed, and nearer to what is traced than none."""

import numpy as np
import pytest
from scene_kit import LAMBERT, Stage, at, box, floor, quad, render, turned

from phrt.scene import Scene

OPTIONS = {"fallback": "screen_space", "radius": 2.0}
SIZE = (96, 64)


def occlusion(scene: Scene, heuristic: str = "raster_only", **options: object) -> np.ndarray:
    """(H, W) the layer."""
    effects = {"ambient_occlusion": OPTIONS | options}
    frame = render(scene, SIZE, heuristic=heuristic, effects=effects, gbuffer="raycast")
    return frame.layers["ambient_occlusion"][..., 0]


def yard() -> Stage:
    made = Stage(dome=(1.0, 1.0, 1.0))
    made.add("/floor", floor(40.0))
    return made


@pytest.mark.parametrize("eye", [(0.0, 3.0, 0.01), (0.0, 2.0, 4.0), (3.0, 0.4, 6.0)])
def test_a_plane_is_open_however_it_is_seen(eye: tuple[float, float, float]) -> None:
    scene = yard().camera(eye, (0.0, 0.0, 0.0)).scene
    np.testing.assert_allclose(occlusion(scene), 1.0, atol=1e-3)


def test_a_plane_is_open_to_an_orthographic_camera() -> None:
    scene = yard().camera((0.0, 3.0, 4.0), (0.0, 0.0, 0.0), ortho_height=4.0).scene
    np.testing.assert_allclose(occlusion(scene), 1.0, atol=1e-3)


def test_at_the_foot_of_a_high_wall_half_is_open() -> None:
    """A wall that covers one side of the hemisphere takes half of its cosine-weighted solid angle, less what is off the picture."""
    made = yard().add("/wall", quad(40.0, 40.0), matrix=at(0.0, 0.0, -0.5))
    scene = made.camera((0.0, 3.0, 1.5), (0.0, 0.0, -0.3)).scene
    frame = render(
        scene,
        SIZE,
        heuristic="raster_only",
        effects={"ambient_occlusion": OPTIONS | {"radius": 30.0}},
        gbuffer="raycast",
    )
    position = frame.gbuffer.arrays["position_world"]
    foot = (np.abs(position[..., 2] + 0.45) < 0.04) & (position[..., 1] < 0.01) & (np.abs(position[..., 0]) < 1.0)
    assert foot.sum() > 20
    assert 0.48 < frame.layers["ambient_occlusion"][..., 0][foot].mean() < 0.62


def test_it_is_nearer_to_what_is_traced_than_none() -> None:
    made = (
        yard()
        .add("/box", box(2.0, 2.0, 2.0), matrix=at(0.0, 1.0, 0.0))
        .add("/wall", quad(12.0, 6.0), LAMBERT, at(0.0, 3.0, -2.0))
    )
    made.add("/side", quad(8.0, 6.0), LAMBERT, at(-3.0, 3.0, 2.0) @ turned("y", 90.0))
    scene = made.camera((4.0, 3.0, 6.0), (0.0, 1.0, -0.5)).scene
    traced = occlusion(scene, "all_trace", samples=64)
    open_everywhere, on_screen = np.abs(1.0 - traced).mean(), np.abs(occlusion(scene) - traced).mean()
    assert on_screen < 0.6 * open_everywhere


def test_a_radius_that_is_out_of_reach_leaves_everything_open() -> None:
    made = yard().add("/wall", quad(12.0, 6.0), LAMBERT, at(0.0, 3.0, -3.0))
    scene = made.camera((0.0, 3.0, 6.0), (0.0, 0.0, 1.0)).scene
    np.testing.assert_allclose(occlusion(scene, radius=1e-3), 1.0, atol=1e-3)


def test_threads_and_pixels_asked_for_change_nothing() -> None:
    made = yard().add("/box", box(2.0, 2.0, 2.0), matrix=at(0.0, 1.0, 0.0))
    scene = made.camera((4.0, 3.0, 6.0), (0.0, 1.0, -0.5)).scene
    effects = {"ambient_occlusion": OPTIONS}
    one, four = (
        render(scene, SIZE, heuristic="raster_only", effects=effects, gbuffer="raycast", threads=count).image
        for count in (1, 4)
    )
    np.testing.assert_array_equal(one, four)
