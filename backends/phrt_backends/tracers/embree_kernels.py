"""The packet loops of the `embree` tracer: numpy arrays in, 16 rays a call to Embree, numpy arrays out.

Embree's two query functions are known to LLVM by names of our own (`bind_queries`), not by address, so that the
compiled kernels can be cached on disk and cannot meet another Embree that happens to be loaded in the process.
"""

from __future__ import annotations

import llvmlite.binding as llvm
import numpy as np
from numba import njit, types

from phrt.conventions import NO_PRIMITIVE
from phrt_backends.tracers.embree_abi import (
    DIRECTION_ROW,
    GEOMETRY_ROW,
    INSTANCE_ROW,
    INVALID_ID,
    LANES,
    MASK_ROW,
    ORIGIN_ROW,
    PACKET_ROWS,
    PRIMITIVE_ROW,
    T_FAR_ROW,
    T_NEAR_ROW,
    U_ROW,
    V_ROW,
    EmbreeLibrary,
)

_SIGNATURE = types.void(types.intp, types.intp, types.intp, types.intp)
_intersect16 = types.ExternalFunction("phrt_rtcIntersect16", _SIGNATURE)
_occluded16 = types.ExternalFunction("phrt_rtcOccluded16", _SIGNATURE)

SEEN = np.uint32(1)
CASTS_SHADOW = np.uint32(2)
OPAQUE = np.uint32(4)
"""Bits of geometry masks: closest-hit rays ask for SEEN, or OPAQUE or CASTS_SHADOW where that is all they want, occlusion rays
for CASTS_SHADOW."""

# Embree counts a hit at exactly t_far, the Tracer contract does not: t_far is one step below t_max.
_JUST_BELOW = np.float32(1.0 - 2.0**-23)
_ALIGNMENT = 64
_WORDS = PACKET_ROWS * LANES


def bind_queries(library: EmbreeLibrary) -> None:
    """Tell LLVM where the queries are. Before the first call of a kernel in this process."""
    for name, address in library.query_address.items():
        llvm.add_symbol(f"phrt_{name}", address)


@njit(nogil=True, cache=True, error_model="numpy")
def _aligned_words(buffer):
    """Index of the first 64-byte aligned word of `buffer` (n,) uint32."""
    return ((_ALIGNMENT - buffer.ctypes.data % _ALIGNMENT) % _ALIGNMENT) // 4


@njit(nogil=True, cache=True, error_model="numpy")
def _fill_packet(first, rays, mask, origin, direction, t_max, packet, words, valid):
    """Rays `first` to `first + rays` into the lanes of a packet; a lane without a usable ray is switched off.

    NaN or infinite rays and empty intervals are misses by definition; Embree does not promise anything for them.
    """
    # Array by array, so that the compiler makes vector instructions of each loop.
    for lane in range(rays):
        ray = np.uint64(first + lane)
        for axis in range(3):
            packet[(ORIGIN_ROW + axis) * LANES + lane] = origin[ray, axis]
    for lane in range(rays):
        ray = np.uint64(first + lane)
        for axis in range(3):
            packet[(DIRECTION_ROW + axis) * LANES + lane] = direction[ray, axis]
    for lane in range(rays):
        packet[T_FAR_ROW * LANES + lane] = t_max[np.uint64(first + lane)] * _JUST_BELOW
    for lane in range(LANES):
        packet[T_NEAR_ROW * LANES + lane] = np.float32(0.0)
    for lane in range(LANES):
        words[MASK_ROW * LANES + lane] = mask
        words[GEOMETRY_ROW * LANES + lane] = INVALID_ID
        words[INSTANCE_ROW * LANES + lane] = INVALID_ID
    for lane in range(LANES):
        usable = packet[T_FAR_ROW * LANES + lane] > np.float32(0.0)
        place = packet[ORIGIN_ROW * LANES + lane]
        place += packet[(ORIGIN_ROW + 1) * LANES + lane]
        place += packet[(ORIGIN_ROW + 2) * LANES + lane]
        along = packet[DIRECTION_ROW * LANES + lane]
        along += packet[(DIRECTION_ROW + 1) * LANES + lane]
        along += packet[(DIRECTION_ROW + 2) * LANES + lane]
        total = place + along
        usable = usable and total - total == np.float32(0.0)
        valid[lane] = -1 if usable and lane < rays else 0


@njit(nogil=True, cache=True, error_model="numpy")
def closest_hit_packets(
    scene, arguments, mask, first_triangle, origin, direction, t_max, distance, primitive, barycentric
):
    """Nearest hits of n rays.

    scene, arguments : addresses of a committed RTCScene and of QueryArguments
    mask : SEEN, OPAQUE or CASTS_SHADOW
    first_triangle : (objects + 1,) int32; a hit's triangle is first_triangle[geometry id] + primitive id
    origin, direction (n, 3), t_max (n,) float32 -> distance (n,) float32, primitive (n,) uint32, barycentric (n, 2)
    """
    buffer = np.zeros(_WORDS + LANES + _ALIGNMENT // 4, np.uint32)
    start = _aligned_words(buffer)
    words = buffer[start : start + _WORDS]
    packet = words.view(np.float32)
    valid = buffer[start + _WORDS : start + _WORDS + LANES].view(np.int32)
    packet_address, valid_address = words.ctypes.data, valid.ctypes.data
    count = len(t_max)
    for first in range(0, count, LANES):
        rays = min(LANES, count - first)
        _fill_packet(first, rays, mask, origin, direction, t_max, packet, words, valid)
        _intersect16(valid_address, scene, packet_address, arguments)
        for lane in range(rays):
            ray = first + lane
            geometry = words[GEOMETRY_ROW * LANES + lane]
            if valid[lane] != 0 and geometry != INVALID_ID:
                distance[ray] = packet[T_FAR_ROW * LANES + lane]
                primitive[ray] = np.uint32(first_triangle[geometry]) + words[PRIMITIVE_ROW * LANES + lane]
                barycentric[ray, 0] = packet[U_ROW * LANES + lane]
                barycentric[ray, 1] = packet[V_ROW * LANES + lane]
            else:
                distance[ray] = np.float32(np.inf)
                primitive[ray] = NO_PRIMITIVE
                barycentric[ray, 0] = np.float32(0.0)
                barycentric[ray, 1] = np.float32(0.0)


@njit(nogil=True, cache=True, error_model="numpy")
def occluded_packets(scene, arguments, origin, direction, t_max, blocked):
    """Is anything that casts a shadow in the way of n rays? Arguments as above; blocked (n,) bool is written."""
    buffer = np.zeros(_WORDS + LANES + _ALIGNMENT // 4, np.uint32)
    start = _aligned_words(buffer)
    words = buffer[start : start + _WORDS]
    packet = words.view(np.float32)
    valid = buffer[start + _WORDS : start + _WORDS + LANES].view(np.int32)
    packet_address, valid_address = words.ctypes.data, valid.ctypes.data
    count = len(t_max)
    for first in range(0, count, LANES):
        rays = min(LANES, count - first)
        _fill_packet(first, rays, CASTS_SHADOW, origin, direction, t_max, packet, words, valid)
        _occluded16(valid_address, scene, packet_address, arguments)
        # Embree marks a blocked ray by t_far = -inf.
        for lane in range(rays):
            blocked[first + lane] = valid[lane] != 0 and packet[T_FAR_ROW * LANES + lane] < np.float32(0.0)
