"""Direct light: what every light would send to the eye by each surface point, if nothing were in the way."""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.jit import device, kernel
from phrt.lights import DIRECTIONAL, POINT, RECT, SPHERE, SPOT

f32 = np.float32
INV_PI = f32(1.0 / math.pi)
MIRROR_ROUGHNESS = f32(0.02)
"""Below this a surface is a perfect mirror: a light without extent makes no highlight on it."""

BLOCK = 64


@device
def dielectric_f0(ior, specular):
    """Reflectance at normal incidence of a dielectric against air."""
    ratio = (ior - f32(1.0)) / (ior + f32(1.0))
    return ratio * ratio * specular


@device
def falloff(light, lx, ly, lz, square):
    """What a light's kind makes of the distance: irradiance factor from unit direction l and squared distance.

    Sphere lights count as points, rect lights as one-sided Lambertian emitters at their centre: their extent is for shadows.
    KHR_lights_punctual for spot falloff and range window.
    """
    factor = f32(1.0) / square
    cosine = -(lx * light.direction[0] + ly * light.direction[1] + lz * light.direction[2])
    if light.kind == SPOT:
        t = (cosine - light.cos_outer) / max(light.cos_inner - light.cos_outer, f32(1e-4))
        t = min(max(t, f32(0.0)), f32(1.0))
        factor *= t * t
    elif light.kind == RECT:
        ux, uy, uz = light.half_u[0], light.half_u[1], light.half_u[2]
        vx, vy, vz = light.half_v[0], light.half_v[1], light.half_v[2]
        cx, cy, cz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        area = f32(4.0) * math.sqrt(cx * cx + cy * cy + cz * cz)
        # A disc of the same area seen on its axis: bounded near the light, exact far from it.
        factor = area * max(cosine, f32(0.0)) / (square + area * INV_PI)
    if light.inverse_range > f32(0.0):
        ratio = square * light.inverse_range * light.inverse_range
        factor *= max(f32(1.0) - ratio * ratio, f32(0.0))
    return factor


# Rows of the block `direct_light` works in: one array, because the compiler makes vector loops only where it can tell that
# what is written is not what is read, and it gives up telling among many arrays.
_NX, _NY, _NZ, _VX, _VY, _VZ, _LX, _LY, _LZ = 0, 1, 2, 3, 4, 5, 6, 7, 8
(
    _RED,
    _GREEN,
    _BLUE,
    _METAL,
    _DIFFUSE,
    _ALPHA2,
    _SHINY,
    _F0,
    _F90,
    _LIT,
    _REACH,
    _PX,
    _PY,
    _PZ,
    _NV,
    _PLAIN_F0,
    _PLAIN_F90,
    _MASK_V,
) = range(9, 27)
_ROWS = 27


@kernel
def direct_light(start, stop, surfaces, materials, lights, view, view_is_point, out):
    """Reflected radiance of every light at surface points start..stop, unshadowed: writes out (n, L, 3).

    Lambert and GGX with height-correlated Smith (Walter et al. 2007, eq. 33; Heitz 2014, eq. 99), Schlick's Fresnel, glTF 2.0
    appendix B. view: the eye (1, 3) when view_is_point, else directions the rays came along, (stop - start, 3).
    Blocks of BLOCK points, each step a loop without branches, so that the compiler makes vector instructions of it.
    """
    # Out of the loop: a tuple's array costs a reference count every time it is taken out.
    position, normal, base_color = surfaces.position, surfaces.normal, surfaces.base_color
    metallic, roughness, transmission = surfaces.metallic, surfaces.roughness, surfaces.transmission
    material_id, object_id = surfaces.material_id, surfaces.object_id
    f0_of = np.empty(len(materials), np.float32)
    for m in range(len(materials)):
        f0_of[m] = dielectric_f0(materials[m].ior, materials[m].specular)
    at = np.zeros((_ROWS, BLOCK), np.float32)
    radiance = np.empty((3, BLOCK), np.float32)
    for block in range(start, stop, BLOCK):
        size = min(BLOCK, stop - block)
        # Everything about the points, side by side; background and unlit surfaces reflect nothing.
        for i in range(size):
            row = np.uint64(block + i)
            material = materials[material_id[row]]
            at[_LIT, i] = f32(0.0) if object_id[row] == 0 or material.unlit else f32(1.0)
            at[_PLAIN_F0, i], at[_PLAIN_F90, i] = f0_of[material_id[row]], material.specular
        for i in range(size):
            row = np.uint64(block + i)
            at[_NX, i], at[_NY, i], at[_NZ, i] = normal[row, 0], normal[row, 1], normal[row, 2]
        for i in range(size):
            row = np.uint64(block + i)
            at[_PX, i], at[_PY, i], at[_PZ, i] = position[row, 0], position[row, 1], position[row, 2]
        for i in range(size):
            row = np.uint64(block + i)
            at[_RED, i], at[_GREEN, i], at[_BLUE, i] = base_color[row, 0], base_color[row, 1], base_color[row, 2]
        for i in range(size):
            row = np.uint64(block + i)
            at[_METAL, i], at[_ALPHA2, i], at[_DIFFUSE, i] = metallic[row], roughness[row], transmission[row]
        if view_is_point:
            eye_x, eye_y, eye_z = view[0, 0], view[0, 1], view[0, 2]
            for i in range(BLOCK):
                x, y, z = eye_x - at[_PX, i], eye_y - at[_PY, i], eye_z - at[_PZ, i]
                scale = f32(1.0) / math.sqrt(x * x + y * y + z * z + f32(1e-20))
                at[_VX, i], at[_VY, i], at[_VZ, i] = x * scale, y * scale, z * scale
        else:
            for i in range(size):
                row = np.uint64(block - start + i)
                at[_VX, i], at[_VY, i], at[_VZ, i] = -view[row, 0], -view[row, 1], -view[row, 2]
        for i in range(BLOCK):
            metal, rough = at[_METAL, i], at[_ALPHA2, i]
            at[_SHINY, i] = f32(0.0) if rough < MIRROR_ROUGHNESS else f32(0.5) * INV_PI
            at[_ALPHA2, i] = max(rough * rough * rough * rough, f32(1e-6))
            at[_DIFFUSE, i] = (f32(1.0) - metal) * (f32(1.0) - at[_DIFFUSE, i]) * INV_PI
            at[_F0, i] = at[_PLAIN_F0, i] * (f32(1.0) - metal)
            at[_F90, i] = at[_PLAIN_F90, i] * (f32(1.0) - metal) + metal
            facing = at[_NX, i] * at[_VX, i] + at[_NY, i] * at[_VY, i] + at[_NZ, i] * at[_VZ, i]
            n_v, a2 = max(abs(facing), f32(1e-3)), at[_ALPHA2, i]
            at[_NV, i], at[_MASK_V, i] = n_v, math.sqrt(n_v * n_v * (f32(1.0) - a2) + a2)
        for k in range(len(lights)):
            light = lights[k]
            if light.kind == DIRECTIONAL:
                x, y, z = -light.direction[0], -light.direction[1], -light.direction[2]
                for i in range(BLOCK):
                    at[_LX, i], at[_LY, i], at[_LZ, i], at[_REACH, i] = x, y, z, at[_LIT, i]
            else:
                light_x, light_y, light_z = light.position[0], light.position[1], light.position[2]
                plain = light.kind == POINT or light.kind == SPHERE
                window = light.inverse_range * light.inverse_range
                for i in range(BLOCK):
                    x, y, z = light_x - at[_PX, i], light_y - at[_PY, i], light_z - at[_PZ, i]
                    square = max(x * x + y * y + z * z, f32(1e-8))
                    scale = f32(1.0) / math.sqrt(square)
                    at[_LX, i], at[_LY, i], at[_LZ, i] = x * scale, y * scale, z * scale
                    ratio = square * window
                    at[_REACH, i] = at[_LIT, i] * max(f32(1.0) - ratio * ratio, f32(0.0)) / square if plain else square
                if not plain:
                    for i in range(size):
                        at[_REACH, i] = at[_LIT, i] * falloff(light, at[_LX, i], at[_LY, i], at[_LZ, i], at[_REACH, i])
            red, green, blue = light.color[0], light.color[1], light.color[2]
            for i in range(BLOCK):
                nx, ny, nz, n_v = at[_NX, i], at[_NY, i], at[_NZ, i], at[_NV, i]
                lx, ly, lz = at[_LX, i], at[_LY, i], at[_LZ, i]
                vx, vy, vz = at[_VX, i], at[_VY, i], at[_VZ, i]
                n_l = max(nx * lx + ny * ly + nz * lz, f32(0.0))
                hx, hy, hz = lx + vx, ly + vy, lz + vz
                inverse = f32(1.0) / math.sqrt(max(hx * hx + hy * hy + hz * hz, f32(1e-12)))
                v_h = max((vx * hx + vy * hy + vz * hz) * inverse, f32(0.0))
                n_h = max((nx * hx + ny * hy + nz * hz) * inverse, f32(0.0))
                w = f32(1.0) - v_h
                w2 = w * w
                schlick = w2 * w2 * w
                a2 = at[_ALPHA2, i]
                d = n_h * n_h * (a2 - f32(1.0)) + f32(1.0)
                smith = n_l * at[_MASK_V, i] + n_v * math.sqrt(n_l * n_l * (f32(1.0) - a2) + a2)
                specular = a2 * at[_SHINY, i] / max(d * d * smith, f32(1e-20))
                metal, grazing = at[_METAL, i], at[_F90, i]
                r, g, b = at[_RED, i], at[_GREEN, i], at[_BLUE, i]
                fr, fg, fb = at[_F0, i] + r * metal, at[_F0, i] + g * metal, at[_F0, i] + b * metal
                fr, fg, fb = fr + (grazing - fr) * schlick, fg + (grazing - fg) * schlick, fb + (grazing - fb) * schlick
                arriving = at[_REACH, i] * n_l
                plain = at[_PLAIN_F0, i] + (at[_PLAIN_F90, i] - at[_PLAIN_F0, i]) * schlick
                diffuse = at[_DIFFUSE, i] * (f32(1.0) - plain)
                radiance[0, i] = (diffuse * r + fr * specular) * red * arriving
                radiance[1, i] = (diffuse * g + fg * specular) * green * arriving
                radiance[2, i] = (diffuse * b + fb * specular) * blue * arriving
            for i in range(size):
                row = np.uint64(block + i)
                out[row, k, 0], out[row, k, 1], out[row, k, 2] = radiance[0, i], radiance[1, i], radiance[2, i]
