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


@kernel
def fill_gaps(pixels, object_id, mask, width, height, traced_code, history_code, filled_code, layer):
    """Pixels of partly traced items take the mean of the nearest pixels of their object that hold a value, in growing rings up
    to 2.

    pixels (n,) are the item's; those whose mask is neither `traced_code` nor `history_code` and that find a neighbour whose is get
    `filled_code`. Returns how many found none. A partial item is a coarser effect, not stripes.
    """
    missing = 0
    components = layer.shape[1]
    for i in range(len(pixels)):
        row = pixels[i]
        if mask[row] == traced_code or mask[row] == history_code:
            continue
        x, y = row % width, row // width
        found = 0
        for ring in range(1, 3):
            for dy in range(-ring, ring + 1):
                for dx in range(-ring, ring + 1):
                    if max(abs(dx), abs(dy)) != ring:
                        continue
                    nx, ny = x + dx, y + dy
                    if nx < 0 or ny < 0 or nx >= width or ny >= height:
                        continue
                    other = ny * width + nx
                    holds = mask[other] == traced_code or mask[other] == history_code
                    if holds and object_id[other] == object_id[row]:
                        for k in range(components):
                            if found == 0:
                                layer[row, k] = layer[other, k]
                            else:
                                layer[row, k] += layer[other, k]
                        found += 1
            if found:
                break
        if found:
            for k in range(components):
                layer[row, k] /= f32(found)
            mask[row] = filled_code
        else:
            missing += 1
    return missing


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
