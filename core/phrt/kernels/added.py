"""Light that layers of further effects bring, added to a composed picture."""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.jit import kernel
from phrt.kernels.shade import reflectance

f32 = np.float32
INV_PI = f32(1.0 / math.pi)


@kernel
def add_light(start, stop, surfaces, materials, camera, layer, arrives, exposure, image):
    """Add layer (n, 3) to rows start..stop of image (n, 3); camera (5, 3) as `composite` takes it.

    arrives: the layer is irradiance, of which the surface's body sends base_color (1 - F) (1 - metallic) (1 - transmission) / pi
    on to the eye, as it does of the dome's; else it is radiance that leaves the surface towards the eye as it is. An
    alpha-blended surface shows its own share alone, the background nothing.
    """
    # Out of the loop: a tuple's array costs a reference count every time it is taken out.
    object_id, material_id = surfaces.object_id, surfaces.material_id
    position, normal, base_color = surfaces.position, surfaces.normal, surfaces.base_color
    metallic, roughness, transmission, alpha = (
        surfaces.metallic, surfaces.roughness, surfaces.transmission, surfaces.alpha,
    )  # fmt: skip
    for i in range(start, stop):
        row = np.uint32(i)
        r, g, b = layer[row, 0], layer[row, 1], layer[row, 2]
        if object_id[row] == 0 or (r == f32(0.0) and g == f32(0.0) and b == f32(0.0)):
            continue
        share = alpha[row] * exposure
        if arrives:
            material = materials[material_id[row]]
            if material.unlit:
                continue
            if camera[4, 0] > f32(0.0):
                x, y, z = camera[3, 0], camera[3, 1], camera[3, 2]
            else:
                x, y, z = (
                    camera[0, 0] - position[row, 0],
                    camera[0, 1] - position[row, 1],
                    camera[0, 2] - position[row, 2],
                )
            cosine = normal[row, 0] * x + normal[row, 1] * y + normal[row, 2] * z
            n_v = min(max(abs(cosine) / math.sqrt(x * x + y * y + z * z + f32(1e-20)), f32(1e-3)), f32(1.0))
            red, green, blue = base_color[row, 0], base_color[row, 1], base_color[row, 2]
            metal, through = metallic[row], transmission[row]
            _, _, _, plain = reflectance(material, metal, roughness[row], through, red, green, blue, n_v, material.ior)
            share *= INV_PI * (f32(1.0) - plain) * (f32(1.0) - metal) * (f32(1.0) - through)
            r, g, b = r * red, g * green, b * blue
        image[row, 0] += r * share
        image[row, 1] += g * share
        image[row, 2] += b * share
