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
    """Features of display (h, w, 3) float32, 0 to 1: intensity, and both colour opponencies, which fade below a brightness of
    `darkest`; (h, w) float32 each."""
    for y in range(display.shape[0]):
        for x in range(display.shape[1]):
            r, g, b = display[y, x, 0], display[y, x, 1], display[y, x, 2]
            brightness = max(r, g, b, darkest)
            intensity[y, x] = (r + g + b) / f32(3.0)
            red_green[y, x] = (r - g) / brightness
            blue_yellow[y, x] = (b - min(r, g)) / brightness


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
                _add_scaled(rows[k, y], padded[t : t + width], taps[k, t])
    # Which row filter and which column filter: smooth, both of x, both of y, and the four products of slanted ones.
    across = np.array([0, 1, 2, 0, 0, 3, 4, 3, 4])
    down = np.array([0, 0, 0, 1, 2, 3, 4, 4, 3])
    at = np.empty((9, width), np.float32)
    for y in range(height):
        at[:] = f32(0.0)
        for k in range(9):
            for t in range(count):
                _add_scaled(at[k], rows[across[k], min(max(y + t - reach, 0), height - 1)], taps[down[k], t])
        for x in range(width):
            straight, slanted = straight_mean * at[0, x], slanted_mean * at[0, x]
            energy[0, y, x] = _magnitude(at[1, x] - straight, at[2, x])
            energy[1, y, x] = _magnitude(at[3, x] - straight, at[4, x])
            energy[2, y, x] = _magnitude(at[5, x] - at[6, x] - slanted, at[7, x] + at[8, x])
            energy[3, y, x] = _magnitude(at[5, x] + at[6, x] - slanted, at[7, x] - at[8, x])


@exact
def _add_scaled(target, source, weight):
    """target (n,) += weight * source (n,). By itself, so that the compiler makes vector instructions of it."""
    for x in range(len(target)):
        target[x] += weight * source[x]


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
    width = levels[0].shape[1]
    line, enlarged = np.empty(width + 2, np.float32), np.empty(width, np.float32)
    for center in range(centers):
        fine = levels[center]
        contrast, standing_out = np.empty(fine.shape, np.float32), np.zeros(fine.shape, np.float32)
        surround = np.empty(fine.shape[1], np.float32)
        for delta in range(first_surround, last_surround + 1):
            coarse = levels[center + delta]
            for y in range(fine.shape[0]):
                _enlarge_row(coarse, y, delta, line, surround)
                _set_contrast(fine[y], surround, faintest, contrast[y])
            weight = uniqueness(contrast, least)
            for y in range(fine.shape[0]):
                _add_scaled(standing_out[y], contrast[y], weight)
        for y in range(total.shape[0]):
            _enlarge_row(standing_out, y, center, line, enlarged)
            _add_scaled(total[y], enlarged, f32(1.0))


@exact
def _set_contrast(center, surround, faintest, contrast):
    """contrast (n,) = |center - surround|, or 0 where that is below `faintest`."""
    for x in range(len(contrast)):
        difference = abs(center[x] - surround[x])
        contrast[x] = difference if difference >= faintest else f32(0.0)


@exact
def _enlarge_row(values, y, octaves, line, out):
    """out (n,): row y of values (h, w) made 2 ** octaves as wide and high, bilinear, the last row and column repeated. Pixel 0
    stays where it is. line: room for w + 1."""
    if octaves == 0:
        out[:] = values[y]
        return
    height, width = values.shape
    scale, whole = f32(1.0) / f32(1 << octaves), (1 << octaves) - 1
    row = min(y >> octaves, height - 1)
    below, v = min(row + 1, height - 1), f32(y & whole) * scale
    for x in range(width):
        line[x] = values[row, x] + (values[below, x] - values[row, x]) * v
    line[width] = line[width - 1]
    for x in range(len(out)):
        column = min(x >> octaves, width - 1)
        out[x] = line[column] + (line[column + 1] - line[column]) * (f32(x & whole) * scale)


@exact
def uniqueness(values, least):
    """What N(.) multiplies a map (h, w) of values >= 0 with: (1 - m / M)^2 / M, with its maximum M and the mean m of its other
    local maxima. It makes the maximum 1 where it stands alone, and little of everything where there are many like it.

    Of local maxima only those above M / 10 count. What is below `least` is not raised to 1: M is at least that in the divisor.
    """
    height, width = values.shape
    # Each pixel and both its neighbours in the row: what is less than these, above or below, is no peak.
    of_three, column = np.empty((height + 2, width), np.float32), np.zeros(width, np.float32)
    of_three[0], of_three[height + 1] = f32(0.0), f32(0.0)
    for y in range(height):
        _raise_to(column, values[y])
        of_three[y + 1] = values[y]
        _raise_to(of_three[y + 1, 1:], values[y, :-1])
        _raise_to(of_three[y + 1, :-1], values[y, 1:])
    largest = column.max()
    if largest <= f32(0.0):
        return f32(0.0)
    total, count, lowest = 0.0, 0, f32(0.1) * largest
    for y in range(height):
        above, beside, below = of_three[y], of_three[y + 1], of_three[y + 2]
        for x in range(width):
            value = values[y, x]
            if value <= lowest or value < beside[x] or value < above[x] or value < below[x]:
                continue
            if _is_first(values, y, x, value):
                total += np.float64(value)
                count += 1
    others = (total - np.float64(largest)) / max(count - 1, 1)
    apart = f32(1.0 - max(others, 0.0) / np.float64(largest))
    return apart * apart / max(largest, least)


@exact
def _raise_to(values, least):
    """values (n,) = the larger of values and least (n,)."""
    for x in range(len(values)):
        values[x] = max(values[x], least[x])


@exact
def _is_first(values, y, x, value):
    """Is no neighbour before (y, x) as large? Of a level stretch only the first pixel is a peak."""
    above, right = max(y - 1, 0), min(x + 1, values.shape[1] - 1)
    for column in range(max(x - 1, 0), right + 1):
        if above < y and values[above, column] == value:
            return False
    return x == 0 or values[y, x - 1] != value


@exact
def take_steps(item, passes, cost, over, named, state, remaining, enough, taken):
    """Walk on through steps of items, taking each that fits what then remains, until those taken cost `enough` together, or one is
    of an item that is among them already. taken (n, 2) int64 gets items and passes. Returns how many.

    item, passes (m,) int64, cost (m,) float64: the steps, those of an item in their order. over (n,) uint8: items of which a step
    was passed over; named (n,) int64: the number of the answer that last named an item; state: the place, and the answer's number.
    """
    state[1] += 1
    count, planned = 0, 0.0
    while state[0] < len(item) and planned < enough:
        step = state[0]
        owner = item[step]
        if named[owner] == state[1]:
            break
        state[0] += 1
        if over[owner]:
            continue
        if cost[step] > remaining - planned:
            over[owner] = 1
            continue
        planned += cost[step]
        taken[count, 0], taken[count, 1] = owner, passes[step]
        named[owner] = state[1]
        count += 1
    return count
