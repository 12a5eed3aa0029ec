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


# Rows of the block `composite` works in; one array, as in `direct_light`.
(
    _F0,
    _SPECULAR,
    _LIT,
    _NX,
    _NY,
    _NZ,
    _X,
    _Y,
    _Z,
    _RED,
    _GREEN,
    _BLUE,
    _METAL,
    _ROUGH,
    _PASSES,
    _COVER,
    _OPEN,
    _NV,
    _BODY,
    _SHARE_R,
    _SHARE_G,
    _SHARE_B,
    _TOTAL_R,
    _TOTAL_G,
    _TOTAL_B,
    _AMBIENT_R,
    _AMBIENT_G,
    _AMBIENT_B,
    _MIRROR_R,
    _MIRROR_G,
    _MIRROR_B,
) = range(31)
_ROWS = 31


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
    object_id, material_id = surfaces.object_id, surfaces.material_id
    position, normal, base_color, emissive = surfaces.position, surfaces.normal, surfaces.base_color, surfaces.emissive
    metallic, roughness, transmission = surfaces.metallic, surfaces.roughness, surfaces.transmission
    alpha, baked = surfaces.alpha, surfaces.occlusion
    sharp, blurred, harmonics = environment.sharp, environment.blurred, environment.irradiance
    constant_dome = sharp.shape[1] == 1
    dome_r, dome_g, dome_b = sharp[0, 0, 0, 0], sharp[0, 0, 0, 1], sharp[0, 0, 0, 2]
    lights = direct.shape[1]
    width = np.uint32(f32(1.0) / camera[4, 1] + f32(0.5))
    eye_x, eye_y, eye_z = camera[0, 0], camera[0, 1], camera[0, 2]
    forward_x, forward_y, forward_z = camera[3, 0], camera[3, 1], camera[3, 2]
    f0_of = np.empty(len(materials), np.float32)
    for m in range(len(materials)):
        f0_of[m] = dielectric_f0(materials[m].ior, materials[m].specular)
    at = np.zeros((_ROWS, BLOCK), np.float32)
    for block in range(start, stop, BLOCK):
        size = min(BLOCK, stop - block)
        # Everything about the points, side by side.
        empty, special, held = 0, 0, 0
        for i in range(size):
            row = np.uint64(block + i)
            material = materials[material_id[row]]
            at[_F0, i], at[_SPECULAR, i] = f0_of[material_id[row]], material.specular
            at[_LIT, i] = f32(0.0) if material.unlit else f32(1.0)
            empty += object_id[row] == 0
            held += reflection_mask[row] != 0
        for i in range(size):
            row = np.uint64(block + i)
            at[_NX, i], at[_NY, i], at[_NZ, i] = normal[row, 0], normal[row, 1], normal[row, 2]
        for i in range(size):
            row = np.uint64(block + i)
            at[_X, i], at[_Y, i], at[_Z, i] = position[row, 0], position[row, 1], position[row, 2]
        for i in range(size):
            row = np.uint64(block + i)
            at[_RED, i], at[_GREEN, i], at[_BLUE, i] = base_color[row, 0], base_color[row, 1], base_color[row, 2]
        for i in range(size):
            row = np.uint64(block + i)
            at[_METAL, i], at[_ROUGH, i], at[_PASSES, i] = metallic[row], roughness[row], transmission[row]
            special += transmission[row] > f32(0.0)
        for i in range(size):
            row = np.uint64(block + i)
            at[_COVER, i], at[_OPEN, i] = alpha[row], ao[row] * baked[row]
            special += alpha[row] < f32(1.0)

        # The angle to the eye.
        if camera[4, 0] > f32(0.0):
            for i in range(BLOCK):
                cosine = at[_NX, i] * forward_x + at[_NY, i] * forward_y + at[_NZ, i] * forward_z
                at[_NV, i] = min(max(abs(cosine), f32(1e-3)), f32(1.0))
        else:
            for i in range(BLOCK):
                x, y, z = eye_x - at[_X, i], eye_y - at[_Y, i], eye_z - at[_Z, i]
                cosine = at[_NX, i] * x + at[_NY, i] * y + at[_NZ, i] * z
                cosine = abs(cosine) / math.sqrt(x * x + y * y + z * z + f32(1e-20))
                at[_NV, i] = min(max(cosine, f32(1e-3)), f32(1.0))

        # Reflected share, as `reflectance` has it; smooth glass again, exactly.
        for i in range(BLOCK):
            w = f32(1.0) - at[_NV, i]
            w2 = w * w
            schlick = w2 * w2 * w
            f0, smooth, metal, lit = at[_F0, i], f32(1.0) - at[_ROUGH, i], at[_METAL, i], at[_LIT, i]
            plain = f0 + (max(smooth * at[_SPECULAR, i], f0) - f0) * schlick
            rest = plain * (f32(1.0) - metal)
            r, g, b = at[_RED, i], at[_GREEN, i], at[_BLUE, i]
            at[_BODY, i] = f32(1.0) - plain
            at[_SHARE_R, i] = (rest + (r + (max(smooth, r) - r) * schlick) * metal) * lit
            at[_SHARE_G, i] = (rest + (g + (max(smooth, g) - g) * schlick) * metal) * lit
            at[_SHARE_B, i] = (rest + (b + (max(smooth, b) - b) * schlick) * metal) * lit
        if special:
            for i in range(size):
                if at[_PASSES, i] > f32(0.0) and at[_ROUGH, i] <= SMOOTH_GLASS and at[_METAL, i] == f32(0.0):
                    ior = materials[material_id[np.uint32(block + i)]].ior
                    f = fresnel_dielectric(at[_NV, i], ior) * at[_SPECULAR, i] * at[_LIT, i]
                    at[_SHARE_R, i], at[_SHARE_G, i], at[_SHARE_B, i] = f, f, f
                    at[_BODY, i] = f32(1.0) - f

        # Emitted and direct light.
        for i in range(size):
            row = np.uint64(block + i)
            r, g, b = emissive[row, 0], emissive[row, 1], emissive[row, 2]
            for k in range(lights):
                light = np.uint32(k)
                v = visibility[row, light]
                r += direct[row, light, 0] * v
                g += direct[row, light, 1] * v
                b += direct[row, light, 2] * v
            at[_TOTAL_R, i], at[_TOTAL_G, i], at[_TOTAL_B, i] = r, g, b

        # The dome: diffuse, and in the mirror direction where no layer holds it.
        if constant_dome:
            for i in range(BLOCK):
                at[_AMBIENT_R, i], at[_AMBIENT_G, i], at[_AMBIENT_B, i] = dome_r, dome_g, dome_b
                opened = at[_OPEN, i]
                at[_MIRROR_R, i], at[_MIRROR_G, i], at[_MIRROR_B, i] = dome_r * opened, dome_g * opened, dome_b * opened
        else:
            for i in range(size):
                row = np.uint64(block + i)
                nx, ny, nz, opened = at[_NX, i], at[_NY, i], at[_NZ, i], at[_OPEN, i]
                at[_AMBIENT_R, i], at[_AMBIENT_G, i], at[_AMBIENT_B, i] = irradiance(harmonics, nx, ny, nz)
                if reflection_mask[row] == 0:
                    x, y, z = view_direction(camera, pixels[row], width)
                    twice = f32(2.0) * (x * nx + y * ny + z * nz)
                    x, y, z = x - twice * nx, y - twice * ny, z - twice * nz
                    r, g, b = environment_radiance(sharp, blurred, x, y, z, at[_ROUGH, i])
                    at[_MIRROR_R, i], at[_MIRROR_G, i], at[_MIRROR_B, i] = r * opened, g * opened, b * opened
        if held:
            for i in range(size):
                row = np.uint64(block + i)
                if reflection_mask[row] != 0:
                    r, g, b = reflection[row, 0], reflection[row, 1], reflection[row, 2]
                    at[_MIRROR_R, i], at[_MIRROR_G, i], at[_MIRROR_B, i] = r, g, b

        # The sum. Only what lets light through, and what does not cover its pixel, shows what is behind it.
        for i in range(BLOCK):
            inside = (f32(1.0) - at[_METAL, i]) * at[_LIT, i] * at[_BODY, i]
            body = inside * (f32(1.0) - at[_PASSES, i]) * at[_OPEN, i]
            at[_BODY, i] = inside * at[_PASSES, i]
            at[_TOTAL_R, i] += at[_SHARE_R, i] * at[_MIRROR_R, i] + at[_RED, i] * (body * at[_AMBIENT_R, i])
            at[_TOTAL_G, i] += at[_SHARE_G, i] * at[_MIRROR_G, i] + at[_GREEN, i] * (body * at[_AMBIENT_G, i])
            at[_TOTAL_B, i] += at[_SHARE_B, i] * at[_MIRROR_B, i] + at[_BLUE, i] * (body * at[_AMBIENT_B, i])
        if special:
            for i in range(size):
                row = np.uint64(block + i)
                through, cover = at[_BODY, i], at[_COVER, i]
                r, g, b = refraction[row, 0], refraction[row, 1], refraction[row, 2]
                at[_TOTAL_R, i] = (at[_TOTAL_R, i] + at[_RED, i] * through * r) * cover + r * (f32(1.0) - cover)
                at[_TOTAL_G, i] = (at[_TOTAL_G, i] + at[_GREEN, i] * through * g) * cover + g * (f32(1.0) - cover)
                at[_TOTAL_B, i] = (at[_TOTAL_B, i] + at[_BLUE, i] * through * b) * cover + b * (f32(1.0) - cover)
        if empty:
            for i in range(size):
                row = np.uint64(block + i)
                if object_id[row] == 0:
                    x, y, z = view_direction(camera, pixels[row], width)
                    r, g, b = environment_radiance(sharp, blurred, x, y, z, f32(0.0))
                    seen = f32(1.0) if background else f32(0.0)
                    at[_TOTAL_R, i], at[_TOTAL_G, i], at[_TOTAL_B, i] = r * seen, g * seen, b * seen
        for i in range(size):
            row = np.uint64(block + i)
            image[row, 0] = at[_TOTAL_R, i] * exposure
            image[row, 1] = at[_TOTAL_G, i] * exposure
            image[row, 2] = at[_TOTAL_B, i] * exposure
