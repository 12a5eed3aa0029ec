"""Texture lookups: wrap, bilinear, between two mip levels."""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.jit import device
from phrt.kernels.mipmaps import SRGB_TO_LINEAR

f32 = np.float32
BYTE = f32(1.0 / 255.0)


@device
def fast_log2(x):
    """log2 of x > 0, within 0.01: exponent bits and a quadratic in the mantissa."""
    bits = np.float32(x).view(np.int32)
    exponent = (bits >> 23) - 127
    mantissa = np.int32((bits & 0x007FFFFF) | 0x3F800000).view(np.float32)
    return f32(exponent) + (mantissa * (f32(-0.33582878) * mantissa + f32(2.0)) - f32(1.65871))


@device
def wrapped(coordinate, mode):
    """A texture coordinate brought into 0..1 by wrap mode (WRAPS)."""
    if mode == 0:
        return coordinate - math.floor(coordinate)
    if mode == 1:
        return min(max(coordinate, f32(0.0)), f32(1.0))
    half = coordinate * f32(0.5)
    return f32(1.0) - abs((half - math.floor(half)) * f32(2.0) - f32(1.0))


@device
def bilinear(texels, start, width, height, u, v, wrap_s, wrap_t, srgb):
    """(r, g, b, a) 0..1 at wrapped u, v of one mip level; colour decoded where srgb."""
    x = f32(u) * f32(width) - f32(0.5)
    y = f32(v) * f32(height) - f32(0.5)
    x0, y0 = int(math.floor(x)), int(math.floor(y))
    fx, fy = f32(x - f32(x0)), f32(y - f32(y0))
    x1, y1 = x0 + 1, y0 + 1
    if x0 < 0:
        x0 = width - 1 if wrap_s == 0 else 0
    if y0 < 0:
        y0 = height - 1 if wrap_t == 0 else 0
    if x1 >= width:
        x1 = 0 if wrap_s == 0 else width - 1
        x0 = min(x0, width - 1)
    if y1 >= height:
        y1 = 0 if wrap_t == 0 else height - 1
        y0 = min(y0, height - 1)
    i, j = start + y0 * width + x0, start + y0 * width + x1
    k, m = start + y1 * width + x0, start + y1 * width + x1
    a, b = (f32(1.0) - fx) * (f32(1.0) - fy), fx * (f32(1.0) - fy)
    c, d = (f32(1.0) - fx) * fy, fx * fy
    alpha = (f32(texels[i, 3]) * a + f32(texels[j, 3]) * b + f32(texels[k, 3]) * c + f32(texels[m, 3]) * d) * BYTE
    if srgb:
        red = SRGB_TO_LINEAR[texels[i, 0]] * a + SRGB_TO_LINEAR[texels[j, 0]] * b
        red += SRGB_TO_LINEAR[texels[k, 0]] * c + SRGB_TO_LINEAR[texels[m, 0]] * d
        green = SRGB_TO_LINEAR[texels[i, 1]] * a + SRGB_TO_LINEAR[texels[j, 1]] * b
        green += SRGB_TO_LINEAR[texels[k, 1]] * c + SRGB_TO_LINEAR[texels[m, 1]] * d
        blue = SRGB_TO_LINEAR[texels[i, 2]] * a + SRGB_TO_LINEAR[texels[j, 2]] * b
        blue += SRGB_TO_LINEAR[texels[k, 2]] * c + SRGB_TO_LINEAR[texels[m, 2]] * d
        return red, green, blue, alpha
    red = (f32(texels[i, 0]) * a + f32(texels[j, 0]) * b + f32(texels[k, 0]) * c + f32(texels[m, 0]) * d) * BYTE
    green = (f32(texels[i, 1]) * a + f32(texels[j, 1]) * b + f32(texels[k, 1]) * c + f32(texels[m, 1]) * d) * BYTE
    blue = (f32(texels[i, 2]) * a + f32(texels[j, 2]) * b + f32(texels[k, 2]) * c + f32(texels[m, 2]) * d) * BYTE
    return red, green, blue, alpha


@device
def sample_texture(materials, row, u0, v0, u1, v1, footprint, srgb):
    """(r, g, b, a) of texture `row` at a hit; footprint: log2 of the ray cone's width in uv units (`surface_footprint`)."""
    texture = materials.textures[row]
    u, v = (u0, v0) if texture.uv_set == 0 else (u1, v1)
    tu = wrapped(texture.m00 * u + texture.m01 * v + texture.m02, texture.wrap_s)
    tv = wrapped(texture.m10 * u + texture.m11 * v + texture.m12, texture.wrap_t)
    if texture.nearest:
        x = min(int(tu * f32(texture.width)), texture.width - 1)
        y = min(int(tv * f32(texture.height)), texture.height - 1)
        i = materials.level_start[row, 0] + y * texture.width + x
        alpha = f32(materials.texels[i, 3]) * BYTE
        if srgb:
            return (
                SRGB_TO_LINEAR[materials.texels[i, 0]],
                SRGB_TO_LINEAR[materials.texels[i, 1]],
                SRGB_TO_LINEAR[materials.texels[i, 2]],
                alpha,
            )
        return f32(materials.texels[i, 0]) * BYTE, f32(materials.texels[i, 1]) * BYTE, f32(materials.texels[i, 2]) * BYTE, alpha
    level = min(max(footprint + texture.log2_size, f32(0.0)), f32(texture.levels - 1))
    low = int(level)
    mix = level - f32(low)
    width, height = max(texture.width >> low, 1), max(texture.height >> low, 1)
    start = materials.level_start[row, low]
    r, g, b, a = bilinear(materials.texels, start, width, height, tu, tv, texture.wrap_s, texture.wrap_t, srgb)
    if mix > f32(0.02) and low + 1 < texture.levels:
        width, height = max(texture.width >> (low + 1), 1), max(texture.height >> (low + 1), 1)
        start = materials.level_start[row, low + 1]
        r2, g2, b2, a2 = bilinear(materials.texels, start, width, height, tu, tv, texture.wrap_s, texture.wrap_t, srgb)
        r, g, b, a = r + (r2 - r) * mix, g + (g2 - g) * mix, b + (b2 - b) * mix, a + (a2 - a) * mix
    return r, g, b, a
