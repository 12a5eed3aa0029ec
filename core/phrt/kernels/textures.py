"""Texture lookups: wrap, mip level, bilinear."""

from __future__ import annotations

import numpy as np

from phrt.kernels.jit import device, inlined
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


@inlined
def floor32(x):
    """Largest integer not above x, as int32; math.floor would go through int64 and double precision."""
    whole = np.int32(x)
    return whole - np.int32(1) if f32(whole) > x else whole


@inlined
def wrapped(coordinate, mode):
    """A texture coordinate brought into 0..1 by wrap mode (WRAPS). Beyond 2**23 single precision has no fraction left,
    and beyond 2**31 no integer: such a coordinate, and NaN, counts as 0."""
    c = coordinate if abs(coordinate) < f32(8388608.0) else f32(0.0)
    half = c * f32(0.5)
    repeated = c - f32(floor32(c))
    clamped = min(max(c, f32(0.0)), f32(1.0))
    mirrored = f32(1.0) - abs((half - f32(floor32(half))) * f32(2.0) - f32(1.0))
    return repeated if mode == 0 else (clamped if mode == 1 else mirrored)


@inlined
def corners(width, height, u, v, wrap_s, wrap_t):
    """The four texels around wrapped u, v in one mip level, row by row, as places in it, and how far (x, y) the point is
    among them."""
    x = u * f32(width) - f32(0.5)
    y = v * f32(height) - f32(0.5)
    x0, y0 = floor32(x), floor32(y)
    fx, fy = x - f32(x0), y - f32(y0)
    right, bottom = np.int32(width - np.int32(1)), np.int32(height - np.int32(1))
    x1, y1 = np.int32(x0 + np.int32(1)), np.int32(y0 + np.int32(1))
    # Beyond the edges: the other side where the texture repeats, else the edge.
    x0 = (right if wrap_s == 0 else np.int32(0)) if x0 < 0 else min(x0, right)
    y0 = (bottom if wrap_t == 0 else np.int32(0)) if y0 < 0 else min(y0, bottom)
    x1 = (np.int32(0) if wrap_s == 0 else right) if x1 > right else x1
    y1 = (np.int32(0) if wrap_t == 0 else bottom) if y1 > bottom else y1
    upper, lower = np.int32(y0 * width), np.int32(y1 * width)
    return np.uint32(upper + x0), np.uint32(upper + x1), np.uint32(lower + x0), np.uint32(lower + x1), fx, fy


@inlined
def nearest(width, height, u, v):
    """The texel at wrapped u, v, as its place in the level."""
    x = min(np.int32(u * f32(width)), np.int32(width - np.int32(1)))
    y = min(np.int32(v * f32(height)), np.int32(height - np.int32(1)))
    return np.uint32(y * width + x)


@inlined
def mip_level(footprint, log2_size, levels):
    """The level nearest to a ray's footprint: log2 of its cone's width in uv units, as the `surface` kernel computes it."""
    return np.int32(min(max(footprint + log2_size + f32(0.5), f32(0.0)), f32(levels) - f32(0.5)))


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
    texture = textures[row]
    u, v = (u0, v0) if texture.uv_set == 0 else (u1, v1)
    tu = wrapped(texture.m00 * u + texture.m01 * v + texture.m02, texture.wrap_s)
    tv = wrapped(texture.m10 * u + texture.m11 * v + texture.m12, texture.wrap_t)
    if texture.nearest:
        t = texels[level_start[row, 0] + nearest(texture.width, texture.height, tu, tv)]
        return blend(t, t, t, t, f32(0.0), f32(0.0), srgb)
    level = mip_level(footprint, texture.log2_size, texture.levels)
    width, height = max(texture.width >> level, np.int32(1)), max(texture.height >> level, np.int32(1))
    i, j, k, m, fx, fy = corners(width, height, tu, tv, texture.wrap_s, texture.wrap_t)
    start = level_start[row, level]
    return blend(texels[start + i], texels[start + j], texels[start + k], texels[start + m], fx, fy, srgb)


BLOCK = 64
"""Hits that are looked up together."""
U1, U2, U3, U4 = np.uint64(BLOCK), np.uint64(2 * BLOCK), np.uint64(3 * BLOCK), np.uint64(4 * BLOCK)


@device
def sample_block(count, row, uv, footprint, srgb, texels, textures, level_start, taps, part, texel):
    """`sample_texture` for `count` hits side by side: writes texel (4, BLOCK), 1 where a hit has no texture.

    row (BLOCK,) int32, negative for none; uv (4, BLOCK): u0, v0, u1, v1; taps (5 * BLOCK,) uint32, part (2 * BLOCK,) float32:
    work space. Returns whether any has a texture. Neighbours mostly have the same one: it is looked up once for a run of
    them, and their places in it are found by vector instructions, before the first texel is read.
    """
    textured, first = False, 0
    while first < count:
        this = row[first]
        last = first + 1
        while last < count and row[last] == this:
            last += 1
        start, run = np.uint64(first), last - first
        first = last
        if this < 0:
            for i in range(run):
                k = start + np.uint64(i)
                texel[0, k], texel[1, k], texel[2, k], texel[3, k] = f32(1.0), f32(1.0), f32(1.0), f32(1.0)
            continue
        textured = True
        texture = textures[np.uint32(this)]
        width, height, levels, log2_size = texture.width, texture.height, texture.levels, texture.log2_size
        wrap_s, wrap_t, point = texture.wrap_s, texture.wrap_t, texture.nearest != 0
        m00, m01, m02, m10, m11, m12 = texture.m00, texture.m01, texture.m02, texture.m10, texture.m11, texture.m12
        u_row, v_row = (np.uint32(0), np.uint32(1)) if texture.uv_set == 0 else (np.uint32(2), np.uint32(3))
        for i in range(run):
            k = start + np.uint64(i)
            u, v = uv[u_row, k], uv[v_row, k]
            tu = wrapped(m00 * u + m01 * v + m02, wrap_s)
            tv = wrapped(m10 * u + m11 * v + m12, wrap_t)
            level = np.int32(0) if point else mip_level(footprint[k], log2_size, levels)
            wide, high = max(np.int32(width >> level), np.int32(1)), max(np.int32(height >> level), np.int32(1))
            a, b, c, d, fx, fy = corners(wide, high, tu, tv, wrap_s, wrap_t)
            if point:
                a, fx, fy = nearest(wide, high, tu, tv), f32(0.0), f32(0.0)
            taps[k], taps[k + U1], taps[k + U2], taps[k + U3], taps[k + U4] = a, b, c, d, np.uint32(level)
            part[k], part[k + U1] = fx, fy
        for i in range(run):
            k = start + np.uint64(i)
            level_first = level_start[np.uint32(this), taps[k + U4]]
            texel[0, k], texel[1, k], texel[2, k], texel[3, k] = blend(
                texels[level_first + taps[k]],
                texels[level_first + taps[k + U1]],
                texels[level_first + taps[k + U2]],
                texels[level_first + taps[k + U3]],
                part[k],
                part[k + U1],
                srgb,
            )
    return textured
