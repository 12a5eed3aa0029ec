"""Cost models: fitted to what waves took, and what they then predict."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from phrt.costs import DEFAULT_MS_PER_ITEM, DEFAULT_MS_PER_RAY, CostModels, GroupCost, LinearFit


def test_a_fit_finds_the_line_it_is_shown() -> None:
    fit, rng = LinearFit(), np.random.default_rng(1)
    for _ in range(400):
        items, rays = rng.integers(1, 60), rng.integers(500, 80_000)
        fit.learn(items, rays, (0.02 * items + 8e-5 * rays) * rng.normal(1, 0.05))
    assert fit.per_item == pytest.approx(0.02, rel=0.1)
    assert fit.per_ray == pytest.approx(8e-5, rel=0.02)


def test_a_fit_follows_a_machine_that_slows_down() -> None:
    fit = LinearFit()
    for price in (1e-4, 3e-4):
        for rays in np.tile([2000, 9000, 40_000], 150):
            fit.learn(1, float(rays), price * rays)
    assert fit.per_ray == pytest.approx(3e-4, rel=0.1)


@given(st.lists(st.tuples(st.integers(1, 100), st.floats(1, 1e6), st.floats(0, 100)), min_size=1, max_size=30))
def test_a_fit_never_predicts_less_than_nothing(groups: list[tuple[int, float, float]]) -> None:
    fit = LinearFit()
    for items, rays, milliseconds in groups:
        fit.learn(items, rays, milliseconds)
    assert fit.per_item >= 0
    assert fit.per_ray >= 0
    assert np.isfinite([fit.per_item, fit.per_ray]).all()


def test_each_effect_has_its_own_price() -> None:
    models = CostModels(["shadows", "reflections"])
    before = models.measured_ms(np.array([0, 1]), np.array([1000.0, 1000.0]))
    np.testing.assert_allclose(before, DEFAULT_MS_PER_ITEM + 1000 * DEFAULT_MS_PER_RAY)
    for _ in range(50):
        models.learn([GroupCost(0, 1, 1000, 1, 0.05), GroupCost(1, 1, 1000, 1, 0.4)])
    after = models.measured_ms(np.array([0, 1]), np.array([1000.0, 1000.0]))
    np.testing.assert_allclose(after, [0.05, 0.4], rtol=0.01)


def test_the_papers_model_is_one_price_for_a_unit_of_c() -> None:
    models = CostModels(["shadows"])
    cost = np.array([0.002, 0.006])
    first = models.paper_ms(cost, np.array([1.0, 1.0]))
    np.testing.assert_allclose(first, [0.5, 1.5], err_msg="nothing measured: the sum is that of the other model")
    models.learn([GroupCost(0, 2, 5000, 0.01, 4.0)])
    np.testing.assert_allclose(models.paper_ms(cost, first), [0.8, 2.4])
    np.testing.assert_allclose(models.paper_rays(cost, first), [1000, 3000])
    assert models.paper_ms(np.zeros(2), np.zeros(2)).tolist() == [0, 0]


def test_coefficients_outlive_a_run() -> None:
    one, other = CostModels(["shadows", "reflections"]), CostModels(["reflections", "caustics"])
    for _ in range(20):
        one.learn([GroupCost(1, 3, 2000, 1, 0.5)])
    other.warm(one.coefficients())
    assert other.coefficients()["reflections"] == one.coefficients()["reflections"]
    assert other.coefficients()["caustics"] == {
        "ms_per_item": DEFAULT_MS_PER_ITEM,
        "ms_per_ray": DEFAULT_MS_PER_RAY,
    }
    other.learn([GroupCost(0, 1, 50_000, 1, 50.0)])
    assert other.coefficients()["reflections"]["ms_per_ray"] == pytest.approx(1e-3, rel=0.05), "a start, not a belief"
