"""The model of saliency: answers that are known, and what it must not depend on."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phrt_saliency.model import SaliencyMap, saliency

HEIGHT, WIDTH = 90, 160


def even(color: tuple[float, float, float] = (0.5, 0.5, 0.5), height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    return np.tile(np.array(color, np.float32), (height, width, 1))


def spot(picture: np.ndarray, y: int, x: int, color: tuple[float, float, float], size: int = 6) -> np.ndarray:
    """`picture` with a square of `color` whose middle is at (y, x)."""
    made = picture.copy()
    made[y - size // 2 : y + size // 2, x - size // 2 : x + size // 2] = color
    return made


def place(values: np.ndarray) -> tuple[int, int]:
    """Where the largest value is."""
    y, x = np.unravel_index(values.argmax(), values.shape)
    return int(y), int(x)


def near(values: np.ndarray, y: int, x: int, reach: int = 5) -> bool:
    at = place(values)
    return abs(at[0] - y) <= reach and abs(at[1] - x) <= reach


def bars(angle_at: dict[tuple[int, int], bool]) -> np.ndarray:
    """A field of upright bars, lying ones where it says so."""
    picture = even((0.2, 0.2, 0.2))
    for row in range(5):
        for column in range(9):
            y, x = 9 + 18 * row, 8 + 18 * column
            lying = angle_at.get((row, column), False)
            high, wide = (1, 5) if lying else (5, 1)
            picture[y - high : y + high, x - wide : x + wide] = 0.8
    return picture


# What stands out


@pytest.mark.parametrize(("y", "x"), [(45, 80), (20, 30), (70, 130)])
def test_a_bright_spot_on_black_is_the_salient_place(y: int, x: int) -> None:
    found = saliency(spot(even((0, 0, 0)), y, x, (1, 1, 1)))
    assert near(found.saliency, y, x)
    assert near(found.intensity, y, x)
    assert found.color.max() == 0
    far = found.saliency.copy()
    far[max(y - 30, 0) : y + 30, max(x - 30, 0) : x + 30] = 0
    assert far.max() < 0.05 * found.saliency.max()


def test_a_dark_spot_on_white_is_as_salient() -> None:
    bright = saliency(spot(even((0, 0, 0)), 40, 60, (1, 1, 1)))
    dark = saliency(spot(even((1, 1, 1)), 40, 60, (0, 0, 0)))
    np.testing.assert_allclose(dark.saliency, bright.saliency, atol=1e-4)


@pytest.mark.parametrize("color", [(0, 0, 0), (1, 1, 1), (0.37, 0.37, 0.37), (0.8, 0.1, 0.1), (0.1, 0.2, 0.9)])
def test_an_even_picture_has_no_saliency(color: tuple[float, float, float]) -> None:
    found = saliency(even(color))
    for values in vars(found).values():
        assert values.max() == 0


def test_red_among_green_stands_out_in_color_alone() -> None:
    picture = even((0.3, 0.3, 0.3))
    for row in range(5):
        for column in range(9):
            color = (0.6, 0.1, 0.1) if (row, column) == (3, 6) else (0.1, 0.6, 0.1)
            picture = spot(picture, 9 + 18 * row, 8 + 18 * column, color)
    found = saliency(picture)
    assert near(found.saliency, 63, 116)
    assert near(found.color, 63, 116)
    assert not near(found.intensity, 63, 116, reach=20), "they are equally bright"


def test_a_lying_bar_among_upright_ones_stands_out_by_its_direction() -> None:
    found = saliency(bars({(1, 6): True}))
    assert near(found.orientation, 27, 116, reach=8)
    assert near(found.saliency, 27, 116, reach=8)


def test_what_is_everywhere_stands_out_nowhere() -> None:
    one = saliency(spot(even((0.2, 0.2, 0.2)), 45, 80, (0.8, 0.8, 0.8)))
    all_alike = saliency(bars({}))
    assert all_alike.saliency.max() < 0.5 * one.saliency.max()


def test_the_odd_one_stands_out_more_among_many_than_the_many_do() -> None:
    picture = even((0.2, 0.2, 0.2))
    for row in range(5):
        for column in range(9):
            bright = 0.95 if (row, column) == (2, 2) else 0.5
            picture = spot(picture, 9 + 18 * row, 8 + 18 * column, (bright,) * 3)
    assert near(saliency(picture).saliency, 45, 44)


# What it does not depend on

GREY = np.random.default_rng(5).random((9, 16)).repeat(10, axis=0).repeat(10, axis=1)[..., None].repeat(3, axis=2) * 0.4


def same(one: SaliencyMap, other: SaliencyMap, tolerance: float = 2e-3) -> None:
    assert one.saliency.max() > 0.05
    np.testing.assert_allclose(other.saliency, one.saliency, atol=tolerance * float(one.saliency.max()))


def test_it_does_not_depend_on_the_contrast_of_grey_pictures() -> None:
    same(saliency(GREY), saliency(GREY * 2))


def test_it_does_not_depend_on_even_light_added() -> None:
    same(saliency(GREY), saliency(GREY + 0.4))


def test_a_negative_is_as_salient() -> None:
    same(saliency(GREY), saliency(1 - GREY), 1e-2)


def test_color_does_not_depend_on_how_brightly_everything_is_lit() -> None:
    picture = np.random.default_rng(6).random((9, 16, 3)).repeat(10, axis=0).repeat(10, axis=1) * 0.2 + 0.28
    same(saliency(picture, (0, 1, 0)), saliency(picture * 2, (0, 1, 0)))


@pytest.mark.parametrize("turned", ["mirrored", "upside down", "transposed"])
def test_turning_the_picture_turns_the_map(turned: str) -> None:
    # Levels of 2^k + 1 pixels begin and end with the same pixels as the picture.
    picture = np.random.default_rng(8).random((65, 65, 3)).astype(np.float32)
    turns = {"mirrored": (slice(None), slice(None, None, -1)), "upside down": (slice(None, None, -1), slice(None))}
    found = saliency(picture).saliency
    if turned == "transposed":
        again, expected = saliency(np.ascontiguousarray(picture.transpose(1, 0, 2))).saliency, found.T
    else:
        again, expected = saliency(np.ascontiguousarray(picture[turns[turned]])).saliency, found[turns[turned]]
    np.testing.assert_allclose(again, expected, atol=1e-4)


def test_bytes_and_floats_are_the_same_picture() -> None:
    picture = np.random.default_rng(9).integers(0, 256, (36, 64, 3)).astype(np.uint8)
    np.testing.assert_array_equal(saliency(picture).saliency, saliency(picture / np.float32(255)).saliency)


def test_the_picture_is_not_changed_and_may_be_read_only() -> None:
    picture = spot(even(), 45, 80, (1, 0, 0))
    before = picture.copy()
    picture.flags.writeable = False
    saliency(picture)
    np.testing.assert_array_equal(picture, before)


# Weights, shapes, mistakes


def test_weights_are_those_of_the_channels() -> None:
    picture = spot(spot(even(), 30, 40, (0.9, 0.9, 0.9)), 60, 120, (0.9, 0.1, 0.1))
    whole = saliency(picture)
    for number, channel in enumerate(("intensity", "color", "orientation")):
        alone = saliency(picture, tuple(float(k == number) for k in range(3)))  # type: ignore[arg-type]
        np.testing.assert_array_equal(alone.saliency, getattr(whole, channel))
    mean = (whole.intensity + 2 * whole.color) / 3
    np.testing.assert_allclose(saliency(picture, (1, 2, 0)).saliency, mean, rtol=1e-5, atol=1e-7)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 40), st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_any_picture_has_a_finite_map_of_its_size(height: int, width: int, seed: int) -> None:
    picture = np.random.default_rng(seed).random((height, width, 3)).round(1)
    for values in vars(saliency(picture)).values():
        assert values.shape == (height, width)
        assert values.dtype == np.float32
        assert np.isfinite(values).all()
        assert values.min() >= 0


@pytest.mark.parametrize("shape", [(4, 4), (4, 4, 4), (0, 4, 3)])
def test_a_picture_that_is_none_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"expected a picture \(h, w, 3\), got"):
        saliency(np.zeros(shape))


@pytest.mark.parametrize("weights", [(0, 0, 0), (-1, 1, 1)])
def test_weights_that_are_none_are_refused(weights: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="they must be 0 or more, and one above 0"):
        saliency(even(), weights)
