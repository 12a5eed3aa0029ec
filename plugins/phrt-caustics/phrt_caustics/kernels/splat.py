"""Splats found again from pixels: a hash grid of several cell sizes, and the sum of those that cover a point."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phrt.kernels.jit import device, kernel

f32 = np.float32
LEVELS = 10
"""Cell sizes, each half as large as the one before."""
ROOM = 2.1
"""Cells are so many radii wide: a splat over a point has its middle in one of the eight cells nearest to it."""
SAME_SIDE = f32(0.7)
"""Cosine between the normals of a splat and of a point that it may lie on: 45 degrees."""
THICKNESS = f32(0.25)
"""How far off a splat's plane a point may be, in radii."""
_FAR = 1 << 19
"""Cells on either side of the world's origin."""


class Splats(NamedTuple):
    """n splats in the order of their buckets, and the buckets.

    place (n, 6) float32: position, normal; light (n, 4) float32: flux times the kernel's norm, and 1 / radius ** 2; key (n,) int64:
    level and cell; begins (buckets + 1,) int32; levels (buckets,) int32: bits of the levels that splats in a cell of the largest
    size have; size: metres, of the largest cells. The number of buckets is a power of two.
    """

    place: np.ndarray
    light: np.ndarray
    key: np.ndarray
    begins: np.ndarray
    levels: np.ndarray
    size: float


@device
def cell_key(level, x, y, z):
    """One number for a cell of a level."""
    mask = (1 << 20) - 1
    return (level << 60) | (((x + _FAR) & mask) << 40) | (((y + _FAR) & mask) << 20) | ((z + _FAR) & mask)


@device
def cell(x, side):
    """The number of the cell that coordinate x is in."""
    return np.int64(math.floor(x / side))


@device
def bucket_of(key, buckets):
    """Where a cell's splats are: Fibonacci hashing of both halves of its key."""
    mixed = np.uint32(key) * np.uint32(2654435769) ^ np.uint32(key >> 32) * np.uint32(2246822519)
    mixed ^= mixed >> np.uint32(15)
    mixed *= np.uint32(3266489917)
    mixed ^= mixed >> np.uint32(16)
    return np.int64(mixed & np.uint32(buckets - 1))


@kernel
def sort_splats(position, span, size, key, bucket, counts, levels):
    """The level and cell key (n,) int64 of every splat, its bucket (n,) int64, how many there are in each, counts (buckets,)
    int32, and which levels there are round about, see `Splats`."""
    for i in range(len(span)):
        level, side = 0, size
        while level < LEVELS - 1 and span[i] * ROOM <= side * 0.5:
            level += 1
            side *= 0.5
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        key[i] = cell_key(level, cell(x, side), cell(y, side), cell(z, side))
        bucket[i] = bucket_of(key[i], len(counts))
        counts[bucket[i]] += 1
        largest = cell_key(0, cell(x, size), cell(y, size), cell(z, size))
        levels[bucket_of(largest, len(counts))] |= 1 << level


@kernel
def collect(rows, position, normal, place, light, key, begins, levels, size, out):
    """out (n, 3): irradiance in lux at points `rows` (n,) of position, normal (P, 3), the sum of the splats over each of them.

    Epanechnikov's kernel in the plane of the splat, 2 / (pi r^2) (1 - d^2 / r^2): it brings the photon's flux as it is (Silverman
    1986, section 4.2).
    """
    buckets = len(levels)
    for i in range(len(rows)):
        row = np.uint32(rows[i])
        px, py, pz = position[row, 0], position[row, 1], position[row, 2]
        nx, ny, nz = normal[row, 0], normal[row, 1], normal[row, 2]
        there = np.int32(0)
        bx, by, bz = cell(px - size / 2, size), cell(py - size / 2, size), cell(pz - size / 2, size)
        for corner in range(8):
            here = cell_key(0, bx + (corner & 1), by + (corner >> 1 & 1), bz + (corner >> 2))
            there |= levels[bucket_of(here, buckets)]
        r, g, b = f32(0.0), f32(0.0), f32(0.0)
        side = size
        for level in range(LEVELS):
            if there >> level & 1:
                bx, by, bz = cell(px - side / 2, side), cell(py - side / 2, side), cell(pz - side / 2, side)
                for corner in range(8):
                    here = cell_key(level, bx + (corner & 1), by + (corner >> 1 & 1), bz + (corner >> 2))
                    bucket = bucket_of(here, buckets)
                    for j in range(begins[bucket], begins[bucket + 1]):
                        if key[j] != here:
                            continue
                        mx, my, mz = place[j, 3], place[j, 4], place[j, 5]
                        if nx * mx + ny * my + nz * mz < SAME_SIDE:
                            continue
                        x, y, z = px - place[j, 0], py - place[j, 1], pz - place[j, 2]
                        off = x * mx + y * my + z * mz
                        off = off * off * light[j, 3]
                        across = (x * x + y * y + z * z) * light[j, 3] - off
                        if across < f32(1.0) and off < THICKNESS * THICKNESS:
                            weight = f32(1.0) - across
                            r += light[j, 0] * weight
                            g += light[j, 1] * weight
                            b += light[j, 2] * weight
            side *= 0.5
        out[i, 0], out[i, 1], out[i, 2] = r, g, b
