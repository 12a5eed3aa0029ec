"""Tone curves against plain numpy twins and published values."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from phrt.errors import OptionError
from phrt.output.tonemap import CURVE_CODES, linear_from_srgb, to_8bit, tone_map_rows
from phrt.workers import Workers


def srgb_from_linear(linear: np.ndarray) -> np.ndarray:
    linear = np.clip(np.asarray(linear, dtype=np.float64), 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def neutral_curve(color: np.ndarray) -> np.ndarray:
    """The Khronos specification's listing, in float64 numpy."""
    color = np.maximum(np.asarray(color, dtype=np.float64), 0.0)
    start, desaturation = 0.8 - 0.04, 0.15
    darkest = color.min(axis=-1, keepdims=True)
    color = color - np.where(darkest < 0.08, darkest - 6.25 * darkest**2, 0.04)
    peak = color.max(axis=-1, keepdims=True)
    d = 1.0 - start
    new_peak = 1.0 - d * d / (peak + d - start)
    g = 1.0 - 1.0 / (desaturation * (peak - new_peak) + 1.0)
    rolled = color * new_peak / np.maximum(peak, 1e-30) * (1 - g) + new_peak * g
    return np.where(peak < start, color, rolled)


def aces_curve(color: np.ndarray) -> np.ndarray:
    into = np.array([[0.59719, 0.35458, 0.04823], [0.07600, 0.90834, 0.01566], [0.02840, 0.13383, 0.83777]])
    back = np.array([[1.60475, -0.53108, -0.07367], [-0.10208, 1.10813, -0.00605], [-0.00327, -0.07276, 1.07602]])
    v = np.maximum(np.asarray(color, dtype=np.float64), 0.0) @ into.T
    v = (v * (v + 0.0245786) - 0.000090537) / (v * (0.983729 * v + 0.4329510) + 0.238081)
    return v @ back.T


TWINS = {"srgb": lambda color: color, "aces": aces_curve, "neutral": neutral_curve}


@pytest.fixture(scope="module")
def hdr() -> np.ndarray:
    random = np.random.default_rng(7)
    image = (10.0 ** random.uniform(-4, 3, (61, 83, 3))).astype(np.float32)
    image[0, 0], image[0, 1], image[0, 2] = 0.0, 1.0, (-0.5, 0.2, 3.0)
    return image


@pytest.mark.parametrize("curve", CURVE_CODES)
def test_every_curve_matches_its_numpy_twin_within_half_a_code(curve: str, hdr: np.ndarray) -> None:
    exact = 255.0 * srgb_from_linear(TWINS[curve](hdr))
    assert np.abs(to_8bit(hdr, curve) - exact).max() <= 0.501


def test_srgb_encoding_is_correctly_rounded_over_the_whole_range() -> None:
    linear = np.linspace(0.0, 1.0, 300_000, dtype=np.float32).reshape(1, -1, 3)
    exact = 255.0 * srgb_from_linear(linear)
    sure = np.abs(exact % 1.0 - 0.5) > 1e-4
    assert np.array_equal(to_8bit(linear, "srgb")[sure], np.rint(exact[sure]).astype(np.uint8))


def test_every_8_bit_code_survives_decoding_and_encoding() -> None:
    codes = np.arange(255 + 1).repeat(3).reshape(16, 16, 3)
    assert np.array_equal(to_8bit(linear_from_srgb(codes / 255.0).astype(np.float32), "srgb"), codes)


def test_known_values() -> None:
    def one(value: float, curve: str) -> int:
        return int(to_8bit(np.full((1, 1, 3), value, np.float32), curve)[0, 0, 0])

    assert one(0.5, "srgb") == 188
    assert one(0.18, "srgb") == 118
    # Neutral takes 0.04 off mid-tones: 0.5 - 0.04 = 0.46 encodes to 181.
    assert one(0.5, "neutral") == 181
    assert one(np.inf, "neutral") == one(np.inf, "srgb") == one(np.inf, "aces") == 255


def test_neutral_keeps_hue_of_mid_tones_and_turns_bright_colours_white() -> None:
    picture = to_8bit(np.array([[[0.7, 0.35, 0.04], [1e5, 10.0, 10.0]]], np.float32), "neutral")
    linear = linear_from_srgb(picture[0, 0] / 255.0)
    # darkest 0.04 gives an offset of 0.04 - 6.25 * 0.0016 = 0.03
    assert linear == pytest.approx([0.67, 0.32, 0.01], abs=0.004)
    assert picture[0, 1].min() > 250


@pytest.mark.parametrize("curve", CURVE_CODES)
@pytest.mark.parametrize("channel", [0, 1, 2])
def test_nan_becomes_magenta_and_touches_no_neighbour(curve: str, channel: int, hdr: np.ndarray) -> None:
    broken = hdr.copy()
    broken[5, 6, channel] = np.nan
    expected = to_8bit(hdr, curve)
    expected[5, 6] = (255, 0, 255)
    assert np.array_equal(to_8bit(broken, curve), expected)


def test_a_pool_changes_nothing_and_rows_outside_the_range_stay() -> None:
    image = np.random.default_rng(1).random((100, 40, 3), dtype=np.float32) * 2
    with ThreadPoolExecutor(3) as pool:
        assert np.array_equal(to_8bit(image, "neutral", pool), to_8bit(image, "neutral"))
    for threads in (1, 2):
        workers = Workers(threads)
        assert np.array_equal(to_8bit(image, "neutral", workers), to_8bit(image, "neutral"))
        workers.close()
    out = np.full((100, 40, 3), 7, np.uint8)
    tone_map_rows(image, out, 10, 20, CURVE_CODES["neutral"])
    assert (out[:10] == 7).all()
    assert (out[20:] == 7).all()
    assert np.array_equal(out[10:20], to_8bit(image, "neutral")[10:20])


def test_an_unknown_curve_is_refused_by_name() -> None:
    with pytest.raises(OptionError, match=r"'neutrl' is not one of srgb, aces, neutral\. Did you mean 'neutral'"):
        to_8bit(np.zeros((1, 1, 3), np.float32), "neutrl")
    with pytest.raises(ValueError, match=r"expected an image \(H, W, 3\)"):
        to_8bit(np.zeros((1, 1, 4), np.float32))
