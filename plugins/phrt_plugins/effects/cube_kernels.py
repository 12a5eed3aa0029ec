"""Lookups in cube maps: probes' radiance, parallax-corrected, and shadow maps' distances."""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.jit import device, inlined, kernel
from phrt.lights import DIRECTIONAL

f32 = np.float32


@inlined
def cube_face(x, y, z):
    """Face 0..5 (FACES) of a direction, picture coordinates -1..1 (right, down), and the distance along the face's axis."""
    ax, ay, az = abs(x), abs(y), abs(z)
    depth = max(ax, max(ay, az))
    along_x = ax >= ay and ax >= az
    along_y = not along_x and ay >= az
    inverse = f32(1.0) / max(depth, f32(1e-30))
    face_x, face_y, face_z = np.int32(x <= f32(0.0)), np.int32(y <= f32(0.0)), np.int32(z <= f32(0.0))
    right_x, right_z = (z if x > f32(0.0) else -z), (-x if z > f32(0.0) else x)
    down_y = -z if y > f32(0.0) else z
    face = face_x if along_x else (np.int32(2) + face_y if along_y else np.int32(4) + face_z)
    u = right_x if along_x else (x if along_y else right_z)
    v = down_y if along_y else -y
    return face, u * inverse, v * inverse, depth


@device
def cube_radiance(cube, x, y, z):
    """Bilinear (r, g, b) of cube (6, S, S, 3) in a direction; faces are clamped at their edges."""
    face, u, v, _ = cube_face(x, y, z)
    size = cube.shape[1]
    column = min(max((u * f32(0.5) + f32(0.5)) * f32(size) - f32(0.5), f32(0.0)), f32(size - 1))
    row = min(max((v * f32(0.5) + f32(0.5)) * f32(size) - f32(0.5), f32(0.0)), f32(size - 1))
    x0, y0 = min(int(column), size - 2), min(int(row), size - 2)
    fx, fy = column - f32(x0), row - f32(y0)
    a, b = (f32(1.0) - fx) * (f32(1.0) - fy), fx * (f32(1.0) - fy)
    c, d = (f32(1.0) - fx) * fy, fx * fy
    m = cube[face]
    r = m[y0, x0, 0] * a + m[y0, x0 + 1, 0] * b + m[y0 + 1, x0, 0] * c + m[y0 + 1, x0 + 1, 0] * d
    g = m[y0, x0, 1] * a + m[y0, x0 + 1, 1] * b + m[y0 + 1, x0, 1] * c + m[y0 + 1, x0 + 1, 1] * d
    bl = m[y0, x0, 2] * a + m[y0, x0 + 1, 2] * b + m[y0 + 1, x0, 2] * c + m[y0 + 1, x0 + 1, 2] * d
    return r, g, bl


@kernel
def probe_lookup(rows, surfaces, materials, view, view_is_point, through, cubes, centres, probe_of, radius, box_low, box_high,
                 out):  # fmt: skip
    """out (n, 3): radiance from the probe of each point's object, in the mirror direction, or `through` its body.

    cubes (K, 6, S, S, 3); centres (K, 3); probe_of (N + 1,) int32; the direction is corrected for parallax by the box
    box_low, box_high (3,) (Lagarde and Zanuttini 2012). Bodies are taken for balls of radius (N + 1,) metres: a ball's normal where
    light leaves it follows from where and how it came in, so both refractions are exact (as is Beer-Lambert's absorption between).
    """
    for i in range(len(rows)):
        row = rows[i]
        k = probe_of[surfaces.object_id[row]]
        px, py, pz = surfaces.position[row, 0], surfaces.position[row, 1], surfaces.position[row, 2]
        if view_is_point:
            dx, dy, dz = px - view[0, 0], py - view[0, 1], pz - view[0, 2]
            scale = f32(1.0) / math.sqrt(dx * dx + dy * dy + dz * dz + f32(1e-20))
            dx, dy, dz = dx * scale, dy * scale, dz * scale
        else:
            dx, dy, dz = view[i, 0], view[i, 1], view[i, 2]
        nx, ny, nz = surfaces.normal[row, 0], surfaces.normal[row, 1], surfaces.normal[row, 2]
        cosine = -(dx * nx + dy * ny + dz * nz)
        left_r, left_g, left_b = f32(1.0), f32(1.0), f32(1.0)
        if not through:
            twice = f32(2.0) * cosine
            dx, dy, dz = dx + twice * nx, dy + twice * ny, dz + twice * nz
        elif cosine > f32(0.0):
            material = materials[surfaces.material_id[row]]
            ior = material.ior
            sine2 = (f32(1.0) - cosine * cosine) / (ior * ior)
            if sine2 < f32(1.0):
                inside = math.sqrt(f32(1.0) - sine2)
                bend = cosine / ior - inside
                tx, ty, tz = dx / ior + bend * nx, dy / ior + bend * ny, dz / ior + bend * nz
                # The normal at the other end of the chord, and out again.
                twice = f32(2.0) * inside
                ex, ey, ez = nx + twice * tx, ny + twice * ty, nz + twice * tz
                bend = ior * inside - cosine
                dx, dy, dz = ior * tx - bend * ex, ior * ty - bend * ey, ior * tz - bend * ez
                chord = twice * radius[surfaces.object_id[row]]
                px, py, pz = px + tx * chord, py + ty * chord, pz + tz * chord
                left_r = f32(math.exp(-material.absorb_r * chord))
                left_g = f32(math.exp(-material.absorb_g * chord))
                left_b = f32(math.exp(-material.absorb_b * chord))
        # Where the ray leaves the box decides what the probe is asked for.
        reach = f32(1e30)
        for axis in range(3):
            d = dx if axis == 0 else (dy if axis == 1 else dz)
            p = px if axis == 0 else (py if axis == 1 else pz)
            if abs(d) > f32(1e-6):
                edge = box_high[axis] if d > f32(0.0) else box_low[axis]
                reach = min(reach, (edge - p) / d)
        reach = max(reach, f32(0.0))
        x = px + dx * reach - centres[k, 0]
        y = py + dy * reach - centres[k, 1]
        z = pz + dz * reach - centres[k, 2]
        r, g, b = cube_radiance(cubes[k], x, y, z)
        out[i, 0], out[i, 1], out[i, 2] = r * left_r, g * left_g, b * left_b


BLOCK = 64
"""Points that are looked up together."""
TILE_BITS = 5
TILE = 1 << TILE_BITS
"""Texels along one side of a tile of a shadow map."""
FRESH = 1
"""State of a tile that holds what its light sees now."""
STALE_SLACK = f32(6.0)
"""Texels by which more a point must lie behind what a tile holds that is not FRESH: what moved away from the light a little would
else lie in its own shadow."""


@inlined
def texel_place(coordinate, size):
    """The first of the two texels around a picture coordinate -1..1, and how far (0..1) towards the second it is."""
    place = min(max((coordinate * f32(0.5) + f32(0.5)) * f32(size) - f32(0.5), f32(0.0)), f32(size - np.int32(1)))
    first = min(np.int32(place), np.int32(size - np.int32(2)))
    return first, place - f32(first)


@kernel
def shadow_map_lookup(rows, surfaces, direct, lights, maps, frames, state, wanted, visibility):
    """visibility (n, L) from shadow maps (Williams 1978), percentage-closer filtered over the four nearest texels (Reeves et al.
    1987); 1 where direct (n, L, 3), the light that would arrive at surface points `rows`, is black.

    maps (L, 6, S, S) float32: depth along each face's axis, metres; directional lights use face 0 with frames (L, 4, 4)
    float32, map from world: x, y in -1..1 (right, up), z the depth. The receiver is moved along its normal by a texel.
    state, wanted (L, 6 * B * B) uint8, by tile of TILE x TILE texels, B a row: wanted is set to 1 where a point is looked up in a
    tile whose state is not FRESH. Returns how many look-ups that were; what they gave is worth as much as the tile.
    Blocks of BLOCK points: where they fall in a map is found without branches, so that the compiler makes vector instructions of
    it, and only then the map is read.
    """
    size = np.int32(maps.shape[2])
    area = np.int32(size * size)
    at_position, at_normal = surfaces.position, surfaces.geometric_normal
    flat = maps.reshape(len(maps), 6 * maps.shape[2] * maps.shape[3])
    bits = np.int32(TILE_BITS)
    tiles = (size + np.int32(TILE - 1)) >> bits
    unfound = 0
    at = np.empty((6, BLOCK), np.float32)
    place, across, down = np.empty(BLOCK, np.int32), np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    tile = np.empty(BLOCK, np.int32)
    reference, slack = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    for block in range(0, len(rows), BLOCK):
        count = min(BLOCK, len(rows) - block)
        for i in range(count):
            row = np.uint32(rows[block + i])
            at[0, i], at[1, i], at[2, i] = at_position[row, 0], at_position[row, 1], at_position[row, 2]
            at[3, i], at[4, i], at[5, i] = at_normal[row, 0], at_normal[row, 1], at_normal[row, 2]
        for k in range(len(lights)):
            light, m = lights[k], frames[k]
            if light.casts_shadow == 0:
                for i in range(count):
                    visibility[block + i, k] = f32(1.0)
                continue
            if light.kind == DIRECTIONAL:
                scale = math.sqrt(m[0, 0] * m[0, 0] + m[0, 1] * m[0, 1] + m[0, 2] * m[0, 2] + f32(1e-20))
                texel = f32(2.0) / f32(size) / scale
                for i in range(count):
                    x, y, z = at[0, i] + at[3, i] * texel, at[1, i] + at[4, i] * texel, at[2, i] + at[5, i] * texel
                    u = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]
                    v = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]
                    depth = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
                    outside = abs(u) >= f32(1.0) or abs(v) >= f32(1.0)
                    column, across[i] = texel_place(u, size)
                    line, down[i] = texel_place(-v, size)
                    place[i] = line * size + column
                    tile[i] = (line >> bits) * tiles + (column >> bits)
                    reference[i] = f32(-np.inf) if outside else depth - texel * f32(0.5)
                    slack[i] = texel * STALE_SLACK
            else:
                lx, ly, lz = light.position[0], light.position[1], light.position[2]
                width = f32(2.0) / f32(size)
                for i in range(count):
                    x, y, z = at[0, i] - lx, at[1, i] - ly, at[2, i] - lz
                    texel = width * max(abs(x), max(abs(y), abs(z)))
                    aside = texel * f32(1.5)
                    x, y, z = x + at[3, i] * aside, y + at[4, i] * aside, z + at[5, i] * aside
                    face, u, v, depth = cube_face(x, y, z)
                    column, across[i] = texel_place(u, size)
                    line, down[i] = texel_place(v, size)
                    place[i] = face * area + line * size + column
                    tile[i] = (face * tiles + (line >> bits)) * tiles + (column >> bits)
                    reference[i] = depth - texel * f32(0.5)
                    slack[i] = texel * STALE_SLACK
            for i in range(count):
                row = np.uint32(rows[block + i])
                lit = direct[row, k, 0] + direct[row, k, 1] + direct[row, k, 2]
                share = f32(1.0)
                if lit > f32(0.0):
                    own = np.uint32(tile[i])
                    first, nearest = np.uint32(place[i]), reference[i]
                    if state[k, own] != FRESH:
                        wanted[k, own] = 1
                        unfound += 1
                        nearest -= slack[i]
                    below = first + np.uint32(size)
                    a = f32(1.0) if flat[k, first] >= nearest else f32(0.0)
                    b = f32(1.0) if flat[k, first + np.uint32(1)] >= nearest else f32(0.0)
                    c = f32(1.0) if flat[k, below] >= nearest else f32(0.0)
                    d = f32(1.0) if flat[k, below + np.uint32(1)] >= nearest else f32(0.0)
                    upper, lower = a + (b - a) * across[i], c + (d - c) * across[i]
                    share = upper + (lower - upper) * down[i]
                visibility[block + i, k] = share
    return unfound


@kernel
def age_tiles(places, across, now, fresh, stale, state, since):
    """Tiles of one light that are `fresh` become `stale`, since (6 * across * across,) int64 = `now`.

    places (k, 5) int64: face, first and last row, first and last column of rectangles of tiles.
    """
    for i in range(len(places)):
        for row in range(places[i, 1], places[i, 2] + 1):
            for column in range(places[i, 3], places[i, 4] + 1):
                tile = (places[i, 0] * across + row) * across + column
                if state[tile] == fresh:
                    state[tile] = stale
                    since[tile] = now
