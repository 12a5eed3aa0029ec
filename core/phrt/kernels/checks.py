"""Checks: is what a plugin returned a number, and does it point at what is there? One pass without a branch, which becomes vector
instructions; who is wrong is looked for only when somebody is."""

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
def hits_can_be(distance, primitive, triangles):
    """Is each of n hits one of `triangles` at a distance of 0 or more (+inf beyond what float32 holds), or a miss at +inf?"""
    wrong = np.uint32(0)
    for i in range(len(distance)):
        t, p = distance[i], primitive[i]
        near = not (t >= np.float32(0))
        wrong |= np.uint32((p >= triangles) & (p != MISS)) | np.uint32(near) | np.uint32((p == MISS) & (t != INFINITE))
    return wrong == 0


@kernel
def ids_within(ids, limit, none):
    """Is each of `ids` (n,) uint32 `limit` at most, or `none`?"""
    wrong = np.uint32(0)
    for i in range(len(ids)):
        wrong |= np.uint32((ids[i] > limit) & (ids[i] != none))
    return wrong == 0
