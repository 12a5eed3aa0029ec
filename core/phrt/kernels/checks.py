"""Checks: is what a plugin returned a number, and does it point at what is there? One pass, without a branch."""

from __future__ import annotations

import numpy as np

from phrt.conventions import NO_PRIMITIVE
from phrt.kernels.jit import kernel

MISS = np.uint32(NO_PRIMITIVE)
INFINITE = np.float32(np.inf)


@kernel
def all_finite(values):
    """Is none of `values` (n,) float32 NaN or infinite?"""
    total = np.float32(0)
    for i in range(len(values)):
        # Anything but a finite number times zero is NaN, and stays NaN in the sum.
        total += values[i] * np.float32(0)
    return total == np.float32(0)


@kernel
def impossible_hits(distance, primitive, barycentric, triangles):
    """How many of n hits are none: a triangle that is not one of `triangles`, a distance that is not 0 or more (+inf is that of a
    hit beyond what float32 holds), weights that are not finite, or a miss that is not at +inf. distance (n,), primitive (n,),
    barycentric (n, 2) as of a HitBatch."""
    wrong = 0
    for i in range(len(distance)):
        t, p = distance[i], primitive[i]
        u, v = abs(barycentric[i, 0]), abs(barycentric[i, 1])
        hit = (p < triangles) & (t >= np.float32(0)) & (u < INFINITE) & (v < INFINITE)
        miss = (p == MISS) & (t == INFINITE)
        wrong += not (hit | miss)
    return wrong


@kernel
def ids_beyond(ids, limit, none):
    """How many of `ids` (n,) uint32 are larger than `limit`, `none` apart."""
    wrong = 0
    for i in range(len(ids)):
        wrong += (ids[i] > limit) & (ids[i] != none)
    return wrong
