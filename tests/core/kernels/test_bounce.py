"""First reflected and refracted rays, and Fresnel's equations, against plain numpy twins."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_kit import dot, field, fresnel, random_materials, random_surfaces, unit

from phrt.conventions import RAY_BIAS
from phrt.kernels.arrays import GeometryArrays, SurfaceArrays
from phrt.kernels.bounce import reflection_rays, refraction_rays
from phrt.kernels.shade import fresnel_dielectric

COUNT = 600
EYE = np.array([0.5, 3.0, 9.0])


def setting(*, towards_eye: bool = True) -> tuple[SurfaceArrays, np.ndarray, np.ndarray]:
    """Random points whose normals face EYE as a G-buffer's do, their material table, and unit view directions."""
    rng = np.random.default_rng(11)
    table = random_materials(rng, 24)
    points = random_surfaces(rng, COUNT, table)
    incoming = unit(points.position - EYE)
    if towards_eye:
        away = dot(points.geometric_normal, incoming) > 0
        points.geometric_normal[away] *= -1
        points.normal[away] *= -1
    return points, table, incoming


def bias(position: np.ndarray) -> np.ndarray:
    return RAY_BIAS * np.maximum(np.abs(position).max(axis=1), 1.0)[:, None]


def views(point: bool, incoming: np.ndarray, rows: np.ndarray) -> tuple[np.ndarray, bool]:
    return (EYE[None].astype(np.float32), True) if point else (incoming[rows].astype(np.float32), False)


def reflected_rays(
    points: SurfaceArrays,
    table: np.ndarray,
    view: tuple[np.ndarray, bool],
    rows: np.ndarray,
    samples: int,
    cutoff: float,
) -> tuple[np.ndarray, ...]:
    capacity = len(rows) * samples
    origin, direction, weight = (np.full((capacity, 3), np.nan, np.float32) for _ in range(3))
    target = np.empty(capacity, np.int32)
    applies = np.ones(len(table), bool)
    applies[3] = False
    count = reflection_rays(
        rows, rows.astype(np.uint32), points, table, *view, applies, np.float32(cutoff), samples, 3,
        origin, direction, weight, target,
    )  # fmt: skip
    return origin[:count], direction[:count], weight[:count], target[:count]


@pytest.mark.parametrize("point", [True, False])
def test_mirrors_send_one_ray_the_mirror_way(point: bool) -> None:
    points, table, incoming = setting()
    points.roughness[:] = np.where(points.roughness < 0.02, points.roughness, 0.9)
    rows = np.random.default_rng(1).permutation(COUNT)[:400].astype(np.int32)
    origin, direction, weight, target = reflected_rays(points, table, views(point, incoming, rows), rows, 4, 0.3)
    expected = np.flatnonzero((points.roughness[rows] < 0.02) & (points.material_id[rows] != 3))
    np.testing.assert_array_equal(target, expected)
    row = rows[target]
    d, n, g = incoming[row], points.normal[row].astype(float), points.geometric_normal[row].astype(float)
    mirror = d - 2 * dot(d, n)[:, None] * n
    below = np.minimum(dot(mirror, g), 0)[:, None]
    np.testing.assert_allclose(direction, unit(mirror - 2 * below * g), atol=2e-5)
    np.testing.assert_allclose(origin, points.position[row] + g * bias(points.position[row]), atol=2e-6)
    assert np.all(weight == 1)


def test_glossy_surfaces_send_many_rays_that_share_a_pixel() -> None:
    points, table, incoming = setting()
    rows = np.arange(COUNT, dtype=np.int32)
    _, direction, weight, target = reflected_rays(points, table, views(True, incoming, rows), rows, 6, 0.6)
    rough = points.roughness
    wanted = np.where(rough > np.float32(0.6), 0, np.where(rough < 0.05, 1, 6)) * (points.material_id != 3)
    np.testing.assert_array_equal(np.bincount(target, minlength=COUNT), wanted)
    np.testing.assert_allclose(np.bincount(target, weight[:, 0], minlength=COUNT), wanted > 0, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1, atol=1e-5)
    assert dot(direction, points.geometric_normal[target]).min() >= -1e-5


@pytest.mark.parametrize("roughness", [0.2, 0.35, 0.5])
def test_glossy_rays_seen_head_on_follow_the_ggx_distribution(roughness: float) -> None:
    points, table, _ = setting()
    points.normal[:] = points.geometric_normal[:] = unit(EYE - points.position)
    points.roughness[:] = roughness
    rows = np.arange(COUNT, dtype=np.int32)
    _, direction, _, target = reflected_rays(
        points, table, views(True, unit(points.position - EYE), rows), rows, 32, 1.0
    )
    n_h = np.sqrt((1 + dot(direction, points.normal[target])) / 2)
    # Head on, visible normals have density D(h) cos: its distribution function in cos^2 is closed.
    a2 = roughness**4
    u = (1 - n_h**2) / (1 + (a2 - 1) * n_h**2)
    # Lobes that would go under the surface are turned up; compare the part that cannot.
    share = [(u < level).mean() for level in (0.1, 0.25, 0.4)]
    np.testing.assert_allclose(share, [0.1, 0.25, 0.4], atol=0.02)


def triangles(rng: np.random.Generator, count: int = 100) -> GeometryArrays:
    """A soup, of which refraction asks only which side is the front."""
    positions = rng.normal(size=(count * 3, 3)).astype(np.float32)
    corner = np.arange(count * 3, dtype=np.int32).reshape(-1, 3)
    blank = np.zeros((0, 4), np.float32)
    ids = np.zeros(count, np.int32)
    return GeometryArrays(
        positions,
        positions,
        blank,
        positions[:, :2].copy(),
        blank[:, :2].copy(),
        blank,
        corner,
        ids,
        ids,
        ids.astype(np.float32),
    )


@pytest.mark.parametrize("point", [True, False])
def test_refracted_rays_obey_snell_on_both_sides_and_thin_walls_let_them_pass(point: bool) -> None:
    points, table, incoming = setting()
    geometry = triangles(np.random.default_rng(4))
    rows = np.random.default_rng(1).permutation(COUNT)[:500].astype(np.int32)
    origin, direction, weight = (np.full((500, 3), np.nan, np.float32) for _ in range(3))
    target, medium = np.empty(500, np.int32), np.empty(500, np.int32)
    count = refraction_rays(
        rows, points, geometry, table, *views(point, incoming, rows), origin, direction, weight, target, medium
    )

    a, b, c = np.moveaxis(geometry.positions[geometry.triangles[points.primitive_id[rows]]].astype(float), 1, 0)
    d, n, g = incoming[rows], points.normal[rows].astype(float), points.geometric_normal[rows].astype(float)
    entering = dot(np.cross(b - a, c - a), d) <= 0
    m = table[points.material_id[rows]]
    transmits = points.transmission[rows] > 0
    bends = transmits & (m["thin"] == 0) & (dot(d, n) < 0)
    ratio = np.where(entering, 1 / field(m, "ior"), field(m, "ior"))
    cosine = -dot(d, n)
    square = 1 - ratio**2 * (1 - cosine**2)
    bent = ratio[:, None] * d + (ratio * cosine - np.sqrt(np.maximum(square, 0)))[:, None] * n
    goes = (points.object_id[rows] != 0) & (transmits | (points.alpha[rows] < 1)) & ~(bends & (square <= 0))
    assert (bends & (square <= 0)).sum() > 5, "some must be reflected totally"

    np.testing.assert_array_equal(target[:count], np.flatnonzero(goes))
    np.testing.assert_allclose(direction[:count], np.where(bends[:, None], bent, d)[goes], atol=1e-4)
    start = points.position[rows] - g * bias(points.position[rows])
    np.testing.assert_allclose(origin[:count], start[goes], atol=2e-6)
    inside = np.where(bends & entering, points.material_id[rows], 0)
    np.testing.assert_array_equal(medium[:count], inside[goes])
    assert np.all(weight[:count] == 1)


@pytest.mark.parametrize("eta", [1.5, 2.4, 1 / 1.5, 1 / 1.33])
def test_fresnel_from_both_sides_with_total_reflection_past_the_critical_angle(eta: float) -> None:
    cosine = np.linspace(0.001, 1, 500)
    out = np.empty(500, np.float32)
    for i, c in enumerate(cosine.astype(np.float32)):
        out[i] = fresnel_dielectric(c, np.float32(eta))
    np.testing.assert_allclose(out, fresnel(cosine, np.array(eta)), atol=2e-4)
    assert out[-1] == pytest.approx(((eta - 1) / (eta + 1)) ** 2, rel=1e-4)
    if eta < 1:
        total = np.sqrt(1 - cosine**2) > eta * 1.0001
        assert total.any()
        assert np.all(out[total] == 1)
