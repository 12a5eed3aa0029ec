"""Earlier values of effects: where a visible point was in the previous picture, what may be taken over, what must be forgotten.

A value belongs to the place where its ray was traced. It is carried from picture to picture with its `offset`: how far that
place lies from the pixel's centre. Without it every frame would round to whole pixels anew, and shadow edges would drift with
the camera (a point that moves 0.4 pixels a frame would never move at all).
"""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.jit import device, kernel

f32 = np.float32
STEP = f32(1.0 / 64.0)
"""Of offsets, in pixels; they are int8."""
REACH = f32(0.95)
"""A value stands in for a pixel when it was traced within this many pixels of its centre. A pixel's corners are 0.71 away, and the
next pixel 1: an item of which a quarter was traced is not passed off as whole."""
NORMALS_AGREE = f32(0.9)
OFF_PLANE = f32(2.0)
"""How far the earlier point may lie off the plane of the present one, in widths of a pixel there,"""
ASIDE = f32(1.25)
"""and how many times as far beside it, over the cosine to the eye: an earlier picture may have been coarser."""
GRAZING = f32(0.05)
"""Cosines to the eye are taken to be no less."""
BLOCK = 256
TILE = 16
"""Tiles of so many pixels a side are tested against what moved, before their pixels are."""


@device
def same_plane(x, y, z, nx, ny, nz, past_x, past_y, past_z, past_nx, past_ny, past_nz, off):
    """Do two points with their normals belong to one surface? off: metres the other may lie off the plane of the first."""
    if nx * past_nx + ny * past_ny + nz * past_nz < NORMALS_AGREE:
        return False
    return abs(nx * (past_x - x) + ny * (past_y - y) + nz * (past_z - z)) <= off


@device
def off_plane(width, x, y, z):
    """Metres the earlier point may be off the plane of the one at x, y, z, where a pixel is `width` metres wide."""
    return OFF_PLANE * width + f32(1e-6) * (abs(x) + abs(y) + abs(z))


@device
def width_on_surface(footprint, depth, eye, x, y, z, nx, ny, nz):
    """How far apart, in metres along the surface, neighbouring pixels are at most."""
    dx, dy, dz = eye[0] - x * eye[3], eye[1] - y * eye[3], eye[2] - z * eye[3]
    length = math.sqrt(dx * dx + dy * dy + dz * dz + f32(1e-20))
    cosine = abs(dx * nx + dy * ny + dz * nz)
    return (footprint[0] + footprint[1] * depth) * length / max(cosine, GRAZING * length)


@kernel
def match_pixels(first, last, object_id, material_id, position, normal, depth, past_object, past_material, past_position,
                 past_normal, past_clip, past_width, past_height, footprint, eye, moved, source, slip):  # fmt: skip
    """Where the points at pixels first..last - 1 were in the previous picture.

    past_clip (4, 4) float32, its clip_from_world; footprint (2,), width of a pixel at depth 0, and its growth per metre; eye (4,)
    as in `carry`; moved (N + 1,) uint8: objects whose points cannot be found again.
    source (P,) int32 gets the nearest pixel of the previous picture that shows the same surface, -1 where none does;
    slip (P, 2) float32 how far beside that pixel's centre the point was, in pixels.
    """
    width, height = f32(past_width), f32(past_height)
    across, down = np.empty(BLOCK, np.float32), np.empty(BLOCK, np.float32)
    for block in range(first, last, BLOCK):
        size = min(BLOCK, last - block)
        # Places in the previous picture, without branches, so that the compiler makes vector instructions of it.
        for k in range(size):
            i = np.uint32(block + k)
            x, y, z = position[i, 0], position[i, 1], position[i, 2]
            w = past_clip[3, 0] * x + past_clip[3, 1] * y + past_clip[3, 2] * z + past_clip[3, 3]
            cx = past_clip[0, 0] * x + past_clip[0, 1] * y + past_clip[0, 2] * z + past_clip[0, 3]
            cy = past_clip[1, 0] * x + past_clip[1, 1] * y + past_clip[1, 2] * z + past_clip[1, 3]
            scale = f32(0.5) / max(w, f32(1e-6))
            u = (cx * scale + f32(0.5)) * width
            across[k] = u if w > f32(1e-6) else f32(-9.0)
            down[k] = (f32(0.5) - cy * scale) * height
        for k in range(size):
            i = np.uint32(block + k)
            source[i] = -1
            u, v = across[k], down[k]
            o = object_id[i]
            seen = u > f32(-0.5) and v > f32(-0.5) and u < width + f32(0.5) and v < height + f32(0.5)
            if o == 0 or not seen or moved[o]:
                continue
            x, y, z, m = position[i, 0], position[i, 1], position[i, 2], material_id[i]
            nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
            pixel = footprint[0] + footprint[1] * depth[i]
            off = off_plane(pixel, x, y, z)
            ex, ey, ez = eye[0] - x * eye[3], eye[1] - y * eye[3], eye[2] - z * eye[3]
            far = ex * ex + ey * ey + ez * ez
            cosine = ex * nx + ey * ny + ez * nz
            cosine2, beside2 = max(cosine * cosine, GRAZING * GRAZING * far), ASIDE * ASIDE * off * off * far
            # The pixel it fell into; at edges of objects one of the next nearest may show it instead.
            column, row = np.int32(u + f32(1.0)) - 1, np.int32(v + f32(1.0)) - 1
            step_x = 1 if u - f32(column) >= f32(0.5) else -1
            step_y = 1 if v - f32(row) >= f32(0.5) else -1
            for corner in range(4):
                a, b = column + (step_x if corner & 1 else 0), row + (step_y if corner & 2 else 0)
                if a < 0 or b < 0 or a >= past_width or b >= past_height:
                    continue
                j = np.uint32(b * past_width + a)
                if past_object[j] != o or past_material[j] != m:
                    continue
                px, py, pz = past_position[j, 0], past_position[j, 1], past_position[j, 2]
                dx, dy, dz = px - x, py - y, pz - z
                if (dx * dx + dy * dy + dz * dz) * cosine2 <= beside2 and same_plane(
                    x, y, z, nx, ny, nz, px, py, pz, past_normal[j, 0], past_normal[j, 1], past_normal[j, 2], off
                ):
                    source[i] = j
                    slip[i, 0], slip[i, 1] = u - (f32(a) + f32(0.5)), v - (f32(b) + f32(0.5))
                    break


@device
def in_steps(aside):
    """Pixels as the nearest number of STEP; -2 < aside < 2."""
    return np.int8(np.int32(aside / STEP + f32(128.5)) - np.int32(128))


@kernel
def choose_values(first, last, source, slip, object_id, material_id, position, normal, depth, past_object, past_material,
                  past_position, past_normal, past_width, footprint, applies, traced_code, history_code,
                  past_mask, past_offset, chosen, offset):  # fmt: skip
    """Of which pixel of the previous picture the value was traced nearest to each of first..last - 1.

    source, slip: of `match_pixels`. applies (materials,) bool. past_mask (P,), past_offset (P, 2) int8: of an effect's layer; the
    offset is read where the mask is history_code. chosen (P,) int32 gets the pixel, -1 when nothing was traced within
    REACH; offset (P, 2) int8 how far beside the present pixel's centre that was.

    First the pixel where the point was. Its value may have been traced nearer to the next point: then the neighbour on the other
    side has ours. Only where neither has one near enough, the three pixels next nearest to the point are looked at.
    """
    for pixel in range(first, last):
        i = np.uint32(pixel)
        chosen[i] = -1
        start = source[i]
        if start < 0 or not applies[material_id[i]]:
            continue
        slip_x, slip_y = slip[i, 0], slip[i, 1]
        best, best_x, best_y, nearest = np.int32(-1), f32(0.0), f32(0.0), f32(4.0)
        a, b = 0, 0
        code = past_mask[start]
        if code in (traced_code, history_code):
            best, best_x, best_y = start, -slip_x, -slip_y
            if code == history_code:
                best_x += f32(past_offset[start, 0]) * STEP
                best_y += f32(past_offset[start, 1]) * STEP
            if max(abs(best_x), abs(best_y)) <= f32(0.5):
                chosen[i] = best
                offset[i, 0], offset[i, 1] = in_steps(best_x), in_steps(best_y)
                continue
            nearest = min(nearest, best_x * best_x + best_y * best_y)
            a = -1 if best_x > f32(0.5) else (1 if best_x < f32(-0.5) else 0)
            b = -1 if best_y > f32(0.5) else (1 if best_y < f32(-0.5) else 0)
        width = footprint[0] + footprint[1] * depth[i]
        side_x, side_y = 1 if slip_x >= f32(0.0) else -1, 1 if slip_y >= f32(0.0) else -1
        for attempt in range(-1 if best >= 0 else 0, 3):
            if attempt >= 0:
                if nearest <= REACH * REACH:
                    break
                a, b = side_x if attempt != 1 else 0, side_y if attempt != 0 else 0
            # The mask first: most neighbours of pixels without a value have none either, and a division is dear.
            place = np.int32(start + np.int32(b) * np.int32(past_width) + np.int32(a))
            if place < 0 or place >= len(past_mask):
                continue
            j = np.uint32(place)
            code = past_mask[j]
            if code not in (traced_code, history_code):
                continue
            column = np.int32(np.uint32(start) % np.uint32(past_width)) + a
            if column < 0 or column >= past_width:
                continue
            aside_x, aside_y = f32(a) - slip_x, f32(b) - slip_y
            if code == history_code:
                aside_x += f32(past_offset[j, 0]) * STEP
                aside_y += f32(past_offset[j, 1]) * STEP
            distance = aside_x * aside_x + aside_y * aside_y
            if distance >= nearest or past_object[j] != object_id[i] or past_material[j] != material_id[i]:
                continue
            x, y, z = position[i, 0], position[i, 1], position[i, 2]
            if same_plane(
                x, y, z, normal[i, 0], normal[i, 1], normal[i, 2], past_position[j, 0], past_position[j, 1], past_position[j, 2],
                past_normal[j, 0], past_normal[j, 1], past_normal[j, 2], off_plane(width, x, y, z),
            ):  # fmt: skip
                best, best_x, best_y, nearest = np.int32(j), aside_x, aside_y, distance
        if best < 0 or best_x * best_x + best_y * best_y > REACH * REACH:
            continue
        chosen[i] = best
        offset[i, 0], offset[i, 1] = in_steps(best_x), in_steps(best_y)


@device
def turned_by(eyes, age, x, y, z):
    """Square of the angle, nearly, by which the eye went round a point since `age` frames ago; eyes (A, 4) as in `carry`."""
    ax, ay, az = eyes[0, 0] - x * eyes[0, 3], eyes[0, 1] - y * eyes[0, 3], eyes[0, 2] - z * eyes[0, 3]
    bx, by, bz = eyes[age, 0] - x * eyes[age, 3], eyes[age, 1] - y * eyes[age, 3], eyes[age, 2] - z * eyes[age, 3]
    a = f32(1.0) / math.sqrt(ax * ax + ay * ay + az * az + f32(1e-20))
    b = f32(1.0) / math.sqrt(bx * bx + by * by + bz * bz + f32(1e-20))
    dx, dy, dz = ax * a - bx * b, ay * a - by * b, az * a - bz * b
    return dx * dx + dy * dy + dz * dz


@kernel
def carry(first, last, chosen, position, roughness, first_light, direct, past_direct, eyes, parallax, max_age, traced_code,
          history_code, past_layer, past_mask, past_age, layer, mask, age):  # fmt: skip
    """Take one effect's earlier values over to pixels first..last - 1: layer (P, C), mask, age (P,).

    chosen (P,): of `choose_values`. first_light: component k is the visibility of light first_light + k, and holds only
    where that light arrived, by direct (P, L, 3); -1 when components are no lights. parallax: radians that the eye may have gone
    round a point, inf for any; a glossy surface is granted the width of its lobe more (alpha of GGX). eyes (A, 4): now, one frame
    ago, ...; x, y, z, 1, or a direction towards the eye and 0. max_age: frames; at 255 the age stops counting. past_age is read
    only where past_mask is history_code.
    Returns how many pixels were taken over.
    """
    components = layer.shape[1]
    taken = 0
    for pixel in range(first, last):
        i = np.uint32(pixel)
        if chosen[i] < 0:
            continue
        j = np.uint32(chosen[i])
        frames = np.int64(1)
        if past_mask[j] != traced_code:
            frames = min(np.int64(past_age[j]) + np.int64(1), np.int64(255))
        if frames > max_age:
            continue
        if parallax < f32(np.inf):
            limit = parallax + roughness[i] * roughness[i]
            if frames >= len(eyes) or (
                turned_by(eyes, frames, position[i, 0], position[i, 1], position[i, 2]) > limit * limit
            ):
                continue
        if first_light >= 0:
            known = True
            for k in range(components):
                if past_layer[j, k] >= f32(1.0):
                    light = first_light + k
                    now = direct[i, light, 0] + direct[i, light, 1] + direct[i, light, 2]
                    then = past_direct[j, light, 0] + past_direct[j, light, 1] + past_direct[j, light, 2]
                    known = known and not (now > f32(0.0) and then <= f32(0.0))
            if not known:
                continue
        for k in range(components):
            layer[i, k] = past_layer[j, k]
        mask[i] = history_code
        age[i] = frames
        taken += 1
    return taken


@device
def crossed(x, y, z, end_x, end_y, end_z, kind, extent, centre_x, centre_y, centre_z, radius, slack):
    """Does a moving sphere come between a point and the end of its way, `slack` metres aside included?

    Kind 1: a light at the end, `extent` metres large; 0: one in that direction, extent the tangent of half its angle; -1: no way
    at all, everything within `extent` metres counts.
    """
    wx, wy, wz = centre_x - x, centre_y - y, centre_z - z
    if kind < f32(0.0):
        reach = radius + extent + slack
        return wx * wx + wy * wy + wz * wz <= reach * reach
    dx, dy, dz = end_x, end_y, end_z
    if kind > f32(0.0):
        dx, dy, dz = dx - x, dy - y, dz - z
        squared = max(dx * dx + dy * dy + dz * dz, f32(1e-12))
        t = min(max((wx * dx + wy * dy + wz * dz) / squared, f32(0.0)), f32(1.0))
        tangent = extent / math.sqrt(squared)
    else:
        t = max(wx * dx + wy * dy + wz * dz, f32(0.0))
        tangent = extent
    wx, wy, wz = wx - t * dx, wy - t * dy, wz - t * dz
    # The ways to all points of a light are a cone, which a sphere touches before it touches the axis.
    reach = radius * math.sqrt(f32(1.0) + tangent * tangent) + t * extent + slack
    return wx * wx + wy * wy + wz * wz <= reach * reach


@kernel
def forget_crossed(first, last, width, position, normal, depth, footprint, eye, ends, spheres, history_code,
                   none_code, clear, layer, mask):  # fmt: skip
    """Values at pixels first..last - 1 (whole rows) that a moving sphere can have changed are cleared again.

    ends (K, 5): x, y, z, kind and extent as in `crossed`; spheres (M, 4): centre, radius, before and after; eye (4,) as in
    `carry`. Tile by tile: what no way from a tile's bounding sphere meets, none from its pixels does. Returns how many pixels
    were cleared.
    """
    rows = (last - first) // width
    pairs = np.empty((len(ends) * len(spheres), 2), np.int32)
    cleared = 0
    for top in range(0, rows, TILE):
        for left in range(0, width, TILE):
            bottom, right = min(top + TILE, rows), min(left + TILE, width)
            # The bounding sphere of the tile's points.
            low_x, low_y, low_z = f32(np.inf), f32(np.inf), f32(np.inf)
            high_x, high_y, high_z = f32(-np.inf), f32(-np.inf), f32(-np.inf)
            deepest = f32(0.0)
            for row in range(top, bottom):
                for column in range(left, right):
                    i = np.uint32(first + row * width + column)
                    if mask[i] == history_code:
                        x, y, z = position[i, 0], position[i, 1], position[i, 2]
                        low_x, low_y, low_z = min(low_x, x), min(low_y, y), min(low_z, z)
                        high_x, high_y, high_z = max(high_x, x), max(high_y, y), max(high_z, z)
                        deepest = max(deepest, depth[i])
            if low_x > high_x:
                continue
            x, y, z = (low_x + high_x) * f32(0.5), (low_y + high_y) * f32(0.5), (low_z + high_z) * f32(0.5)
            dx, dy, dz = high_x - low_x, high_y - low_y, high_z - low_z
            around = (
                f32(0.5) * math.sqrt(dx * dx + dy * dy + dz * dz) + (footprint[0] + footprint[1] * deepest) / GRAZING
            )
            found = 0
            for k in range(len(ends)):
                for m in range(len(spheres)):
                    if crossed(
                        x, y, z, ends[k, 0], ends[k, 1], ends[k, 2], ends[k, 3], ends[k, 4],
                        spheres[m, 0], spheres[m, 1], spheres[m, 2], spheres[m, 3], around,
                    ):  # fmt: skip
                        pairs[found, 0], pairs[found, 1] = k, m
                        found += 1
            if found == 0:
                continue
            for row in range(top, bottom):
                for column in range(left, right):
                    i = np.uint32(first + row * width + column)
                    if mask[i] != history_code:
                        continue
                    x, y, z = position[i, 0], position[i, 1], position[i, 2]
                    slack = width_on_surface(
                        footprint, depth[i], eye, x, y, z, normal[i, 0], normal[i, 1], normal[i, 2]
                    )
                    for p in range(found):
                        k, m = pairs[p, 0], pairs[p, 1]
                        if crossed(
                            x, y, z, ends[k, 0], ends[k, 1], ends[k, 2], ends[k, 3], ends[k, 4],
                            spheres[m, 0], spheres[m, 1], spheres[m, 2], spheres[m, 3], slack,
                        ):  # fmt: skip
                            mask[i] = none_code
                            for c in range(layer.shape[1]):
                                layer[i, c] = clear
                            cleared += 1
                            break
    return cleared


@kernel
def history_of_units(pixels, first, count, mask, age, history_code, held, age_sum):
    """What stands in at the pixels of each unit, pixels[first[u]:first[u] + count[u]]: held (m,) int32, how many of them;
    age_sum (m,) float64, the sum of their ages in frames."""
    for u in range(len(first)):
        held[u], age_sum[u] = 0, 0.0
        for k in range(first[u], first[u] + count[u]):
            row = pixels[k]
            if mask[row] == history_code:
                held[u] += 1
                age_sum[u] += age[row]
