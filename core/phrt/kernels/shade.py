"""From layers to light: Fresnel weights, and the sum that composition and bounces share."""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.environment import environment_radiance, irradiance
from phrt.kernels.jit import device, kernel
from phrt.kernels.light import dielectric_f0

f32 = np.float32
SMOOTH_GLASS = f32(0.1)
"""Transmissive surfaces up to this roughness reflect by the exact Fresnel equations."""


@device
def fresnel_dielectric(cosine, eta):
    """Unpolarised reflectance at an interface; cosine > 0 of the incident angle, eta = ior behind / ior in front.

    Exact (Born and Wolf, Principles of Optics, section 1.5.2); 1 in total internal reflection.
    """
    sine2 = (f32(1.0) - cosine * cosine) / (eta * eta)
    if sine2 >= f32(1.0):
        return f32(1.0)
    transmitted = math.sqrt(f32(1.0) - sine2)
    parallel = (eta * cosine - transmitted) / (eta * cosine + transmitted)
    perpendicular = (cosine - eta * transmitted) / (cosine + eta * transmitted)
    return f32(0.5) * (parallel * parallel + perpendicular * perpendicular)


@device
def reflectance(material, metallic, roughness, transmission, red, green, blue, n_v, eta):
    """Share of the light from the mirror direction that reaches the eye, (r, g, b).

    Schlick with roughness (Lagarde 2011), which is exact at both ends and keeps a furnace white; smooth glass exactly.
    """
    if transmission > f32(0.0) and roughness <= SMOOTH_GLASS and metallic == f32(0.0):
        f = fresnel_dielectric(n_v, eta) * material.specular
        return f, f, f
    w = f32(1.0) - n_v
    w2 = w * w
    schlick = w2 * w2 * w
    f0 = dielectric_f0(material.ior, material.specular)
    plain = f0 + (max((f32(1.0) - roughness) * material.specular, f0) - f0) * schlick
    smooth = f32(1.0) - roughness
    metal_r = red + (max(smooth, red) - red) * schlick
    metal_g = green + (max(smooth, green) - green) * schlick
    metal_b = blue + (max(smooth, blue) - blue) * schlick
    rest = plain * (f32(1.0) - metallic)
    return rest + metal_r * metallic, rest + metal_g * metallic, rest + metal_b * metallic


@device
def ambient_light(sharp, harmonics, nx, ny, nz):
    """Irradiance / pi of the dome at a surface of unit normal n, unoccluded."""
    if sharp.shape[1] == 1:
        return sharp[0, 0, 0, 0], sharp[0, 0, 0, 1], sharp[0, 0, 0, 2]
    return irradiance(harmonics, nx, ny, nz)


@kernel
def composite(rows, surfaces, materials, camera, background, direct, visibility, ao, reflection, reflection_mask,
              refraction, environment, exposure, image):  # fmt: skip
    """Layers into the picture: image[row] (rows, 3) linear, exposure applied.

    L = emissive + (1 - F) (1 - metallic) (1 - transmission) base_color ambient ao + sum over lights direct visibility
        + F reflection + (1 - F) (1 - metallic) transmission base_color refraction;
    an alpha-blended surface covers what is behind it (the refraction layer) by its alpha.
    camera (5, 3): eye, right * tan_half_x, up * tan_half_y, forward, (orthographic, 1 / width, 1 / height) with rows counted
    along the picture; background: whether the dome is seen; reflection_mask (rows,) 0 where the dome stands in.
    """
    # Out of the loop: a tuple's array costs a reference count every time it is taken out.
    at_object_id = surfaces.object_id
    at_material_id = surfaces.material_id
    at_base_color = surfaces.base_color
    at_emissive = surfaces.emissive
    at_transmission = surfaces.transmission
    at_alpha = surfaces.alpha
    at_normal = surfaces.normal
    at_position = surfaces.position
    at_metallic = surfaces.metallic
    at_roughness = surfaces.roughness
    dome_sharp = environment.sharp
    dome_blurred = environment.blurred
    dome_irradiance = environment.irradiance
    lights = direct.shape[1]
    width = int(f32(1.0) / camera[4, 1] + f32(0.5))
    for row in rows:
        if at_object_id[row] == 0:
            if not background:
                image[row, 0] = f32(0.0)
                image[row, 1] = f32(0.0)
                image[row, 2] = f32(0.0)
                continue
            sx = (f32(row % width) + f32(0.5)) * camera[4, 1] * f32(2.0) - f32(1.0)
            sy = f32(1.0) - (f32(row // width) + f32(0.5)) * camera[4, 2] * f32(2.0)
            if camera[4, 0] > f32(0.0):
                sx, sy = f32(0.0), f32(0.0)
            dx = camera[3, 0] + camera[1, 0] * sx + camera[2, 0] * sy
            dy = camera[3, 1] + camera[1, 1] * sx + camera[2, 1] * sy
            dz = camera[3, 2] + camera[1, 2] * sx + camera[2, 2] * sy
            scale = f32(1.0) / math.sqrt(dx * dx + dy * dy + dz * dz)
            r, g, b = environment_radiance(dome_sharp, dome_blurred, dx * scale, dy * scale, dz * scale, f32(0.0))
            image[row, 0], image[row, 1], image[row, 2] = r * exposure, g * exposure, b * exposure
            continue
        material = materials[at_material_id[row]]
        red, green, blue = at_base_color[row, 0], at_base_color[row, 1], at_base_color[row, 2]
        out_r, out_g, out_b = at_emissive[row, 0], at_emissive[row, 1], at_emissive[row, 2]
        transmission = at_transmission[row]
        alpha = at_alpha[row]
        if material.unlit == 0:
            nx, ny, nz = at_normal[row, 0], at_normal[row, 1], at_normal[row, 2]
            if camera[4, 0] > f32(0.0):
                vx, vy, vz = -camera[3, 0], -camera[3, 1], -camera[3, 2]
            else:
                vx = camera[0, 0] - at_position[row, 0]
                vy = camera[0, 1] - at_position[row, 1]
                vz = camera[0, 2] - at_position[row, 2]
                scale = f32(1.0) / math.sqrt(vx * vx + vy * vy + vz * vz + f32(1e-20))
                vx, vy, vz = vx * scale, vy * scale, vz * scale
            n_dot_v = nx * vx + ny * vy + nz * vz
            n_v = min(max(abs(n_dot_v), f32(1e-3)), f32(1.0))
            metallic, roughness = at_metallic[row], at_roughness[row]
            fr, fg, fb = reflectance(material, metallic, roughness, transmission, red, green, blue, n_v, material.ior)
            for k in range(lights):
                v = visibility[row, k]
                out_r += direct[row, k, 0] * v
                out_g += direct[row, k, 1] * v
                out_b += direct[row, k, 2] * v
            ar, ag, ab = ambient_light(dome_sharp, dome_irradiance, nx, ny, nz)
            body = (f32(1.0) - metallic) * (f32(1.0) - transmission) * ao[row]
            out_r += (f32(1.0) - fr) * body * red * ar
            out_g += (f32(1.0) - fg) * body * green * ag
            out_b += (f32(1.0) - fb) * body * blue * ab
            if reflection_mask[row] == 0:
                twice = f32(2.0) * n_dot_v
                r, g, b = environment_radiance(
                    dome_sharp, dome_blurred, twice * nx - vx, twice * ny - vy, twice * nz - vz, roughness
                )
                r, g, b = r * ao[row], g * ao[row], b * ao[row]
            else:
                r, g, b = reflection[row, 0], reflection[row, 1], reflection[row, 2]
            out_r, out_g, out_b = out_r + fr * r, out_g + fg * g, out_b + fb * b
            if transmission > f32(0.0):
                through = (f32(1.0) - metallic) * transmission
                out_r += (f32(1.0) - fr) * through * red * refraction[row, 0]
                out_g += (f32(1.0) - fg) * through * green * refraction[row, 1]
                out_b += (f32(1.0) - fb) * through * blue * refraction[row, 2]
        if alpha < f32(1.0):
            out_r = out_r * alpha + refraction[row, 0] * (f32(1.0) - alpha)
            out_g = out_g * alpha + refraction[row, 1] * (f32(1.0) - alpha)
            out_b = out_b * alpha + refraction[row, 2] * (f32(1.0) - alpha)
        image[row, 0], image[row, 1], image[row, 2] = out_r * exposure, out_g * exposure, out_b * exposure
