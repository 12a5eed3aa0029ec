"""Booking: what requests stand for, why items were traced or not, and means that forget; loops over items and units."""

from __future__ import annotations

import numpy as np

from phrt.kernels.jit import kernel


@kernel
def first_repeated(items, count):
    """The first of `items` (k,) that came before; -1 if none did. Those that are not 0 to count - 1 are left out."""
    seen = np.zeros(count, np.uint8)
    for i in range(len(items)):
        item = items[i]
        if item < 0 or item >= count:
            continue
        if seen[item]:
            return item
        seen[item] = 1
    return -1


@kernel
def are_requests(items, passes, pixels, asked_passes, total_passes):
    """Is every one of `items` (k,) an item, not asked for whole before, and are its passes and pixels 1 at least?"""
    for i in range(len(items)):
        if items[i] < 0 or items[i] >= len(asked_passes) or passes[i] < 1 or pixels[i] < 1:
            return False
        if asked_passes[items[i]] >= total_passes:
            return False
    return True


@kernel
def request_parts(items, passes, pixels, size, asked, asked_passes, total_passes, ends, start, stop):
    """Pixels start (k,) to stop - 1 that requests for `items` (k,), none of them twice, stand for.

    passes, pixels (k,): at most so many; the largest int64 is no limit. size, asked (n,): pixels of items, and how many were
    asked for; asked_passes (n,) moves on where a request for some pixels finds none left. ends (n, total_passes): how many pixels
    the first passes of each have; (n, 1), their size, will do where all are asked for whole.
    """
    for i in range(len(items)):
        item = items[i]
        begin, whole = asked[item], np.int64(size[item])
        limited = pixels[i] != np.iinfo(np.int64).max
        done = asked_passes[item]
        if limited:
            if begin >= whole:
                # Requests for some pixels leave no trace, unless there are none left: or they could be made forever.
                asked_passes[item] += 1
            done = 0
            while done < total_passes and ends[item, done] <= begin:
                done += 1
        last = max(ends[item, min(done + passes[i], ends.shape[1]) - 1], begin)
        end = min(last, begin + min(pixels[i], whole))
        if limited:
            end = min(max(end, begin + 1), whole)
        start[i], stop[i] = begin, end


@kernel
def beginnings(items, effect, begin, out):
    """out (k,) float64: for the first of `items` (k,) of each effect what it takes before its first ray; taken out of begin
    (effects,)."""
    for i in range(len(items)):
        e = effect[items[i]]
        out[i] = begin[e]
        begin[e] = 0.0


@kernel
def forget_and_add(object_id, effect, frame, kept, least, total, weight, sums, weights, last):
    """Take sums of a frame, total and weight (k,), into means that forget: sums, weights (N + 1, effects), last (the frame of their
    latest measurement). Nothing is forgotten where weight is 0. kept: the share of a mean that is left one frame later, `least`
    after many."""
    for i in range(len(object_id)):
        if weight[i] > 0:
            o, e = object_id[i], effect[i]
            share = max(kept ** (frame - last[o, e]), least)
            sums[o, e] = sums[o, e] * share + total[i]
            weights[o, e] = weights[o, e] * share + weight[i]
            last[o, e] = frame


@kernel
def mean_rays(object_id, effect, pixels, rays, memory, measurements, mean):
    """Take rays (k,) of pixels (k,) into mean (N + 1, effects) rays per pixel: the first measurement replaces it, later ones move
    it, each by 1 / memory at least."""
    for i in range(len(object_id)):
        o, e = object_id[i], effect[i]
        measurements[o, e] += 1
        mean[o, e] += (rays[i] / pixels[i] - mean[o, e]) / min(measurements[o, e], memory)
