"""Cost models: fitted to what waves took, and what they then predict."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phrt.costs import (
    DEFAULT_MS_PER_BATCH,
    DEFAULT_MS_PER_RAY,
    LARGE_BATCH_RAYS,
    SLOWEST,
    CostModels,
    GroupCost,
    LinearFit,
)


def test_a_fit_finds_the_line_it_is_shown() -> None:
    fit, rng = LinearFit(), np.random.default_rng(1)
    for _ in range(400):
        rays = rng.integers(500, 80_000)
        fit.learn(rays, (0.6 + 8e-5 * rays) * rng.normal(1, 0.05))
    assert fit.per_batch == pytest.approx(0.6, rel=0.1)
    assert fit.per_ray == pytest.approx(8e-5, rel=0.02)


def test_a_fit_follows_a_machine_that_slows_down() -> None:
    fit = LinearFit()
    for price in (1e-4, 3e-4):
        for rays in np.tile([2000, 9000, 40_000], 150):
            fit.learn(float(rays), price * rays)
    assert fit.per_ray == pytest.approx(3e-4, rel=0.1)


@given(st.lists(st.tuples(st.floats(1, 1e6), st.floats(0, 100)), min_size=1, max_size=30))
def test_a_fit_never_predicts_less_than_nothing(batches: list[tuple[float, float]]) -> None:
    fit = LinearFit()
    for rays, milliseconds in batches:
        fit.learn(rays, milliseconds)
    assert fit.per_batch >= 0
    assert fit.per_ray >= 0
    assert np.isfinite([fit.per_batch, fit.per_ray]).all()


def test_each_effect_has_its_own_price() -> None:
    models = CostModels(["shadows", "reflections"])
    per_ray = DEFAULT_MS_PER_RAY + DEFAULT_MS_PER_BATCH / LARGE_BATCH_RAYS
    before = models.measured_ms(np.array([0, 1]), np.array([1000.0, 1000.0]))
    np.testing.assert_allclose(before, 1000 * per_ray)
    for rays in np.tile([1000, 40_000], 100).tolist():
        models.learn([GroupCost(0, rays, 1, 5e-5 * rays), GroupCost(1, rays, 1, 0.5 + 4e-4 * rays)])
    after = models.measured_ms(np.array([0, 1]), np.array([LARGE_BATCH_RAYS, LARGE_BATCH_RAYS]))
    np.testing.assert_allclose(after, [1.25, 10.5], rtol=0.01)
    np.testing.assert_allclose(models.batch_ms(), [0.0, 0.5], atol=0.02)


def test_batches_of_one_size_do_not_make_the_first_ray_dear() -> None:
    fit = LinearFit()
    for _ in range(300):
        fit.learn(2000, 1.0)
    assert fit.per_batch + 2000 * fit.per_ray == pytest.approx(1.0, rel=0.01)
    assert fit.per_batch < 0.5


def test_items_bear_their_share_of_the_batches_there_are_but_not_that_of_small_ones() -> None:
    for batches, per_batch in ([4000.0, 2000.0], LARGE_BATCH_RAYS), ([90_000.0, 10_000.0], 50_000.0):
        models = CostModels(["shadows"])
        for rays in batches * 200:
            models.learn([GroupCost(0, rays, 1, 2.0 + 1e-4 * rays)])
        predicted = models.measured_ms(np.zeros(1, int), np.array([1000.0]))
        np.testing.assert_allclose(predicted, 0.1 + 2.0 * 1000 / per_batch, rtol=0.03)


def test_what_was_interrupted_counts_as_if_it_took_a_few_times_what_was_expected() -> None:
    fit, models = LinearFit(0.1, 1e-4), CostModels(["shadows"])
    fit.learn(1000, 5000.0)
    assert fit.per_batch + 1000 * fit.per_ray <= 0.2 * SLOWEST
    for _ in range(20):
        models.learn_wave(0.4)
    usual = models.wave_ms
    models.learn_wave(900.0)
    assert 0.3 < usual < 0.4
    assert models.wave_ms <= 2 * usual


def test_the_papers_model_is_one_price_for_a_unit_of_c() -> None:
    models = CostModels(["shadows"])
    cost = np.array([0.002, 0.006])
    first = models.paper_ms(cost, np.array([1.0, 1.0]))
    np.testing.assert_allclose(first, [0.5, 1.5], err_msg="nothing measured: the sum is that of the other model")
    models.learn([GroupCost(0, 5000, 0.01, 4.0)])
    np.testing.assert_allclose(models.paper_ms(cost, first), [0.8, 2.4])
    np.testing.assert_allclose(models.paper_rays(cost, first), [1000, 3000])
    assert models.paper_ms(np.zeros(2), np.zeros(2)).tolist() == [0, 0]


def test_coefficients_outlive_a_run() -> None:
    one, other = CostModels(["shadows", "reflections"]), CostModels(["reflections", "caustics"])
    for _ in range(20):
        one.learn([GroupCost(1, 2000, 1, 0.5)])
    other.warm(one.coefficients())
    assert other.coefficients()["reflections"] == one.coefficients()["reflections"]
    assert other.coefficients()["caustics"] == {
        "ms_per_item": DEFAULT_MS_PER_BATCH,
        "ms_per_ray": DEFAULT_MS_PER_RAY,
    }
    other.learn([GroupCost(0, 50_000, 1, 50.0)])
    assert other.coefficients()["reflections"]["ms_per_ray"] == pytest.approx(1e-3, rel=0.05), "a start, not a belief"


def test_what_was_found_too_dear_is_tried_again_some_day() -> None:
    """An effect that is not traced is expected to take less and less, down to what is usual; what is measured is believed again."""
    models = CostModels(["dear", "traced"])
    models.warm({"dear": {"ms_per_item": 5.0, "ms_per_ray": 0.02}, "traced": {"ms_per_item": 0.1, "ms_per_ray": 3e-4}})
    rays, effect = np.array([10_000.0, 10_000.0]), np.array([0, 1])
    first = models.measured_ms(effect, rays)
    for _ in range(200):
        models.learn([GroupCost(1, 10_000, 1.0, 3.1)])
        models.end_frame()
    later = models.measured_ms(effect, rays)
    assert first[0] > 200
    usual = DEFAULT_MS_PER_RAY * 10_000
    assert 0.9 * usual < later[0] < 1.5 * usual
    assert later[1] == pytest.approx(3.1, rel=0.15)
    for _ in range(30):
        models.learn([GroupCost(0, 10_000, 1.0, 20.0)])
        models.end_frame()
    assert models.measured_ms(effect, rays)[0] == pytest.approx(20.0, rel=0.3)
