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
    # Out of the loop: a tuple's array costs a reference count every time it is taken out.
    g_triangle_object = geometry.triangle_object
    g_triangle_material = geometry.triangle_material
    g_triangles = geometry.triangles
    g_uv0 = geometry.uv0
    g_uv1 = geometry.uv1
    g_colors = geometry.colors
    m_materials = materials.materials
    m_texels = materials.texels
    m_textures = materials.textures
    m_level_start = materials.level_start
    count = 0
    for i in range(len(primitive)):
        is_open[i] = 0
        p = primitive[i]
        if p == MISS:
            continue
        if shadow and not casts_shadow[g_triangle_object[p]]:
            is_open[i] = 1
            count += 1
            continue
        material = m_materials[g_triangle_material[p]]
        if material.alpha_mode == ALPHA_OPAQUE or (material.alpha_mode == ALPHA_BLEND and not shadow):
            continue
        a, b, c = np.uint32(g_triangles[p, 0]), np.uint32(g_triangles[p, 1]), np.uint32(g_triangles[p, 2])
        wb, wc = barycentric[i, 0], barycentric[i, 1]
        wa = f32(1.0) - wb - wc
        alpha = material.alpha
        if material.base_color_texture >= 0:
            u0 = g_uv0[a, 0] * wa + g_uv0[b, 0] * wb + g_uv0[c, 0] * wc
            v0 = g_uv0[a, 1] * wa + g_uv0[b, 1] * wb + g_uv0[c, 1] * wc
            u1, v1 = u0, v0
            if g_uv1.shape[0] > 0:
                u1 = g_uv1[a, 0] * wa + g_uv1[b, 0] * wb + g_uv1[c, 0] * wc
                v1 = g_uv1[a, 1] * wa + g_uv1[b, 1] * wb + g_uv1[c, 1] * wc
            _, _, _, texel = sample_texture(
                m_texels, m_textures, m_level_start, material.base_color_texture, u0, v0, u1, v1, f32(-100.0), False
            )
            alpha *= texel
        if g_colors.shape[0] > 0:
            alpha *= g_colors[a, 3] * wa + g_colors[b, 3] * wb + g_colors[c, 3] * wc
        cutoff = f32(0.5) if material.alpha_mode == ALPHA_BLEND else material.alpha_cutoff
        if alpha < cutoff:
            is_open[i] = 1
            count += 1
    return count
