"""Kernels of `gain`: what steps of items are worth, and handing them out."""

from __future__ import annotations

import numpy as np

from phrt.kernels.jit import device, kernel

f64 = np.float64
CHANGE, DETAIL, DRIFT, STRENGTH = range(4)
"""Rows of `measured` and `means`."""

DARKEST_STRENGTH = 1.0 / 255.0
"""Changes of less than one step of an 8-bit picture count as this large."""


@device
def expected(measured, mean, hope, forgotten):
    """What was measured, as far as it is not `forgotten` (0 to 1), and else `hope` times the effect's mean."""
    if measured != measured:
        return hope * mean
    return f64(measured) + max(hope * mean - measured, 0.0) * forgotten


@device
def share_of_passes(held, done, passes, total):
    """Which share of an item its next `passes` are, after `done` of `total`: see `Candidates.pass_shares`."""
    if held <= 0.0:
        return passes / total
    others = held / (total - 1)
    return passes * others if done > 0 else 1.0 - held + (passes - 1) * others


@kernel
def effect_means(measured, pixel_count, effect, guess, means):
    """means (4, E) float64 of every effect: over the pixels of the items that were measured, and of one more of mean size that has
    `guess` (4,). What no item was measured of stays as it is. measured (4, n) float32, NaN where it was not."""
    for column in range(len(measured)):
        for e in range(means.shape[1]):
            items, pixels, total = 0, 0.0, 0.0
            for i in range(len(effect)):
                if effect[i] == e and measured[column, i] == measured[column, i]:
                    items += 1
                    pixels += pixel_count[i]
                    total += f64(pixel_count[i]) * measured[column, i]
            if pixels > 0.0:
                extra = pixels / items
                means[column, e] = (total + guess[column] * extra) / (pixels + extra)


@kernel
def rank_steps(
    effect, pixel_count, mandatory, cost, importance, share, age, since, seen, measured, means, keys, last_passes,
    never, optimism, forget, longest_wait, power, damping, small_pixels, step_passes, error_left, order,
):  # fmt: skip
    """order (n * steps,) uint64: a number for every step, the first to be taken the smallest. Returns how many there are.

    The upper half is 0 for mandatory items, and else falls with what the step is worth for its cost; the lower one is
    key * 4 + step, so that no two are equal. step_passes (2, steps): passes of the steps of large items, and of those with fewer
    than `small_pixels`, 0 where there is none; error_left (steps,) see `gain`; last_passes (key,): of the previous frame. Other
    arrays are columns of the candidates, in float32 or int32.
    """
    count = 0
    steps = step_passes.shape[1]
    total = step_passes[0].sum()
    for i in range(len(effect)):
        e = effect[i]
        waited = f64(seen[i]) if since[i] == never else f64(since[i] - 1)
        waited /= forget
        forgotten = 1.0 if since[i] == never else 1.0 - 0.5**waited
        # Who waits for long is hoped to be worth more and more, or what seems to change little would never be tried again.
        hope = optimism * (1.0 + min(waited, longest_wait))
        change = expected(measured[CHANGE, i], means[CHANGE, e], hope, forgotten)
        detail = min(expected(measured[DETAIL, i], means[DETAIL, e], 1.0, forgotten), change)
        drift = expected(measured[DRIFT, i], means[DRIFT, e], 1.0, forgotten)
        strength = max(expected(measured[STRENGTH, i], means[STRENGTH, e], 1.0, forgotten), DARKEST_STRENGTH)
        # Values of earlier frames stay where a pass does not come; elsewhere gaps are filled, also between such values.
        held = f64(share[i])
        aged = held * min(drift * age[i], change)
        error = aged + (1.0 - held) * (detail if held >= 0.5 else change)
        # The same mean is worth more where it is few large changes, by a power of their size.
        weight = importance[i] * pixel_count[i] * strength ** (power - 1.0)
        done = 0
        best = np.inf
        for step in range(steps):
            passes = step_passes[int(pixel_count[i] < small_pixels), step]
            if passes == 0:
                break
            part = share_of_passes(held, done, passes, total)
            done += passes
            left = 0.0
            if done < total:
                left = detail * error_left[step]
                if held > 0.0:
                    # The first pass was all that is missing; the others take the age from what is held.
                    left = aged * (total - done) / (total - 1)
            if part > 0.0:
                # No step may be worth more for its price than the one before it, or it would be asked for first.
                best = min(best, max(error - left, 0.0) / part)
            error = left
            worth = weight * best / max(f64(cost[i]), 1e-30)
            if last_passes[keys[i]] >= done:
                worth *= 1.0 + damping
            upper = np.uint64(0)
            if not mandatory[i]:
                upper = np.uint64(0xFFFFFFFF) - np.uint64(np.float32(min(worth, 1e38)).view(np.uint32))
            order[count] = (upper << np.uint64(32)) | np.uint64(keys[i] * 4 + step)
            count += 1
    return count


@kernel
def take_steps(
    order, place, row_of_key, pixel_count, cost, share, given, small_pixels, step_passes, least_share, remaining, enough,
    row_of_item, taken,
):  # fmt: skip
    """The steps from place[0] on that fit one after the other, until they cost `enough` together; others are passed over. A
    step of a large item of which `least_share` would fit is not: it is left for the caller, at place[0].

    order (s,) uint64 sorted numbers of `rank_steps`; row_of_key (key,) int32 candidates; taken (k, 2) int32 gets items and passes,
    one row for all steps of an item; given (n,) int32: passes handed out in this frame; row_of_item (n,) int32 is -1 before
    and after. Returns how many rows there are.
    """
    count, planned = 0, 0.0
    total = step_passes[0].sum()
    while place[0] < len(order) and planned < enough:
        number = order[place[0]] & np.uint64(0xFFFFFFFF)
        item = row_of_key[number >> np.uint64(2)]
        passes = step_passes[int(pixel_count[item] < small_pixels), number & np.uint64(3)]
        price = f64(cost[item]) * share_of_passes(f64(share[item]), given[item], passes, total)
        if price > remaining - planned:
            if pixel_count[item] >= small_pixels and remaining - planned >= least_share * price:
                break
            place[0] += 1
            continue
        place[0] += 1
        # A first pass of an item that is held whole is free, but an answer all the same.
        planned += max(price, 1e-300)
        row = row_of_item[item]
        if row < 0:
            row = count
            row_of_item[item] = row
            taken[row, 0], taken[row, 1] = item, 0
            count += 1
        taken[row, 1] += passes
        given[item] += passes
    for row in range(count):
        row_of_item[taken[row, 0]] = -1
    return count
