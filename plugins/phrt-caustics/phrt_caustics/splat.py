"""Splats: every landed photon spread over a disc as wide as the photon has become, and what they add up to at pixels.

McGuire and Luebke 2009 draw a photon's volume over the pixels of the G-buffer. The sum is the same the other way round: a pixel
collects the splats that cover its point, and costs something only when it is asked for.
"""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.arrays import SurfaceArrays
from phrt_caustics.kernels.photons import Landed, spans
from phrt_caustics.kernels.splat import ROOM, Splats, collect, sort_splats

NEIGHBOURS = 8
"""Photons before and after one, in the order in which they started, that say how wide it is."""
APART = 1.6
"""Median distance to those neighbours, in sides of the square that each has for itself: measured on evenly lit ground."""
LARGEST, SMALLEST = 0.5, 1.0 / 40.0
"""Radius of a splat, in radii of the object that threw it."""


def radii(
    landed: Landed, caster_radius: np.ndarray, smoothing: float, max_radius: float | None, *, extended: bool = False
) -> np.ndarray:
    """(n,) float32 metres: the splats' radii. caster_radius: (N + 1,) of every object; extended: photons of a light do not start at
    one point."""
    thrown = caster_radius[landed.caster]
    largest = thrown * np.float32(LARGEST)
    if max_radius is not None:
        largest = np.full(len(thrown), max_radius, np.float32)
    smallest = np.minimum(thrown * np.float32(SMALLEST), largest)
    order, span = np.lexsort((landed.number, landed.trail)), np.empty(len(thrown), np.float32)
    spans(order, landed, NEIGHBOURS, smallest, largest, np.float32(smoothing), span)
    return by_density(landed, span, smallest, smoothing) if extended and len(span) else span


def by_density(landed: Landed, span: np.ndarray, smallest: np.ndarray, smoothing: float) -> np.ndarray:
    """(n,) float32 metres: `span`, or less where photons are closer to each other than to their neighbours in order.

    Neighbours that start at different points of a light land as far apart as its blurred image is wide, however many there are.
    So the density that `span` gives is a pilot, and the radius goes with its square root (Silverman 1986, section 5.3).
    """
    counted = landed._replace(flux=np.ones_like(landed.flux))
    splats = splats_of(counted, span)
    assert splats is not None
    density = np.zeros_like(landed.flux)
    rows = np.arange(len(span), dtype=np.int32)
    collect(
        rows, landed.position, landed.normal, splats.place, splats.light, splats.key, splats.begins, splats.levels,
        splats.size, density,
    )  # fmt: skip
    wide = np.float32(smoothing * APART) / np.sqrt(np.maximum(density[:, 0], np.float32(1e-12)))
    return np.asarray(np.clip(wide, smallest, span), np.float32)


def splats_of(landed: Landed, radius: np.ndarray) -> Splats | None:
    """The splats of `landed` (n,), ready to be found; None where there is none."""
    count = len(radius)
    if count == 0:
        return None
    size = float(radius.max()) * ROOM * 1.0001
    buckets = 1 << max(int(2 * count - 1).bit_length(), 4)
    key, bucket = np.empty(count, np.int64), np.empty(count, np.int64)
    begins, levels = np.zeros(buckets + 1, np.int32), np.zeros(buckets, np.int32)
    sort_splats(landed.position, radius, size, key, bucket, begins[1:], levels)
    np.cumsum(begins, out=begins)
    order = np.argsort(bucket, kind="stable")
    place = np.concatenate([landed.position, landed.normal], axis=1)[order]
    area = math.pi * radius.astype(np.float64) ** 2
    light = np.concatenate(
        [landed.flux * (2.0 / area)[:, None], (1.0 / radius.astype(np.float64) ** 2)[:, None]], axis=1
    )
    return Splats(place, light.astype(np.float32)[order], key[order], begins, levels, size)


def irradiance(splats: Splats | None, surfaces: SurfaceArrays, pixels: np.ndarray) -> np.ndarray:
    """(n, 3) float32 lux at `pixels` (n,) of `surfaces`. Releases the GIL."""
    out = np.zeros((len(pixels), 3), np.float32)
    if splats is not None:
        collect(
            pixels, surfaces.position, surfaces.geometric_normal, splats.place, splats.light, splats.key, splats.begins,
            splats.levels, splats.size, out,
        )  # fmt: skip
    return out
