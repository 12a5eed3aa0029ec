"""Shadow and ambient-occlusion rays: where they start, where they go, and what their answers add up to."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_kit import dot, random_lights, random_materials, random_surfaces

from phrt.conventions import RAY_BIAS
from phrt.kernels.arrays import SurfaceArrays
from phrt.kernels.shadow import apply_occlusion, hemisphere_rays, open_share, shadow_rays
from phrt.lights import DIRECTIONAL, RECT, SPHERE

COUNT = 300


def lifted(points: SurfaceArrays, rows: np.ndarray) -> np.ndarray:
    """Where rays leave surface points: along the geometric normal by the bias of conventions."""
    position = points.position[rows].astype(float)
    reach = np.maximum(np.abs(position).max(axis=1), 1.0)
    return position + points.geometric_normal[rows] * (RAY_BIAS * reach)[:, None]


def made_rays(samples: int) -> tuple[SurfaceArrays, np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Random points, which rows are asked for, lights, direct light, and the rays the kernel made of them."""
    rng = np.random.default_rng(7)
    lights = random_lights(rng)
    points = random_surfaces(rng, COUNT, random_materials(rng))
    rows = rng.permutation(COUNT)[:200].astype(np.int32)
    direct = (rng.random((COUNT, len(lights), 3)) * (rng.random((COUNT, len(lights), 1)) < 0.6)).astype(np.float32)
    capacity = len(rows) * len(lights) * max(samples, 1)
    rays = {
        "origin": np.full((capacity, 3), np.nan, np.float32),
        "direction": np.full((capacity, 3), np.nan, np.float32),
    }
    rays |= {"t_max": np.full(capacity, np.nan, np.float32)}
    rays |= {"row": np.empty(capacity, np.int32), "light": np.empty(capacity, np.int32)}
    count = shadow_rays(rows, rows.astype(np.uint32), points, direct, lights, samples, 11, *rays.values())
    return points, rows, lights, direct, {name: array[:count] for name, array in rays.items()}


def extended(lights: np.ndarray) -> np.ndarray:
    sphere = (lights["kind"] == SPHERE) & (lights["radius"] > 0)
    sun = (lights["kind"] == DIRECTIONAL) & (lights["tan_half_angle"] > 0)
    return (lights["kind"] == RECT) | sphere | sun


@pytest.mark.parametrize("samples", [0, 1, 5])
def test_every_light_that_arrives_and_casts_shadows_gets_its_rays_and_no_other(samples: int) -> None:
    _, rows, lights, direct, rays = made_rays(samples)
    expected = np.where(extended(lights), max(samples, 1), 1) * (lights["casts_shadow"] != 0)
    expected = (direct[rows].sum(axis=2) > 0) * expected[None, :]
    found = np.zeros_like(expected)
    np.add.at(found, (rays["row"], rays["light"]), 1)
    np.testing.assert_array_equal(found, expected)


def test_hard_shadow_rays_start_off_the_surface_and_end_just_before_the_lights_centre() -> None:
    points, rows, lights, _, rays = made_rays(0)
    origin, light = lifted(points, rows[rays["row"]]), lights[rays["light"]]
    np.testing.assert_allclose(rays["origin"], origin, atol=1e-6)
    to_light = light["position"] - origin
    distance = np.linalg.norm(to_light, axis=1)
    sun = light["kind"] == DIRECTIONAL
    expected = np.where(sun[:, None], -light["direction"], to_light / distance[:, None])
    np.testing.assert_allclose(rays["direction"], expected, atol=2e-5)
    np.testing.assert_allclose(rays["t_max"], np.where(sun, np.inf, distance * 0.9999), rtol=1e-5)


def test_soft_shadow_rays_end_on_the_light_and_cover_all_of_it() -> None:
    _, _, lights, _, rays = made_rays(16)
    np.testing.assert_allclose(np.linalg.norm(rays["direction"], axis=1), 1, atol=1e-5)
    for k, light in enumerate(lights):
        mine = rays["light"] == k
        end = rays["origin"][mine] + rays["direction"][mine] * (rays["t_max"][mine, None] / 0.9999)
        if light["kind"] == RECT:
            sides = np.stack([light["half_u"], light["half_v"]]).astype(float)
            place = (end - light["position"]) @ (sides / (sides**2).sum(axis=1, keepdims=True)).T
            off_plane = (end - light["position"]) @ np.cross(*sides)
            assert np.abs(off_plane).max() < 1e-4
        elif light["kind"] == SPHERE:
            # A disc through the centre that faces the point.
            offset = end - light["position"]
            to_centre = light["position"] - rays["origin"][mine]
            assert np.abs(dot(offset, to_centre)).max() < 1e-3
            place = np.linalg.norm(offset, axis=1, keepdims=True) / light["radius"]
        elif light["kind"] == DIRECTIONAL:
            cosine = rays["direction"][mine] @ -light["direction"]
            place = np.sqrt(np.maximum(1 / cosine**2 - 1, 0))[:, None] / light["tan_half_angle"]
        else:
            continue
        assert np.abs(place).max() <= 1.001
        # Even over the area: a quarter of the points within half the extent of a disc, half within half a side.
        inner = (np.abs(place) < 0.5).mean(axis=0)
        np.testing.assert_allclose(inner, 0.5 if light["kind"] == RECT else 0.25, atol=0.03)


@pytest.mark.parametrize("samples", [0, 1, 7])
def test_blocked_rays_take_their_share_of_the_light(samples: int) -> None:
    _, rows, lights, _, rays = made_rays(samples)
    blocked = np.random.default_rng(1).random(len(rays["row"])) < 0.5
    visibility = np.ones((len(rows), len(lights)), np.float32)
    apply_occlusion(blocked, rays["row"], rays["light"], lights, samples, visibility)
    lost = np.zeros((len(rows), len(lights)))
    np.add.at(
        lost, (rays["row"], rays["light"]), blocked / np.where(extended(lights), max(samples, 1), 1)[rays["light"]]
    )
    np.testing.assert_allclose(visibility, 1 - lost, atol=1e-6)


def test_ambient_occlusion_rays_are_cosine_distributed_above_the_surface() -> None:
    rng = np.random.default_rng(2)
    points = random_surfaces(rng, COUNT, random_materials(rng))
    points.geometric_normal[:] = points.normal
    rows, samples = np.arange(COUNT, dtype=np.int32), 16
    origin, direction = np.empty((COUNT * samples, 3), np.float32), np.empty((COUNT * samples, 3), np.float32)
    t_max = np.empty(COUNT * samples, np.float32)
    hemisphere_rays(rows, rows.astype(np.uint32), points, samples, 5, np.float32(2.5), origin, direction, t_max)
    np.testing.assert_allclose(origin, np.repeat(lifted(points, rows), samples, axis=0), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1, atol=1e-5)
    assert np.all(t_max == np.float32(2.5))
    cosine = dot(direction, np.repeat(points.normal, samples, axis=0))
    assert cosine.min() >= -1e-6
    # The square of the cosine is uniform under a cosine distribution.
    counts, _ = np.histogram(cosine**2, bins=8, range=(0, 1))
    np.testing.assert_allclose(counts / len(cosine), 1 / 8, atol=0.01)


def test_ambient_occlusion_rays_stay_above_the_triangle_under_a_bent_normal() -> None:
    rng = np.random.default_rng(2)
    points = random_surfaces(rng, COUNT, random_materials(rng))
    rows = np.arange(COUNT, dtype=np.int32)
    origin, direction = np.empty((COUNT * 8, 3), np.float32), np.empty((COUNT * 8, 3), np.float32)
    t_max = np.empty(COUNT * 8, np.float32)
    hemisphere_rays(rows, rows.astype(np.uint32), points, 8, 5, np.float32(1), origin, direction, t_max)
    assert dot(direction, np.repeat(points.geometric_normal, 8, axis=0)).min() >= -1e-6


def test_open_share_is_the_mean_of_each_points_free_rays() -> None:
    blocked = np.random.default_rng(3).random(60) < 0.4
    out = np.empty((12, 1), np.float32)
    open_share(blocked, 5, out)
    np.testing.assert_allclose(out[:, 0], 1 - blocked.reshape(12, 5).mean(axis=1), atol=1e-6)
