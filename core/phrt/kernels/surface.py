"""Hits into surface points: position, normals, texture coordinates and material values. Primary rays and bounces share it."""

from __future__ import annotations

import math

import numpy as np

from phrt.conventions import NO_PRIMITIVE
from phrt.kernels.jit import kernel
from phrt.kernels.textures import fast_log2, sample_color, sample_texture
from phrt.materials import ALPHA_BLEND, ALPHA_MASK

f32 = np.float32
MISS = np.uint32(NO_PRIMITIVE)


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
    target,
    out,
    passed,
):
    """Fill row target[i] of `out` with the surface ray i hit, for n rays.

    direction (n, 3) unit; path_length (n,) metres travelled from the eye, for the ray cone; primitive (n,) uint32;
    barycentric (n, 2); eye, forward (3,) for `depth`; cone (2,): width at the eye in metres, and spread per metre;
    target (n,) int32. Misses get the channels' clear values. hidden (N + 1,) uint8: objects that every ray passes.
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
    going_on = 0
    for i in range(len(primitive)):
        row = np.uint32(target[i])
        passed[i] = 0
        p = primitive[i]
        if p == MISS:
            out_object_id[row] = 0
            out_primitive_id[row] = MISS
            out_material_id[row] = 0
            out_depth[row] = f32(np.inf)
            out_alpha[row] = f32(1.0)
            out_metallic[row] = f32(0.0)
            out_roughness[row] = f32(1.0)
            out_transmission[row] = f32(0.0)
            out_occlusion[row] = f32(1.0)
            for k in range(3):
                out_position[row, k] = f32(0.0)
                out_normal[row, k] = f32(0.0)
                out_geometric_normal[row, k] = f32(0.0)
                out_base_color[row, k] = f32(0.0)
                out_emissive[row, k] = f32(0.0)
            out_uv[row, 0] = f32(0.0)
            out_uv[row, 1] = f32(0.0)
            continue
        if hidden[g_triangle_object[p]]:
            passed[i] = 1
            going_on += 1
            continue
        a, b, c = np.uint32(g_triangles[p, 0]), np.uint32(g_triangles[p, 1]), np.uint32(g_triangles[p, 2])
        wb, wc = barycentric[i, 0], barycentric[i, 1]
        wa = f32(1.0) - wb - wc
        dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]

        # Position and the triangle's own normal.
        ax, ay, az = g_positions[a, 0], g_positions[a, 1], g_positions[a, 2]
        ux, uy, uz = g_positions[b, 0] - ax, g_positions[b, 1] - ay, g_positions[b, 2] - az
        vx, vy, vz = g_positions[c, 0] - ax, g_positions[c, 1] - ay, g_positions[c, 2] - az
        px, py, pz = ax + ux * wb + vx * wc, ay + uy * wb + vy * wc, az + uz * wb + vz * wc
        gx, gy, gz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        scale = f32(1.0) / (math.sqrt(gx * gx + gy * gy + gz * gz) + f32(1e-30))
        gx, gy, gz = gx * scale, gy * scale, gz * scale
        facing = gx * dx + gy * dy + gz * dz
        material_row = g_triangle_material[p]
        material = m_materials[material_row]
        if eye_ray and facing > f32(0.0) and material.double_sided == 0:
            passed[i] = 1
            going_on += 1
            continue

        # Texture coordinates, and how wide the ray cone is among them.
        u0 = g_uv0[a, 0] * wa + g_uv0[b, 0] * wb + g_uv0[c, 0] * wc
        v0 = g_uv0[a, 1] * wa + g_uv0[b, 1] * wb + g_uv0[c, 1] * wc
        u1, v1 = u0, v0
        if g_uv1.shape[0] > 0:
            u1 = g_uv1[a, 0] * wa + g_uv1[b, 0] * wb + g_uv1[c, 0] * wc
            v1 = g_uv1[a, 1] * wa + g_uv1[b, 1] * wb + g_uv1[c, 1] * wc
        # Ray cones (Akenine-Moller et al. 2021, eq. 3); ours: the geometric mean of the footprint's axes, which keeps
        # floors sharper than its long axis would.
        width = cone[0] + cone[1] * path_length[i]
        grazing = max(abs(facing), f32(0.02))
        footprint = g_triangle_lod[p] + fast_log2(width + f32(1e-12)) - f32(0.5) * fast_log2(grazing)

        # Base colour and coverage.
        red, green, blue, alpha = material.base_r, material.base_g, material.base_b, material.alpha
        if material.base_color_texture >= 0:
            tr, tg, tb, ta = sample_color(
                m_texels, m_textures, m_level_start, material.base_color_texture, u0, v0, u1, v1, footprint, True
            )
            red, green, blue, alpha = red * tr, green * tg, blue * tb, alpha * ta
        if g_colors.shape[0] > 0:
            red *= g_colors[a, 0] * wa + g_colors[b, 0] * wb + g_colors[c, 0] * wc
            green *= g_colors[a, 1] * wa + g_colors[b, 1] * wb + g_colors[c, 1] * wc
            blue *= g_colors[a, 2] * wa + g_colors[b, 2] * wb + g_colors[c, 2] * wc
            alpha *= g_colors[a, 3] * wa + g_colors[b, 3] * wb + g_colors[c, 3] * wc
        if eye_ray and material.alpha_mode == ALPHA_MASK and alpha < material.alpha_cutoff:
            passed[i] = 1
            going_on += 1
            continue

        # Shading normal, towards the side the ray came from.
        nx = g_normals[a, 0] * wa + g_normals[b, 0] * wb + g_normals[c, 0] * wc
        ny = g_normals[a, 1] * wa + g_normals[b, 1] * wb + g_normals[c, 1] * wc
        nz = g_normals[a, 2] * wa + g_normals[b, 2] * wb + g_normals[c, 2] * wc
        if material.normal_texture >= 0 and g_tangents.shape[0] > 0:
            tx = g_tangents[a, 0] * wa + g_tangents[b, 0] * wb + g_tangents[c, 0] * wc
            ty = g_tangents[a, 1] * wa + g_tangents[b, 1] * wb + g_tangents[c, 1] * wc
            tz = g_tangents[a, 2] * wa + g_tangents[b, 2] * wb + g_tangents[c, 2] * wc
            hand = g_tangents[a, 3]
            bx, by, bz = (ny * tz - nz * ty) * hand, (nz * tx - nx * tz) * hand, (nx * ty - ny * tx) * hand
            mr, mg, mb, _ = sample_texture(
                m_texels, m_textures, m_level_start, material.normal_texture, u0, v0, u1, v1, footprint, False
            )
            sx = (mr * f32(2.0) - f32(1.0)) * material.normal_scale
            sy = (mg * f32(2.0) - f32(1.0)) * material.normal_scale
            sz = mb * f32(2.0) - f32(1.0)
            if tx * tx + ty * ty + tz * tz > f32(0.0):
                nx, ny, nz = tx * sx + bx * sy + nx * sz, ty * sx + by * sy + ny * sz, tz * sx + bz * sy + nz * sz
        scale = f32(1.0) / (math.sqrt(nx * nx + ny * ny + nz * nz) + f32(1e-30))
        if facing > f32(0.0):
            scale = -scale
            gx, gy, gz = -gx, -gy, -gz
        nx, ny, nz = nx * scale, ny * scale, nz * scale

        # The other material values.
        metallic, roughness, transmission = material.metallic, material.roughness, material.transmission
        if material.metallic_roughness_texture >= 0:
            _, tg, tb, _ = sample_texture(
                m_texels,
                m_textures,
                m_level_start,
                material.metallic_roughness_texture,
                u0,
                v0,
                u1,
                v1,
                footprint,
                False,
            )
            roughness *= tg
            metallic *= tb
        if material.transmission_texture >= 0:
            tr, _, _, _ = sample_texture(
                m_texels, m_textures, m_level_start, material.transmission_texture, u0, v0, u1, v1, footprint, False
            )
            transmission *= tr
        occlusion = f32(1.0)
        if material.occlusion_texture >= 0:
            tr, _, _, _ = sample_texture(
                m_texels, m_textures, m_level_start, material.occlusion_texture, u0, v0, u1, v1, footprint, False
            )
            occlusion += material.occlusion_strength * (tr - f32(1.0))
        er, eg, eb = material.emissive_r, material.emissive_g, material.emissive_b
        if material.emissive_texture >= 0:
            tr, tg, tb, _ = sample_texture(
                m_texels, m_textures, m_level_start, material.emissive_texture, u0, v0, u1, v1, footprint, True
            )
            er, eg, eb = er * tr, eg * tg, eb * tb
        if material.unlit:
            er, eg, eb = red, green, blue

        out_position[row, 0], out_position[row, 1], out_position[row, 2] = px, py, pz
        out_normal[row, 0], out_normal[row, 1], out_normal[row, 2] = nx, ny, nz
        out_geometric_normal[row, 0], out_geometric_normal[row, 1], out_geometric_normal[row, 2] = gx, gy, gz
        out_uv[row, 0], out_uv[row, 1] = u0, v0
        out_depth[row] = (px - eye[0]) * forward[0] + (py - eye[1]) * forward[1] + (pz - eye[2]) * forward[2]
        out_object_id[row] = g_triangle_object[p]
        out_primitive_id[row] = p
        out_material_id[row] = material_row
        out_base_color[row, 0], out_base_color[row, 1], out_base_color[row, 2] = red, green, blue
        out_alpha[row] = alpha if material.alpha_mode == ALPHA_BLEND else f32(1.0)
        out_metallic[row] = metallic
        out_roughness[row] = roughness
        out_transmission[row] = transmission
        out_occlusion[row] = occlusion
        out_emissive[row, 0], out_emissive[row, 1], out_emissive[row, 2] = er, eg, eb
    return going_on
