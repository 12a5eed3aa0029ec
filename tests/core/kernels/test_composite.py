"""The composite kernel against a plain numpy twin of the sum in docs/gbuffer.md."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from kernel_kit import dome_radiance, dot, field, fresnel, random_materials, random_surfaces, random_view, to_eye, unit

from phrt.camera import CameraView
from phrt.composite import compose
from phrt.environment import Environment, harmonics
from phrt.kernels.arrays import EnvironmentArrays, SurfaceArrays
from phrt.scene import Dome
from phrt.workers import Workers

WIDTH, HEIGHT, LIGHTS = 40, 30, 3
COUNT = WIDTH * HEIGHT


@cache
def dome(kind: str) -> EnvironmentArrays:
    pixels = np.random.default_rng(3).uniform(0, 2, (16, 32, 3)).astype(np.float32) if kind == "picture" else None
    environment = Environment.from_dome(Dome((0.3, 0.5, 0.9), pixels))
    return EnvironmentArrays(environment.sharp[None], environment.blurred, environment.irradiance)


def reflectance(s: SurfaceArrays, m: np.ndarray, n_v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) and the dielectric's own (n, 1): Schlick towards max(1 - roughness, F0); smooth glass by Fresnel's equations."""
    smooth, schlick = (1 - s.roughness.astype(float))[:, None], ((1 - n_v) ** 5)[:, None]
    ior, specular = field(m, "ior"), field(m, "specular")
    f0 = (((ior - 1) / (ior + 1)) ** 2 * specular)[:, None]
    plain = f0 + (np.maximum(smooth * specular[:, None], f0) - f0) * schlick
    metal = s.base_color + (np.maximum(smooth, s.base_color) - s.base_color) * schlick
    mixed = plain + (metal - plain) * s.metallic[:, None]
    glass = (s.transmission > 0) & (s.roughness <= 0.1) & (s.metallic == 0)
    exact = (fresnel(n_v, ior) * specular)[:, None]
    return np.where(glass[:, None], exact, mixed), np.where(glass[:, None], exact, plain)


def background_directions(view: CameraView) -> np.ndarray:
    """(P, 3) through the pixels' centres."""
    x = ((np.arange(WIDTH) + 0.5) / WIDTH * 2 - 1) * view.tan_half[0]
    y = (1 - (np.arange(HEIGHT) + 0.5) / HEIGHT * 2) * view.tan_half[1]
    x, y = np.meshgrid(x, y)
    local = np.stack([x, y, -np.ones_like(x)], axis=-1).reshape(-1, 3) * ([0, 0, 1] if view.orthographic else [1, 1, 1])
    return unit(local @ view.world_from_view[:3, :3].T)


def put_behind_pixels(points: SurfaceArrays, view: CameraView) -> None:
    """Move surface point i onto the eye ray of pixel i."""
    direction = background_directions(view)
    matrix = view.world_from_view
    x = ((np.arange(WIDTH) + 0.5) / WIDTH * 2 - 1) * view.tan_half[0] * view.orthographic
    y = (1 - (np.arange(HEIGHT) + 0.5) / HEIGHT * 2) * view.tan_half[1] * view.orthographic
    offset = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) @ matrix[:3, :2].T
    points.position[:] = matrix[:3, 3] + offset + direction * points.depth[:, None]


def composite_twin(
    s: SurfaceArrays, table: np.ndarray, light_dome: EnvironmentArrays, background: bool, view: CameraView,
    direct: np.ndarray, layers: dict[str, np.ndarray], reflected: np.ndarray, exposure: float,
) -> np.ndarray:  # fmt: skip
    m = table[s.material_id]
    eye, normal = to_eye(view, s.position.astype(float)), s.normal.astype(float)
    f, dielectric = reflectance(s, m, np.clip(np.abs(dot(normal, eye)), 1e-3, 1))
    mirror = 2 * dot(normal, eye)[:, None] * normal - eye
    ao = layers["ambient_occlusion"].astype(float) * s.occlusion[:, None]
    reflection = np.where(
        (reflected == 0)[:, None],
        dome_radiance(light_dome, mirror, s.roughness.astype(float)) * ao,
        layers["reflection"],
    )
    if light_dome.sharp.shape[1] == 1:
        ambient = np.broadcast_to(light_dome.sharp[0, 0, 0].astype(float), normal.shape)
    else:
        ambient = np.maximum(harmonics(normal) @ light_dome.irradiance.astype(float), 0)
    body = (1 - dielectric) * (1 - s.metallic[:, None]) * s.base_color
    through = s.transmission[:, None]
    lit = (direct * layers["visibility"][..., None]).sum(axis=1) + f * reflection
    lit = lit + body * (1 - through) * ambient * ao + body * through * layers["refraction"]
    color = s.emissive + np.where((m["unlit"] != 0)[:, None], 0, lit)
    color = color * s.alpha[:, None] + layers["refraction"] * (1 - s.alpha[:, None])
    sky = dome_radiance(light_dome, background_directions(view), np.zeros(COUNT)) * background
    return np.where((s.object_id == 0)[:, None], sky, color) * exposure


@pytest.mark.parametrize("kind", ["constant", "picture"])
@pytest.mark.parametrize("orthographic", [False, True])
@pytest.mark.parametrize("background", [True, False])
def test_the_picture_is_the_sum_its_twin_computes(kind: str, orthographic: bool, background: bool) -> None:
    rng = np.random.default_rng(5)
    table = random_materials(rng)
    points = random_surfaces(rng, COUNT, table)
    view = random_view(rng, WIDTH, HEIGHT, orthographic=orthographic).with_jitter(0.0, 0.0)
    put_behind_pixels(points, view)
    direct = rng.uniform(0, 1, (COUNT, LIGHTS, 3)).astype(np.float32)
    direct[table["unlit"][points.material_id] != 0] = 0
    shapes = {"visibility": LIGHTS, "ambient_occlusion": 1, "reflection": 3, "refraction": 3}
    layers = {name: rng.uniform(0, 1, (COUNT, n)).astype(np.float32) for name, n in shapes.items()}
    reflected = rng.integers(0, 4, COUNT).astype(np.uint8)
    image = np.full((COUNT, 3), np.nan, np.float32)
    pixels = np.arange(COUNT, dtype=np.int32)
    masks = {"reflection": reflected}
    compose(points, table, dome(kind), background, view, pixels, direct, layers, masks, 1.7, image, Workers(2))
    expected = composite_twin(points, table, dome(kind), background, view, direct, layers, reflected, 1.7)
    np.testing.assert_allclose(image, expected, rtol=2e-3, atol=2e-3)
