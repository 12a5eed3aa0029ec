"""Kernels of the saliency model.

Without fastmath: sums are made in the order that is written, so that a map, and what is decided by it, is the same bit for bit
on every machine.
"""

from __future__ import annotations

import math

import numba
import numpy as np

f32 = np.float32
exact = numba.njit(nogil=True, cache=True, error_model="numpy")


@exact
def split_features(display, darkest, intensity, red_green, blue_yellow):
    """Features of display (h, w, 3) float32, 0 to 1: intensity, and both colour opponencies where something is brighter than
    `darkest`; (h, w) float32 each."""
    for y in range(display.shape[0]):
        for x in range(display.shape[1]):
            r, g, b = display[y, x, 0], display[y, x, 1], display[y, x, 2]
            brightest = max(r, g, b)
            intensity[y, x] = (r + g + b) / f32(3.0)
            red_green[y, x] = f32(0.0)
            blue_yellow[y, x] = f32(0.0)
            if brightest >= darkest:
                red_green[y, x] = (r - g) / brightest
                blue_yellow[y, x] = (b - min(r, g)) / brightest


@exact
def halve(source, out):
    """The next level of a Gaussian pyramid: source (h, w) filtered by [1 4 6 4 1] / 16 along both sides, edges repeated, and every
    second pixel of it kept, into out ((h + 1) // 2, (w + 1) // 2)."""
    height, width = source.shape
    rows, columns = out.shape
    narrow = np.empty((height, columns), np.float32)
    for y in range(height):
        for k in range(columns):
            x = 2 * k
            far = source[y, max(x - 2, 0)] + source[y, min(x + 2, width - 1)]
            near = source[y, max(x - 1, 0)] + source[y, min(x + 1, width - 1)]
            narrow[y, k] = (far + f32(4.0) * near + f32(6.0) * source[y, x]) / f32(16.0)
    for k in range(rows):
        y = 2 * k
        above, below = max(y - 1, 0), min(y + 1, height - 1)
        top, bottom = max(y - 2, 0), min(y + 2, height - 1)
        for x in range(columns):
            far, near = narrow[top, x] + narrow[bottom, x], narrow[above, x] + narrow[below, x]
            out[k, x] = (far + f32(4.0) * near + f32(6.0) * narrow[y, x]) / f32(16.0)


@exact
def filter_oriented(level, taps, straight_mean, slanted_mean, energy):
    """energy (4, h, w): how strongly level (h, w) varies along x, along y, and along both diagonals: magnitudes of complex Gabor
    filters.

    taps (5, n) float32: a Gaussian g, then g cos and g sin of the wave along an axis, and of its part along each axis when it
    is slanted. A Gabor filter with a round envelope is a product of such, so that rows are filtered first, and columns then.
    straight_mean, slanted_mean: mean of the even filter over that of the Gaussian, which is taken off, so that even light has none.
    """
    height, width = level.shape
    count = taps.shape[1]
    reach = count // 2
    rows = np.zeros((5, height, width), np.float32)
    padded = np.empty(width + 2 * reach, np.float32)
    for y in range(height):
        for x in range(width + 2 * reach):
            padded[x] = level[y, min(max(x - reach, 0), width - 1)]
        for k in range(5):
            for t in range(count):
                weight = taps[k, t]
                for x in range(width):
                    rows[k, y, x] += weight * padded[x + t]
    # Which row filter and which column filter: smooth, both of x, both of y, and the four products of slanted ones.
    across = np.array([0, 1, 2, 0, 0, 3, 4, 3, 4])
    down = np.array([0, 0, 0, 1, 2, 3, 4, 4, 3])
    at = np.empty((9, width), np.float32)
    for y in range(height):
        at[:] = f32(0.0)
        for k in range(9):
            for t in range(count):
                line, weight = min(max(y + t - reach, 0), height - 1), taps[down[k], t]
                for x in range(width):
                    at[k, x] += weight * rows[across[k], line, x]
        for x in range(width):
            straight, slanted = straight_mean * at[0, x], slanted_mean * at[0, x]
            energy[0, y, x] = _magnitude(at[1, x] - straight, at[2, x])
            energy[1, y, x] = _magnitude(at[3, x] - straight, at[4, x])
            energy[2, y, x] = _magnitude(at[5, x] - at[6, x] - slanted, at[7, x] + at[8, x])
            energy[3, y, x] = _magnitude(at[5, x] + at[6, x] - slanted, at[7, x] - at[8, x])


@exact
def _magnitude(even, odd):
    """Of an answer to a pair of filters; twice, so that a grating of amplitude 1 that fits has 1."""
    return f32(2.0) * math.sqrt(even * even + odd * odd)


@exact
def add_contrasts(levels, centers, first_surround, last_surround, faintest, least, total):
    """total (h, w) += N(|center - surround|) over all pairs of levels of a pyramid, laid over its finest.

    levels: tuple of arrays (h, w), (h / 2, w / 2), ... float32; centers: 0 .. centers - 1; surrounds: a center's level plus
    first_surround .. last_surround. Contrasts below `faintest` are none; least: see `uniqueness`.
    """
    for center in range(centers):
        fine = levels[center]
        contrast = np.empty(fine.shape, np.float32)
        for delta in range(first_surround, last_surround + 1):
            coarse, scale = levels[center + delta], f32(1.0) / f32(1 << delta)
            for y in range(fine.shape[0]):
                for x in range(fine.shape[1]):
                    difference = abs(fine[y, x] - _between(coarse, f32(y) * scale, f32(x) * scale))
                    contrast[y, x] = difference if difference >= faintest else f32(0.0)
            weight = uniqueness(contrast, least)
            if weight > f32(0.0):
                _add_enlarged(contrast, f32(1.0) / f32(1 << center), weight, total)


@exact
def _between(values, row, column):
    """Bilinear value (h, w) at a place inside, edges repeated."""
    y, x = min(int(row), values.shape[0] - 1), min(int(column), values.shape[1] - 1)
    below, right = min(y + 1, values.shape[0] - 1), min(x + 1, values.shape[1] - 1)
    v, u = row - f32(y), column - f32(x)
    upper = values[y, x] + (values[y, right] - values[y, x]) * u
    lower = values[below, x] + (values[below, right] - values[below, x]) * u
    return upper + (lower - upper) * v


@exact
def _add_enlarged(values, scale, weight, total):
    """total (h, w) += weight * values, whose pixels are 1 / scale as wide."""
    for y in range(total.shape[0]):
        for x in range(total.shape[1]):
            total[y, x] += weight * _between(values, f32(y) * scale, f32(x) * scale)


@exact
def uniqueness(values, least):
    """What N(.) multiplies a map (h, w) of values >= 0 with: (1 - m / M)^2 / M, with its maximum M and the mean m of its other
    local maxima. It makes the maximum 1 where it stands alone, and little of everything where there are many like it.

    Of local maxima only those above M / 10 count. What is below `least` is not raised to 1: M is at least that in the divisor.
    """
    height, width = values.shape
    largest = f32(0.0)
    for y in range(height):
        for x in range(width):
            largest = max(largest, values[y, x])
    if largest <= f32(0.0):
        return f32(0.0)
    total, count = 0.0, 0
    for y in range(height):
        for x in range(width):
            value = values[y, x]
            if value > f32(0.1) * largest and _is_peak(values, y, x, value):
                total += np.float64(value)
                count += 1
    others = (total - np.float64(largest)) / max(count - 1, 1)
    apart = f32(1.0 - max(others, 0.0) / np.float64(largest))
    return apart * apart / max(largest, least)


@exact
def _is_peak(values, y, x, value):
    """Is `value` more than its neighbours? Of a level stretch its first pixel is a peak."""
    for row in range(max(y - 1, 0), min(y + 2, values.shape[0])):
        for column in range(max(x - 1, 0), min(x + 2, values.shape[1])):
            if row == y and column == x:
                continue
            earlier = row < y or (row == y and column < x)
            if values[row, column] > value or (earlier and values[row, column] == value):
                return False
    return True
