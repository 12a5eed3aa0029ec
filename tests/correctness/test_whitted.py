"""All-traced pictures against a plain recursive ray tracer: the oracle of everything that happens after the first hit.

Brute force over triangles, float64, one ray at a time, written from the formulas in the docs: Whitted's recursion with
Fresnel, Snell, Beer-Lambert, alpha blending and hard shadows. Surfaces are smooth or purely diffuse, so nothing is random.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scene_kit import (
    GLASS,
    LAMBERT,
    MIRROR,
    TRACERS,
    Stage,
    at,
    ball,
    box,
    floor,
    need_tracer,
    quad,
    turned,
    write_evidence,
)

from phrt.conventions import RAY_BIAS
from phrt.model import Material
from phrt.world import World

WIDTH, HEIGHT, DEPTH = 24, 16, 4
EFFECTS = {"reflections": {"max_depth": DEPTH}, "refractions": {"max_depth": DEPTH}}


class Oracle:
    """Radiance along single rays through a scene, triangles and vertex normals taken from its `World`."""

    def __init__(self, made: Stage) -> None:
        self.materials = [Material(), *made.scene.materials]
        self.lights = [(e.light, made.scene.nodes[e.node].matrix[:3, 3]) for e in made.scene.lights]
        self.dome = np.array(made.scene.dome.color)
        world = World(made.scene)
        self.corners = world.positions[world.triangles].astype(float)
        self.normals = world.normals[world.triangles].astype(float)
        self.material = world.triangle_material
        self.casts = world.object_casts_shadow[world.triangle_object]

    def hits(
        self, origin: np.ndarray, direction: np.ndarray, mask: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distances (T,), +inf for none, and barycentrics u, v (T,): Moller and Trumbore 1997."""
        a, e1, e2 = self.corners[:, 0], self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0]
        p = np.cross(direction, e2)
        det = np.sum(e1 * p, axis=1)
        with np.errstate(all="ignore"):
            s = origin - a
            u = np.sum(s * p, axis=1) / det
            q = np.cross(s, e1)
            v = q @ direction / det
            t = np.sum(e2 * q, axis=1) / det
        good = mask & (np.abs(det) > 1e-14) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        return np.where(good, t, np.inf), u, v

    def opaque_half(self) -> np.ndarray:
        """(T,) bool: casts a shadow; blended surfaces from half coverage on."""
        solid = [m.alpha_mode != "BLEND" or m.base_color[3] >= 0.5 for m in self.materials]
        return self.casts & np.array(solid)[self.material]

    def radiance(
        self, origin: np.ndarray, direction: np.ndarray, left: int, medium: Material | None = None, *, eye: bool = False
    ) -> np.ndarray:
        """Light that comes back; left: bounces that may follow. An eye ray does not see single-sided backs."""
        mask = np.ones(len(self.material), bool)
        if eye:
            face = np.cross(self.corners[:, 1] - self.corners[:, 0], self.corners[:, 2] - self.corners[:, 0])
            mask = (face @ direction <= 0) | np.array([m.double_sided for m in self.materials])[self.material]
        t, u, v = self.hits(origin, direction, mask)
        k = int(np.argmin(t))
        if not np.isfinite(t[k]):
            return self.dome
        m, (a, b, c), point = self.materials[self.material[k]], self.corners[k], origin + direction * t[k]
        through_medium = np.ones(3)
        if medium is not None and np.isfinite(medium.attenuation_distance):
            through_medium = np.array(medium.attenuation_color) ** (t[k] / medium.attenuation_distance)
        g = np.cross(b - a, c - a)
        entering = bool(g @ direction <= 0)
        turn = 1.0 if entering else -1.0
        g = turn * g / np.linalg.norm(g)
        n = turn * ((1 - u[k] - v[k]) * self.normals[k, 0] + u[k] * self.normals[k, 1] + v[k] * self.normals[k, 2])
        n = n / np.linalg.norm(n)
        off = g * RAY_BIAS * max(np.abs(point).max(), 1.0)
        surface = self.shade(m, point, direction, n, g, off, entering, left, medium)
        alpha = m.base_color[3] if m.alpha_mode == "BLEND" else 1.0
        if alpha < 1:
            behind = self.radiance(point - off, direction, left - 1, medium) if left > 0 else np.zeros(3)
            surface = alpha * surface + (1 - alpha) * behind
        return through_medium * surface

    def shade(
        self, m: Material, point: np.ndarray, d: np.ndarray, n: np.ndarray, g: np.ndarray, off: np.ndarray, entering: bool,
        left: int, medium: Material | None,
    ) -> np.ndarray:  # fmt: skip
        color, emitted = np.array(m.base_color[:3]), np.array(m.emissive)
        if m.unlit:
            return color
        thick = m.transmission > 0 and m.thickness > 0
        eta = m.ior if entering or not thick else 1 / m.ior
        f, dielectric = reflectance(m, color, np.clip(-(d @ n), 1e-3, 1), eta)
        body = (1 - m.metallic) * (1 - m.transmission) * color
        total = emitted + self.direct(m, color, point, d, n, off) + (1 - dielectric) * body * self.dome

        mirror = d - 2 * (d @ n) * n
        mirror = mirror - 2 * min(mirror @ g, 0) * g
        smooth = m.roughness <= 0.15
        if smooth and left > 0:
            total = total + f * self.radiance(point + off, mirror, left - 1, medium)
        elif medium is None:
            total = total + f * self.dome
        if m.transmission > 0:
            onward, inside = d, medium
            if thick:
                cosine = -(d @ n)
                square = 1 - (1 - cosine**2) / eta**2
                if square <= 0:
                    return total
                onward = d / eta + (cosine / eta - np.sqrt(square)) * n
                inside = m if entering else None
            passing = (1 - dielectric) * m.transmission * (1 - m.metallic) * color
            total = total + passing * (self.radiance(point - off, onward, left - 1, inside) if left > 0 else self.dome)
        return total

    def direct(
        self, m: Material, color: np.ndarray, point: np.ndarray, d: np.ndarray, n: np.ndarray, off: np.ndarray
    ) -> np.ndarray:
        total = np.zeros(3)
        for light, place in self.lights:
            to_light = place - point
            distance = np.linalg.norm(to_light)
            to_light = to_light / distance
            half = (to_light - d) / np.linalg.norm(to_light - d)
            plain = ((m.ior - 1) / (m.ior + 1)) ** 2 * m.specular
            plain += (m.specular - plain) * (1 - max(-(d @ half), 0)) ** 5
            lambert = (1 - plain) * (1 - m.metallic) * (1 - m.transmission) * color / np.pi
            arriving = np.array(light.color) * light.intensity * max(n @ to_light, 0) / distance**2
            if lambert.any() and arriving.any():
                reach = np.linalg.norm(place - point - off) * 0.9999
                t, _, _ = self.hits(point + off, to_light, self.opaque_half())
                total = total + lambert * arriving * (t.min() >= reach)
        return total


def reflectance(m: Material, color: np.ndarray, cosine: float, eta: float) -> tuple[np.ndarray, float]:
    """(3,), and the dielectric's own: exactly for glass, else Schlick's curve towards 1 - roughness."""
    if m.transmission > 0 and m.metallic == 0:
        square = 1 - (1 - cosine**2) / eta**2
        if square <= 0:
            return np.full(3, m.specular), m.specular
        behind = np.sqrt(square)
        s = (cosine - eta * behind) / (cosine + eta * behind)
        p = (eta * cosine - behind) / (eta * cosine + behind)
        exact = (s**2 + p**2) / 2 * m.specular
        return np.full(3, exact), exact
    schlick, smooth = (1 - cosine) ** 5, 1 - m.roughness
    f0 = ((m.ior - 1) / (m.ior + 1)) ** 2 * m.specular
    plain = f0 + (max(smooth * m.specular, f0) - f0) * schlick
    metal = color + (np.maximum(smooth, color) - color) * schlick
    return plain * (1 - m.metallic) + metal * m.metallic, plain


def oracle_image(made: Stage) -> np.ndarray:
    oracle, camera = Oracle(made), made.scene.cameras[0]
    matrix, half = made.scene.nodes[camera.node].matrix, np.tan(camera.lens.fov_y / 2)
    image = np.empty((HEIGHT, WIDTH, 3))
    for row in range(HEIGHT):
        for column in range(WIDTH):
            x = ((column + 0.5) / WIDTH * 2 - 1) * half * WIDTH / HEIGHT
            y = (1 - (row + 0.5) / HEIGHT * 2) * half
            direction = matrix[:3, :3] @ [x, y, -1.0]
            image[row, column] = oracle.radiance(
                matrix[:3, 3], direction / np.linalg.norm(direction), DEPTH + 1, eye=True
            )
    return image


def film(alpha: float, **values: Any) -> Material:
    return Material(base_color=(0.9, 0.2, 0.3, alpha), alpha_mode="BLEND", specular=0.0, double_sided=True, **values)


AMBER = replace(GLASS, base_color=(0.9, 0.8, 0.7, 1.0), attenuation_color=(0.9, 0.5, 0.1), attenuation_distance=0.4)
GOLD = Material(base_color=(1.0, 0.8, 0.4, 1.0), metallic=1.0, roughness=0.0)
LACQUER = Material(base_color=(0.2, 0.5, 0.3, 1.0), roughness=0.0)
SUBJECTS: dict[str, list[tuple[Any, Material, np.ndarray]]] = {
    "mirrors": [(box(), MIRROR, at(-0.7, 0, 0) @ turned("y", 25)), (ball(0.5, 1), GOLD, at(0.6, 0, 0.1))],
    "glass": [(box(), AMBER, at(-0.7, 0, 0) @ turned("y", 25)), (ball(0.5, 1), GLASS, at(0.6, 0, 0.1))],
    "lacquer_behind_glass": [(box(), LACQUER, at(0, 0, -1)), (box(0.9, 0.9, 0.2), AMBER, at(0.2, 0, 0.5) @ turned("y", 20))],
    "thin_panes": [
        (quad(1, 1), replace(GLASS, thickness=0.0, double_sided=True, base_color=(0.5, 0.9, 0.6, 1)), at(-0.3, 0, 0.6)),
        (quad(1, 1), replace(GLASS, thickness=0.0, double_sided=True, transmission=0.6), at(0.3, 0, 0.2) @ turned("y", 30)),
        (box(0.6, 0.6, 0.6), GOLD, at(0, 0, -0.8) @ turned("y", 40)),
    ],
    "films": [
        (quad(1, 1), film(0.3), at(-0.3, 0, 0.6)),
        (quad(1, 1), film(0.7, emissive=(0.1, 0.0, 0.2)), at(0.3, 0, 0.2) @ turned("y", 30)),
        (box(0.8, 0.8, 0.8), MIRROR, at(0, 0, -0.9) @ turned("y", 40)),
    ],
    "ball_in_glass": [(box(1.2, 1.2, 1.2), AMBER, turned("y", 35)), (ball(0.3, 1), LACQUER, np.eye(4))],
    "everything_in_a_mirror": [
        (quad(4, 2), MIRROR, at(0, 0.4, -1.5)),
        (ball(0.4, 1), GLASS, at(-0.7, -0.1, 0)),
        (quad(0.8, 0.8), film(0.4), at(0.1, 0, -0.4)),
        (box(0.5, 0.5, 0.5), LACQUER, at(0.8, -0.2, 0) @ turned("y", 30)),
    ],
}  # fmt: skip


def stage(name: str) -> Stage:
    made = Stage(dome=(0.25, 0.3, 0.4)).add("/floor", floor(6), LAMBERT, at(0, -0.62, 0))
    made.add("/post", box(0.2, 1.5, 0.2), replace(LAMBERT, base_color=(0.9, 0.4, 0.1, 1)), at(1.5, 0.2, -0.6))
    for index, (mesh, material, matrix) in enumerate(SUBJECTS[name]):
        made.add(f"/subject{index}", mesh, material, matrix)
    made.light("point", at(1.5, 2.5, 2.0), intensity=12.0).light(
        "point", at(-2, 1.5, 1), intensity=5.0, color=(1, 0.7, 0.5)
    )
    return made.camera((0.3, 0.9, 3.2), (0.02, -0.05, 0.01), fov_y=0.7)


@pytest.fixture(scope="module")
def oracle_images() -> dict[str, np.ndarray]:
    """The oracle's pictures, each made when first asked for."""
    return {}


@pytest.mark.parametrize("name", SUBJECTS)
@pytest.mark.parametrize("tracer", TRACERS)
def test_every_pixel_is_what_the_recursion_says(
    name: str, tracer: str, oracle_images: dict[str, np.ndarray], tmp_path: Path
) -> None:
    if name not in oracle_images:
        oracle_images[name] = oracle_image(stage(name))
    image = stage(name).render((WIDTH, HEIGHT), tracer=need_tracer(tracer), effects=EFFECTS).image
    difference = np.abs(image - oracle_images[name]).max(axis=-1)
    evidence = write_evidence(
        tmp_path, ours=image, oracle=oracle_images[name], difference=difference[..., None].repeat(3, -1)
    )
    # A few pixels lie on an edge, where float32 and float64 may take different sides.
    wrong = difference > 0.01
    assert wrong.sum() <= 4, f"{wrong.sum()} pixels differ, by up to {difference.max():.3f}; see {evidence}"
