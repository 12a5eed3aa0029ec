"""Holes: hits on alpha-masked texels below the cut-off are not there."""

from __future__ import annotations

import numpy as np

from phrt.conventions import NO_PRIMITIVE
from phrt.kernels.jit import kernel
from phrt.kernels.textures import sample_texture
from phrt.materials import ALPHA_BLEND, ALPHA_OPAQUE

f32 = np.float32
MISS = np.uint32(NO_PRIMITIVE)


@kernel
def holes(primitive, barycentric, geometry, materials, casts_shadow, shadow, is_open):
    """Mark (is_open (n,) uint8 = 1) the hits a ray passes, and count them; texture at its finest level.

    shadow: of a shadow ray, so that blended surfaces below half coverage and objects that cast no shadow are open too.
    """
    count = 0
    for i in range(len(primitive)):
        is_open[i] = 0
        p = primitive[i]
        if p == MISS:
            continue
        if shadow and not casts_shadow[geometry.triangle_object[p]]:
            is_open[i] = 1
            count += 1
            continue
        material = materials.materials[geometry.triangle_material[p]]
        if material.alpha_mode == ALPHA_OPAQUE or (material.alpha_mode == ALPHA_BLEND and not shadow):
            continue
        a, b, c = geometry.triangles[p, 0], geometry.triangles[p, 1], geometry.triangles[p, 2]
        wb, wc = barycentric[i, 0], barycentric[i, 1]
        wa = f32(1.0) - wb - wc
        alpha = material.alpha
        if material.base_color_texture >= 0:
            u0 = geometry.uv0[a, 0] * wa + geometry.uv0[b, 0] * wb + geometry.uv0[c, 0] * wc
            v0 = geometry.uv0[a, 1] * wa + geometry.uv0[b, 1] * wb + geometry.uv0[c, 1] * wc
            u1, v1 = u0, v0
            if geometry.uv1.shape[0] > 0:
                u1 = geometry.uv1[a, 0] * wa + geometry.uv1[b, 0] * wb + geometry.uv1[c, 0] * wc
                v1 = geometry.uv1[a, 1] * wa + geometry.uv1[b, 1] * wb + geometry.uv1[c, 1] * wc
            _, _, _, texel = sample_texture(materials, material.base_color_texture, u0, v0, u1, v1, f32(-100.0), False)
            alpha *= texel
        if geometry.colors.shape[0] > 0:
            alpha *= geometry.colors[a, 3] * wa + geometry.colors[b, 3] * wb + geometry.colors[c, 3] * wc
        cutoff = f32(0.5) if material.alpha_mode == ALPHA_BLEND else material.alpha_cutoff
        if alpha < cutoff:
            is_open[i] = 1
            count += 1
    return count
