"""FLIP and SSIM on answers that are known, and what they refuse."""

from __future__ import annotations

import needs
import numpy as np
import pytest

needs.package("flip_evaluator")
needs.package("skimage")

SHAPE = (40, 56, 3)


def flat(value: float) -> np.ndarray:
    return np.full(SHAPE, value, np.float32)


def noisy(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).random(SHAPE).astype(np.float32)


def flip_of_grays(a: float, b: float) -> float:
    """FLIP of two flat gray pictures, sRGB 0..1: only lightness differs, and nothing is there to filter or to find edges in.

    Andersson et al. 2020, section 4: the HyAB distance (here that of L*) to the power of 0.7, mapped so that 0.4 of the
    largest distance (green to blue, 41.276 with Hunt's effect) becomes 0.95.
    """

    def lightness(srgb: float) -> float:
        y = srgb / 12.92 if srgb <= 0.04045 else ((srgb + 0.055) / 1.055) ** 2.4
        return 116 * (y ** (1 / 3) if y > (6 / 29) ** 3 else y / (3 * (6 / 29) ** 2) + 4 / 29) - 16

    largest = 41.2760
    knee, error = 0.4 * largest, abs(lightness(a) - lightness(b)) ** 0.7
    return 0.95 * error / knee if error < knee else 0.95 + 0.05 * (error - knee) / (largest - knee)


def ssim_of_grays(a: float, b: float) -> float:
    """Wang et al. 2004, eq. (13), without variance: (2 a b + C1) / (a^2 + b^2 + C1), C1 = 0.01^2."""
    return (2 * a * b + 1e-4) / (a * a + b * b + 1e-4)


def test_equal_pictures_are_at_no_distance(module):
    quality = module("quality").compare(noisy(), noisy())
    assert quality.flip == 0.0
    assert quality.ssim == pytest.approx(1.0)


@pytest.mark.parametrize(("a", "b"), [(0.0, 1.0), (0.5, 0.55), (0.2, 0.7), (1.0, 0.9)])
def test_flat_grays_have_the_distance_of_the_formulas(module, a, b):
    quality = module("quality").compare(flat(a), flat(b))
    assert quality.flip == pytest.approx(flip_of_grays(a, b), abs=2e-3)
    assert quality.ssim == pytest.approx(ssim_of_grays(a, b), abs=1e-4)


def test_more_noise_is_farther(module):
    compare = module("quality").compare
    picture, noise = np.full(SHAPE, 0.5), np.random.default_rng(1).normal(size=SHAPE)
    found = [compare(picture, np.clip(picture + noise * strength, 0, 1)) for strength in (0.01, 0.05, 0.2)]
    assert found[0].flip < found[1].flip < found[2].flip
    assert found[0].ssim > found[1].ssim > found[2].ssim


def test_codes_of_8_bit_are_taken_as_srgb(module):
    codes = np.random.default_rng(2).integers(0, 256, SHAPE).astype(np.uint8)
    other = np.roll(codes, 1, axis=0)
    compare = module("quality").compare
    assert compare(codes, other) == compare(codes / 255.0, (other / 255.0).astype(np.float32))


@pytest.mark.parametrize(
    ("picture", "message"),
    [
        (np.zeros((40, 56), np.float32), r"picture has shape \(40, 56\)"),
        (np.zeros((40, 6, 3), np.float32), "sides of at least 7"),
        (np.zeros((40, 56, 3), np.int32), "picture is int32"),
        (np.full(SHAPE, np.nan, np.float32), "NaN or values outside"),
        (np.full(SHAPE, 1.1, np.float32), "outside 0..1, from 1.1 to 1.1"),
        (np.full(SHAPE, -0.1, np.float32), "outside 0..1"),
        (np.zeros((41, 56, 3), np.float32), r"the reference is \(40, 56, 3\), the picture \(41, 56, 3\)"),
    ],
)
def test_what_flip_would_end_the_process_on_is_refused(module, picture, message):
    with pytest.raises(ValueError, match=message):
        module("quality").compare(flat(0.5), picture)


def test_a_faulty_reference_is_called_so(module):
    with pytest.raises(ValueError, match="reference holds NaN"):
        module("quality").compare(flat(np.inf), flat(0.5))


@pytest.mark.parametrize("processes", [1, 2])
def test_pairs_keep_their_order(module, processes):
    quality = module("quality")
    pairs = [(flat(0.0), flat(value)) for value in (0.0, 0.3, 0.6, 0.9, 0.1)]
    found = quality.compare_all(pairs, processes)
    assert found == [quality.compare(*pair) for pair in pairs]
    assert [entry.flip for entry in found] != sorted(entry.flip for entry in found)
