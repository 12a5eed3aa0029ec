"""Splats: every landed photon spread over a disc as wide as the photon has become, and what they add up to at pixels.

McGuire and Luebke 2009 draw a photon's volume over the pixels of the G-buffer. The sum is the same the other way round: a pixel
collects the splats that cover its point, and costs something only when it is asked for.
"""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.arrays import SurfaceArrays
from phrt_caustics.kernels.photons import Landed, spans
from phrt_caustics.kernels.splat import ROOM, Splats, collect, crowd, enter

NEIGHBOURS = 8
"""Photons before and after one, in the order in which they started, that say how wide it is."""
PILOT = 3.0
"""Radius of the splats that say how crowded it is, in distances to neighbours."""
APART = 2.5
"""Those distances, in sides of the square that a photon has to itself: on evenly lit ground half are under 2, few above this."""
MIXED = 1.6
"""A splat is larger, up to so many times, where photons of an extended light mix: there is nothing fine to lose, and less noise."""
LARGEST, SMALLEST = 0.5, 1.0 / 40.0
"""Radius of a splat, in radii of the object that threw it."""


def radii(landed: Landed, caster_radius: np.ndarray, smoothing: float, max_radius: float | None) -> np.ndarray:
    """(n,) float32 metres: the splats' radii. caster_radius: (N + 1,) of every object."""
    if len(landed.number) == 0:
        return np.zeros(0, np.float32)
    thrown = caster_radius[landed.caster]
    largest = thrown * np.float32(LARGEST)
    if max_radius is not None:
        largest = np.full(len(thrown), max_radius, np.float32)
    smallest = np.minimum(thrown * np.float32(SMALLEST), largest)
    order, span = np.lexsort((landed.number, landed.trail)), np.empty(len(thrown), np.float32)
    spans(order, landed, NEIGHBOURS, smallest, largest, np.float32(PILOT), span)
    return by_density(landed, span, smallest, largest, smoothing)


def by_density(
    landed: Landed, span: np.ndarray, smallest: np.ndarray, largest: np.ndarray, smoothing: float
) -> np.ndarray:
    """(n,) float32 metres: `smoothing` distances between photons as they lie there, of which `span` (n,) is PILOT by neighbours.

    Neighbours that start at different points of a light land as far apart as its blurred image is wide, however many there are; and
    one distance is a matter of chance. So the density that `span` gives is a pilot, and the radius goes with its square root
    (Silverman 1986, section 5.3).
    """
    pilot = splats_of(landed, span)
    assert pilot is not None
    density = np.empty(len(span), np.float32)
    crowd(*pilot, density)
    apart = 1.0 / np.sqrt(np.maximum(density, np.float32(1e-12)))
    mixed = np.clip(span / (np.float32(PILOT * APART) * apart), 1.0, MIXED)
    return np.asarray(np.clip(np.float32(smoothing) * apart * mixed, smallest, largest), np.float32)


def splats_of(landed: Landed, radius: np.ndarray) -> Splats | None:
    """The splats of `landed` (n,), ready to be found; None where there is none."""
    if len(radius) == 0:
        return None
    place = np.concatenate([landed.position, landed.normal], axis=1)
    wide = radius.astype(np.float64)[:, None]
    light = np.concatenate([landed.flux * 2.0 / (math.pi * wide**2), 1.0 / wide**2], axis=1).astype(np.float32)
    size = float(radius.max()) * ROOM * 1.0001
    buckets = 1 << int(4 * len(radius)).bit_length()
    begins, nothing = np.zeros(buckets + 1, np.int32), (np.empty(0, np.int64), np.empty(0, np.int32))
    used = enter(place, radius, size, buckets, False, begins, *nothing)
    np.cumsum(begins, out=begins)
    key, entry = np.empty(begins[-1], np.int64), np.empty(begins[-1], np.int32)
    enter(place, radius, size, buckets, True, begins[:-1].copy(), key, entry)
    return Splats(place, light, key, entry, begins, used, size)


def irradiance(splats: Splats | None, surfaces: SurfaceArrays, pixels: np.ndarray) -> np.ndarray:
    """(n, 3) float32 lux at `pixels` (n,) of `surfaces`. Releases the GIL."""
    out = np.zeros((len(pixels), 3), np.float32)
    if splats is not None:
        collect(pixels, surfaces.position, surfaces.geometric_normal, *splats, out)
    return out
