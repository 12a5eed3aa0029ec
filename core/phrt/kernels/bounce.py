"""Bounces: the first reflected or refracted ray of a pixel, what a hit sends back, and the rays that go on from it."""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.environment import environment_radiance
from phrt.kernels.jit import device, kernel
from phrt.kernels.random import orthonormal, pixel_sample
from phrt.kernels.shade import ambient_light, reflectance
from phrt.kernels.shadow import bias_at

f32 = np.float32
MIRROR_RAY_ROUGHNESS = f32(0.05)
"""Up to this roughness a reflection is one ray; rougher ones take several, spread by GGX."""

MIRROR_BOUNCE_ROUGHNESS = f32(0.15)
"""A surface seen in a mirror is itself a mirror up to this roughness; rougher ones take the filtered dome."""


@device
def refracted(dx, dy, dz, nx, ny, nz, ratio):
    """Unit direction d refracted at unit normal n (d . n < 0), ratio = ior in front / ior behind; total: whether it cannot be."""
    cosine = -(dx * nx + dy * ny + dz * nz)
    sine2 = ratio * ratio * (f32(1.0) - cosine * cosine)
    if sine2 >= f32(1.0):
        return dx, dy, dz, True
    k = ratio * cosine - math.sqrt(f32(1.0) - sine2)
    x, y, z = ratio * dx + k * nx, ratio * dy + k * ny, ratio * dz + k * nz
    scale = f32(1.0) / math.sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale, False


@device
def faces_front(geometry, primitive, dx, dy, dz):
    """Does a ray along d meet the front (counter-clockwise) side of triangle `primitive`?"""
    a, b, c = (
        np.uint32(geometry.triangles[primitive, 0]),
        np.uint32(geometry.triangles[primitive, 1]),
        np.uint32(geometry.triangles[primitive, 2]),
    )
    ax, ay, az = geometry.positions[a, 0], geometry.positions[a, 1], geometry.positions[a, 2]
    ux, uy, uz = geometry.positions[b, 0] - ax, geometry.positions[b, 1] - ay, geometry.positions[b, 2] - az
    vx, vy, vz = geometry.positions[c, 0] - ax, geometry.positions[c, 1] - ay, geometry.positions[c, 2] - az
    gx, gy, gz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    return gx * dx + gy * dy + gz * dz <= f32(0.0)


@device
def glossy_normal(nx, ny, nz, vx, vy, vz, roughness, u, v):
    """A microfacet normal seen from v: GGX's visible normals (Heitz 2018, "Sampling the GGX Distribution of Visible Normals")."""
    alpha = roughness * roughness
    tx, ty, tz, bx, by, bz = orthonormal(nx, ny, nz)
    # The view in the local, stretched frame.
    ex = alpha * (vx * tx + vy * ty + vz * tz)
    ey = alpha * (vx * bx + vy * by + vz * bz)
    ez = max(vx * nx + vy * ny + vz * nz, f32(1e-4))
    scale = f32(1.0) / math.sqrt(ex * ex + ey * ey + ez * ez)
    ex, ey, ez = ex * scale, ey * scale, ez * scale
    square = ex * ex + ey * ey
    if square > f32(0.0):
        inverse = f32(1.0) / math.sqrt(square)
        t1x, t1y = -ey * inverse, ex * inverse
    else:
        t1x, t1y = f32(1.0), f32(0.0)
    t2x, t2y, t2z = -ez * t1y, ez * t1x, ex * t1y - ey * t1x
    r = math.sqrt(u)
    phi = f32(2.0 * math.pi) * v
    p1, p2 = r * math.cos(phi), r * math.sin(phi)
    s = f32(0.5) * (f32(1.0) + ez)
    p2 = (f32(1.0) - s) * math.sqrt(max(f32(1.0) - p1 * p1, f32(0.0))) + s * p2
    p3 = math.sqrt(max(f32(1.0) - p1 * p1 - p2 * p2, f32(0.0)))
    hx = alpha * (p1 * t1x + p2 * t2x + p3 * ex)
    hy = alpha * (p1 * t1y + p2 * t2y + p3 * ey)
    hz = max(p2 * t2z + p3 * ez, f32(1e-6))
    scale = f32(1.0) / math.sqrt(hx * hx + hy * hy + hz * hz)
    hx, hy, hz = hx * scale, hy * scale, hz * scale
    return tx * hx + bx * hy + nx * hz, ty * hx + by * hy + ny * hz, tz * hx + bz * hy + nz * hz


@kernel
def reflection_rays(rows, seeds, surfaces, materials, view, view_is_point, applies, cutoff, samples, seed,
                    origin, direction, weight, target):  # fmt: skip
    """First reflected rays of the points `rows` (n,): one for a mirror, `samples` for a glossy surface, none above `cutoff`.

    view: eye (1, 3), or ray directions (n, 3). weight (rays, 3) sums to one over a point's rays; target = position in
    `rows`. Writes n * samples rays at most; returns how many.
    """
    # Out of the loop: a tuple's array costs a reference count every time it is taken out.
    at_material_id = surfaces.material_id
    at_roughness = surfaces.roughness
    at_position = surfaces.position
    at_normal = surfaces.normal
    at_geometric_normal = surfaces.geometric_normal
    count = 0
    for i in range(len(rows)):
        row = np.uint32(rows[i])
        material = at_material_id[row]
        roughness = at_roughness[row]
        if not applies[material] or roughness > cutoff:
            continue
        px, py, pz = at_position[row, 0], at_position[row, 1], at_position[row, 2]
        nx, ny, nz = at_normal[row, 0], at_normal[row, 1], at_normal[row, 2]
        gx, gy, gz = at_geometric_normal[row, 0], at_geometric_normal[row, 1], at_geometric_normal[row, 2]
        if view_is_point:
            vx, vy, vz = view[0, 0] - px, view[0, 1] - py, view[0, 2] - pz
            scale = f32(1.0) / math.sqrt(vx * vx + vy * vy + vz * vz + f32(1e-20))
            vx, vy, vz = vx * scale, vy * scale, vz * scale
        else:
            vx, vy, vz = -view[i, 0], -view[i, 1], -view[i, 2]
        bias = bias_at(px, py, pz)
        mirror = roughness < MIRROR_RAY_ROUGHNESS
        repeats = 1 if mirror else samples
        for j in range(repeats):
            hx, hy, hz = nx, ny, nz
            if not mirror:
                u, v = pixel_sample(seeds[i], seed, j, 200)
                hx, hy, hz = glossy_normal(nx, ny, nz, vx, vy, vz, roughness, u, v)
            twice = f32(2.0) * (vx * hx + vy * hy + vz * hz)
            x, y, z = twice * hx - vx, twice * hy - vy, twice * hz - vz
            below = x * gx + y * gy + z * gz
            if below < f32(0.0):
                # Interpolated normals can send a ray under the triangle: turn it up again.
                x, y, z = x - f32(2.0) * below * gx, y - f32(2.0) * below * gy, z - f32(2.0) * below * gz
            scale = f32(1.0) / math.sqrt(x * x + y * y + z * z)
            origin[count, 0], origin[count, 1], origin[count, 2] = px + gx * bias, py + gy * bias, pz + gz * bias
            direction[count, 0], direction[count, 1], direction[count, 2] = x * scale, y * scale, z * scale
            share = f32(1.0) / f32(repeats)
            weight[count, 0], weight[count, 1], weight[count, 2] = share, share, share
            target[count] = i
            count += 1
    return count


@kernel
def refraction_rays(
    rows, surfaces, geometry, materials, view, view_is_point, origin, direction, weight, target, medium
):
    """First rays through the points `rows` (n,): bent by glass, straight through thin walls and blended surfaces.

    medium (rays,) int32: material row the ray travels in, 0 for air. Returns how many were written (total internal
    reflection leaves none).
    """
    # Out of the loop: a tuple's array costs a reference count every time it is taken out.
    at_material_id = surfaces.material_id
    at_transmission = surfaces.transmission
    at_object_id = surfaces.object_id
    at_alpha = surfaces.alpha
    at_position = surfaces.position
    at_normal = surfaces.normal
    at_geometric_normal = surfaces.geometric_normal
    at_primitive_id = surfaces.primitive_id
    count = 0
    for i in range(len(rows)):
        row = np.uint32(rows[i])
        material_row = at_material_id[row]
        material = materials[material_row]
        through = at_transmission[row]
        if at_object_id[row] == 0 or (through <= f32(0.0) and at_alpha[row] >= f32(1.0)):
            continue
        px, py, pz = at_position[row, 0], at_position[row, 1], at_position[row, 2]
        nx, ny, nz = at_normal[row, 0], at_normal[row, 1], at_normal[row, 2]
        gx, gy, gz = at_geometric_normal[row, 0], at_geometric_normal[row, 1], at_geometric_normal[row, 2]
        if view_is_point:
            dx, dy, dz = px - view[0, 0], py - view[0, 1], pz - view[0, 2]
            scale = f32(1.0) / math.sqrt(dx * dx + dy * dy + dz * dz + f32(1e-20))
            dx, dy, dz = dx * scale, dy * scale, dz * scale
        else:
            dx, dy, dz = view[i, 0], view[i, 1], view[i, 2]
        inside = 0
        if through > f32(0.0) and material.thin == 0 and dx * nx + dy * ny + dz * nz < f32(0.0):
            entering = faces_front(geometry, at_primitive_id[row], dx, dy, dz)
            ratio = f32(1.0) / material.ior if entering else material.ior
            dx, dy, dz, total = refracted(dx, dy, dz, nx, ny, nz, ratio)
            if total:
                continue
            inside = material_row if entering else 0
        bias = bias_at(px, py, pz)
        origin[count, 0], origin[count, 1], origin[count, 2] = px - gx * bias, py - gy * bias, pz - gz * bias
        direction[count, 0], direction[count, 1], direction[count, 2] = dx, dy, dz
        weight[count, 0], weight[count, 1], weight[count, 2] = f32(1.0), f32(1.0), f32(1.0)
        target[count] = i
        medium[count] = inside
        count += 1
    return count


@kernel
def shade_and_spawn(direction, distance, path_length, weight, target, medium, surfaces, direct, visibility, geometry, materials,
                    environment, last, threshold, next_origin, next_direction, next_path, next_weight, next_target, next_medium,
                    radiance):  # fmt: skip
    """Add what n hits send back to radiance[target] (m, 3), and write the rays that go on; returns how many (3 n at most).

    surfaces: rows 0..n of the hits; direct, visibility (n, L) of them; last: nothing goes on, the dome stands in;
    threshold: rays that carry less than this are dropped.
    """
    # Out of the loop: a tuple's array costs a reference count every time it is taken out.
    at_object_id = surfaces.object_id
    at_material_id = surfaces.material_id
    at_position = surfaces.position
    at_geometric_normal = surfaces.geometric_normal
    at_normal = surfaces.normal
    at_alpha = surfaces.alpha
    at_emissive = surfaces.emissive
    at_base_color = surfaces.base_color
    at_metallic = surfaces.metallic
    at_roughness = surfaces.roughness
    at_transmission = surfaces.transmission
    at_occlusion = surfaces.occlusion
    at_primitive_id = surfaces.primitive_id
    dome_sharp = environment.sharp
    dome_blurred = environment.blurred
    dome_irradiance = environment.irradiance
    count = 0
    lights = direct.shape[1]
    for i in range(len(target)):
        t = target[i]
        wr, wg, wb = weight[i, 0], weight[i, 1], weight[i, 2]
        dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
        if at_object_id[i] == 0:
            r, g, b = environment_radiance(dome_sharp, dome_blurred, dx, dy, dz, f32(0.0))
            radiance[t, 0] += wr * r
            radiance[t, 1] += wg * g
            radiance[t, 2] += wb * b
            continue
        if medium[i] > 0:
            # Beer-Lambert on the way through the medium.
            inside = materials[medium[i]]
            wr *= math.exp(-inside.absorb_r * distance[i])
            wg *= math.exp(-inside.absorb_g * distance[i])
            wb *= math.exp(-inside.absorb_b * distance[i])
        material_row = at_material_id[i]
        material = materials[material_row]
        px, py, pz = at_position[i, 0], at_position[i, 1], at_position[i, 2]
        gx, gy, gz = at_geometric_normal[i, 0], at_geometric_normal[i, 1], at_geometric_normal[i, 2]
        nx, ny, nz = at_normal[i, 0], at_normal[i, 1], at_normal[i, 2]
        bias = bias_at(px, py, pz)
        alpha = at_alpha[i]
        if alpha < f32(1.0):
            rest = f32(1.0) - alpha
            if not last and max(wr, max(wg, wb)) * rest > threshold:
                next_origin[count, 0], next_origin[count, 1], next_origin[count, 2] = (
                    px - gx * bias,
                    py - gy * bias,
                    pz - gz * bias,
                )
                next_direction[count, 0], next_direction[count, 1], next_direction[count, 2] = dx, dy, dz
                next_weight[count, 0], next_weight[count, 1], next_weight[count, 2] = wr * rest, wg * rest, wb * rest
                next_path[count] = path_length[i]
                next_target[count] = t
                next_medium[count] = medium[i]
                count += 1
            wr, wg, wb = wr * alpha, wg * alpha, wb * alpha
        sum_r, sum_g, sum_b = at_emissive[i, 0], at_emissive[i, 1], at_emissive[i, 2]
        if material.unlit == 0:
            red, green, blue = at_base_color[i, 0], at_base_color[i, 1], at_base_color[i, 2]
            metallic, roughness, through = at_metallic[i], at_roughness[i], at_transmission[i]
            d_n = dx * nx + dy * ny + dz * nz
            n_v = min(max(abs(d_n), f32(1e-3)), f32(1.0))
            thick = through > f32(0.0) and material.thin == 0
            entering = True
            eta = material.ior
            if thick:
                entering = faces_front(geometry, at_primitive_id[i], dx, dy, dz)
                if not entering:
                    eta = f32(1.0) / material.ior
            fr, fg, fb, plain = reflectance(material, metallic, roughness, through, red, green, blue, n_v, eta)
            for k in range(lights):
                v = visibility[i, k]
                sum_r += direct[i, k, 0] * v
                sum_g += direct[i, k, 1] * v
                sum_b += direct[i, k, 2] * v
            ar, ag, ab = ambient_light(dome_sharp, dome_irradiance, nx, ny, nz)
            occlusion = at_occlusion[i]
            body = (f32(1.0) - plain) * (f32(1.0) - metallic) * (f32(1.0) - through) * occlusion
            sum_r += body * red * ar
            sum_g += body * green * ag
            sum_b += body * blue * ab

            # The mirror direction: a ray, or the dome filtered by roughness.
            twice = f32(2.0) * d_n
            x, y, z = dx - twice * nx, dy - twice * ny, dz - twice * nz
            below = x * gx + y * gy + z * gz
            if below < f32(0.0):
                x, y, z = x - f32(2.0) * below * gx, y - f32(2.0) * below * gy, z - f32(2.0) * below * gz
            carried = max(wr * fr, max(wg * fg, wb * fb))
            smooth = roughness <= MIRROR_BOUNCE_ROUGHNESS or (through > f32(0.0) and roughness <= f32(0.5))
            if smooth and not last:
                if carried > threshold:
                    next_origin[count, 0] = px + gx * bias
                    next_origin[count, 1] = py + gy * bias
                    next_origin[count, 2] = pz + gz * bias
                    next_direction[count, 0], next_direction[count, 1], next_direction[count, 2] = x, y, z
                    next_weight[count, 0], next_weight[count, 1], next_weight[count, 2] = wr * fr, wg * fg, wb * fb
                    next_path[count] = path_length[i]
                    next_target[count] = t
                    next_medium[count] = medium[i]
                    count += 1
            elif medium[i] == 0:
                r, g, b = environment_radiance(dome_sharp, dome_blurred, x, y, z, roughness)
                sum_r += fr * r * occlusion
                sum_g += fg * g * occlusion
                sum_b += fb * b * occlusion

            # What passes through.
            pass_r = wr * (f32(1.0) - plain) * through * (f32(1.0) - metallic) * red
            pass_g = wg * (f32(1.0) - plain) * through * (f32(1.0) - metallic) * green
            pass_b = wb * (f32(1.0) - plain) * through * (f32(1.0) - metallic) * blue
            if max(pass_r, max(pass_g, pass_b)) > threshold:
                x, y, z, total = dx, dy, dz, False
                inside = medium[i]
                if thick and d_n < f32(0.0):
                    x, y, z, total = refracted(dx, dy, dz, nx, ny, nz, f32(1.0) / eta)
                    inside = material_row if entering else 0
                if not total and not last:
                    next_origin[count, 0] = px - gx * bias
                    next_origin[count, 1] = py - gy * bias
                    next_origin[count, 2] = pz - gz * bias
                    next_direction[count, 0], next_direction[count, 1], next_direction[count, 2] = x, y, z
                    next_weight[count, 0], next_weight[count, 1], next_weight[count, 2] = pass_r, pass_g, pass_b
                    next_path[count] = path_length[i]
                    next_target[count] = t
                    next_medium[count] = inside
                    count += 1
                elif not total:
                    r, g, b = environment_radiance(dome_sharp, dome_blurred, x, y, z, f32(0.0))
                    radiance[t, 0] += pass_r * r
                    radiance[t, 1] += pass_g * g
                    radiance[t, 2] += pass_b * b
        radiance[t, 0] += wr * sum_r
        radiance[t, 1] += wg * sum_g
        radiance[t, 2] += wb * sum_b
    return count
