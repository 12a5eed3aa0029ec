"""Where photons start: which directions of a light meet glass or mirrors, and photons spread evenly over those.

A projection map (Jensen 2001, section 5.3): the sphere of directions round a light, or the square that a directional light
shines through, in CELLS equal cells along a Z-curve; those that a caster covers are marked. Over the marked cells photons start on
a Fibonacci lattice, which fits to itself on all sides and leaves neither gaps nor clusters (Niederreiter 1992, chapter 5). They
are numbered along the curve, so that photons with near numbers start next to each other.
"""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.jit import device, kernel
from phrt.kernels.random import hash_u32, orthonormal, unit_float
from phrt.lights import RECT, SPOT

BITS = 8
SIDE = 1 << BITS
CELLS = SIDE * SIDE
CELL_ANGLE = math.sqrt(4.0 * math.pi / CELLS)
"""Radians along the side of a cell of the sphere, on average."""
STEPS = np.array([[0.0, 0.0], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
"""To a cell and its neighbours, in cells."""
FINE_BITS = 16
FINE = 1 << FINE_BITS
"""Steps along a side of the square that tell photons apart."""
DEEPEST = 16
"""A triangle is cut in four this often at most: what a light touches would be cut for ever."""


@device
def square_to_sphere(a, b):
    """Unit direction of a, b in 0..1; equal areas stay equal (Clarberg 2008, "Fast Equal-Area Mapping of the (Hemi)Sphere")."""
    u, v = 2.0 * a - 1.0, 2.0 * b - 1.0
    signed = 1.0 - (abs(u) + abs(v))
    r = 1.0 - abs(signed)
    phi = (1.0 if r == 0.0 else (abs(v) - abs(u)) / r + 1.0) * (0.25 * math.pi)
    z = math.copysign(1.0 - r * r, signed)
    across = r * math.sqrt(max(2.0 - r * r, 0.0))
    return math.copysign(math.cos(phi), u) * across, math.copysign(math.sin(phi), v) * across, z


@device
def sphere_to_square(x, y, z):
    """The inverse of `square_to_sphere`."""
    ax, ay = abs(x), abs(y)
    r = math.sqrt(max(1.0 - abs(z), 0.0))
    phi = math.atan2(ay, ax) * (2.0 / math.pi)
    v = phi * r
    u = r - v
    if z < 0.0:
        u, v = 1.0 - v, 1.0 - u
    return math.copysign(u, x) * 0.5 + 0.5, math.copysign(v, y) * 0.5 + 0.5


@device
def interleaved(column, row, bits):
    """Place of a cell on the Z-curve through 4 ** bits cells (Morton 1966)."""
    place = 0
    for bit in range(bits):
        place |= ((column >> bit) & 1) << (2 * bit) | ((row >> bit) & 1) << (2 * bit + 1)
    return place


@device
def parted(place, bits):
    """Column and row of a place on a Z-curve through 4 ** bits cells."""
    column, row = 0, 0
    for bit in range(bits):
        column |= ((place >> (2 * bit)) & 1) << bit
        row |= ((place >> (2 * bit + 1)) & 1) << bit
    return column, row


@device
def cell_at(a, b):
    """The cell that a, b in 0..1 is in."""
    return interleaved(min(max(int(a * SIDE), 0), SIDE - 1), min(max(int(b * SIDE), 0), SIDE - 1), BITS)


@device
def put(stack, row, ax, ay, az, bx, by, bz, cx, cy, cz):
    """A triangle into a row of the stack."""
    stack[row, 0], stack[row, 1], stack[row, 2] = ax, ay, az
    stack[row, 3], stack[row, 4], stack[row, 5] = bx, by, bz
    stack[row, 6], stack[row, 7], stack[row, 8] = cx, cy, cz


@device
def is_new(a, b, far, reach, seen):
    """Was nothing as near marked yet in the same sixteenth of a cell? Notes that something is now."""
    column = min(max(int(a * (4 * SIDE)), 0), 4 * SIDE - 1)
    row = min(max(int(b * (4 * SIDE)), 0), 4 * SIDE - 1)
    new = seen[row, column] == 0 or far < reach[interleaved(column >> 2, row >> 2, BITS)]
    seen[row, column] = 1
    return new


@device
def mark(parallel, origin, axes, side, x, y, z, reach, seen):
    """Mark the cells round point x, y, z; its distance is kept where it is the nearest so far."""
    if parallel:
        px, py, pz = x - origin[0], y - origin[1], z - origin[2]
        a = (px * axes[0, 0] + py * axes[0, 1] + pz * axes[0, 2]) / side
        b = (px * axes[1, 0] + py * axes[1, 1] + pz * axes[1, 2]) / side
        far = px * axes[2, 0] + py * axes[2, 1] + pz * axes[2, 2]
        if not is_new(a, b, far, reach, seen):
            return
        for k in range(5):
            cell = cell_at(a + STEPS[k, 0] / SIDE, b + STEPS[k, 1] / SIDE)
            reach[cell] = min(reach[cell], far)
        return
    dx, dy, dz = x - origin[0], y - origin[1], z - origin[2]
    far = math.sqrt(dx * dx + dy * dy + dz * dz)
    if far < 1e-9:
        return
    dx, dy, dz = dx / far, dy / far, dz / far
    a, b = sphere_to_square(dx, dy, dz)
    if not is_new(a, b, far, reach, seen):
        return
    tx, ty, tz, bx, by, bz = orthonormal(np.float32(dx), np.float32(dy), np.float32(dz))
    for k in range(5):
        s, t = STEPS[k, 0] * CELL_ANGLE, STEPS[k, 1] * CELL_ANGLE
        ex, ey, ez = dx + tx * s + bx * t, dy + ty * s + by * t, dz + tz * s + bz * t
        scale = 1.0 / math.sqrt(ex * ex + ey * ey + ez * ez)
        a, b = sphere_to_square(ex * scale, ey * scale, ez * scale)
        cell = cell_at(a, b)
        reach[cell] = min(reach[cell], far)


@kernel
def mark_cells(corners, parallel, origin, axes, side, reach):
    """Mark the cells that triangles corners (T, 3, 3) float64 cover, seen from a light, and those next to them.

    parallel: the light is directional; origin (3,): where the light is, or a corner of the square it shines through, which is
    side metres wide along rows 0 and 1 of axes (3, 3); row 2 is the way it shines. reach (CELLS,) float32: metres from the origin
    to the nearest triangle in a cell, along row 2 when parallel; +inf where there is none.
    """
    stack, depth = np.empty((4 * DEEPEST, 9)), np.empty(4 * DEEPEST, np.int64)
    seen = np.zeros((4 * SIDE, 4 * SIDE), np.uint8)
    for t in range(len(corners)):
        for k in range(9):
            stack[0, k] = corners[t, k // 3, k % 3]
        depth[0] = 0
        top = 1
        while top > 0:
            top -= 1
            ax, ay, az = stack[top, 0], stack[top, 1], stack[top, 2]
            bx, by, bz = stack[top, 3], stack[top, 4], stack[top, 5]
            cx, cy, cz = stack[top, 6], stack[top, 7], stack[top, 8]
            level = depth[top]
            mx, my, mz = (ax + bx + cx) / 3.0, (ay + by + cy) / 3.0, (az + bz + cz) / 3.0
            ab = (ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2
            bc = (bx - cx) ** 2 + (by - cy) ** 2 + (bz - cz) ** 2
            ca = (cx - ax) ** 2 + (cy - ay) ** 2 + (cz - az) ** 2
            longest = math.sqrt(max(ab, max(bc, ca)))
            if parallel:
                enough = side / SIDE
            else:
                far = math.sqrt((mx - origin[0]) ** 2 + (my - origin[1]) ** 2 + (mz - origin[2]) ** 2)
                enough = CELL_ANGLE * max(far - longest, 0.0)
            if longest <= enough or level >= DEEPEST - 1:
                mark(parallel, origin, axes, side, mx, my, mz, reach, seen)
                continue
            # Four triangles half as large, between the corners and the middles of the sides.
            px, py, pz = (ax + bx) * 0.5, (ay + by) * 0.5, (az + bz) * 0.5
            qx, qy, qz = (bx + cx) * 0.5, (by + cy) * 0.5, (bz + cz) * 0.5
            rx, ry, rz = (cx + ax) * 0.5, (cy + ay) * 0.5, (cz + az) * 0.5
            for k in range(4):
                depth[top + k] = level + 1
            put(stack, top, ax, ay, az, px, py, pz, rx, ry, rz)
            put(stack, top + 1, px, py, pz, bx, by, bz, qx, qy, qz)
            put(stack, top + 2, rx, ry, rz, qx, qy, qz, cx, cy, cz)
            put(stack, top + 3, px, py, pz, qx, qy, qz, rx, ry, rz)
            top += 4


@device
def chance(number, key, salt):
    """0 <= x < 1, of a photon's number and what it is for."""
    return float(unit_float(hash_u32(number, key, salt)))


@device
def intensity(light, x, y, z):
    """What a light's shape makes of its colour in the unit direction x, y, z: candela for the colour's nits or candela.

    As `phrt.kernels.light.falloff` has it, far from the light; the range of a light is a matter of distance.
    """
    cosine = x * light.direction[0] + y * light.direction[1] + z * light.direction[2]
    if light.kind == SPOT:
        t = (cosine - light.cos_outer) / max(light.cos_inner - light.cos_outer, 1e-4)
        t = min(max(t, 0.0), 1.0)
        return t * t
    if light.kind == RECT:
        ux, uy, uz = light.half_u[0], light.half_u[1], light.half_u[2]
        vx, vy, vz = light.half_v[0], light.half_v[1], light.half_v[2]
        cx, cy, cz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        return 4.0 * math.sqrt(cx * cx + cy * cy + cz * cz) * max(cosine, 0.0)
    return 1.0


@kernel
def lattice(tiles, tile_bits, points, step, reach, place, code):
    """Photons over the marked cells among `tiles` (t,) int64, squares of 2 ** tile_bits cells along the Z-curve.

    points, step: two Fibonacci numbers in order; a tile has points i / points, i step / points of 0..1 on its sides. Writes place
    (n, 2): 0..1 in the whole square, and code (n,) int64: its place on the curve. Returns how many; room for all of all tiles.
    """
    across = 1 << (BITS - tile_bits)
    count = 0
    for t in range(len(tiles)):
        column, row = parted(tiles[t], BITS - tile_bits)
        for i in range(points):
            a = (column + (i + 0.5) / points) / across
            b = (row + ((i * step) % points + 0.5) / points) / across
            if reach[cell_at(a, b)] < np.inf:
                place[count, 0], place[count, 1] = a, b
                code[count] = interleaved(int(a * FINE), int(b * FINE), FINE_BITS)
                count += 1
    return count


@kernel
def emit(lights, which, parallel, first, share, place, reach, origin, axes, side, back, start, direction, power):
    """Photons first, first + 1, ... that light `which` sends from place (n, 2) float64 of its square.

    Writes start, direction (n, 3) and power (n,) float32: what a photon carries of a light of colour 1, in lumens. share: of the
    square that each has to itself.
    origin, axes, side, reach: as `mark_cells` has them. back: metres that a directional light's photons start before the casters.
    Photons of lights with an extent start at a random point of it, and go to where the photon from its centre would have met the
    caster: power is the solid angle there, seen from that point.
    """
    light = lights[which]
    key = which * 8 + 1
    for j in range(len(power)):
        i = first + j
        a, b = place[j, 0], place[j, 1]
        far = float(reach[cell_at(a, b)])
        # The point of the light, by the R2 sequence (Roberts 2018): photons that start side by side have it far apart.
        u, v = chance(0, key, 1) + i * 0.7548776662466927, chance(0, key, 2) + i * 0.5698402909980532
        u, v = u - math.floor(u), v - math.floor(v)
        ru, rv = math.sqrt(u), 2.0 * math.pi * v
        if parallel:
            wx, wy, wz = axes[2, 0], axes[2, 1], axes[2, 2]
            across, along = ru * light.tan_half_angle * math.cos(rv), ru * light.tan_half_angle * math.sin(rv)
            dx = wx + axes[0, 0] * across + axes[1, 0] * along
            dy = wy + axes[0, 1] * across + axes[1, 1] * along
            dz = wz + axes[0, 2] * across + axes[1, 2] * along
            scale = 1.0 / math.sqrt(dx * dx + dy * dy + dz * dz)
            dx, dy, dz = dx * scale, dy * scale, dz * scale
            x = origin[0] + (axes[0, 0] * a + axes[1, 0] * b) * side + wx * far - dx * back
            y = origin[1] + (axes[0, 1] * a + axes[1, 1] * b) * side + wy * far - dy * back
            z = origin[2] + (axes[0, 2] * a + axes[1, 2] * b) * side + wz * far - dz * back
            carried = side * side
        else:
            wx, wy, wz = square_to_sphere(a, b)
            x, y, z = origin[0], origin[1], origin[2]
            if light.kind == RECT:
                s, t = 2.0 * u - 1.0, 2.0 * v - 1.0
                x += light.half_u[0] * s + light.half_v[0] * t
                y += light.half_u[1] * s + light.half_v[1] * t
                z += light.half_u[2] * s + light.half_v[2] * t
            elif light.radius > 0.0:
                tx, ty, tz, bx, by, bz = orthonormal(np.float32(wx), np.float32(wy), np.float32(wz))
                s, t = ru * light.radius * math.cos(rv), ru * light.radius * math.sin(rv)
                x, y, z = x + tx * s + bx * t, y + ty * s + by * t, z + tz * s + bz * t
            dx, dy, dz = origin[0] + wx * far - x, origin[1] + wy * far - y, origin[2] + wz * far - z
            length = math.sqrt(dx * dx + dy * dy + dz * dz) + 1e-12
            dx, dy, dz = dx / length, dy / length, dz / length
            seen = max(dx * wx + dy * wy + dz * wz, 0.0) * far * far / (length * length)
            carried = 4.0 * math.pi * seen * intensity(light, dx, dy, dz)
        start[j, 0], start[j, 1], start[j, 2] = x, y, z
        direction[j, 0], direction[j, 1], direction[j, 2] = dx, dy, dz
        power[j] = carried * share
