"""Seeded randomness: the same numbers for a pixel and a sample, whatever thread computes them."""

from __future__ import annotations

import numpy as np

from phrt.kernels.jit import device

f32 = np.float32
u32 = np.uint32


@device
def hash_u32(a, b, c):
    """A well-mixed 32-bit value of three integers (PCG-RXS-M-XS, O'Neill 2014, chained)."""
    state = u32(a) * u32(747796405) + u32(2891336453)
    state = (state ^ (state >> u32(16))) * u32(2246822519) + u32(b) * u32(3266489917)
    state = (state ^ (state >> u32(15))) * u32(668265263) + u32(c) * u32(374761393)
    state = (state ^ (state >> u32(13))) * u32(277803737)
    return u32(state ^ (state >> u32(16)))


@device
def unit_float(bits):
    """0 <= x < 1 of 32 random bits."""
    return f32(u32(bits) >> u32(8)) * f32(1.0 / 16777216.0)


@device
def halton(index, base):
    """Element `index` of the van der Corput sequence in `base`."""
    result, fraction = f32(0.0), f32(1.0)
    i = index + 1
    while i > 0:
        fraction /= f32(base)
        result += fraction * f32(i % base)
        i //= base
    return result


@device
def pixel_sample(pixel, seed, index, dimension):
    """Two numbers 0..1 for sample `index` of `pixel`: the R2 sequence (Roberts 2018), shifted per pixel (Cranley-Patterson)."""
    shift_u = unit_float(hash_u32(pixel, seed, 2 * dimension))
    shift_v = unit_float(hash_u32(pixel, seed, 2 * dimension + 1))
    u = shift_u + f32(index) * f32(0.7548776662466927)
    v = shift_v + f32(index) * f32(0.5698402909980532)
    return u - f32(int(u)), v - f32(int(v))


@device
def orthonormal(x, y, z):
    """Two unit tangents of unit (x, y, z): Duff et al. 2017."""
    sign = f32(1.0) if z >= f32(0.0) else f32(-1.0)
    a = f32(-1.0) / (sign + z)
    b = x * y * a
    return f32(1.0) + sign * x * x * a, sign * b, -sign * x, b, sign + y * y * a, -y
