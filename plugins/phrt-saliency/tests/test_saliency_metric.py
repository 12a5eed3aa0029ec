"""The metric: what counts is what happens where the reference stands out."""

from __future__ import annotations

import numpy as np
import pytest
from phrt_saliency.metric import SaliencyError, shrunk
from phrt_saliency.options import SaliencyErrorOptions

from phrt.testing import check_metric
from phrt.testing.metrics import shot_of


def error(display: np.ndarray, reference: np.ndarray) -> float:
    return SaliencyError(SaliencyErrorOptions()).of_shot(shot_of(display, reference))["saliency_error"]


def with_spot() -> np.ndarray:
    """A grey picture with a bright spot in the upper left."""
    picture = np.full((90, 160, 3), 50, np.uint8)
    picture[17:23, 27:33] = 240
    return picture


def darker(picture: np.ndarray, y: int, x: int) -> np.ndarray:
    """`picture`, darker around (y, x)."""
    made = picture.copy()
    made[y - 3 : y + 3, x - 3 : x + 3] //= 2
    return made


def test_it_keeps_the_contract() -> None:
    check_metric("saliency_error")
    check_metric("saliency_error", {"map_width": 32, "color": 0.0})


def test_an_error_where_nothing_stands_out_counts_little() -> None:
    reference = with_spot()
    there, elsewhere = darker(reference, 20, 30), darker(reference, 70, 130)
    elsewhere[67:73, 127:133] = 50 + (240 - 120)  # as large as the one at the spot
    assert np.abs(there.astype(int) - reference).mean() == np.abs(elsewhere.astype(int) - reference).mean()
    assert error(there, reference) > 20 * error(elsewhere, reference)


def test_where_nothing_stands_out_every_pixel_counts_the_same() -> None:
    reference = np.full((40, 64, 3), 100, np.uint8)
    display = reference.copy()
    display[:10] += 51
    assert error(display, reference) == pytest.approx(51 / 255 / 4)


def test_equal_pictures_have_none() -> None:
    assert error(with_spot(), with_spot()) == 0.0


@pytest.mark.parametrize(("height", "width", "small"), [(90, 160, 40), (17, 23, 7), (8, 9, 160)])
def test_a_shrunk_display_is_made_of_means_of_its_parts(height: int, width: int, small: int) -> None:
    display = np.random.default_rng(2).integers(0, 256, (height, width, 3)).astype(np.uint8)
    made, row, column = shrunk(display, small)
    assert made.shape[1] == min(small, width)
    assert made.shape[:2] == (row[-1] + 1, column[-1] + 1)
    for y in (0, made.shape[0] - 1):
        for x in (0, made.shape[1] // 2, made.shape[1] - 1):
            part = display[row == y][:, column == x] / 255.0
            np.testing.assert_allclose(made[y, x], part.mean(axis=(0, 1)), rtol=1e-5)
