"""Lookups in an `Environment`, and its filtering by roughness."""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.jit import device, kernel
from phrt.kernels.random import halton, orthonormal

f32 = np.float32


@device
def octahedral_uv(x, y, z):
    """Texture coordinates 0..1 of a direction; the inverse of `phrt.environment.octahedral_directions`."""
    scale = f32(1.0) / (abs(x) + abs(y) + abs(z) + f32(1e-20))
    u, w = x * scale, z * scale
    if y < f32(0.0):
        fold_u = (f32(1.0) - abs(w)) * (f32(1.0) if u >= f32(0.0) else f32(-1.0))
        w = (f32(1.0) - abs(u)) * (f32(1.0) if w >= f32(0.0) else f32(-1.0))
        u = fold_u
    return u * f32(0.5) + f32(0.5), w * f32(0.5) + f32(0.5)


@device
def lookup(maps, level, x, y, z):
    """Bilinear radiance (r, g, b) of octahedral map `level` of maps (levels, S, S, 3) in direction x, y, z."""
    size = maps.shape[1]
    if size == 1:
        return maps[level, 0, 0, 0], maps[level, 0, 0, 1], maps[level, 0, 0, 2]
    u, v = octahedral_uv(x, y, z)
    column = min(max(u * f32(size) - f32(0.5), f32(0.0)), f32(size - 1))
    row = min(max(v * f32(size) - f32(0.5), f32(0.0)), f32(size - 1))
    x0, y0 = min(int(column), size - 2), min(int(row), size - 2)
    x1, y1 = x0 + 1, y0 + 1
    fx, fy = column - f32(x0), row - f32(y0)
    a, b = (f32(1.0) - fx) * (f32(1.0) - fy), fx * (f32(1.0) - fy)
    c, d = (f32(1.0) - fx) * fy, fx * fy
    r = (
        maps[level, y0, x0, 0] * a
        + maps[level, y0, x1, 0] * b
        + maps[level, y1, x0, 0] * c
        + maps[level, y1, x1, 0] * d
    )
    g = (
        maps[level, y0, x0, 1] * a
        + maps[level, y0, x1, 1] * b
        + maps[level, y1, x0, 1] * c
        + maps[level, y1, x1, 1] * d
    )
    e = (
        maps[level, y0, x0, 2] * a
        + maps[level, y0, x1, 2] * b
        + maps[level, y1, x0, 2] * c
        + maps[level, y1, x1, 2] * d
    )
    return r, g, e


@device
def environment_radiance(sharp, blurred, x, y, z, roughness):
    """Radiance (r, g, b) from direction x, y, z, filtered for a GGX lobe of `roughness`.

    sharp (1, S, S, 3); blurred (levels, B, B, 3), the levels being ROUGHNESS_LEVELS.
    """
    if sharp.shape[1] == 1:
        return sharp[0, 0, 0, 0], sharp[0, 0, 0, 1], sharp[0, 0, 0, 2]
    if roughness < f32(0.05):
        return lookup(sharp, 0, x, y, z)
    if roughness < f32(0.1):
        level = f32(0.0)
    elif roughness < f32(0.5):
        level = (roughness - f32(0.1)) * f32(5.0)
    else:
        level = f32(2.0) + (roughness - f32(0.5)) * f32(4.0)
    low = min(int(level), blurred.shape[0] - 1)
    high = min(low + 1, blurred.shape[0] - 1)
    mix = level - f32(low)
    r0, g0, b0 = lookup(blurred, low, x, y, z)
    r1, g1, b1 = lookup(blurred, high, x, y, z)
    return r0 + (r1 - r0) * mix, g0 + (g1 - g0) * mix, b0 + (b1 - b0) * mix


@device
def irradiance(harmonics, x, y, z):
    """Irradiance / pi (r, g, b) at a surface of normal x, y, z; harmonics (9, 3) of an `Environment`."""
    r = harmonics[0, 0] * f32(0.2820948)
    g = harmonics[0, 1] * f32(0.2820948)
    b = harmonics[0, 2] * f32(0.2820948)
    for k in range(1, 9):
        if k == 1:
            basis = f32(0.4886025) * y
        elif k == 2:
            basis = f32(0.4886025) * z
        elif k == 3:
            basis = f32(0.4886025) * x
        elif k == 4:
            basis = f32(1.0925484) * x * y
        elif k == 5:
            basis = f32(1.0925484) * y * z
        elif k == 6:
            basis = f32(0.3153916) * (f32(3.0) * z * z - f32(1.0))
        elif k == 7:
            basis = f32(1.0925484) * x * z
        else:
            basis = f32(0.5462742) * (x * x - y * y)
        r += harmonics[k, 0] * basis
        g += harmonics[k, 1] * basis
        b += harmonics[k, 2] * basis
    return max(r, f32(0.0)), max(g, f32(0.0)), max(b, f32(0.0))


@kernel
def prefilter(source, levels, target):
    """GGX-filter octahedral `source` (1, S, S, 3) into `target` (levels, B, B, 3): 256 samples, view along the normal.

    Karis 2013, "Real Shading in Unreal Engine 4".
    """
    size = target.shape[1]
    for level in range(len(levels)):
        alpha = levels[level] * levels[level]
        for row in range(size):
            for column in range(size):
                x = (f32(column) + f32(0.5)) / f32(size) * f32(2.0) - f32(1.0)
                z = (f32(row) + f32(0.5)) / f32(size) * f32(2.0) - f32(1.0)
                y = f32(1.0) - abs(x) - abs(z)
                if y < f32(0.0):
                    fold = -y
                    x = x - fold if x >= f32(0.0) else x + fold
                    z = z - fold if z >= f32(0.0) else z + fold
                length = math.sqrt(x * x + y * y + z * z)
                nx, ny, nz = f32(x / length), f32(y / length), f32(z / length)
                tx, ty, tz, bx, by, bz = orthonormal(nx, ny, nz)
                total_r, total_g, total_b, weight = f32(0.0), f32(0.0), f32(0.0), f32(0.0)
                for k in range(256):
                    u, v = halton(k, 2), halton(k, 3)
                    cosine = math.sqrt((f32(1.0) - u) / (f32(1.0) + (alpha * alpha - f32(1.0)) * u))
                    sine = math.sqrt(max(f32(0.0), f32(1.0) - cosine * cosine))
                    phi = f32(2.0 * math.pi) * v
                    a, b = sine * math.cos(phi), sine * math.sin(phi)
                    hx, hy, hz = (
                        tx * a + bx * b + nx * cosine,
                        ty * a + by * b + ny * cosine,
                        tz * a + bz * b + nz * cosine,
                    )
                    lx, ly, lz = f32(2.0) * cosine * hx - nx, f32(2.0) * cosine * hy - ny, f32(2.0) * cosine * hz - nz
                    facing = lx * nx + ly * ny + lz * nz
                    if facing > f32(0.0):
                        r, g, bl = lookup(source, 0, f32(lx), f32(ly), f32(lz))
                        total_r += r * facing
                        total_g += g * facing
                        total_b += bl * facing
                        weight += facing
                target[level, row, column, 0] = total_r / weight
                target[level, row, column, 1] = total_g / weight
                target[level, row, column, 2] = total_b / weight
