"""Random input for kernels, and plain numpy twins that several tests share. float64 throughout."""

from __future__ import annotations

import numpy as np

from phrt.camera import CameraView, look_at
from phrt.environment import ROUGHNESS_LEVELS
from phrt.kernels.arrays import EnvironmentArrays, SurfaceArrays, empty_surfaces
from phrt.lights import light_table
from phrt.materials import material_table
from phrt.model import Light, Material
from phrt.scene import SceneLight


def unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.sum(a * b, axis=-1)


def random_materials(rng: np.random.Generator, count: int = 12) -> np.ndarray:
    """A material table of `count` rows and the default one: diffuse, metal, glass, thin glass, unlit, partly metal."""
    kinds = [
        {"specular": 0.0},
        {"metallic": 1.0},
        {"transmission": 1.0, "thickness": 1.0, "roughness": 0.0},
        {"transmission": 0.7},
        {"unlit": True},
        {"metallic": 0.4},
    ]
    materials = [
        Material(ior=float(rng.uniform(1.1, 2.4)), **({"specular": float(rng.uniform(0, 1))} | kinds[i % len(kinds)]))  # type: ignore[arg-type]
        for i in range(count)
    ]
    return material_table(materials, {})


def random_surfaces(rng: np.random.Generator, count: int, table: np.ndarray, objects: int = 5) -> SurfaceArrays:
    """Surface points in a cube of 4 m around the origin; some background; smooth glass, mirrors and rough surfaces."""
    points = empty_surfaces(count)
    points.position[:] = rng.uniform(-2, 2, (count, 3))
    points.normal[:] = unit(rng.normal(size=(count, 3)))
    points.geometric_normal[:] = unit(points.normal + rng.normal(size=(count, 3)) * 0.1)
    points.uv[:] = rng.uniform(0, 1, (count, 2))
    points.depth[:] = rng.uniform(1, 9, count)
    points.object_id[:] = rng.integers(0, objects + 1, count)
    points.primitive_id[:] = rng.integers(0, 100, count)
    points.material_id[:] = rng.integers(0, len(table), count)
    points.base_color[:] = rng.uniform(0, 1, (count, 3))
    points.alpha[:] = np.where(rng.random(count) < 0.2, rng.uniform(0, 1, count), 1.0)
    points.metallic[:] = table["metallic"][points.material_id]
    # Narrow lobes lose digits in float32; below 0.02 there is none.
    points.roughness[:] = np.where(rng.random(count) < 0.3, rng.uniform(0, 0.019, count), rng.uniform(0.15, 1, count))
    points.transmission[:] = table["transmission"][points.material_id]
    points.occlusion[:] = np.where(rng.random(count) < 0.5, rng.uniform(0, 1, count), 1.0)
    points.occlusion[:] = rng.uniform(0.3, 1, count)
    points.emissive[:] = rng.uniform(0, 1, (count, 3)) * (rng.random((count, 1)) < 0.2)
    return points


def random_matrix(rng: np.random.Generator) -> np.ndarray:
    """Somewhere within 4 m, turned anyhow."""
    place, target = (tuple(float(c) for c in rng.uniform(-4, 4, 3)) for _ in range(2))
    return look_at(place, target)  # type: ignore[arg-type]


def random_lights(rng: np.random.Generator) -> np.ndarray:
    """A light table of every kind: point (with and without range), spot, sun, sphere, rect, and one without shadow."""
    lights = [
        Light("point", intensity=9.0, color=(1.0, 0.5, 0.2)),
        Light("point", intensity=9.0, range=4.0),
        Light("spot", intensity=9.0, inner_angle=0.6, outer_angle=1.2),
        Light("directional", intensity=3.0, angle=0.2),
        Light("sphere", intensity=9.0, radius=0.3),
        Light("rect", intensity=5.0, size=(0.8, 0.5)),
        Light("point", intensity=2.0, casts_shadow=False),
    ]
    matrices = np.stack([random_matrix(rng) for _ in lights])
    return light_table([SceneLight(f"/{i}", i, light) for i, light in enumerate(lights)], matrices)


def random_view(rng: np.random.Generator, width: int, height: int, *, orthographic: bool = False) -> CameraView:
    return CameraView(
        width,
        height,
        random_matrix(rng),
        (2.0, 1.5) if orthographic else (0.8, 0.6),
        orthographic,
        near=0.1,
        far=50.0,
        jitter=(float(rng.uniform(-0.5, 0.5)), float(rng.uniform(-0.5, 0.5))),
    )


def to_eye(view: CameraView, position: np.ndarray) -> np.ndarray:
    """(n, 3) unit directions from surface points to the eye."""
    if view.orthographic:
        return np.broadcast_to(view.world_from_view[:3, 2], position.shape)
    return unit(view.position - position)


def field(table: np.ndarray, name: str) -> np.ndarray:
    return table[name].astype(np.float64)


# --- the dome -------------------------------------------------------------------------------------------------------


def octahedral_lookup(maps: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """(n, 3) bilinear lookup of an octahedral map (S, S, 3), clamped at its edge; Cigolle et al. 2014 with Y up."""
    size = len(maps)
    if size == 1:
        return np.broadcast_to(maps[0, 0].astype(np.float64), directions.shape)
    p = directions / np.abs(directions).sum(axis=1, keepdims=True)
    x, y, z = p.T
    sign = lambda v: np.where(v >= 0, 1.0, -1.0)  # noqa: E731
    u = np.where(y < 0, (1 - np.abs(z)) * sign(x), x)
    w = np.where(y < 0, (1 - np.abs(x)) * sign(z), z)
    column = np.clip((u + 1) / 2 * size - 0.5, 0, size - 1)
    row = np.clip((w + 1) / 2 * size - 0.5, 0, size - 1)
    x0, y0 = np.minimum(column.astype(int), size - 2), np.minimum(row.astype(int), size - 2)
    fx, fy = (column - x0)[:, None], (row - y0)[:, None]
    top = maps[y0, x0] * (1 - fx) + maps[y0, x0 + 1] * fx
    return top * (1 - fy) + (maps[y0 + 1, x0] * (1 - fx) + maps[y0 + 1, x0 + 1] * fx) * fy


def dome_radiance(dome: EnvironmentArrays, directions: np.ndarray, roughness: np.ndarray) -> np.ndarray:
    """(n, 3) radiance filtered for `roughness` (n,): linear between the levels of the blurred maps."""
    sharp = octahedral_lookup(dome.sharp[0], directions)
    if dome.sharp.shape[1] == 1:
        return sharp
    level = np.interp(roughness, ROUGHNESS_LEVELS, np.arange(len(ROUGHNESS_LEVELS)))
    stack = np.stack([octahedral_lookup(m, directions) for m in dome.blurred])
    low = np.minimum(level.astype(int), len(stack) - 1)
    high, rows = np.minimum(low + 1, len(stack) - 1), np.arange(len(directions))
    mixed = stack[low, rows] + (stack[high, rows] - stack[low, rows]) * (level - low)[:, None]
    return np.where((roughness < 0.05)[:, None], sharp, mixed)


def fresnel(cosine: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Unpolarised reflectance; 1 in total internal reflection."""
    sine2 = (1 - cosine**2) / eta**2
    behind = np.sqrt(np.maximum(1 - sine2, 0))
    s = (cosine - eta * behind) / (cosine + eta * behind)
    p = (eta * cosine - behind) / (eta * cosine + behind)
    return np.where(sine2 >= 1, 1.0, (s**2 + p**2) / 2)
