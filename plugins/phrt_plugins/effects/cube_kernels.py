"""Lookups in cube maps: probes' radiance, parallax-corrected, and shadow maps' distances."""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.jit import device, kernel
from phrt.lights import DIRECTIONAL

f32 = np.float32


@device
def cube_texel(x, y, z):
    """Face 0..5 (FACES) and picture coordinates -1..1 (right, down) of a direction."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        if x > f32(0.0):
            return 0, z / ax, -y / ax
        return 1, -z / ax, -y / ax
    if ay >= az:
        if y > f32(0.0):
            return 2, x / ay, -z / ay
        return 3, x / ay, z / ay
    if z > f32(0.0):
        return 4, -x / az, -y / az
    return 5, x / az, -y / az


@device
def cube_radiance(cube, x, y, z):
    """Bilinear (r, g, b) of cube (6, S, S, 3) in a direction; faces are clamped at their edges."""
    face, u, v = cube_texel(x, y, z)
    size = cube.shape[1]
    column = min(max((u * f32(0.5) + f32(0.5)) * f32(size) - f32(0.5), f32(0.0)), f32(size - 1))
    row = min(max((v * f32(0.5) + f32(0.5)) * f32(size) - f32(0.5), f32(0.0)), f32(size - 1))
    x0, y0 = min(int(column), size - 2), min(int(row), size - 2)
    fx, fy = column - f32(x0), row - f32(y0)
    a, b = (f32(1.0) - fx) * (f32(1.0) - fy), fx * (f32(1.0) - fy)
    c, d = (f32(1.0) - fx) * fy, fx * fy
    m = cube[face]
    r = m[y0, x0, 0] * a + m[y0, x0 + 1, 0] * b + m[y0 + 1, x0, 0] * c + m[y0 + 1, x0 + 1, 0] * d
    g = m[y0, x0, 1] * a + m[y0, x0 + 1, 1] * b + m[y0 + 1, x0, 1] * c + m[y0 + 1, x0 + 1, 1] * d
    bl = m[y0, x0, 2] * a + m[y0, x0 + 1, 2] * b + m[y0 + 1, x0, 2] * c + m[y0 + 1, x0 + 1, 2] * d
    return r, g, bl


@kernel
def probe_lookup(rows, surfaces, view, view_is_point, straight, cubes, centres, probe_of, box_low, box_high, out):
    """out (n, 3): radiance from the probe of each point's object, in the mirror direction or straight on.

    cubes (K, 6, S, S, 3); centres (K, 3); probe_of (N + 1,) int32; the direction is corrected for parallax by the box
    box_low, box_high (3,) (Lagarde and Zanuttini 2012).
    """
    for i in range(len(rows)):
        row = rows[i]
        k = probe_of[surfaces.object_id[row]]
        px, py, pz = surfaces.position[row, 0], surfaces.position[row, 1], surfaces.position[row, 2]
        if view_is_point:
            dx, dy, dz = px - view[0, 0], py - view[0, 1], pz - view[0, 2]
            scale = f32(1.0) / math.sqrt(dx * dx + dy * dy + dz * dz + f32(1e-20))
            dx, dy, dz = dx * scale, dy * scale, dz * scale
        else:
            dx, dy, dz = view[i, 0], view[i, 1], view[i, 2]
        if not straight:
            nx, ny, nz = surfaces.normal[row, 0], surfaces.normal[row, 1], surfaces.normal[row, 2]
            twice = f32(2.0) * (dx * nx + dy * ny + dz * nz)
            dx, dy, dz = dx - twice * nx, dy - twice * ny, dz - twice * nz
        # Where the ray leaves the box decides what the probe is asked for.
        reach = f32(1e30)
        for axis in range(3):
            d = dx if axis == 0 else (dy if axis == 1 else dz)
            p = px if axis == 0 else (py if axis == 1 else pz)
            if abs(d) > f32(1e-6):
                edge = box_high[axis] if d > f32(0.0) else box_low[axis]
                reach = min(reach, (edge - p) / d)
        reach = max(reach, f32(0.0))
        x = px + dx * reach - centres[k, 0]
        y = py + dy * reach - centres[k, 1]
        z = pz + dz * reach - centres[k, 2]
        r, g, b = cube_radiance(cubes[k], x, y, z)
        out[i, 0], out[i, 1], out[i, 2] = r, g, b


@device
def lit_share(distances, face, u, v, reference):
    """Share of the four nearest texels of distances (faces, S, S) that are not nearer than `reference` (bilinear PCF)."""
    size = distances.shape[1]
    column = min(max((u * f32(0.5) + f32(0.5)) * f32(size) - f32(0.5), f32(0.0)), f32(size - 1))
    row = min(max((v * f32(0.5) + f32(0.5)) * f32(size) - f32(0.5), f32(0.0)), f32(size - 1))
    x0, y0 = min(int(column), size - 2), min(int(row), size - 2)
    fx, fy = column - f32(x0), row - f32(y0)
    a = f32(1.0) if distances[face, y0, x0] >= reference else f32(0.0)
    b = f32(1.0) if distances[face, y0, x0 + 1] >= reference else f32(0.0)
    c = f32(1.0) if distances[face, y0 + 1, x0] >= reference else f32(0.0)
    d = f32(1.0) if distances[face, y0 + 1, x0 + 1] >= reference else f32(0.0)
    return (a * (f32(1.0) - fx) + b * fx) * (f32(1.0) - fy) + (c * (f32(1.0) - fx) + d * fx) * fy


@kernel
def shadow_map_lookup(rows, surfaces, direct, lights, maps, frames, visibility):
    """visibility (n, L) from shadow maps (Williams 1978), percentage-closer filtered (Reeves et al. 1987); 1 where direct
    (n, L, 3), the light that would arrive at surface points `rows`, is black.

    maps (L, 6, S, S) float32: depth along each face's axis, metres; directional lights use face 0 with frames (L, 4, 4)
    float32, map from world: x, y in -1..1 (right, up), z the depth. The receiver is moved along its normal by a texel.
    """
    size = maps.shape[2]
    at_position, at_normal = surfaces.position, surfaces.geometric_normal
    # Light by light: its map stays in the cache, and is taken out of the array once.
    for k in range(len(lights)):
        light, distances, m = lights[k], maps[k], frames[k]
        casts, directional = light.casts_shadow != 0, light.kind == DIRECTIONAL
        lx, ly, lz = light.position[0], light.position[1], light.position[2]
        sun_texel = (
            f32(2.0) / f32(size) / math.sqrt(m[0, 0] * m[0, 0] + m[0, 1] * m[0, 1] + m[0, 2] * m[0, 2] + f32(1e-20))
        )
        for i in range(len(rows)):
            visibility[i, k] = f32(1.0)
            row = np.uint32(rows[i])
            if not casts or direct[row, k, 0] + direct[row, k, 1] + direct[row, k, 2] <= f32(0.0):
                continue
            nx, ny, nz = at_normal[row, 0], at_normal[row, 1], at_normal[row, 2]
            px, py, pz = at_position[row, 0], at_position[row, 1], at_position[row, 2]
            if directional:
                x, y, z = px + nx * sun_texel, py + ny * sun_texel, pz + nz * sun_texel
                u = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]
                v = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]
                depth = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
                if abs(u) < f32(1.0) and abs(v) < f32(1.0):
                    visibility[i, k] = lit_share(distances, 0, u, -v, depth - sun_texel * f32(0.5))
                continue
            x, y, z = px - lx, py - ly, pz - lz
            axis = max(abs(x), max(abs(y), abs(z)))
            texel = f32(2.0) * axis / f32(size)
            x, y, z = x + nx * texel * f32(1.5), y + ny * texel * f32(1.5), z + nz * texel * f32(1.5)
            face, u, v = cube_texel(x, y, z)
            depth = max(abs(x), max(abs(y), abs(z)))
            visibility[i, k] = lit_share(distances, face, u, v, depth - texel * f32(0.5))
