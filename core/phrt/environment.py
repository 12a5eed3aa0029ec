"""Light from infinitely far away, prepared for lookups without trigonometry: octahedral maps and spherical harmonics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phrt.scene import Dome

SHARP_SIZE = 1024
BLURRED_SIZE = 32
ROUGHNESS_LEVELS = (0.1, 0.3, 0.5, 0.75, 1.0)


@dataclass(frozen=True)
class Environment:
    """sharp: (S, S, 3) float32 octahedral radiance, for the background and mirrors; blurred: (levels, B, B, 3), GGX-filtered
    at ROUGHNESS_LEVELS; irradiance: (9, 3) spherical harmonics of irradiance / pi, so that a white diffuse surface under a
    constant dome has the dome's radiance. A constant dome has 1 x 1 maps. visible: whether the background shows it."""

    sharp: np.ndarray
    blurred: np.ndarray
    irradiance: np.ndarray
    visible: bool

    @classmethod
    def from_dome(cls, dome: Dome) -> Environment:
        color = np.asarray(dome.color, dtype=np.float32)
        if dome.pixels is None:
            irradiance = np.zeros((9, 3), np.float32)
            irradiance[0] = color / np.float32(0.2820948)
            return cls(color.reshape(1, 1, 3).copy(), color.reshape(1, 1, 1, 3).copy(), irradiance, dome.visible)
        from phrt.kernels.environment import prefilter

        sharp = octahedral_from_equirectangular(dome.pixels, dome.rotation) * color
        small = sharp.reshape(128, SHARP_SIZE // 128, 128, SHARP_SIZE // 128, 3).mean(axis=(1, 3))
        blurred = np.zeros((len(ROUGHNESS_LEVELS), BLURRED_SIZE, BLURRED_SIZE, 3), np.float32)
        prefilter(np.ascontiguousarray(small[None], dtype=np.float32), np.array(ROUGHNESS_LEVELS, np.float32), blurred)
        return cls(np.ascontiguousarray(sharp, dtype=np.float32), blurred, irradiance_harmonics(small), dome.visible)


def octahedral_directions(size: int) -> np.ndarray:
    """(size, size, 3) float64 unit directions at the texel centres of an octahedral map (Cigolle et al. 2014), Y the axis."""
    centre = (np.arange(size) + 0.5) / size * 2 - 1
    x, z = np.meshgrid(centre, centre)
    y = 1 - np.abs(x) - np.abs(z)
    fold = np.maximum(-y, 0)
    x = x - np.where(x >= 0, fold, -fold)
    z = z - np.where(z >= 0, fold, -fold)
    directions = np.stack([x, y, z], axis=-1)
    return directions / np.linalg.norm(directions, axis=-1, keepdims=True)


def octahedral_from_equirectangular(pixels: np.ndarray, rotation: float) -> np.ndarray:
    """(SHARP_SIZE, SHARP_SIZE, 3) float32 from (H, W, 3), bilinear; the centre column looks down -Z before `rotation`."""
    height, width = pixels.shape[:2]
    x, y, z = np.moveaxis(octahedral_directions(SHARP_SIZE), -1, 0)
    u = (np.arctan2(x, -z) + rotation) / (2 * np.pi) + 0.5
    v = np.arccos(np.clip(y, -1, 1)) / np.pi
    column, row = u * width - 0.5, np.clip(v * height - 0.5, 0, height - 1)
    x0, y0 = np.floor(column).astype(int), np.floor(row).astype(int)
    fx, fy = (column - x0)[..., None].astype(np.float32), (row - y0)[..., None].astype(np.float32)
    y1 = np.minimum(y0 + 1, height - 1)
    top = pixels[y0, x0 % width] * (1 - fx) + pixels[y0, (x0 + 1) % width] * fx
    bottom = pixels[y1, x0 % width] * (1 - fx) + pixels[y1, (x0 + 1) % width] * fx
    return (top * (1 - fy) + bottom * fy).astype(np.float32)


def irradiance_harmonics(octahedral: np.ndarray) -> np.ndarray:
    """(9, 3) float32: irradiance / pi of an octahedral radiance map (Ramamoorthi and Hanrahan 2001, eq. 13)."""
    size = len(octahedral)
    directions = octahedral_directions(size)
    centre = (np.arange(size) + 0.5) / size * 2 - 1
    u, w = np.meshgrid(centre, centre)
    # Solid angle of an octahedral texel: its area over the cube of its distance on the unfolded octahedron.
    length = np.sqrt(u**2 + w**2 + (1 - np.abs(u) - np.abs(w)) ** 2)
    flat = np.linalg.norm(np.stack([_unfold(u, w), 1 - np.abs(u) - np.abs(w), _unfold(w, u)]), axis=0)
    weight = 1.0 / np.maximum(np.where(np.abs(u) + np.abs(w) <= 1, length, flat), 1e-6) ** 3
    weight *= 4 * np.pi / weight.sum()
    basis = harmonics(directions.reshape(-1, 3))
    coefficients = basis.T @ (octahedral.reshape(-1, 3) * weight.reshape(-1, 1))
    band = np.array([1.0, 2 / 3, 2 / 3, 2 / 3, 0.25, 0.25, 0.25, 0.25, 0.25])
    return (coefficients * band[:, None]).astype(np.float32)


def _unfold(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The first octahedron coordinate of a texel in the folded half."""
    fold = np.maximum(np.abs(a) + np.abs(b) - 1, 0)
    return a - np.where(a >= 0, fold, -fold)


def harmonics(directions: np.ndarray) -> np.ndarray:
    """(n, 9) real spherical harmonics of bands 0 to 2 at unit `directions` (n, 3)."""
    x, y, z = directions.T
    return np.stack(
        [
            np.full_like(x, 0.2820948),
            0.4886025 * y,
            0.4886025 * z,
            0.4886025 * x,
            1.0925484 * x * y,
            1.0925484 * y * z,
            0.3153916 * (3 * z * z - 1),
            1.0925484 * x * z,
            0.5462742 * (x * x - y * y),
        ],
        axis=1,
    )
