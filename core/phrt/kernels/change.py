"""Measuring change: which pixels are looked at, what their neighbours say, and how far two colours are apart on a display."""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.jit import device, kernel
from phrt.kernels.random import hash_u32, unit_float
from phrt.output.tonemap import neutral

f32 = np.float32


@kernel
def pick_samples(
    pixels, first, count, object_id, quota, material_id, applies, pixel_object, width, salt, seed, row, unit
):
    """Pixels of every unit, spread over it, other ones in every frame; returns how many.

    pixels (p,) int32: unit u owns first[u] to first[u] + count[u] - 1; object_id (m,) its object; quota (m,) float32 how many
    it should give, on average over frames where that is not whole. material_id, pixel_object (P,); applies (materials,) bool.
    row, unit (s,) int32 are filled: the pixel, and the number of its unit.

    A sample moves to the place of its 2x2 block that is traced first, where that belongs to the unit: so that all samples of an
    item that was traced at a quarter of its density count.
    """
    found = 0
    for u in range(len(first)):
        wanted = quota[u] + unit_float(hash_u32(object_id[u], salt, seed))
        n = min(int(wanted), count[u])
        stride = f32(count[u]) / f32(max(n, 1))
        for k in range(n):
            if n == count[u]:
                pixel = pixels[first[u] + k]
            else:
                at = (f32(k) + unit_float(hash_u32(object_id[u], salt + k + 1, seed))) * stride
                pixel = pixels[first[u] + min(int(at), count[u] - 1)]
                even = (pixel // width & ~1) * width + (pixel % width & ~1)
                if pixel_object[even] == pixel_object[pixel] and applies[material_id[even]]:
                    pixel = even
            row[found] = pixel
            unit[found] = u
            found += 1
    return found


@kernel
def neighbour_values(row, object_id, mask, traced_code, width, height, layer, values, found):
    """values (s, C): the mean of the traced pixels of the same object two pixels away from each of row (s,) int32, which is
    what a gap there would be filled with; found (s,) uint8: is there one?"""
    components = layer.shape[1]
    for i in range(len(row)):
        x, y = row[i] % width, row[i] // width
        number = 0
        for k in range(components):
            values[i, k] = f32(0.0)
        for side in range(4):
            nx = x + (2 if side == 0 else -2 if side == 1 else 0)
            ny = y + (2 if side == 2 else -2 if side == 3 else 0)
            if nx < 0 or ny < 0 or nx >= width or ny >= height:
                continue
            other = ny * width + nx
            if mask[other] == traced_code and object_id[other] == object_id[row[i]]:
                for k in range(components):
                    values[i, k] += layer[other, k]
                number += 1
        found[i] = number > 0
        for k in range(components):
            values[i, k] /= f32(max(number, 1))


@kernel
def gather_surfaces(row, surfaces, direct, out, out_direct):
    """What the composition reads of surfaces and direct (P, L, 3) at row (s,) int32, into `out` and out_direct (s, L, 3)."""
    for i in range(len(row)):
        r = row[i]
        out.object_id[i], out.material_id[i] = surfaces.object_id[r], surfaces.material_id[r]
        out.alpha[i], out.metallic[i], out.roughness[i] = surfaces.alpha[r], surfaces.metallic[r], surfaces.roughness[r]
        out.transmission[i], out.occlusion[i] = surfaces.transmission[r], surfaces.occlusion[r]
        for k in range(3):
            out.position[i, k], out.normal[i, k] = surfaces.position[r, k], surfaces.normal[r, k]
            out.base_color[i, k], out.emissive[i, k] = surfaces.base_color[r, k], surfaces.emissive[r, k]
        for light in range(direct.shape[1]):
            for k in range(3):
                out_direct[i, light, k] = direct[r, light, k]


@device
def displayed(red, green, blue):
    """What a display is given of linear light: the default tone curve, and the square root, which is close to sRGB's curve."""
    brightest = f32(1e6)
    r, g, b = neutral(
        min(max(red, f32(0.0)), brightest), min(max(green, f32(0.0)), brightest), min(max(blue, f32(0.0)), brightest)
    )
    one = f32(1.0)
    return (
        math.sqrt(min(max(r, f32(0.0)), one)),
        math.sqrt(min(max(g, f32(0.0)), one)),
        math.sqrt(min(max(b, f32(0.0)), one)),
    )


@kernel
def display_change(row, image, other, change):
    """change (s,) float32, 0 to 1: mean difference of the displayed red, green and blue of image[row] and other (s, 3), both
    linear light with exposure applied."""
    for i in range(len(row)):
        r, g, b = displayed(image[row[i], 0], image[row[i], 1], image[row[i], 2])
        other_r, other_g, other_b = displayed(other[i, 0], other[i, 1], other[i, 2])
        change[i] = (abs(r - other_r) + abs(g - other_g) + abs(b - other_b)) / f32(3.0)
