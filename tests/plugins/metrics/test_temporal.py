"""Change from frame to frame: still, flickering, shifted by a known motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from metric_kit import SHAPE, codes, found, noise, waves

import phrt
from phrt.output.tonemap import to_8bit
from phrt.testing.metrics import shot_of as shot
from phrt_plugins.metrics.temporal import bilinear, compensated_difference


def motion_of(x: float, y: float = 0.0) -> np.ndarray:
    """The same motion everywhere."""
    return np.broadcast_to(np.array([x, y], np.float32), (*SHAPE[:2], 2)).copy()


def test_a_frame_without_a_previous_one_has_no_answer() -> None:
    assert found("temporal", shot(noise(), waves(), motion=motion_of(0))) == {}


def test_without_motion_there_is_no_compensation() -> None:
    values = found("temporal", shot(noise(), waves(), previous=shot(noise(), waves())))
    assert set(values) == {"difference_error", "popping"}


def test_an_error_that_stays_does_not_count() -> None:
    now = shot(noise(), waves(), previous=shot(noise(), waves()), motion=motion_of(0))
    assert found("temporal", now) == {"difference_error": 0.0, "popping": 0.0, "compensated_difference": 0.0}


def test_a_picture_that_changes_as_the_reference_does_is_right() -> None:
    now = shot(waves(3), waves(3), previous=shot(waves(1), waves(1)), motion=motion_of(-2))
    assert found("temporal", now) == {"difference_error": 0.0, "popping": 0.0, "compensated_difference": 0.0}


@pytest.mark.parametrize("step", [51, -51])
def test_flicker_counts_in_full(step: int) -> None:
    now = shot(codes(100 + step), codes(100), previous=shot(codes(100), codes(100)), motion=motion_of(0))
    assert found("temporal", now) == pytest.approx(dict.fromkeys(("difference_error", "popping"), 0.2) | {
        "compensated_difference": 0.2
    })  # fmt: skip


def test_a_picture_that_lags_behind_is_wrong_by_the_references_change() -> None:
    now = shot(codes(100), codes(151), previous=shot(codes(100), codes(100)), motion=motion_of(0))
    values = found("temporal", now)
    assert values["difference_error"] == pytest.approx(0.2)
    # The picture is the steadier one.
    assert values["compensated_difference"] == pytest.approx(-0.2)


def test_compensation_follows_the_motion_and_not_its_opposite() -> None:
    now, before = (waves(shift) / np.float32(255) for shift in (3, 1))
    # What is here now was 2 pixels to the left: the channel says -2.
    right = compensated_difference(now, before, motion_of(-2))
    assert right == pytest.approx(0.0, abs=1e-6)
    assert compensated_difference(now, before, motion_of(2)) > 0.1
    assert compensated_difference(now, before, motion_of(0)) > 0.05


def test_the_second_component_points_down() -> None:
    now, before = noise(1), np.roll(noise(1), -3, axis=0)
    inner = motion_of(0, -3)
    assert compensated_difference(now / 255.0, before / 255.0, inner) == 0.0
    assert compensated_difference(now / 255.0, before / 255.0, -inner) > 0.2


def test_the_g_buffers_motion_is_the_one_it_takes() -> None:
    scene = phrt.load_scene(Path(__file__).resolve().parents[3] / "scenes" / "spheres.yaml")
    displays = []
    with phrt.Renderer(scene, size=(128, 72), heuristic="raster_only", gbuffer="raycast", threads=2) as renderer:
        for time in (1.0, 1.1):
            frame = renderer.render(time)
            motion = renderer.producer.render(frame.view, channels=("motion",)).arrays["motion"]
            displays.append(to_8bit(frame.image) / np.float32(255))
    before, now = displays
    followed, ignored, opposite = (compensated_difference(now, before, motion * factor) for factor in (1, 0, -1))
    assert np.abs(motion).max() > 2
    assert followed < 0.7 * ignored < ignored < opposite


def test_noise_on_a_moving_picture_is_less_steady_than_the_reference() -> None:
    rough = [np.clip(waves(s) + np.random.default_rng(s).normal(0, 12, SHAPE), 0, 255).astype(np.uint8) for s in (3, 1)]
    now = shot(rough[0], waves(3), previous=shot(rough[1], waves(1)), motion=motion_of(-2))
    assert found("temporal", now)["compensated_difference"] > 0.03


def test_motion_that_is_not_known_or_leaves_the_picture_is_left_out() -> None:
    now, before = codes(100) / 255.0, codes(100) / 255.0
    before[:, :8] = 1.0
    motion = motion_of(0)
    motion[:, :8] = np.nan
    assert compensated_difference(now, before, motion) == 0.0
    motion[:, :8] = (-9.0, 0.0)
    assert compensated_difference(now, before, motion) == 0.0
    motion[:, :8] = 0.0
    assert compensated_difference(now, before, motion) == pytest.approx(8 / 64 * 155 / 255)
    assert np.isnan(compensated_difference(now, before, motion_of(100)))


def test_popping_is_how_much_the_worst_hundredth_jumps() -> None:
    before, few, more = codes(100), codes(100), codes(100)
    # Of 2304 pixels 1 % are 23.
    few.reshape(-1, 3)[:20] = 202
    more.reshape(-1, 3)[:40] = 202
    for picture, expected in ((few, 0.0), (more, 0.4)):
        values = found("temporal", shot(picture, before, previous=shot(before, before)))
        assert values["popping"] == pytest.approx(expected)
        assert 0 < values["difference_error"] < 0.01


def test_bilinear_is_scipys() -> None:
    from scipy.ndimage import map_coordinates

    picture = noise(5)[..., 0] / 255.0
    random = np.random.default_rng(6)
    x, y = random.uniform(-0.5, SHAPE[1] - 0.5, 500), random.uniform(-0.5, SHAPE[0] - 0.5, 500)
    expected = map_coordinates(picture, [y, x], order=1, mode="nearest")
    assert bilinear(picture[..., None], x, y)[:, 0] == pytest.approx(expected)


def test_frames_of_two_sizes_are_refused() -> None:
    small = (20, 20, 3)
    with pytest.raises(ValueError, match=r"the picture is \(36, 64, 3\), the one before \(20, 20, 3\)"):
        found("temporal", shot(waves(), waves(), previous=shot(codes(0, small), codes(0, small))))
    with pytest.raises(ValueError, match=r"motion has shape \(2,\)"):
        found("temporal", shot(waves(), waves(), previous=shot(waves(), waves()), motion=np.zeros(2, np.float32)))
