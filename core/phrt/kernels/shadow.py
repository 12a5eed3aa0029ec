"""Shadow rays: set-up towards every light that reaches a point, and what their answers mean."""

from __future__ import annotations

import math

import numpy as np

from phrt.conventions import RAY_BIAS
from phrt.kernels.jit import device, kernel
from phrt.kernels.random import orthonormal, pixel_sample
from phrt.lights import DIRECTIONAL, RECT

f32 = np.float32
BIAS = f32(RAY_BIAS)


@device
def bias_at(x, y, z):
    """How far a ray starts off a surface at x, y, z, in metres."""
    return BIAS * max(max(abs(x), abs(y)), max(abs(z), f32(1.0)))


@device
def is_extended(light):
    """Has the light an extent that softens its shadows?"""
    if light.kind == RECT:
        return True
    if light.kind == DIRECTIONAL:
        return light.tan_half_angle > f32(0.0)
    return light.radius > f32(0.0)


@device
def light_point(light, px, py, pz, u, v, soft):
    """Where on the light a shadow ray goes: direction (x, y, z) and distance; u, v pick the point of an extended light."""
    if light.kind == DIRECTIONAL:
        x, y, z = -light.direction[0], -light.direction[1], -light.direction[2]
        if soft and light.tan_half_angle > f32(0.0):
            tx, ty, tz, bx, by, bz = orthonormal(x, y, z)
            radius = math.sqrt(u) * light.tan_half_angle
            a, b = radius * math.cos(f32(2.0 * math.pi) * v), radius * math.sin(f32(2.0 * math.pi) * v)
            x, y, z = x + tx * a + bx * b, y + ty * a + by * b, z + tz * a + bz * b
            scale = f32(1.0) / math.sqrt(x * x + y * y + z * z)
            x, y, z = x * scale, y * scale, z * scale
        return x, y, z, f32(np.inf)
    x, y, z = light.position[0] - px, light.position[1] - py, light.position[2] - pz
    if soft and light.kind == RECT:
        a, b = f32(2.0) * u - f32(1.0), f32(2.0) * v - f32(1.0)
        x += light.half_u[0] * a + light.half_v[0] * b
        y += light.half_u[1] * a + light.half_v[1] * b
        z += light.half_u[2] * a + light.half_v[2] * b
    elif soft and light.radius > f32(0.0):
        length = math.sqrt(x * x + y * y + z * z + f32(1e-12))
        tx, ty, tz, bx, by, bz = orthonormal(x / length, y / length, z / length)
        radius = math.sqrt(u) * light.radius
        a, b = radius * math.cos(f32(2.0 * math.pi) * v), radius * math.sin(f32(2.0 * math.pi) * v)
        x, y, z = x + tx * a + bx * b, y + ty * a + by * b, z + tz * a + bz * b
    length = math.sqrt(x * x + y * y + z * z + f32(1e-12))
    return x / length, y / length, z / length, length


@kernel
def shadow_rays(rows, seeds, surfaces, direct, lights, samples, seed, origin, direction, t_max, ray_row, ray_light):
    """Shadow rays for the points `rows` (n,), light by light: only where the light would arrive at all.

    seeds (n,) uint32: what a point's random numbers hang on. samples: rays per extended light. The outputs hold
    n * L * samples rays at most; ray_row is the position in `rows`. Returns how many rays were written.
    """
    # Out of the loop: a tuple's array costs a reference count every time it is taken out.
    at_position = surfaces.position
    at_geometric_normal = surfaces.geometric_normal
    count = 0
    for k in range(len(lights)):
        light = lights[k]
        if light.casts_shadow == 0:
            continue
        extended = is_extended(light)
        repeats = samples if extended else 1
        soft = extended and samples > 0
        repeats = max(repeats, 1)
        for i in range(len(rows)):
            row = np.uint32(rows[i])
            if direct[row, k, 0] + direct[row, k, 1] + direct[row, k, 2] <= f32(0.0):
                continue
            px, py, pz = at_position[row, 0], at_position[row, 1], at_position[row, 2]
            gx, gy, gz = at_geometric_normal[row, 0], at_geometric_normal[row, 1], at_geometric_normal[row, 2]
            bias = bias_at(px, py, pz)
            px, py, pz = px + gx * bias, py + gy * bias, pz + gz * bias
            for j in range(repeats):
                u, v = f32(0.5), f32(0.5)
                if soft:
                    u, v = pixel_sample(seeds[i], seed, j, k)
                x, y, z, length = light_point(light, px, py, pz, u, v, soft)
                origin[count, 0], origin[count, 1], origin[count, 2] = px, py, pz
                direction[count, 0], direction[count, 1], direction[count, 2] = x, y, z
                t_max[count] = length * f32(0.9999)
                ray_row[count] = i
                ray_light[count] = k
                count += 1
    return count


@kernel
def apply_occlusion(blocked, ray_row, ray_light, lights, samples, visibility):
    """Take each blocked ray's share out of visibility (n, L), which starts at 1."""
    for j in range(len(blocked)):
        if blocked[j]:
            k = ray_light[j]
            light = lights[k]
            extended = is_extended(light)
            share = f32(1.0) / f32(max(samples, 1)) if extended else f32(1.0)
            visibility[ray_row[j], k] = max(visibility[ray_row[j], k] - share, f32(0.0))


@kernel
def hemisphere_rays(rows, seeds, surfaces, samples, seed, radius, origin, direction, t_max):
    """Cosine-distributed rays above the points `rows` (n,), `samples` each, up to `radius` metres: ambient occlusion."""
    # Out of the loop: a tuple's array costs a reference count every time it is taken out.
    at_position = surfaces.position
    at_geometric_normal = surfaces.geometric_normal
    at_normal = surfaces.normal
    count = 0
    for i in range(len(rows)):
        row = np.uint32(rows[i])
        px, py, pz = at_position[row, 0], at_position[row, 1], at_position[row, 2]
        gx, gy, gz = at_geometric_normal[row, 0], at_geometric_normal[row, 1], at_geometric_normal[row, 2]
        nx, ny, nz = at_normal[row, 0], at_normal[row, 1], at_normal[row, 2]
        bias = bias_at(px, py, pz)
        tx, ty, tz, bx, by, bz = orthonormal(nx, ny, nz)
        for j in range(samples):
            u, v = pixel_sample(seeds[i], seed, j, 100)
            r = math.sqrt(u)
            a, b = r * math.cos(f32(2.0 * math.pi) * v), r * math.sin(f32(2.0 * math.pi) * v)
            c = math.sqrt(max(f32(1.0) - u, f32(0.0)))
            x, y, z = tx * a + bx * b + nx * c, ty * a + by * b + ny * c, tz * a + bz * b + nz * c
            below = x * gx + y * gy + z * gz
            if below < f32(0.0):
                x, y, z = x - f32(2.0) * below * gx, y - f32(2.0) * below * gy, z - f32(2.0) * below * gz
            origin[count, 0], origin[count, 1], origin[count, 2] = px + gx * bias, py + gy * bias, pz + gz * bias
            direction[count, 0], direction[count, 1], direction[count, 2] = x, y, z
            t_max[count] = radius
            count += 1


@kernel
def open_share(blocked, samples, out):
    """out (n, 1): share of each point's `samples` rays that were not blocked (n * samples,)."""
    for i in range(len(out)):
        free = 0
        for j in range(samples):
            if not blocked[i * samples + j]:
                free += 1
        out[i, 0] = f32(free) / f32(samples)
