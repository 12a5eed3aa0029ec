"""Photons on their way through glass and off mirrors, until they land on something diffuse.

Jensen 1996: photons from the lights, sent to casters alone (a projection map, see `kernels.emission`), followed by the tracer.
"""

from __future__ import annotations

import numpy as np

from phrt.frame import Frame
from phrt.kernels.arrays import empty_surfaces
from phrt.kernels.surface import surface
from phrt.rays import RayBatch
from phrt.tracing import nearest
from phrt_caustics.emission import Batch, started
from phrt_caustics.kernels.photons import Landed, Photons, bounce, empty_landed, empty_photons

WEAKEST = np.float32(0.1)
"""A photon that carries less than this share of what it began with goes on by chance only, and is as strong as this if it does."""

_NOWHERE = np.zeros(3, np.float32)
_SHARP = np.zeros(2, np.float32)


def trace_photons(frame: Frame, batch: Batch, max_depth: int, cutoff: float) -> tuple[Landed, int]:
    """Where the photons of `batch` landed after at least one mirror or glass, and the rays it took.

    max_depth: mirrors and glass surfaces on the way; cutoff: rougher ones end it.
    """
    photons = sent(frame, batch)
    count, total = len(photons.unit), 0
    inverse_range = np.float32(frame.world.lights["inverse_range"][batch.beam.light])
    landings = []
    for depth in range(max_depth + 1):
        if count == 0:
            break
        photons = Photons(*(array[:count] for array in photons))
        hits = nearest(frame, RayBatch(photons.origin, photons.direction, np.full(count, np.inf, np.float32)))
        total += count
        points, rows = empty_surfaces(count), np.arange(count, dtype=np.int32)
        surface(
            photons.direction, photons.path, hits.primitive, hits.barycentric, frame.geometry, frame.materials,
            _NOWHERE, _NOWHERE, _SHARP, np.zeros(frame.world.object_count + 1, np.uint8), False, rows, rows, points,
            np.empty(count, np.uint8),
        )  # fmt: skip
        onward, landed = empty_photons(2 * count), empty_landed(count)
        going, ended = bounce(
            count, photons, hits.distance, points, frame.geometry, frame.materials.materials,
            frame.world.object_casts_shadow, np.float32(cutoff), inverse_range, WEAKEST, depth == max_depth, onward, landed,
        )  # fmt: skip
        landings.append(Landed(*(array[:ended] for array in landed)))
        photons, count = onward, going
    return joined(landings), total


def sent(frame: Frame, batch: Batch) -> Photons:
    """The photons of `batch` at their light; those without power are left out."""
    origin, direction, power = started(frame.world, batch.beam, batch.start, batch.stop)
    lit = power > 0
    count = int(lit.sum())
    flux = power[lit][:, None] * frame.world.lights["color"][batch.beam.light]
    number = np.arange(batch.start, batch.stop, dtype=np.int32)[lit] + np.int32(batch.beam.first)
    nothing = np.zeros(count, np.int32)
    return Photons(
        np.ascontiguousarray(origin[lit]), np.ascontiguousarray(direction[lit]), flux, flux.max(axis=1),
        np.zeros(count, np.float32), nothing, np.zeros(count, np.uint32), number, nothing.copy(),
    )  # fmt: skip


def joined(parts: list[Landed]) -> Landed:
    """One after the other."""
    if not parts:
        return empty_landed(0)
    return Landed(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
