"""Waves: shares of units, the order in which parts of them are traced, and sharing out what they took."""

from __future__ import annotations

import numpy as np

from phrt.kernels.jit import kernel


@kernel
def unit_shares(
    unit, whole, part_start, part_stop, unit_effect, unit_count, unit_rays, unit_ms, large_rays, effects,
    kept, start, stop, rays, ms, group, group_effect, group_pixels, group_rays, group_ms,
):  # fmt: skip
    """Parts of units, and the groups they are counted in. Returns how many parts and groups there are.

    unit (k,): sorted numbers; pixels part_start (k,) to part_stop - 1 of an item with whole (k,) pixels stand for the same share
    of each of its units; parts that follow each other are one, and those that come to no pixel are left out.
    Written are: kept (k,), the unit; start, stop (k,); predicted rays, ms (k,); group (k,). One with `large_rays` is a group by
    itself, the others of an effect are one group: group_effect, group_pixels, group_rays, group_ms (k,).
    """
    count, groups = 0, 0
    small = np.full(effects, -1, np.int64)
    end = 0
    while end < len(unit):
        i, u = end, unit[end]
        while end + 1 < len(unit) and unit[end + 1] == u and part_start[end + 1] == part_stop[end]:
            end += 1
        size = np.int64(unit_count[u])
        first, last = part_start[i] * size // whole[i], part_stop[end] * size // whole[i]
        end += 1
        if last <= first:
            continue
        share = (last - first) / size
        kept[count], start[count], stop[count] = u, first, last
        rays[count], ms[count] = unit_rays[u] * share, unit_ms[u] * share
        effect = unit_effect[u]
        own = rays[count] >= large_rays
        g = groups if own else small[effect]
        if g < 0 or own:
            g = groups
            groups += 1
            group_effect[g], group_pixels[g], group_rays[g], group_ms[g] = effect, 0, 0.0, 0.0
            if not own:
                small[effect] = g
        group[count] = g
        group_pixels[g] += last - first
        group_rays[g] += rays[count]
        group_ms[g] += ms[count]
        count += 1
    return count, groups


@kernel
def share_out(
    unit, group, start, stop, rays, ms, group_rays, group_ms, took_rays, took_ms, unit_pixels, unit_rays, unit_ms
):
    """Share out what groups took, took_rays and took_ms (g,), to the units (m,) of their parts (k,), as was predicted."""
    for i in range(len(unit)):
        u, g = unit[i], group[i]
        unit_pixels[u] += stop[i] - start[i]
        if group_rays[g] > 0.0:
            unit_rays[u] += took_rays[g] * rays[i] / group_rays[g]
        if group_ms[g] > 0.0:
            unit_ms[u] += took_ms[g] * ms[i] / group_ms[g]


@kernel
def pass_kinds(pixels, first, count, held, numbers, mask, history_code, kinds, sizes):
    """The pass of every pixel of units, and how many each pass has.

    pixels (p,) int32: unit u owns rows first[u] to first[u] + count[u] - 1. kinds (p,) uint8: passes 0 to 3, numbers (P,) of
    `pass_numbers`; where held[u] of them hold a value of an earlier frame (mask (P,) is history_code), these have 4 to 7.
    sizes (u, 8) int32: pixels of each kind.
    """
    for u in range(len(first)):
        sizes[u, :] = 0
        for i in range(first[u], first[u] + count[u]):
            pixel = pixels[i]
            kind = numbers[pixel]
            if held[u] and mask[pixel] == history_code:
                kind += 4
            kinds[i] = kind
            sizes[u, kind] += 1


@kernel
def gather_parts(pixels, kinds, first, count, sizes, start, stop, out):
    """Pixels start[u] to stop[u] - 1 of units in the order of their passes, written to `out` in the order in which they lie in
    `pixels`. See `pass_kinds` for the others, which are not read of units that are taken whole. Returns how many there are.
    """
    place = 0
    next_of = np.empty(8, np.int64)
    for u in range(len(first)):
        begin, wanted = first[u], stop[u] - start[u]
        if wanted == count[u]:
            for i in range(begin, begin + wanted):
                out[place] = pixels[i]
                place += 1
            continue
        total = 0
        for k in range(8):
            next_of[k] = total
            total += sizes[u, k]
        end, i = place + wanted, begin
        while place < end:
            kind = kinds[i]
            at = next_of[kind]
            next_of[kind] = at + 1
            out[place] = pixels[i]
            # Written and then taken or not: the next one overwrites it.
            place += start[u] <= at and at < stop[u]
            i += 1
    return place
