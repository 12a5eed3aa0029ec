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


@device
def dielectric_f0(ior, specular):
    """Reflectance at normal incidence of a dielectric against air."""
    ratio = (ior - f32(1.0)) / (ior + f32(1.0))
    return ratio * ratio * specular


@device
def incident(light, px, py, pz):
    """Direction to the light (x, y, z) and its irradiance factor at a point, before the surface's cosine.

    Sphere lights count as points, rect lights as one-sided Lambertian emitters at their centre: their extent is for shadows.
    KHR_lights_punctual for spot falloff and range window.
    """
    if light.kind == DIRECTIONAL:
        return -light.direction[0], -light.direction[1], -light.direction[2], f32(1.0)
    lx, ly, lz = light.position[0] - px, light.position[1] - py, light.position[2] - pz
    square = max(lx * lx + ly * ly + lz * lz, f32(1e-8))
    inverse = f32(1.0) / math.sqrt(square)
    lx, ly, lz = lx * inverse, ly * inverse, lz * inverse
    factor = inverse * inverse
    if light.kind == POINT or light.kind == SPHERE:
        pass
    else:
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
    return lx, ly, lz, factor


@kernel
def direct_light(rows, surfaces, materials, lights, view, view_is_point, out):
    """Reflected radiance of every light at surface points `rows` (n,), unshadowed: writes out[row] (rows, L, 3).

    Lambert and GGX with height-correlated Smith (Walter et al. 2007, eq. 33; Heitz 2014, eq. 99), Schlick's Fresnel, glTF 2.0
    appendix B. view: the eye (1, 3) when view_is_point, else directions the rays came along (n, 3), by position in `rows`.
    """
    # Out of the loop: a tuple's array costs a reference count every time it is taken out.
    at_material_id = surfaces.material_id
    at_object_id = surfaces.object_id
    at_position = surfaces.position
    at_normal = surfaces.normal
    at_metallic = surfaces.metallic
    at_roughness = surfaces.roughness
    at_base_color = surfaces.base_color
    at_transmission = surfaces.transmission
    for i in range(len(rows)):
        row = rows[i]
        material = materials[at_material_id[row]]
        if at_object_id[row] == 0 or material.unlit:
            for k in range(len(lights)):
                out[row, k, 0] = f32(0.0)
                out[row, k, 1] = f32(0.0)
                out[row, k, 2] = f32(0.0)
            continue
        px, py, pz = at_position[row, 0], at_position[row, 1], at_position[row, 2]
        nx, ny, nz = at_normal[row, 0], at_normal[row, 1], at_normal[row, 2]
        if view_is_point:
            vx, vy, vz = view[0, 0] - px, view[0, 1] - py, view[0, 2] - pz
            scale = f32(1.0) / math.sqrt(vx * vx + vy * vy + vz * vz + f32(1e-20))
            vx, vy, vz = vx * scale, vy * scale, vz * scale
        else:
            vx, vy, vz = -view[i, 0], -view[i, 1], -view[i, 2]
        n_v = max(abs(nx * vx + ny * vy + nz * vz), f32(1e-3))
        metallic, roughness = at_metallic[row], at_roughness[row]
        red, green, blue = at_base_color[row, 0], at_base_color[row, 1], at_base_color[row, 2]
        plain = dielectric_f0(material.ior, material.specular) * (f32(1.0) - metallic)
        f0r, f0g, f0b = plain + red * metallic, plain + green * metallic, plain + blue * metallic
        f90 = material.specular * (f32(1.0) - metallic) + metallic
        diffuse = (f32(1.0) - metallic) * (f32(1.0) - at_transmission[row]) * INV_PI
        alpha = roughness * roughness
        a2 = max(alpha * alpha, f32(1e-6))
        shiny = roughness >= MIRROR_ROUGHNESS and f90 > f32(0.0)
        smith_v = math.sqrt(n_v * n_v * (f32(1.0) - a2) + a2)
        for k in range(len(lights)):
            light = lights[k]
            lx, ly, lz, factor = incident(light, px, py, pz)
            n_l = nx * lx + ny * ly + nz * lz
            if n_l <= f32(0.0) or factor <= f32(0.0):
                out[row, k, 0] = f32(0.0)
                out[row, k, 1] = f32(0.0)
                out[row, k, 2] = f32(0.0)
                continue
            factor *= n_l
            specular = f32(0.0)
            hx, hy, hz = lx + vx, ly + vy, lz + vz
            inverse = f32(1.0) / math.sqrt(max(hx * hx + hy * hy + hz * hz, f32(1e-12)))
            v_h = max((vx * hx + vy * hy + vz * hz) * inverse, f32(0.0))
            w = f32(1.0) - v_h
            w2 = w * w
            fresnel = w2 * w2 * w
            if shiny:
                n_h = max((nx * hx + ny * hy + nz * hz) * inverse, f32(0.0))
                d = n_h * n_h * (a2 - f32(1.0)) + f32(1.0)
                smith_l = math.sqrt(n_l * n_l * (f32(1.0) - a2) + a2)
                specular = a2 * INV_PI / max(d * d, f32(1e-20)) * f32(0.5) / (n_l * smith_v + n_v * smith_l)
            fr = f0r + (f90 - f0r) * fresnel
            fg = f0g + (f90 - f0g) * fresnel
            fb = f0b + (f90 - f0b) * fresnel
            out[row, k, 0] = ((f32(1.0) - fr) * diffuse * red + fr * specular) * light.color[0] * factor
            out[row, k, 1] = ((f32(1.0) - fg) * diffuse * green + fg * specular) * light.color[1] * factor
            out[row, k, 2] = ((f32(1.0) - fb) * diffuse * blue + fb * specular) * light.color[2] * factor
