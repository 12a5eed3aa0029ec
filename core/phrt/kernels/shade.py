"""From layers to light: Fresnel weights, and the sum that composition and bounces share."""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.environment import environment_radiance, irradiance
from phrt.kernels.jit import device, kernel
from phrt.kernels.light import BLOCK, dielectric_f0

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
    """Share of the light from the mirror direction that reaches the eye, (r, g, b), and the dielectric's share alone: what a
    surface's body gets is the rest of that, and a metal has no body.

    Schlick with roughness (Lagarde 2011), which is exact at both ends and keeps a furnace white; smooth glass exactly.
    """
    if transmission > f32(0.0) and roughness <= SMOOTH_GLASS and metallic == f32(0.0):
        f = fresnel_dielectric(n_v, eta) * material.specular
        return f, f, f, f
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
    return rest + metal_r * metallic, rest + metal_g * metallic, rest + metal_b * metallic, plain


@device
def ambient_light(sharp, harmonics, nx, ny, nz):
    """Irradiance / pi of the dome at a surface of unit normal n, unoccluded."""
    if sharp.shape[1] == 1:
        return sharp[0, 0, 0, 0], sharp[0, 0, 0, 1], sharp[0, 0, 0, 2]
    return irradiance(harmonics, nx, ny, nz)


@device
def view_direction(camera, pixel, width):
    """Unit direction of the eye ray through the centre of `pixel` (flat index); camera (5, 3) as `composite` takes it."""
    sx = (f32(pixel % width) + f32(0.5)) * camera[4, 1] * f32(2.0) - f32(1.0)
    sy = f32(1.0) - (f32(pixel // width) + f32(0.5)) * camera[4, 2] * f32(2.0)
    if camera[4, 0] > f32(0.0):
        sx, sy = f32(0.0), f32(0.0)
    x = camera[3, 0] + camera[1, 0] * sx + camera[2, 0] * sy
    y = camera[3, 1] + camera[1, 1] * sx + camera[2, 1] * sy
    z = camera[3, 2] + camera[1, 2] * sx + camera[2, 2] * sy
    scale = f32(1.0) / math.sqrt(x * x + y * y + z * z)
    return x * scale, y * scale, z * scale


@kernel
def composite(start, stop, pixels, surfaces, materials, camera, background, direct, visibility, ao, reflection, reflection_mask,
              refraction, environment, exposure, image):  # fmt: skip
    """Layers into the picture: rows start..stop of image (n, 3), linear, exposure applied.

    L = emissive + (1 - F) (1 - metallic) (1 - transmission) base_color ambient ao baked + sum over lights direct visibility
        + F reflection + (1 - F) (1 - metallic) transmission base_color refraction;
    an alpha-blended surface covers what is behind it (the refraction layer) by its alpha.
    pixels (n,) int32, each row's place in the picture; camera (5, 3): eye, right * tan_half_x, up * tan_half_y, forward,
    (orthographic, 1 / width, 1 / height); background: whether the dome is seen; reflection_mask (n,) 0 where the dome stands in.
    Blocks of BLOCK rows, each step a loop without branches where it can be, so that the compiler makes vector instructions of it.
    """
    # Out of the loop: a tuple's array costs a reference count every time it is taken out.
    object_id, material_id, position, normal = (
        surfaces.object_id,
        surfaces.material_id,
        surfaces.position,
        surfaces.normal,
    )
    base_color, emissive, alpha = surfaces.base_color, surfaces.emissive, surfaces.alpha
    metallic, roughness, transmission = surfaces.metallic, surfaces.roughness, surfaces.transmission
    baked = surfaces.occlusion
    sharp, blurred, harmonics = environment.sharp, environment.blurred, environment.irradiance
    constant_dome = sharp.shape[1] == 1
    lights = direct.shape[1]
    width = np.uint32(f32(1.0) / camera[4, 1] + f32(0.5))
    n_v, f0, specular, lit = (np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32),
                              np.empty(BLOCK, np.float32))  # fmt: skip
    total, share, body_share = (
        np.empty((3, BLOCK), np.float32),
        np.empty((3, BLOCK), np.float32),
        np.empty(BLOCK, np.float32),
    )
    ambient, mirrored = np.empty((3, BLOCK), np.float32), np.empty((3, BLOCK), np.float32)
    for block in range(start, stop, BLOCK):
        size = min(BLOCK, stop - block)
        empty, special = 0, 0
        for i in range(size):
            material = materials[material_id[block + i]]
            f0[i] = dielectric_f0(material.ior, material.specular)
            specular[i] = material.specular
            lit[i] = f32(0.0) if material.unlit else f32(1.0)
            empty += object_id[block + i] == 0
            special += transmission[block + i] > f32(0.0)

        # The angle to the eye.
        if camera[4, 0] > f32(0.0):
            for i in range(size):
                row = block + i
                cosine = normal[row, 0] * camera[3, 0] + normal[row, 1] * camera[3, 1] + normal[row, 2] * camera[3, 2]
                n_v[i] = min(max(abs(cosine), f32(1e-3)), f32(1.0))
        else:
            eye_x, eye_y, eye_z = camera[0, 0], camera[0, 1], camera[0, 2]
            for i in range(size):
                row = block + i
                x, y, z = eye_x - position[row, 0], eye_y - position[row, 1], eye_z - position[row, 2]
                cosine = normal[row, 0] * x + normal[row, 1] * y + normal[row, 2] * z
                cosine = abs(cosine) / math.sqrt(x * x + y * y + z * z + f32(1e-20))
                n_v[i] = min(max(cosine, f32(1e-3)), f32(1.0))

        # Reflected share, as `reflectance` has it; smooth glass again, exactly.
        for i in range(size):
            row = block + i
            w = f32(1.0) - n_v[i]
            w2 = w * w
            schlick = w2 * w2 * w
            smooth = f32(1.0) - roughness[row]
            plain = f0[i] + (max(smooth * specular[i], f0[i]) - f0[i]) * schlick
            metal = metallic[row]
            rest = plain * (f32(1.0) - metal)
            body_share[i] = f32(1.0) - plain
            r, g, b = base_color[row, 0], base_color[row, 1], base_color[row, 2]
            share[0, i] = (rest + (r + (max(smooth, r) - r) * schlick) * metal) * lit[i]
            share[1, i] = (rest + (g + (max(smooth, g) - g) * schlick) * metal) * lit[i]
            share[2, i] = (rest + (b + (max(smooth, b) - b) * schlick) * metal) * lit[i]
        if special:
            for i in range(size):
                row = block + i
                if transmission[row] > f32(0.0) and roughness[row] <= SMOOTH_GLASS and metallic[row] == f32(0.0):
                    f = fresnel_dielectric(n_v[i], materials[material_id[row]].ior) * specular[i] * lit[i]
                    share[0, i], share[1, i], share[2, i] = f, f, f
                    body_share[i] = f32(1.0) - f

        # Emitted and direct light.
        for i in range(size):
            row = block + i
            total[0, i], total[1, i], total[2, i] = emissive[row, 0], emissive[row, 1], emissive[row, 2]
        for k in range(lights):
            for i in range(size):
                row = block + i
                v = visibility[row, k]
                total[0, i] += direct[row, k, 0] * v
                total[1, i] += direct[row, k, 1] * v
                total[2, i] += direct[row, k, 2] * v

        # The dome: diffuse, and in the mirror direction where no layer holds it.
        if constant_dome:
            for i in range(size):
                ambient[0, i], ambient[1, i], ambient[2, i] = sharp[0, 0, 0, 0], sharp[0, 0, 0, 1], sharp[0, 0, 0, 2]
                mirrored[0, i], mirrored[1, i], mirrored[2, i] = sharp[0, 0, 0, 0], sharp[0, 0, 0, 1], sharp[0, 0, 0, 2]
        else:
            for i in range(size):
                row = block + i
                nx, ny, nz = normal[row, 0], normal[row, 1], normal[row, 2]
                ambient[0, i], ambient[1, i], ambient[2, i] = irradiance(harmonics, nx, ny, nz)
                if reflection_mask[row] == 0:
                    x, y, z = view_direction(camera, pixels[row], width)
                    twice = f32(2.0) * (x * nx + y * ny + z * nz)
                    x, y, z = x - twice * nx, y - twice * ny, z - twice * nz
                    r, g, b = environment_radiance(sharp, blurred, x, y, z, roughness[row])
                    mirrored[0, i], mirrored[1, i], mirrored[2, i] = r, g, b
        for i in range(size):
            row = block + i
            held = reflection_mask[row] != 0
            occlusion = ao[row] * baked[row]
            r = reflection[row, 0] if held else mirrored[0, i] * occlusion
            g = reflection[row, 1] if held else mirrored[1, i] * occlusion
            b = reflection[row, 2] if held else mirrored[2, i] * occlusion
            inside = (f32(1.0) - metallic[row]) * lit[i] * body_share[i]
            body = inside * (f32(1.0) - transmission[row]) * occlusion
            through = inside * transmission[row]
            cover = alpha[row]
            red, green, blue = base_color[row, 0], base_color[row, 1], base_color[row, 2]
            r = total[0, i] + share[0, i] * r
            g = total[1, i] + share[1, i] * g
            b = total[2, i] + share[2, i] * b
            behind_r, behind_g, behind_b = refraction[row, 0], refraction[row, 1], refraction[row, 2]
            r += red * (body * ambient[0, i] + through * behind_r)
            g += green * (body * ambient[1, i] + through * behind_g)
            b += blue * (body * ambient[2, i] + through * behind_b)
            image[row, 0] = (r * cover + behind_r * (f32(1.0) - cover)) * exposure
            image[row, 1] = (g * cover + behind_g * (f32(1.0) - cover)) * exposure
            image[row, 2] = (b * cover + behind_b * (f32(1.0) - cover)) * exposure
        if empty and constant_dome:
            for i in range(size):
                row = block + i
                if object_id[row] == 0:
                    seen = exposure if background else f32(0.0)
                    for c in range(3):
                        image[row, c] = sharp[0, 0, 0, c] * seen
        elif empty:
            for i in range(size):
                row = block + i
                if object_id[row] == 0:
                    x, y, z = view_direction(camera, pixels[row], width)
                    r, g, b = environment_radiance(sharp, blurred, x, y, z, f32(0.0))
                    seen = exposure if background else f32(0.0)
                    image[row, 0], image[row, 1], image[row, 2] = r * seen, g * seen, b * seen
