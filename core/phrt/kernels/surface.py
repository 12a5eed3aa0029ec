"""Hits into surface points: position, normals, texture coordinates and material values. Primary rays and bounces share it."""

from __future__ import annotations

import math

import numpy as np

from phrt.conventions import NO_PRIMITIVE
from phrt.kernels.jit import kernel
from phrt.kernels.textures import BLOCK, fast_log2, sample_block
from phrt.materials import ALPHA_BLEND, ALPHA_MASK

f32 = np.float32
MISS = np.uint32(NO_PRIMITIVE)

# Hits go through the steps BLOCK at a time. One after the other, a hit is a chain of look-ups - triangle, corners, texture
# coordinates, texel - and the processor waits at every link; side by side, the waits of many hits overlap.

# Rows of the blocks the kernel works in.
_PX, _PY, _PZ, _GX, _GY, _GZ, _NX, _NY, _NZ, _FACING, _PATH, _WB, _WC, _RED, _GREEN, _BLUE, _ALPHA = range(17)
_METAL, _ROUGH, _PASSES, _OPEN, _ER, _EG, _EB, _DEPTH = range(17, 25)
_ROWS = 25
_TARGET, _RAY, _HIT, _MATERIAL, _OBJECT, _A, _B, _C = range(8)
_IDS = 8


@kernel
def surface(
    direction,
    path_length,
    primitive,
    barycentric,
    geometry,
    materials,
    eye,
    forward,
    cone,
    hidden,
    eye_ray,
    order,
    target,
    out,
    passed,
):
    """Fill row target[i] of `out` with the surface ray i hit, for n rays.

    direction (n, 3) unit; path_length (n,) metres travelled from the eye, for the ray cone; primitive (n,) uint32;
    barycentric (n, 2); eye, forward (3,) for `depth`; cone (2,): width at the eye in metres, and spread per metre;
    order, target (n,) int32: the rays, in the order in which their rows are written. Misses get the channels' clear values.
    hidden (N + 1,) uint8: objects that every ray passes.
    eye_ray: back faces of single-sided materials and holes of alpha masks are not there: passed (n,) uint8 is set to 1 where
    the ray must go on behind its hit (hidden ones too), and that row is not written. Other rays have passed their holes before
    (`phrt.tracing.nearest`) and see both sides. Returns how many must go on.
    """
    # Out of the loop: a tuple's array costs a reference count every time it is taken out.
    g_triangles = geometry.triangles
    g_positions = geometry.positions
    g_triangle_material = geometry.triangle_material
    g_uv0 = geometry.uv0
    g_uv1 = geometry.uv1
    g_triangle_lod = geometry.triangle_lod
    g_colors = geometry.colors
    g_normals = geometry.normals
    g_tangents = geometry.tangents
    g_triangle_object = geometry.triangle_object
    m_materials = materials.materials
    m_texels = materials.texels
    m_textures = materials.textures
    m_level_start = materials.level_start
    out_object_id = out.object_id
    out_primitive_id = out.primitive_id
    out_material_id = out.material_id
    out_depth = out.depth
    out_alpha = out.alpha
    out_metallic = out.metallic
    out_roughness = out.roughness
    out_transmission = out.transmission
    out_occlusion = out.occlusion
    out_position = out.position
    out_normal = out.normal
    out_geometric_normal = out.geometric_normal
    out_base_color = out.base_color
    out_emissive = out.emissive
    out_uv = out.uv
    second_uv, colored = g_uv1.shape[0] > 0, g_colors.shape[0] > 0
    # Which kinds of textures there are at all, and whether there are holes.
    rough_maps, normal_maps, pass_maps, baked_maps, glow_maps, holes = False, False, False, False, False, False
    for m in range(len(m_materials)):
        material = m_materials[m]
        rough_maps |= material.metallic_roughness_texture >= 0
        normal_maps |= material.normal_texture >= 0 and g_tangents.shape[0] > 0
        pass_maps |= material.transmission_texture >= 0
        baked_maps |= material.occlusion_texture >= 0
        glow_maps |= material.emissive_texture >= 0
        holes |= material.alpha_mode == ALPHA_MASK and eye_ray
    at, ids = np.empty((_ROWS, BLOCK), np.float32), np.empty((_IDS, BLOCK), np.uint32)
    uv, footprint = np.empty((4, BLOCK), np.float32), np.empty(BLOCK, np.float32)
    texture, texel = np.empty(BLOCK, np.int32), np.empty((4, BLOCK), np.float32)
    taps, part = np.empty(5 * BLOCK, np.uint32), np.empty(2 * BLOCK, np.float32)
    cone_at_eye, cone_spread = cone[0], cone[1]
    eye_x, eye_y, eye_z = eye[0], eye[1], eye[2]
    forward_x, forward_y, forward_z = forward[0], forward[1], forward[2]
    going_on = 0
    for first in range(0, len(primitive), BLOCK):
        # The hits of this block: misses and what the rays pass are sorted out, the others stand side by side.
        hits, misses = np.int64(0), 0  # no plain 0: numba would compile `sample_block` for it alone
        for i in range(first, min(first + BLOCK, len(primitive))):
            ray = np.uint32(order[i])
            passed[ray] = 0
            p = primitive[ray]
            if p == MISS:
                misses += 1
                continue
            object_id = g_triangle_object[p]
            if hidden[object_id]:
                passed[ray] = 1
                continue
            # Position and the triangle's own normal.
            a, b, c = np.uint32(g_triangles[p, 0]), np.uint32(g_triangles[p, 1]), np.uint32(g_triangles[p, 2])
            wb, wc = barycentric[ray, 0], barycentric[ray, 1]
            ax, ay, az = g_positions[a, 0], g_positions[a, 1], g_positions[a, 2]
            ux, uy, uz = g_positions[b, 0] - ax, g_positions[b, 1] - ay, g_positions[b, 2] - az
            vx, vy, vz = g_positions[c, 0] - ax, g_positions[c, 1] - ay, g_positions[c, 2] - az
            gx, gy, gz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
            facing = gx * direction[ray, 0] + gy * direction[ray, 1] + gz * direction[ray, 2]
            material_row = np.uint32(g_triangle_material[p])
            if eye_ray and facing > f32(0.0) and m_materials[material_row].double_sided == 0:
                passed[ray] = 1
                continue
            k = np.uint32(hits)
            hits += 1
            at[_PX, k], at[_PY, k], at[_PZ, k] = ax + ux * wb + vx * wc, ay + uy * wb + vy * wc, az + uz * wb + vz * wc
            at[_GX, k], at[_GY, k], at[_GZ, k] = gx, gy, gz
            at[_FACING, k], at[_PATH, k], at[_WB, k], at[_WC, k] = facing, path_length[ray], wb, wc
            footprint[k] = g_triangle_lod[p]
            ids[_TARGET, k], ids[_RAY, k], ids[_HIT, k] = np.uint32(target[ray]), ray, p
            ids[_MATERIAL, k], ids[_OBJECT, k] = material_row, object_id
            ids[_A, k], ids[_B, k], ids[_C, k] = a, b, c
        if misses:
            for i in range(first, min(first + BLOCK, len(primitive))):
                ray = np.uint32(order[i])
                if primitive[ray] != MISS:
                    continue
                row = np.uint32(target[ray])
                out_object_id[row] = 0
                out_primitive_id[row] = MISS
                out_material_id[row] = 0
                out_depth[row] = f32(np.inf)
                out_alpha[row] = f32(1.0)
                out_metallic[row] = f32(0.0)
                out_roughness[row] = f32(1.0)
                out_transmission[row] = f32(0.0)
                out_occlusion[row] = f32(1.0)
                for axis in range(3):
                    out_position[row, axis] = f32(0.0)
                    out_normal[row, axis] = f32(0.0)
                    out_geometric_normal[row, axis] = f32(0.0)
                    out_base_color[row, axis] = f32(0.0)
                    out_emissive[row, axis] = f32(0.0)
                out_uv[row, 0] = f32(0.0)
                out_uv[row, 1] = f32(0.0)

        # Texture coordinates, and the material's own values.
        for i in range(hits):
            k = np.uint32(i)
            a, b, c = ids[_A, k], ids[_B, k], ids[_C, k]
            wb, wc = at[_WB, k], at[_WC, k]
            wa = f32(1.0) - wb - wc
            uv[0, k] = g_uv0[a, 0] * wa + g_uv0[b, 0] * wb + g_uv0[c, 0] * wc
            uv[1, k] = g_uv0[a, 1] * wa + g_uv0[b, 1] * wb + g_uv0[c, 1] * wc
            at[_NX, k] = g_normals[a, 0] * wa + g_normals[b, 0] * wb + g_normals[c, 0] * wc
            at[_NY, k] = g_normals[a, 1] * wa + g_normals[b, 1] * wb + g_normals[c, 1] * wc
            at[_NZ, k] = g_normals[a, 2] * wa + g_normals[b, 2] * wb + g_normals[c, 2] * wc
            material = m_materials[ids[_MATERIAL, k]]
            texture[k] = material.base_color_texture
            at[_RED, k], at[_GREEN, k], at[_BLUE, k] = material.base_r, material.base_g, material.base_b
            at[_ALPHA, k], at[_METAL, k], at[_ROUGH, k] = material.alpha, material.metallic, material.roughness
            at[_PASSES, k], at[_OPEN, k] = material.transmission, f32(1.0)
            at[_ER, k], at[_EG, k], at[_EB, k] = material.emissive_r, material.emissive_g, material.emissive_b
        if second_uv:
            for i in range(hits):
                k = np.uint32(i)
                a, b, c = ids[_A, k], ids[_B, k], ids[_C, k]
                wb, wc = at[_WB, k], at[_WC, k]
                wa = f32(1.0) - wb - wc
                uv[2, k] = g_uv1[a, 0] * wa + g_uv1[b, 0] * wb + g_uv1[c, 0] * wc
                uv[3, k] = g_uv1[a, 1] * wa + g_uv1[b, 1] * wb + g_uv1[c, 1] * wc
        else:
            for i in range(hits):
                uv[2, i], uv[3, i] = uv[0, i], uv[1, i]

        # The triangle's normal, and how wide the ray cone is among the texture coordinates.
        # Ray cones (Akenine-Moller et al. 2021, eq. 3); ours: the geometric mean of the footprint's axes, which keeps
        # floors sharper than its long axis would.
        for i in range(hits):
            gx, gy, gz = at[_GX, i], at[_GY, i], at[_GZ, i]
            scale = f32(1.0) / (math.sqrt(gx * gx + gy * gy + gz * gz) + f32(1e-30))
            facing = at[_FACING, i] * scale
            width = cone_at_eye + cone_spread * at[_PATH, i]
            grazing = max(abs(facing), f32(0.02))
            footprint[i] += fast_log2(width + f32(1e-12)) - f32(0.5) * fast_log2(grazing)
            scale = -scale if facing > f32(0.0) else scale
            at[_GX, i], at[_GY, i], at[_GZ, i] = gx * scale, gy * scale, gz * scale

        # Base colour and coverage.
        if sample_block(hits, texture, uv, footprint, True, m_texels, m_textures, m_level_start, taps, part, texel):
            for i in range(hits):
                at[_RED, i] *= texel[0, i]
                at[_GREEN, i] *= texel[1, i]
                at[_BLUE, i] *= texel[2, i]
                at[_ALPHA, i] *= texel[3, i]
        if colored:
            for i in range(hits):
                k = np.uint32(i)
                a, b, c = ids[_A, k], ids[_B, k], ids[_C, k]
                wb, wc = at[_WB, k], at[_WC, k]
                wa = f32(1.0) - wb - wc
                at[_RED, k] *= g_colors[a, 0] * wa + g_colors[b, 0] * wb + g_colors[c, 0] * wc
                at[_GREEN, k] *= g_colors[a, 1] * wa + g_colors[b, 1] * wb + g_colors[c, 1] * wc
                at[_BLUE, k] *= g_colors[a, 2] * wa + g_colors[b, 2] * wb + g_colors[c, 2] * wc
                at[_ALPHA, k] *= g_colors[a, 3] * wa + g_colors[b, 3] * wb + g_colors[c, 3] * wc
        if holes:
            kept = np.int64(0)
            for i in range(hits):
                material = m_materials[ids[_MATERIAL, i]]
                if material.alpha_mode == ALPHA_MASK and at[_ALPHA, i] < material.alpha_cutoff:
                    passed[ids[_RAY, i]] = 1
                    continue
                if kept < i:
                    at[:, kept] = at[:, i]
                    ids[:, kept] = ids[:, i]
                    uv[:, kept] = uv[:, i]
                    footprint[kept] = footprint[i]
                kept += 1
            hits = kept

        # Shading normal, towards the side the ray came from.
        if normal_maps:
            for i in range(hits):
                texture[i] = m_materials[ids[_MATERIAL, i]].normal_texture
            sample_block(hits, texture, uv, footprint, False, m_texels, m_textures, m_level_start, taps, part, texel)
            for i in range(hits):
                k = np.uint32(i)
                if texture[k] < 0:
                    continue
                a, b, c = ids[_A, k], ids[_B, k], ids[_C, k]
                wb, wc = at[_WB, k], at[_WC, k]
                wa = f32(1.0) - wb - wc
                tx = g_tangents[a, 0] * wa + g_tangents[b, 0] * wb + g_tangents[c, 0] * wc
                ty = g_tangents[a, 1] * wa + g_tangents[b, 1] * wb + g_tangents[c, 1] * wc
                tz = g_tangents[a, 2] * wa + g_tangents[b, 2] * wb + g_tangents[c, 2] * wc
                hand = g_tangents[a, 3]
                nx, ny, nz = at[_NX, k], at[_NY, k], at[_NZ, k]
                bx, by, bz = (ny * tz - nz * ty) * hand, (nz * tx - nx * tz) * hand, (nx * ty - ny * tx) * hand
                bend = m_materials[ids[_MATERIAL, k]].normal_scale
                sx = (texel[0, k] * f32(2.0) - f32(1.0)) * bend
                sy = (texel[1, k] * f32(2.0) - f32(1.0)) * bend
                sz = texel[2, k] * f32(2.0) - f32(1.0)
                if tx * tx + ty * ty + tz * tz > f32(0.0):
                    at[_NX, k] = tx * sx + bx * sy + nx * sz
                    at[_NY, k] = ty * sx + by * sy + ny * sz
                    at[_NZ, k] = tz * sx + bz * sy + nz * sz
        for i in range(hits):
            nx, ny, nz = at[_NX, i], at[_NY, i], at[_NZ, i]
            scale = f32(1.0) / (math.sqrt(nx * nx + ny * ny + nz * nz) + f32(1e-30))
            scale = -scale if at[_FACING, i] > f32(0.0) else scale
            at[_NX, i], at[_NY, i], at[_NZ, i] = nx * scale, ny * scale, nz * scale

        # The other textures.
        if rough_maps:
            for i in range(hits):
                texture[i] = m_materials[ids[_MATERIAL, i]].metallic_roughness_texture
            sample_block(hits, texture, uv, footprint, False, m_texels, m_textures, m_level_start, taps, part, texel)
            for i in range(hits):
                at[_ROUGH, i] *= texel[1, i]
                at[_METAL, i] *= texel[2, i]
        if pass_maps:
            for i in range(hits):
                texture[i] = m_materials[ids[_MATERIAL, i]].transmission_texture
            sample_block(hits, texture, uv, footprint, False, m_texels, m_textures, m_level_start, taps, part, texel)
            for i in range(hits):
                at[_PASSES, i] *= texel[0, i]
        if baked_maps:
            for i in range(hits):
                texture[i] = m_materials[ids[_MATERIAL, i]].occlusion_texture
            sample_block(hits, texture, uv, footprint, False, m_texels, m_textures, m_level_start, taps, part, texel)
            for i in range(hits):
                at[_OPEN, i] += m_materials[ids[_MATERIAL, i]].occlusion_strength * (texel[0, i] - f32(1.0))
        if glow_maps:
            for i in range(hits):
                texture[i] = m_materials[ids[_MATERIAL, i]].emissive_texture
            sample_block(hits, texture, uv, footprint, True, m_texels, m_textures, m_level_start, taps, part, texel)
            for i in range(hits):
                at[_ER, i] *= texel[0, i]
                at[_EG, i] *= texel[1, i]
                at[_EB, i] *= texel[2, i]

        # Everything to its place, few arrays at a time.
        for i in range(hits):
            material = m_materials[ids[_MATERIAL, i]]
            if material.alpha_mode != ALPHA_BLEND:
                at[_ALPHA, i] = f32(1.0)
            if material.unlit:
                at[_ER, i], at[_EG, i], at[_EB, i] = at[_RED, i], at[_GREEN, i], at[_BLUE, i]
        for i in range(hits):
            x, y, z = at[_PX, i] - eye_x, at[_PY, i] - eye_y, at[_PZ, i] - eye_z
            at[_DEPTH, i] = x * forward_x + y * forward_y + z * forward_z
        for i in range(hits):
            row = ids[_TARGET, i]
            out_position[row, 0], out_position[row, 1], out_position[row, 2] = at[_PX, i], at[_PY, i], at[_PZ, i]
        for i in range(hits):
            row = ids[_TARGET, i]
            out_normal[row, 0], out_normal[row, 1], out_normal[row, 2] = at[_NX, i], at[_NY, i], at[_NZ, i]
        for i in range(hits):
            row = ids[_TARGET, i]
            out_geometric_normal[row, 0], out_geometric_normal[row, 1], out_geometric_normal[row, 2] = (
                at[_GX, i],
                at[_GY, i],
                at[_GZ, i],
            )
        for i in range(hits):
            row = ids[_TARGET, i]
            out_base_color[row, 0], out_base_color[row, 1], out_base_color[row, 2] = (
                at[_RED, i],
                at[_GREEN, i],
                at[_BLUE, i],
            )
        for i in range(hits):
            row = ids[_TARGET, i]
            out_emissive[row, 0], out_emissive[row, 1], out_emissive[row, 2] = at[_ER, i], at[_EG, i], at[_EB, i]
        for i in range(hits):
            row = ids[_TARGET, i]
            out_uv[row, 0], out_uv[row, 1] = uv[0, i], uv[1, i]
        for i in range(hits):
            row = ids[_TARGET, i]
            out_depth[row], out_alpha[row], out_occlusion[row] = at[_DEPTH, i], at[_ALPHA, i], at[_OPEN, i]
        for i in range(hits):
            row = ids[_TARGET, i]
            out_metallic[row], out_roughness[row], out_transmission[row] = at[_METAL, i], at[_ROUGH, i], at[_PASSES, i]
        for i in range(hits):
            row = ids[_TARGET, i]
            out_object_id[row], out_primitive_id[row] = ids[_OBJECT, i], ids[_HIT, i]
            out_material_id[row] = ids[_MATERIAL, i]
        going_on += min(BLOCK, len(primitive) - first) - int(hits) - misses
    return going_on
