"""FLIP: known answers, what its authors promise of it, and its map."""

from __future__ import annotations

import needs
import numpy as np
import pytest
from metric_kit import SHAPE, codes, found, noise, waves

from phrt.errors import OptionError
from phrt.testing.metrics import shot_of as shot
from phrt_plugins.metrics.flip import flip_map
from phrt_plugins.metrics.measure import make_metrics

flip_evaluator = needs.package("flip_evaluator")


def test_equal_pictures_are_at_no_distance() -> None:
    assert found("flip", shot(noise(), noise())) == {"flip": 0.0, "flip_changeable": 0.0, "flip_p95": 0.0}


def test_black_and_white_are_as_far_apart_as_flat_grays_can_be() -> None:
    # Andersson et al. 2020, section 4: HyAB of 100 in L* to the power of 0.7, of at most 41.2760 (green to blue).
    knee, error = 0.4 * 41.2760, 100.0**0.7
    expected = 0.95 + 0.05 * (error - knee) / (41.2760 - knee)
    values = found("flip", shot(codes(0), codes(255)))
    assert values["flip"] == pytest.approx(expected, abs=2e-3)
    assert values["flip_p95"] == pytest.approx(expected, abs=2e-3)


def test_the_map_is_the_one_of_its_authors_program() -> None:
    a, b = noise(1), waves()
    errors, mean, settings = flip_evaluator.evaluate(
        (a / np.float32(255)).astype(np.float32), (b / np.float32(255)).astype(np.float32), "LDR", applyMagma=False
    )
    made = flip_map(a, b)
    assert made.shape == SHAPE[:2]
    assert made.dtype == np.float32
    assert np.array_equal(made, errors[:, :, 0])
    assert found("flip", shot(b, a))["flip"] == pytest.approx(mean, rel=1e-6)
    assert settings["ppd"] == pytest.approx(67.0206, abs=1e-4)


def test_it_does_not_matter_which_of_the_two_is_the_reference() -> None:
    assert flip_map(waves(), noise(2)) == pytest.approx(flip_map(noise(2), waves()), abs=1e-5)


def test_one_changed_pixel_is_seen_where_it_is_and_nowhere_else() -> None:
    changed = codes(128)
    changed[10, 20] = 255
    errors = flip_map(codes(128), changed)
    assert np.unravel_index(errors.argmax(), errors.shape) == (10, 20)
    assert errors[10, 20] > 0.3
    assert errors[:, 40:].max() < 1e-5


def test_changeable_looks_at_the_chosen_pixels_alone() -> None:
    changed = codes(128)
    changed[10, 20] = 255
    near, far = np.zeros(SHAPE[:2], bool), np.zeros(SHAPE[:2], bool)
    near[10, 20], far[:, 40:] = True, True
    errors = flip_map(codes(128), changed)
    assert found("flip", shot(changed, codes(128), changeable=near))["flip_changeable"] == errors[10, 20]
    assert found("flip", shot(changed, codes(128), changeable=far))["flip_changeable"] < 1e-5
    none = found("flip", shot(changed, codes(128), changeable=np.zeros(SHAPE[:2], bool)))
    assert np.isnan(none["flip_changeable"])


def test_p95_is_of_the_pixels() -> None:
    changed = codes(128)
    changed[:18] = 200
    values = found("flip", shot(changed, codes(128)))
    errors = flip_map(codes(128), changed)
    assert values["flip_p95"] == np.percentile(errors, 95)
    assert values["flip_p95"] > 1.5 * values["flip"]


def test_fine_noise_is_seen_less_from_afar() -> None:
    a, b = noise(3), noise(4)
    near, far = (found("flip", shot(a, b), pixels_per_degree=p)["flip"] for p in (30.0, 120.0))
    assert near > 1.1 * far


@pytest.mark.parametrize("pixels_per_degree", [5.0, 500.0])
def test_every_viewing_distance_that_is_allowed_works_on_the_smallest_picture(pixels_per_degree: float) -> None:
    errors = flip_map(codes(0, (7, 7, 3)), codes(255, (7, 7, 3)), pixels_per_degree)
    assert errors.shape == (7, 7)
    assert (errors > 0.9).all()


def test_a_viewing_distance_that_is_not_allowed_is_refused() -> None:
    with pytest.raises(OptionError, match="metric 'flip': option 'pixels_per_degree' is 0"):
        make_metrics(["flip"], {"flip": {"pixels_per_degree": 0}})


@pytest.mark.parametrize(
    ("reference", "picture", "message"),
    [
        (codes(0), codes(0, (36, 63, 3)), r"the reference is \(36, 64, 3\), the picture \(36, 63, 3\)"),
        (codes(0, (36, 6, 3)), codes(0), r"reference has shape \(36, 6, 3\); expected .* at least 7"),
        (codes(0), np.full(SHAPE, np.nan, np.float32), "picture holds NaN"),
    ],
)
def test_what_flip_cannot_use_is_refused(reference: np.ndarray, picture: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        flip_map(reference, picture)
