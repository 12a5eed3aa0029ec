"""Screen-space ambient occlusion: what the G-buffer itself knows of what is near a point.

Ground-truth ambient occlusion (Jimenez et al. 2016, "Practical Real-Time Strategies for Accurate Indirect Occlusion", equations
5 to 10): in a slice through the point, its normal and the eye, the horizon is sought on either side among the
pixels along a line; between the two horizons the cosine-weighted visibility has a closed form. Each of four
neighbouring places looks along one of four slices, and pixels take their mean. It does not know what is hidden or off the picture,
and takes what it sees for infinitely thick.
"""

from __future__ import annotations

import math

import numpy as np

from phrt.frame import Frame
from phrt.kernels.jit import device, kernel
from phrt.workers import chunks

f32 = np.float32
CHUNK = 8192
STEPS = 4
"""Pixels looked at on either side."""
WIDEST = 0.2
"""Of the picture's height: how far from a pixel it looks at most, for points close to the eye."""
FADE = f32(0.6)
"""Of the radius: from here on what is seen counts less and less."""
EVERY = 2
"""Pixels from one place of the coarse grid to the next, along lines and across them."""
ALIKE, NEAR, RISE = f32(0.8), f32(0.1), f32(0.04)
"""A place of the grid is of a pixel's surface where the cosine between their normals is above the first, and it is no further from
its tangent plane than the second, in radii. What rises over a surface by less than the third, a sine, is that surface."""
HALF_PI = f32(math.pi / 2)


def screen_occlusion(frame: Frame, pixels: np.ndarray, radius: float) -> np.ndarray:
    """(n, 1) float32: the unoccluded share of the hemisphere at `pixels` (n,), with occluders within `radius` metres.

    Found at every second pixel of every second line, and between those where the surface is the same."""
    view, surfaces = frame.view, frame.surfaces
    position, normal, object_id = surfaces.position, surfaces.geometric_normal, surfaces.object_id
    axes = np.ascontiguousarray(view.world_from_view[:3, :3].T.astype(np.float32))
    reach = np.float32(radius / view.pixel_spread)
    toward, is_point = frame.view_vectors(pixels[:1])
    wanted = np.zeros((-(-view.height // EVERY), -(-view.width // EVERY)), np.uint8)
    mark_corners(pixels, view.width, wanted)
    corners = np.flatnonzero(wanted).astype(np.int32)
    coarse = np.ones(wanted.shape, np.float32)

    def look(piece: slice) -> None:
        occlusion_at_corners(
            corners[piece], position, normal, object_id, view.width, view.height, toward, is_point, axes, reach,
            np.float32(radius), coarse,
        )  # fmt: skip

    frame.workers.map(look, chunks(len(corners), CHUNK, frame.workers.threads))
    values = np.empty((len(pixels), 1), np.float32)

    def between(piece: slice) -> None:
        occlusion_between(
            pixels[piece], position, normal, object_id, view.width, np.float32(radius), coarse, wanted, values[piece]
        )

    frame.workers.map(between, chunks(len(pixels), CHUNK, frame.workers.threads))
    return values


@kernel
def mark_corners(pixels, width, wanted):
    """Set to 1 the four places of the coarse grid around every pixel."""
    lines, columns = wanted.shape
    for row in range(len(pixels)):
        column, line = (pixels[row] % width) // EVERY, (pixels[row] // width) // EVERY
        right, below = min(column + 1, columns - 1), min(line + 1, lines - 1)
        wanted[line, column] = wanted[line, right] = wanted[below, column] = wanted[below, right] = 1


@kernel
def occlusion_at_corners(
    corners, position, normal, object_id, width, height, view, is_point, axes, reach, radius, coarse
):
    """Of the places `corners` (k,) of the coarse grid `coarse`. view: the eye (1, 3), or where all rays go when orthographic; axes
    (3, 3) float32: rows are the camera's right, up and back in world space; reach: the radius in pixels at one metre, or
    everywhere when orthographic."""
    columns = coarse.shape[1]
    for row in range(len(corners)):
        line, column = corners[row] // columns, corners[row] % columns
        pixel = line * EVERY * width + column * EVERY
        if object_id[pixel] != 0:
            coarse[line, column] = occlusion(
                pixel,
                (line % 2) * 2 + column % 2,
                position,
                normal,
                object_id,
                width,
                height,
                view,
                is_point,
                axes,
                reach,
                radius,
            )


@kernel
def occlusion_between(pixels, position, normal, object_id, width, radius, coarse, wanted, out):
    """At every pixel the mean of those of the four places around it, each with a slice of its own, that are of its surface; the
    first where none is."""
    lines, columns = coarse.shape
    for row in range(len(pixels)):
        pixel = pixels[row]
        x, y = pixel % width, pixel // width
        sums, weights = f32(0.0), f32(0.0)
        for k in range(4):
            column, line = min(x // EVERY + k % 2, columns - 1), min(y // EVERY + k // 2, lines - 1)
            other = line * EVERY * width + column * EVERY
            if object_id[other] == 0:
                continue
            facing = f32(0.0)
            off = f32(0.0)
            for axis in range(3):
                facing += normal[pixel, axis] * normal[other, axis]
                off += normal[pixel, axis] * (position[other, axis] - position[pixel, axis])
            if facing > ALIKE and abs(off) < NEAR * radius:
                sums += facing * coarse[line, column]
                weights += facing
        out[row, 0] = sums / weights if weights > f32(0.0) else coarse[y // EVERY, x // EVERY]


@device
def occlusion(pixel, turn, position, normal, object_id, width, height, view, is_point, axes, reach, radius):
    """The open share in one slice through a pixel, by what would be open if nothing rose: 1 for a plane, however it is seen.
    turn: 0 to 3, which of four slices."""
    px, py, pz = position[pixel, 0], position[pixel, 1], position[pixel, 2]
    if is_point:
        vx, vy, vz = view[0, 0] - px, view[0, 1] - py, view[0, 2] - pz
        away = vx * axes[2, 0] + vy * axes[2, 1] + vz * axes[2, 2]
        reach = reach / max(away, f32(1e-4))
        scale = f32(1.0) / math.sqrt(vx * vx + vy * vy + vz * vz)
        vx, vy, vz = vx * scale, vy * scale, vz * scale
    else:
        vx, vy, vz = -view[0, 0], -view[0, 1], -view[0, 2]
    reach = min(reach, f32(WIDEST) * f32(height))
    if reach < f32(1.0):
        return f32(1.0)

    # The slice: a direction in the picture, the same in the world, and the normal laid into it.
    angle = f32(math.pi / 4) * (f32(turn) + f32(0.5))
    along_x, along_y = math.cos(angle), math.sin(angle)
    tx = axes[0, 0] * along_x - axes[1, 0] * along_y
    ty = axes[0, 1] * along_x - axes[1, 1] * along_y
    tz = axes[0, 2] * along_x - axes[1, 2] * along_y
    tv = tx * vx + ty * vy + tz * vz
    tx, ty, tz = tx - tv * vx, ty - tv * vy, tz - tv * vz
    scale = f32(1.0) / math.sqrt(tx * tx + ty * ty + tz * tz + f32(1e-20))
    tx, ty, tz = tx * scale, ty * scale, tz * scale
    in_view = normal[pixel, 0] * vx + normal[pixel, 1] * vy + normal[pixel, 2] * vz
    in_slice = normal[pixel, 0] * tx + normal[pixel, 1] * ty + normal[pixel, 2] * tz
    tilt = math.atan2(in_slice, in_view)

    jitter = f32(0.25) * f32(turn * 3 % 4) + f32(0.25)
    low = horizon(
        pixel, f32(-1.0), along_x, along_y, reach, jitter, position, object_id, width, height,
        px, py, pz, vx, vy, vz, normal, radius, math.cos(tilt - HALF_PI),
    )  # fmt: skip
    high = horizon(
        pixel, f32(1.0), along_x, along_y, reach, jitter, position, object_id, width, height,
        px, py, pz, vx, vy, vz, normal, radius, math.cos(tilt + HALF_PI),
    )  # fmt: skip
    below, above = max(-math.acos(low), tilt - HALF_PI), min(math.acos(high), tilt + HALF_PI)
    whole = arc(tilt - HALF_PI, tilt) + arc(tilt + HALF_PI, tilt)
    return min((arc(below, tilt) + arc(above, tilt)) / max(whole, f32(1e-4)), f32(1.0))


@device
def arc(h, tilt):
    """Cosine-weighted share between the eye and a horizon at angle h in a slice whose normal is tilted (equation 7)."""
    return f32(0.25) * (-math.cos(f32(2.0) * h - tilt) + math.cos(tilt) + f32(2.0) * h * math.sin(tilt))


@device
def horizon(
    pixel, side, along_x, along_y, reach, jitter, position, object_id, width, height, px, py, pz, vx, vy, vz, normal, radius, lowest
):  # fmt: skip
    """The cosine between the eye and the highest that is seen on one side of a slice; `lowest` where nothing rises."""
    x, y = pixel % width, pixel // width
    highest = lowest
    for step in range(STEPS):
        # Denser near the point, where little things matter.
        part = (f32(step) + jitter) / f32(STEPS)
        offset = side * max(part * part * reach, f32(1.0) + f32(step))
        column = x + round(along_x * offset)
        line = y + round(along_y * offset)
        if column < 0 or column >= width or line < 0 or line >= height:
            break
        other = line * width + column
        if object_id[other] == 0:
            continue
        dx, dy, dz = position[other, 0] - px, position[other, 1] - py, position[other, 2] - pz
        square = dx * dx + dy * dy + dz * dz
        if square >= radius * radius or square <= f32(1e-12):
            continue
        distance = math.sqrt(square)
        if dx * normal[pixel, 0] + dy * normal[pixel, 1] + dz * normal[pixel, 2] < RISE * distance:
            continue
        cosine = (dx * vx + dy * vy + dz * vz) / distance
        fade = min((radius - distance) / (radius * (f32(1.0) - FADE)), f32(1.0))
        highest = max(highest, lowest + fade * (cosine - lowest))
    return min(max(highest, f32(-1.0)), f32(1.0))
