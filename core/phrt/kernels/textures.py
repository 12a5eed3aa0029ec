"""Texture lookups: wrap, mip level, bilinear."""

from __future__ import annotations

import numpy as np

from phrt.kernels.jit import device
from phrt.kernels.mipmaps import SRGB_TO_LINEAR

f32 = np.float32
BYTE = f32(1.0 / 255.0)
# A texel is one 32-bit word, red in its lowest byte: one load in place of four.
LOW, G, B, A = np.uint32(255), np.uint32(8), np.uint32(16), np.uint32(24)


@device
def fast_log2(x):
    """log2 of x > 0, within 0.01: exponent bits and a quadratic in the mantissa."""
    bits = np.float32(x).view(np.int32)
    exponent = (bits >> 23) - 127
    mantissa = np.int32((bits & 0x007FFFFF) | 0x3F800000).view(np.float32)
    return f32(exponent) + (mantissa * (f32(-0.33582878) * mantissa + f32(2.0)) - f32(1.65871))


@device
def floor32(x):
    """Largest integer not above x, as int32; math.floor would go through int64 and double precision."""
    whole = np.int32(x)
    return whole - np.int32(1) if f32(whole) > x else whole


@device
def wrapped(coordinate, mode):
    """A texture coordinate brought into 0..1 by wrap mode (WRAPS). Beyond 2**23 single precision has no fraction left,
    and beyond 2**31 no integer: such a coordinate, and NaN, counts as 0."""
    if not abs(coordinate) < f32(8388608.0):
        return f32(0.0)
    if mode == 0:
        return coordinate - f32(floor32(coordinate))
    if mode == 1:
        return min(max(coordinate, f32(0.0)), f32(1.0))
    half = coordinate * f32(0.5)
    return f32(1.0) - abs((half - f32(floor32(half))) * f32(2.0) - f32(1.0))


@device
def corners(start, width, height, u, v, wrap_s, wrap_t):
    """The four texels around wrapped u, v in one mip level, row by row, and how far (x, y) the point is among them."""
    x = u * f32(width) - f32(0.5)
    y = v * f32(height) - f32(0.5)
    x0, y0 = floor32(x), floor32(y)
    fx, fy = x - f32(x0), y - f32(y0)
    x1, y1 = x0 + np.int32(1), y0 + np.int32(1)
    if x0 < 0:
        x0 = width - np.int32(1) if wrap_s == 0 else np.int32(0)
    if y0 < 0:
        y0 = height - np.int32(1) if wrap_t == 0 else np.int32(0)
    if x1 >= width:
        x1 = np.int32(0) if wrap_s == 0 else width - np.int32(1)
        x0 = min(x0, width - np.int32(1))
    if y1 >= height:
        y1 = np.int32(0) if wrap_t == 0 else height - np.int32(1)
        y0 = min(y0, height - np.int32(1))
    upper, lower = y0 * width, y1 * width
    return (
        start + np.uint32(upper + x0),
        start + np.uint32(upper + x1),
        start + np.uint32(lower + x0),
        start + np.uint32(lower + x1),
        fx,
        fy,
    )


@device
def place(textures, level_start, row, u0, v0, u1, v1, footprint):
    """Where a lookup in texture `row` reads: `corners` in the mip level nearest to the ray's footprint.

    footprint: log2 of the ray cone's width in uv units, as the `surface` kernel computes it.
    """
    texture = textures[row]
    u, v = (u0, v0) if texture.uv_set == 0 else (u1, v1)
    tu = wrapped(texture.m00 * u + texture.m01 * v + texture.m02, texture.wrap_s)
    tv = wrapped(texture.m10 * u + texture.m11 * v + texture.m12, texture.wrap_t)
    if texture.nearest:
        x = min(np.int32(tu * f32(texture.width)), texture.width - np.int32(1))
        y = min(np.int32(tv * f32(texture.height)), texture.height - np.int32(1))
        i = level_start[row, 0] + np.uint32(y * texture.width + x)
        return i, i, i, i, f32(0.0), f32(0.0)
    level = np.int32(min(max(footprint + texture.log2_size + f32(0.5), f32(0.0)), f32(texture.levels) - f32(0.5)))
    width, height = max(texture.width >> level, np.int32(1)), max(texture.height >> level, np.int32(1))
    return corners(level_start[row, level], width, height, tu, tv, texture.wrap_s, texture.wrap_t)


@device
def blend(p, q, s, t, fx, fy, srgb):
    """(r, g, b, a) 0..1 between four texels; colour decoded where srgb."""
    a, b = (f32(1.0) - fx) * (f32(1.0) - fy), fx * (f32(1.0) - fy)
    c, d = (f32(1.0) - fx) * fy, fx * fy
    alpha = (f32(p >> A) * a + f32(q >> A) * b + f32(s >> A) * c + f32(t >> A) * d) * BYTE
    if srgb:
        red = SRGB_TO_LINEAR[p & LOW] * a + SRGB_TO_LINEAR[q & LOW] * b
        red += SRGB_TO_LINEAR[s & LOW] * c + SRGB_TO_LINEAR[t & LOW] * d
        green = SRGB_TO_LINEAR[(p >> G) & LOW] * a + SRGB_TO_LINEAR[(q >> G) & LOW] * b
        green += SRGB_TO_LINEAR[(s >> G) & LOW] * c + SRGB_TO_LINEAR[(t >> G) & LOW] * d
        blue = SRGB_TO_LINEAR[(p >> B) & LOW] * a + SRGB_TO_LINEAR[(q >> B) & LOW] * b
        blue += SRGB_TO_LINEAR[(s >> B) & LOW] * c + SRGB_TO_LINEAR[(t >> B) & LOW] * d
        return red, green, blue, alpha
    red = (f32(p & LOW) * a + f32(q & LOW) * b + f32(s & LOW) * c + f32(t & LOW) * d) * BYTE
    green = (
        f32((p >> G) & LOW) * a + f32((q >> G) & LOW) * b + f32((s >> G) & LOW) * c + f32((t >> G) & LOW) * d
    ) * BYTE
    blue = (
        f32((p >> B) & LOW) * a + f32((q >> B) & LOW) * b + f32((s >> B) & LOW) * c + f32((t >> B) & LOW) * d
    ) * BYTE
    return red, green, blue, alpha


@device
def sample_texture(texels, textures, level_start, row, u0, v0, u1, v1, footprint, srgb):
    """(r, g, b, a) of texture `row` at a hit: bilinear in the mip level nearest to the ray's footprint."""
    i, j, k, m, fx, fy = place(textures, level_start, row, u0, v0, u1, v1, footprint)
    return blend(texels[i], texels[j], texels[k], texels[m], fx, fy, srgb)


@device
def sample_block(count, row, uv, footprint, srgb, texels, textures, level_start, lane, taps, part, texel):
    """`sample_texture` for `count` hits side by side: writes texel (4, BLOCK), 1 where a hit has no texture. Returns how many do.

    row (BLOCK,) int32, negative for none; uv (4, BLOCK): u0, v0, u1, v1; lane, taps (4, BLOCK), part (2, BLOCK): work space.
    All places are found first, then all texels are read: a read that waits for memory does not hold up the next.
    """
    textured = 0
    for i in range(count):
        k = np.uint32(i)
        if row[k] < 0:
            for c in range(4):
                texel[c, k] = f32(1.0)
            continue
        j = np.uint32(textured)
        lane[j] = k
        taps[0, j], taps[1, j], taps[2, j], taps[3, j], part[0, j], part[1, j] = place(
            textures, level_start, np.uint32(row[k]), uv[0, k], uv[1, k], uv[2, k], uv[3, k], footprint[k]
        )
        textured += 1
    for i in range(textured):
        j = np.uint32(i)
        k = lane[j]
        texel[0, k], texel[1, k], texel[2, k], texel[3, k] = blend(
            texels[taps[0, j]], texels[taps[1, j]], texels[taps[2, j]], texels[taps[3, j]], part[0, j], part[1, j], srgb
        )
    return textured
