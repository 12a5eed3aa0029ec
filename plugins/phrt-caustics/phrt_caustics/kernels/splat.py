"""Splats found again from pixels: a hash grid of several cell sizes, and the sum of those that cover a point."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from phrt.kernels.jit import device, kernel

f32 = np.float32
LEVELS = 10
"""Cell sizes, each half as large as the one before."""
ROOM = 0.75
"""Cells are so many radii wide at least, and less than twice that."""
SAME_SIDE = f32(0.7)
"""Cosine between the normals of a splat and of a point that it may lie on: 45 degrees."""
THICKNESS = f32(0.25)
"""How far off a splat's plane a point may be, in radii."""
FEW = 48
"""Splats of a cell that say how crowded it is."""
_FAR = 1 << 19
"""Cells on either side of the world's origin."""


class Splats(NamedTuple):
    """n splats, and m entries of them in the cells that they reach into.

    place (n, 6) float32: position, normal; light (n, 4) float32: flux times the kernel's norm, and 1 / radius ** 2; key (m,) int64:
    level and cell of an entry; entry (m,) int32: the splat; begins (buckets + 1,) int32: where the entries of a bucket begin; used:
    bits of the levels that there are; size: metres, of the largest cells. The number of buckets is a power of two.
    """

    place: np.ndarray
    light: np.ndarray
    key: np.ndarray
    entry: np.ndarray
    begins: np.ndarray
    used: int
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
    """Where a cell's entries are: multiplicative hashing of both halves of its key (Knuth 1998, section 6.4)."""
    mixed = np.uint32(key) * np.uint32(2654435769) ^ np.uint32(key >> 32) * np.uint32(2246822519)
    mixed ^= mixed >> np.uint32(15)
    mixed *= np.uint32(3266489917)
    mixed ^= mixed >> np.uint32(16)
    return np.int64(mixed & np.uint32(buckets - 1))


@kernel
def enter(place, radius, size, buckets, filling, cursor, key, entry):
    """Enter splats (n,) into the cells that their discs reach into; returns `used` of `Splats`.

    filling False: count them, cursor[bucket + 1] up by one for each; True: cursor (buckets,) says where a bucket's next entry goes.
    """
    used = 0
    for i in range(len(radius)):
        r, x, y, z = float(radius[i]), float(place[i, 0]), float(place[i, 1]), float(place[i, 2])
        nx, ny, nz = place[i, 3], place[i, 4], place[i, 5]
        level, side = 0, size
        while level < LEVELS - 1 and r * ROOM <= side * 0.5:
            level += 1
            side *= 0.5
        used |= 1 << level
        # How far from the disc's plane, and from its middle, the middle of a cell may be that it reaches into.
        off = THICKNESS * r + side * 0.5 * (abs(nx) + abs(ny) + abs(nz))
        reach = r * 1.04 + side * 0.8661
        for cx in range(cell(x - r, side), cell(x + r, side) + 1):
            dx = (cx + 0.5) * side - x
            for cy in range(cell(y - r, side), cell(y + r, side) + 1):
                dy = (cy + 0.5) * side - y
                for cz in range(cell(z - r, side), cell(z + r, side) + 1):
                    dz = (cz + 0.5) * side - z
                    if abs(dx * nx + dy * ny + dz * nz) > off or dx * dx + dy * dy + dz * dz > reach * reach:
                        continue
                    here = cell_key(level, cx, cy, cz)
                    bucket = bucket_of(here, buckets)
                    if filling:
                        key[cursor[bucket]] = here
                        entry[cursor[bucket]] = i
                        cursor[bucket] += 1
                    else:
                        cursor[bucket + 1] += 1
    return used


@kernel
def crowd(place, light, key, entry, begins, used, size, density):
    """density (n,) float32: splats a square metre at the middle of each of them, all counted alike, by their kernels.

    Of cells that many reach into, every so-manieth is looked at, FEW of them or a few more: they lie in the order in which the
    photons started, so that those are spread evenly, too.
    """
    buckets = len(begins) - 1
    for i in range(len(density)):
        px, py, pz = place[i, 0], place[i, 1], place[i, 2]
        nx, ny, nz = place[i, 3], place[i, 4], place[i, 5]
        total = f32(0.0)
        side = size
        for level in range(LEVELS):
            if used >> level & 1:
                here = cell_key(level, cell(px, side), cell(py, side), cell(pz, side))
                bucket = bucket_of(here, buckets)
                step = 1 + (begins[bucket + 1] - begins[bucket]) // FEW
                for j in range(begins[bucket] + i % step, begins[bucket + 1], step):
                    k = np.uint32(entry[j])
                    if key[j] != here or nx * place[k, 3] + ny * place[k, 4] + nz * place[k, 5] < SAME_SIDE:
                        continue
                    x, y, z = px - place[k, 0], py - place[k, 1], pz - place[k, 2]
                    across = (x * x + y * y + z * z) * light[k, 3]
                    if across < f32(1.0):
                        total += (f32(1.0) - across) * light[k, 3] * f32(step)
            side *= 0.5
        density[i] = total * f32(2.0 / math.pi)


@kernel
def collect(rows, position, normal, place, light, key, entry, begins, used, size, out):
    """out (n, 3): irradiance in lux at points `rows` (n,) of position, normal (P, 3), the sum of the splats over each of them.

    Epanechnikov's kernel in the plane of the splat, 2 / (pi r^2) (1 - d^2 / r^2): it brings the photon's flux as it is (Silverman
    1986, section 4.2).
    """
    buckets = len(begins) - 1
    for i in range(len(rows)):
        row = np.uint32(rows[i])
        px, py, pz = position[row, 0], position[row, 1], position[row, 2]
        nx, ny, nz = normal[row, 0], normal[row, 1], normal[row, 2]
        r, g, b = f32(0.0), f32(0.0), f32(0.0)
        side = size
        for level in range(LEVELS):
            if used >> level & 1:
                here = cell_key(level, cell(px, side), cell(py, side), cell(pz, side))
                bucket = bucket_of(here, buckets)
                for j in range(begins[bucket], begins[bucket + 1]):
                    if key[j] != here:
                        continue
                    k = np.uint32(entry[j])
                    mx, my, mz = place[k, 3], place[k, 4], place[k, 5]
                    x, y, z = px - place[k, 0], py - place[k, 1], pz - place[k, 2]
                    off = x * mx + y * my + z * mz
                    off = off * off * light[k, 3]
                    across = (x * x + y * y + z * z) * light[k, 3] - off
                    if across < f32(1.0) and off < THICKNESS * THICKNESS and nx * mx + ny * my + nz * mz >= SAME_SIDE:
                        weight = f32(1.0) - across
                        r += light[k, 0] * weight
                        g += light[k, 1] * weight
                        b += light[k, 2] * weight
            side *= 0.5
        out[i, 0], out[i, 1], out[i, 2] = r, g, b
