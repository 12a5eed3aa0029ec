"""Eye rays, and the order in which pixels are traced."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from phrt.kernels.jit import kernel

f32 = np.float32


@lru_cache(maxsize=16)
def tile_order(width: int, height: int) -> np.ndarray:
    """(width * height,) int32 flat pixel indices, 8x8 tiles of 4x4 tiles: neighbours in the order are neighbours in the
    picture, which is what ray packets and texture caches need (ray phase 48 ms against 61 row by row). Read-only."""
    y, x = np.divmod(np.arange(width * height, dtype=np.int64), width)
    key = (y // 8) * ((width + 7) // 8) + x // 8
    key = ((key * 2 + (y // 4) % 2) * 2 + (x // 4) % 2) * 16 + (y % 4) * 4 + x % 4
    order = np.argsort(key, kind="stable").astype(np.int32)
    order.flags.writeable = False
    return order


@lru_cache(maxsize=16)
def row_order(width: int, height: int, size: int) -> np.ndarray:
    """(width * height,) int32: in each run of `size` pixels of `tile_order`, their places in it, row by row of the picture.
    Read-only.

    Rays are traced in tiles; what they found is written into fifteen arrays of a whole picture. By tiles that would be some
    hundred places in memory at a time, and take as long as everything else the surface kernel does.
    """
    pixels = tile_order(width, height)
    run = np.arange(len(pixels), dtype=np.int64) // size
    order = (np.lexsort((pixels, run)) - run * size).astype(np.int32)
    order.flags.writeable = False
    return order


BLOCK = 64
_SX, _SY, _DX, _DY, _DZ, _OX, _OY, _OZ, _REACH = range(9)
_RAY_ROWS = 9


@kernel
def eye_rays(
    pixels, width, height, world_from_view, tan_half, jitter, orthographic, near, far, origin, direction, t_max
):
    """Rays through `pixels` (n,) of a camera (`CameraView`); they start at the near plane and end at the far one.

    world_from_view (4, 4) float32; tan_half, jitter (2,) float32; writes origin, direction (n, 3) and t_max (n,).
    """
    # The matrix by columns, and out of the loop: what is read inside it could be what is written, as far as the compiler knows.
    xx, xy, xz = world_from_view[0, 0], world_from_view[1, 0], world_from_view[2, 0]
    yx, yy, yz = world_from_view[0, 1], world_from_view[1, 1], world_from_view[2, 1]
    zx, zy, zz = world_from_view[0, 2], world_from_view[1, 2], world_from_view[2, 2]
    eye_x, eye_y, eye_z = world_from_view[0, 3], world_from_view[1, 3], world_from_view[2, 3]
    rows = 1.0 / width  # of a pixel; in double precision, which holds every pixel number exactly
    step_x, step_y = f32(2.0) * tan_half[0] / f32(width), f32(2.0) * tan_half[1] / f32(height)
    left, top = (f32(0.5) + jitter[0]) * step_x - tan_half[0], tan_half[1] - (f32(0.5) + jitter[1]) * step_y
    reach = far - near
    # Blocks of BLOCK rays, computed in one array: the compiler then makes vector instructions of it.
    at = np.zeros((_RAY_ROWS, BLOCK), np.float32)
    for block in range(0, len(pixels), BLOCK):
        size = min(BLOCK, len(pixels) - block)
        for i in range(size):
            pixel = pixels[np.uint64(block + i)]
            y = np.int32((np.float64(pixel) + 0.5) * rows)
            at[_SX, i], at[_SY, i] = f32(pixel - y * width), f32(y)
        for i in range(BLOCK):
            sx, sy = at[_SX, i] * step_x + left, top - at[_SY, i] * step_y
            if orthographic:
                stretch = f32(1.0)
                dx, dy, dz = -zx, -zy, -zz
                from_x, from_y, from_z = eye_x + xx * sx + yx * sy, eye_y + xy * sx + yy * sy, eye_z + xz * sx + yz * sy
            else:
                stretch = f32(math.sqrt(sx * sx + sy * sy + f32(1.0)))
                inverse = f32(1.0) / stretch
                dx = (xx * sx + yx * sy - zx) * inverse
                dy = (xy * sx + yy * sy - zy) * inverse
                dz = (xz * sx + yz * sy - zz) * inverse
                from_x, from_y, from_z = eye_x, eye_y, eye_z
            start = near * stretch
            at[_DX, i], at[_DY, i], at[_DZ, i] = dx, dy, dz
            at[_OX, i], at[_OY, i], at[_OZ, i] = from_x + dx * start, from_y + dy * start, from_z + dz * start
            at[_REACH, i] = reach * stretch
        for i in range(size):
            ray = np.uint64(block + i)
            origin[ray, 0], origin[ray, 1], origin[ray, 2] = at[_OX, i], at[_OY, i], at[_OZ, i]
            direction[ray, 0], direction[ray, 1], direction[ray, 2] = at[_DX, i], at[_DY, i], at[_DZ, i]
            t_max[ray] = at[_REACH, i]
