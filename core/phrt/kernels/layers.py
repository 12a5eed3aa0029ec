"""Layers: putting effect values in place, filling gaps of partly traced items, sorting pixels into work items."""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.jit import kernel

f32 = np.float32


@kernel
def mark_targets(target, pixels, position, view, view_is_point, traced, path_length):
    """traced[target] = 1 for every ray's target (position in `pixels`), and the eye's distance as its path so far: 0 for an
    orthographic view, whose pixels are as wide everywhere."""
    for i in range(len(target)):
        traced[target[i]] = 1
        path_length[i] = f32(0.0)
        if view_is_point:
            row = pixels[target[i]]
            x, y, z = position[row, 0] - view[0, 0], position[row, 1] - view[0, 1], position[row, 2] - view[0, 2]
            path_length[i] = math.sqrt(x * x + y * y + z * z)


@kernel
def scatter(pixels, values, traced, code, layer, mask):
    """layer[pixels] = values (n, C) and mask[pixels] = code, where traced (n,) is not 0."""
    for i in range(len(pixels)):
        if traced[i]:
            row = pixels[i]
            for k in range(values.shape[1]):
                layer[row, k] = values[i, k]
            mask[row] = code


KEPT, FILLED, MISSING, LONELY = 0, 1, 2, 3
"""What `fill_gaps` made of a pixel: it holds a value; its gap is filled; there is none to fill it with; its value, of an earlier
frame, is one of too few."""
ENOUGH = 9
"""Values around a pixel stand for it where there is one to so many pixels of its object: half of a pass, and the corner of one."""
PLENTY = 3
"""Values next to a pixel that are enough without counting further: at a quarter of the pixels, half of the gaps have four."""


@kernel
def fill_gaps(pixels, object_id, mask, width, height, traced_code, history_code, doubt, layer, found, needed):
    """Gaps of items that hold values at some pixels take the mean of the nearest ones of their object, within two pixels.

    pixels (n,) are the items'; found (n,) uint8 gets KEPT, FILLED, MISSING or LONELY. A pixel holds a value where its mask is
    `traced_code` or `history_code`. The mask itself is not changed, so that threads do not see each other's work. doubt: may
    earlier values be LONELY? Looking takes time. needed (P,) uint8 is set to 1 at all pixels that are not KEPT, and at those whose
    values were taken. Returns how many are not KEPT.

    A partial item is a coarser effect, not stripes, and not dots: where values are few, they are left of an earlier frame, and
    blocks of them beside what stands in elsewhere would be seen before anything that they show.
    """
    left = 0
    components = layer.shape[1]
    for i in range(len(pixels)):
        row = pixels[i]
        own, code = object_id[row], mask[row]
        if code == traced_code or (code == history_code and not doubt):
            found[i] = KEPT
            continue
        x, y = row % width, row // width
        inside = x > 1 and y > 1 and x < width - 2 and y < height - 2
        # Values next to it, and whether they are enough already.
        near = 0
        for dy in range(-1, 2):
            if code == history_code and near >= PLENTY:
                break
            for dx in range(-1, 2):
                if not inside and (x + dx < 0 or y + dy < 0 or x + dx >= width or y + dy >= height):
                    continue
                other = row + dy * width + dx
                holds = mask[other] == traced_code or mask[other] == history_code
                if holds and other != row and object_id[other] == own:
                    near += 1
        holders = near
        if near < PLENTY:
            # A ring further out, against how many pixels there are to stand for.
            holders, same = 0, 0
            for dy in range(-2, 3):
                for dx in range(-2, 3):
                    if not inside and (x + dx < 0 or y + dy < 0 or x + dx >= width or y + dy >= height):
                        continue
                    other = row + dy * width + dx
                    if object_id[other] == own:
                        same += 1
                        holders += mask[other] == traced_code or mask[other] == history_code
            if holders * ENOUGH < same:
                found[i] = LONELY if code == history_code else MISSING
                needed[row] = 1
                left += 1
                continue
        if code == history_code:
            found[i] = KEPT
            continue
        reach, number = (1, near) if near else (2, holders)
        for k in range(components):
            layer[row, k] = f32(0.0)
        for dy in range(-reach, reach + 1):
            for dx in range(-reach, reach + 1):
                if not inside and (x + dx < 0 or y + dy < 0 or x + dx >= width or y + dy >= height):
                    continue
                other = row + dy * width + dx
                holds = mask[other] == traced_code or mask[other] == history_code
                if holds and object_id[other] == own:
                    needed[other] = 1
                    for k in range(components):
                        layer[row, k] += layer[other, k]
        scale = f32(1.0) / f32(number)
        for k in range(components):
            layer[row, k] *= scale
        found[i] = FILLED
        needed[row] = 1
        left += 1
    return left


@kernel
def refine_gaps(pixels, found, object_id, mask, width, height, traced_code, history_code, fallback, layer):
    """Pixels that `fill_gaps` FILLED get the detail that the fallback has there: what it has more, or less, than at the pixels
    whose values were taken; but nothing beyond these values and the fallback itself.

    pixels, found (n,); fallback (P, C), right at all pixels that `fill_gaps` called needed. A shadow's edge that a map knows stays
    sharp, and where the fallback is smooth nothing changes (Kopf et al. 2007 interpolate with a guide to the same end).
    """
    components = layer.shape[1]
    mean = np.empty(components, np.float32)
    low, high = np.empty(components, np.float32), np.empty(components, np.float32)
    for i in range(len(pixels)):
        if found[i] != FILLED:
            continue
        row = pixels[i]
        x, y, own = row % width, row // width, object_id[row]
        number = 0
        for reach in range(1, 3):
            for dy in range(-reach, reach + 1):
                for dx in range(-reach, reach + 1):
                    if x + dx < 0 or y + dy < 0 or x + dx >= width or y + dy >= height:
                        continue
                    other = row + dy * width + dx
                    holds = mask[other] == traced_code or mask[other] == history_code
                    if holds and object_id[other] == own:
                        for k in range(components):
                            value, stands = layer[other, k], fallback[other, k]
                            mean[k] = stands if number == 0 else mean[k] + stands
                            low[k] = value if number == 0 else min(low[k], value)
                            high[k] = value if number == 0 else max(high[k], value)
                        number += 1
            if number:
                break
        for k in range(components):
            stands = fallback[row, k]
            value = layer[row, k] + stands - mean[k] / f32(max(number, 1))
            layer[row, k] = min(max(value, min(low[k], stands)), max(high[k], stands))


@kernel
def count_by_object(order, object_id, counts):
    """counts (N + 1,) int64 += how many of the pixels `order` (n,) show each object. Neighbours mostly show the same one."""
    current, run = np.uint32(0), 0
    for j in range(len(order)):
        o = object_id[np.uint32(order[j])]
        if o != current:
            counts[current] += run
            current, run = o, 0
        run += 1
    counts[current] += run


@kernel
def place_by_object(order, object_id, place, pixels):
    """Pixels `order` (n,) to where their objects' next ones belong in `pixels`: place (N + 1,) int64, moved on."""
    current, at = np.uint32(0), place[0]
    for j in range(len(order)):
        row = order[j]
        o = object_id[np.uint32(row)]
        if o != current:
            place[current] = at
            current, at = o, place[o]
        pixels[np.uint64(at)] = row
        at += 1
    place[current] = at


@kernel
def select_pixels(start, pixels, material_id, applies, allowed, selected_start, selected):
    """Those of `pixels` (P,), sorted by object, that an effect applies to, in the same order.

    start (N + 2,) int64: each object's first place, the background at 0; applies (materials,), allowed (N + 1,) bool;
    selected_start, selected: the same for what was selected, without background. Returns how many pixels that is.
    """
    count = 0
    selected_start[0] = 0
    for o in range(1, len(start) - 1):
        selected_start[o] = count
        if allowed[o]:
            for j in range(start[o], start[o + 1]):
                row = pixels[np.uint64(j)]
                selected[np.uint64(count)] = row
                count += applies[material_id[np.uint32(row)]]
    selected_start[len(start) - 1] = count
    return count


@kernel
def pass_numbers(width, numbers):
    """numbers (P,) uint8: the interleaved pass of every pixel, one place of each 2x2 block in each, opposite corners first."""
    for i in range(len(numbers)):
        right, down = i % width & 1, i // width & 1
        # (0, 0), (1, 1), (1, 0), (0, 1) are passes 0 to 3.
        numbers[i] = down if right == down else 2 + down


@kernel
def gather_ranges(source, start, stop, out):
    """out = source[start[0]:stop[0]], source[start[1]:stop[1]], ... one after the other."""
    place = 0
    for k in range(len(start)):
        for i in range(start[k], stop[k]):
            out[place] = source[i]
            place += 1
