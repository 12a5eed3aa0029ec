"""The direct_light kernel against a plain numpy twin."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_kit import dot, field, random_lights, random_materials, random_surfaces, random_view, to_eye, unit

from phrt.composite import light_surfaces
from phrt.kernels.arrays import SurfaceArrays
from phrt.lights import DIRECTIONAL, RECT, SPOT
from phrt.workers import Workers


def arriving(light: np.void, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Direction to the light (n, 3) and irradiance on a surface that faces it (n,), for light of unit intensity."""
    if light["kind"] == DIRECTIONAL:
        return np.broadcast_to(-light["direction"].astype(float), position.shape), np.ones(len(position))
    to_light = light["position"] - position
    distance = np.linalg.norm(to_light, axis=1)
    to_light = to_light / distance[:, None]
    factor = 1 / distance**2
    cosine = -to_light @ light["direction"].astype(float)
    if light["kind"] == SPOT:
        # KHR_lights_punctual, with the square that keeps the edge smooth.
        ramp = (cosine - light["cos_outer"]) / (light["cos_inner"] - light["cos_outer"])
        factor = factor * np.clip(ramp, 0, 1) ** 2
    if light["kind"] == RECT:
        area = 4 * np.linalg.norm(np.cross(light["half_u"], light["half_v"]))
        factor = area * np.maximum(cosine, 0) / (distance**2 + area / np.pi)
    return to_light, factor * np.maximum(1 - (distance * light["inverse_range"]) ** 4, 0)


def direct_twin(s: SurfaceArrays, table: np.ndarray, lights: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """(n, L, 3): glTF 2.0 appendix B; eye (n, 3) unit directions to the eye."""
    m, out = table[s.material_id], np.zeros((len(s.position), len(lights), 3))
    normal, color = s.normal.astype(float), s.base_color.astype(float)
    metal, rough = s.metallic.astype(float)[:, None], s.roughness.astype(float)
    plain = (((field(m, "ior") - 1) / (field(m, "ior") + 1)) ** 2 * field(m, "specular"))[:, None]
    f0 = plain * (1 - metal) + color * metal
    f90 = field(m, "specular")[:, None] * (1 - metal) + metal
    n_v = np.maximum(np.abs(dot(normal, eye)), 1e-3)
    a2 = np.maximum(rough**4, 1e-6)
    for k, light in enumerate(lights):
        to_light, irradiance = arriving(light, s.position.astype(float))
        n_l = np.maximum(dot(normal, to_light), 0)
        half = unit(to_light + eye)
        f = f0 + (f90 - f0) * (1 - dot(eye, half)[:, None]) ** 5
        n_h = np.maximum(dot(normal, half), 0)
        d = a2 / (np.pi * (n_h**2 * (a2 - 1) + 1) ** 2)
        smith = n_l * np.sqrt(n_v**2 * (1 - a2) + a2) + n_v * np.sqrt(n_l**2 * (1 - a2) + a2)
        glossy = np.where(rough < 0.02, 0, d * 0.5 / np.maximum(smith, 1e-12))
        lambert = (1 - metal) * (1 - s.transmission[:, None]) * color / np.pi
        dielectric = plain + (field(m, "specular")[:, None] - plain) * (1 - dot(eye, half)[:, None]) ** 5
        brdf = (1 - dielectric) * lambert + f * glossy[:, None]
        out[:, k] = brdf * light["color"] * (irradiance * n_l)[:, None]
    out[(s.object_id == 0) | (m["unlit"] != 0)] = 0
    return out


@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("count", [1, 63, 3001])
def test_direct_light_is_what_its_twin_says(count: int, orthographic: bool) -> None:
    rng = np.random.default_rng(count)
    table, lights = random_materials(rng), random_lights(rng)
    points = random_surfaces(rng, count, table)
    view = random_view(rng, 64, 64, orthographic=orthographic)
    out = np.full((count, len(lights), 3), np.nan, np.float32)
    light_surfaces(points, table, lights, view, out, Workers(2))
    expected = direct_twin(points, table, lights, to_eye(view, points.position.astype(float)))
    np.testing.assert_allclose(out, expected, rtol=3e-3, atol=1e-5)
    if count > 1000:
        assert (expected > 0).any(axis=(0, 2)).all(), "every light must light something here"


def test_a_surface_turned_away_or_unlit_gets_nothing_and_never_nan() -> None:
    rng = np.random.default_rng(0)
    table, lights = random_materials(rng), random_lights(rng)
    points = random_surfaces(rng, 200, table)
    points.position[:] = lights["position"][0]
    out = np.full((200, len(lights), 3), np.nan, np.float32)
    light_surfaces(points, table, lights, random_view(rng, 8, 8), out, Workers(1))
    assert np.isfinite(out).all()
    assert not out[table["unlit"][points.material_id] != 0].any()
