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
    towards = np.empty((3, BLOCK), np.float32)
    plain, f90, shiny = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    to_light, reach = np.empty((3, BLOCK), np.float32), np.empty(BLOCK, np.float32)
    for block in range(start, stop, BLOCK):
        size = min(BLOCK, stop - block)
        # Material constants of every point; background and unlit surfaces reflect nothing.
        for i in range(size):
            material = materials[material_id[block + i]]
            lit = f32(0.0) if object_id[block + i] == 0 or material.unlit else f32(1.0)
            plain[i] = dielectric_f0(material.ior, material.specular)
            f90[i] = material.specular
            shiny[i] = lit
        # The direction to the eye.
        if view_is_point:
            eye_x, eye_y, eye_z = view[0, 0], view[0, 1], view[0, 2]
            for i in range(size):
                x = eye_x - position[block + i, 0]
                y = eye_y - position[block + i, 1]
                z = eye_z - position[block + i, 2]
                scale = f32(1.0) / math.sqrt(x * x + y * y + z * z + f32(1e-20))
                towards[0, i], towards[1, i], towards[2, i] = x * scale, y * scale, z * scale
        else:
            for i in range(size):
                row = block - start + i
                towards[0, i], towards[1, i], towards[2, i] = -view[row, 0], -view[row, 1], -view[row, 2]
        for k in range(len(lights)):
            light = lights[k]
            if light.kind == DIRECTIONAL:
                for i in range(size):
                    to_light[0, i], to_light[1, i], to_light[2, i] = -light.direction[0], -light.direction[1], -light.direction[2]
                    reach[i] = shiny[i]
            else:
                light_x, light_y, light_z = light.position[0], light.position[1], light.position[2]
                for i in range(size):
                    x = light_x - position[block + i, 0]
                    y = light_y - position[block + i, 1]
                    z = light_z - position[block + i, 2]
                    square = max(x * x + y * y + z * z, f32(1e-8))
                    scale = f32(1.0) / math.sqrt(square)
                    to_light[0, i], to_light[1, i], to_light[2, i] = x * scale, y * scale, z * scale
                    reach[i] = square
                if light.kind == POINT or light.kind == SPHERE:
                    window = light.inverse_range * light.inverse_range
                    for i in range(size):
                        ratio = reach[i] * window
                        reach[i] = shiny[i] * max(f32(1.0) - ratio * ratio, f32(0.0)) / reach[i]
                else:
                    for i in range(size):
                        reach[i] = shiny[i] * falloff(light, to_light[0, i], to_light[1, i], to_light[2, i], reach[i])
            red, green, blue = light.color[0], light.color[1], light.color[2]
            for i in range(size):
                row = block + i
                nx, ny, nz = normal[row, 0], normal[row, 1], normal[row, 2]
                lx, ly, lz = to_light[0, i], to_light[1, i], to_light[2, i]
                vx, vy, vz = towards[0, i], towards[1, i], towards[2, i]
                n_l = max(nx * lx + ny * ly + nz * lz, f32(0.0))
                n_v = max(abs(nx * vx + ny * vy + nz * vz), f32(1e-3))
                hx, hy, hz = lx + vx, ly + vy, lz + vz
                inverse = f32(1.0) / math.sqrt(max(hx * hx + hy * hy + hz * hz, f32(1e-12)))
                v_h = max((vx * hx + vy * hy + vz * hz) * inverse, f32(0.0))
                n_h = max((nx * hx + ny * hy + nz * hz) * inverse, f32(0.0))
                w = f32(1.0) - v_h
                w2 = w * w
                schlick = w2 * w2 * w
                metal = metallic[row]
                base = plain[i] * (f32(1.0) - metal)
                grazing = f90[i] * (f32(1.0) - metal) + metal
                rough = roughness[row]
                a2 = max(rough * rough * rough * rough, f32(1e-6))
                d = n_h * n_h * (a2 - f32(1.0)) + f32(1.0)
                smith = n_l * math.sqrt(n_v * n_v * (f32(1.0) - a2) + a2) + n_v * math.sqrt(n_l * n_l * (f32(1.0) - a2) + a2)
                specular = a2 * INV_PI / max(d * d, f32(1e-20)) * f32(0.5) / max(smith, f32(1e-12))
                specular = f32(0.0) if rough < MIRROR_ROUGHNESS else specular
                diffuse = (f32(1.0) - metal) * (f32(1.0) - transmission[row]) * INV_PI
                arriving = reach[i] * n_l
                r, g, b = base_color[row, 0], base_color[row, 1], base_color[row, 2]
                fr, fg, fb = base + r * metal, base + g * metal, base + b * metal
                fr, fg, fb = fr + (grazing - fr) * schlick, fg + (grazing - fg) * schlick, fb + (grazing - fb) * schlick
                out[row, k, 0] = ((f32(1.0) - fr) * diffuse * r + fr * specular) * red * arriving
                out[row, k, 1] = ((f32(1.0) - fg) * diffuse * g + fg * specular) * green * arriving
                out[row, k, 2] = ((f32(1.0) - fb) * diffuse * b + fb * specular) * blue * arriving
