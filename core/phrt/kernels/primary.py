"""Eye rays, and the order in which pixels are traced."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from phrt.kernels.jit import device, kernel

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


@kernel
def eye_rays(
    pixels, width, height, world_from_view, tan_half, jitter, orthographic, near, far, origin, direction, t_max
):
    """Rays through `pixels` (n,) of a camera (`CameraView`); they start at the near plane and end at the far one.

    world_from_view (4, 4) float32; tan_half, jitter (2,) float32; writes origin, direction (n, 3) and t_max (n,).
    """
    for i in range(len(pixels)):
        x = pixels[i] % width
        y = pixels[i] // width
        sx = ((f32(x) + f32(0.5) + jitter[0]) / f32(width) * f32(2.0) - f32(1.0)) * tan_half[0]
        sy = (f32(1.0) - (f32(y) + f32(0.5) + jitter[1]) / f32(height) * f32(2.0)) * tan_half[1]
        if orthographic:
            lx, ly, lz = sx, sy, f32(0.0)
            vx, vy, vz = f32(0.0), f32(0.0), f32(-1.0)
            stretch = f32(1.0)
        else:
            stretch = f32(math.sqrt(sx * sx + sy * sy + f32(1.0)))
            lx, ly, lz = f32(0.0), f32(0.0), f32(0.0)
            vx, vy, vz = sx / stretch, sy / stretch, f32(-1.0) / stretch
        m = world_from_view
        dx = m[0, 0] * vx + m[0, 1] * vy + m[0, 2] * vz
        dy = m[1, 0] * vx + m[1, 1] * vy + m[1, 2] * vz
        dz = m[2, 0] * vx + m[2, 1] * vy + m[2, 2] * vz
        start = near * stretch
        origin[i, 0] = m[0, 0] * lx + m[0, 1] * ly + m[0, 2] * lz + m[0, 3] + dx * start
        origin[i, 1] = m[1, 0] * lx + m[1, 1] * ly + m[1, 2] * lz + m[1, 3] + dy * start
        origin[i, 2] = m[2, 0] * lx + m[2, 1] * ly + m[2, 2] * lz + m[2, 3] + dz * start
        direction[i, 0], direction[i, 1], direction[i, 2] = dx, dy, dz
        t_max[i] = (far - near) * stretch


@kernel
def put_in_place(pixels, points, out):
    """Rows 0..n of `points` into rows `pixels` (n,) of `out`, array by array.

    The surface kernel writes every array for one pixel after the other; into arrays of a whole picture, in tile order, that
    are some hundred places in memory at a time, and it took as long as everything else it does. So it writes into a chunk
    that the cache holds, and this brings one array after the other to its place.
    """
    rows = len(pixels)
    position, normal, geometric_normal = points.position, points.normal, points.geometric_normal
    out_position, out_normal, out_geometric_normal = out.position, out.normal, out.geometric_normal
    base_color, emissive, uv = points.base_color, points.emissive, points.uv
    out_base_color, out_emissive, out_uv = out.base_color, out.emissive, out.uv
    copy3(rows, pixels, position, out_position)
    copy3(rows, pixels, normal, out_normal)
    copy3(rows, pixels, geometric_normal, out_geometric_normal)
    copy3(rows, pixels, base_color, out_base_color)
    copy3(rows, pixels, emissive, out_emissive)
    for i in range(rows):
        row = np.uint32(pixels[i])
        out_uv[row, 0], out_uv[row, 1] = uv[i, 0], uv[i, 1]
    copy1(rows, pixels, points.depth, out.depth)
    copy1(rows, pixels, points.alpha, out.alpha)
    copy1(rows, pixels, points.metallic, out.metallic)
    copy1(rows, pixels, points.roughness, out.roughness)
    copy1(rows, pixels, points.transmission, out.transmission)
    copy1(rows, pixels, points.occlusion, out.occlusion)
    copy1(rows, pixels, points.object_id, out.object_id)
    copy1(rows, pixels, points.primitive_id, out.primitive_id)
    copy1(rows, pixels, points.material_id, out.material_id)


@device
def copy3(rows, pixels, source, target):
    for i in range(rows):
        row = np.uint32(pixels[i])
        target[row, 0], target[row, 1], target[row, 2] = source[i, 0], source[i, 1], source[i, 2]


@device
def copy1(rows, pixels, source, target):
    for i in range(rows):
        target[np.uint32(pixels[i])] = source[i]
