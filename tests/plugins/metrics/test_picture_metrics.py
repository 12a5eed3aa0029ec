"""SSIM, PSNR, relMSE and the displays' error: answers worked out by hand, and other people's programs."""

from __future__ import annotations

import math

import needs
import numpy as np
import pytest
from metric_kit import SHAPE, codes, found, noise, waves

from phrt.testing.metrics import shot_of as shot
from phrt_plugins.metrics.ssim import inside, ssim_map

needs.package("skimage")


def half() -> np.ndarray:
    """The left half of the pixels."""
    chosen = np.zeros(SHAPE[:2], bool)
    chosen[:, : SHAPE[1] // 2] = True
    return chosen


# SSIM


def test_ssim_of_equal_pictures_is_1() -> None:
    values = found("ssim", shot(noise(), noise(), changeable=half()))
    assert values == pytest.approx({"ssim": 1.0, "ssim_changeable": 1.0})


def test_ssim_is_scikit_images_own() -> None:
    from skimage.metrics import structural_similarity

    expected = structural_similarity(waves(), noise(1), channel_axis=2)
    assert found("ssim", shot(noise(1), waves()))["ssim"] == pytest.approx(expected, abs=1e-5)


def test_the_map_of_ssim_follows_the_formula() -> None:
    """Wang et al. 2004, eq. (13), with scipy's box filter for the means."""
    from scipy.ndimage import uniform_filter

    a, b = noise(2)[..., :1] / 255.0, waves()[..., :1] / 255.0
    unbiased = 49 / 48

    def mean(values: np.ndarray) -> np.ndarray:
        return np.asarray(uniform_filter(values, (7, 7, 1)))

    variance_a, variance_b = (unbiased * (mean(v * v) - mean(v) ** 2) for v in (a, b))
    covariance = unbiased * (mean(a * b) - mean(a) * mean(b))
    expected = (2 * mean(a) * mean(b) + 1e-4) * (2 * covariance + 9e-4)
    expected /= (mean(a) ** 2 + mean(b) ** 2 + 1e-4) * (variance_a + variance_b + 9e-4)
    made = ssim_map(np.repeat(a, 3, axis=2), np.repeat(b, 3, axis=2))
    assert made.shape == SHAPE[:2]
    assert inside(made) == pytest.approx(inside(expected[..., 0]), abs=2e-4)


def test_ssim_of_changeable_pixels_does_not_see_the_others() -> None:
    picture, reference = waves(), waves()
    picture[:, 40:] = noise(3)[:, 40:]
    values = found("ssim", shot(picture, reference, changeable=half()))
    assert values["ssim_changeable"] == pytest.approx(1.0)
    assert values["ssim"] < 0.8


def test_ssim_has_no_answer_where_only_the_border_is_changeable() -> None:
    edge = np.zeros(SHAPE[:2], bool)
    edge[0] = True
    assert math.isnan(found("ssim", shot(noise(), waves(), changeable=edge))["ssim_changeable"])


def test_the_smallest_picture_has_one_whole_window() -> None:
    small = (7, 7, 3)
    values = found("ssim", shot(codes(51, small), codes(102, small)))
    # Flat: (2 a b + C1) / (a^2 + b^2 + C1).
    expected = (2 * 0.2 * 0.4 + 1e-4) / (0.2**2 + 0.4**2 + 1e-4)
    assert values == pytest.approx({"ssim": expected, "ssim_changeable": expected}, abs=1e-5)


# PSNR


def test_psnr_of_a_known_difference() -> None:
    # 51 codes are 0.2: MSE 0.04.
    values = found("psnr", shot(codes(100), codes(151), changeable=half()))
    assert values == pytest.approx({"psnr": 13.9794, "psnr_changeable": 13.9794}, abs=1e-4)


def test_psnr_is_scikit_images_own() -> None:
    from skimage.metrics import peak_signal_noise_ratio

    expected = peak_signal_noise_ratio(waves(), noise(1))
    assert found("psnr", shot(noise(1), waves()))["psnr"] == pytest.approx(expected, abs=1e-4)


def test_psnr_of_equal_pictures_is_the_cap() -> None:
    picture = waves()
    picture[:, 40:] = 0
    values = found("psnr", shot(picture, waves(), changeable=half()))
    assert values["psnr_changeable"] == 100.0
    assert values["psnr"] < 20.0
    assert found("psnr", shot(noise(), noise()))["psnr"] == 100.0


def test_psnr_of_what_is_nearly_equal_is_no_more_than_the_cap() -> None:
    shape = (230, 230, 3)
    one = codes(7, shape)
    one[100, 100, 1] = 8
    assert found("psnr", shot(one, codes(7, shape)))["psnr"] == 100.0


def test_psnr_of_no_pixel_is_left_out() -> None:
    none = np.zeros(SHAPE[:2], bool)
    assert math.isnan(found("psnr", shot(waves(), noise(), changeable=none))["psnr_changeable"])


# relMSE


def test_relmse_by_hand() -> None:
    reference = np.full(SHAPE, 2.0, np.float32)
    image = reference.copy()
    image[:, :32] = 3.0
    values = found("relmse", shot(waves(), waves(), image=image, reference=reference, changeable=half()))
    # (3 - 2)^2 / (2^2 + 0.01) in half of the pixels.
    assert values == pytest.approx({"relmse": 0.5 / 4.01, "relmse_changeable": 1 / 4.01})


def test_relmse_counts_every_channel_by_its_own_reference() -> None:
    reference = np.zeros(SHAPE, np.float32)
    reference[..., 1] = 1.0
    image = reference + np.array([0.1, 0.2, 0.0], np.float32)
    expected = (0.01 / 0.01 + 0.04 / 1.01) / 3
    assert found("relmse", shot(waves(), waves(), image=image, reference=reference))["relmse"] == pytest.approx(
        expected
    )
    expected = (0.01 / 0.5 + 0.04 / 1.5) / 3
    made = found("relmse", shot(waves(), waves(), image=image, reference=reference), epsilon=0.5)
    assert made["relmse"] == pytest.approx(expected)


def test_relmse_sees_light_above_white() -> None:
    bright = np.full(SHAPE, 50.0, np.float32)
    values = found("relmse", shot(codes(255), codes(255), image=bright, reference=2 * bright))
    assert values["relmse"] == pytest.approx(0.25, rel=1e-4)


@pytest.mark.parametrize(("field", "name"), [("image", "picture"), ("reference", "reference")])
def test_relmse_refuses_pictures_that_are_no_light(field: str, name: str) -> None:
    broken = np.ones(SHAPE, np.float32)
    broken[3, 4, 1] = np.nan
    with pytest.raises(ValueError, match=f"the linear {name} holds NaN or infinity"):
        found("relmse", shot(waves(), waves(), **{field: broken}))


# The displays' error


def test_the_error_of_one_changed_pixel() -> None:
    changed = codes(100)
    changed[3, 4] = (151, 100, 49)
    here = np.zeros(SHAPE[:2], bool)
    here[3, 4:6] = True
    values = found("error", shot(changed, codes(100), changeable=here))
    # 51 codes are 0.2, in two of three channels.
    assert values["display_error_changeable"] == pytest.approx(0.4 / 3 / 2, rel=1e-5)
    assert values["display_error"] == pytest.approx(0.4 / 3 / (36 * 64), rel=1e-5)


def test_black_and_white_are_1_apart() -> None:
    assert found("error", shot(codes(0), codes(255)))["display_error"] == 1.0
