"""Tone mapping: linear HDR to 8-bit sRGB in one fused pass.

Curves
- `srgb`: no curve; what is above 1 clips.
- `aces`: Stephen Hill's fit of the ACES RRT + sRGB ODT (BakingLab, `ACES.hlsl`, MIT, 2016), without the 1/0.6 exposure
  that some renderers add.
- `neutral`: the Khronos PBR Neutral tone mapper (Khronos specification, 2024): colours below 0.76 keep hue and
  saturation, highlights roll off to white.

Encoding is correctly rounded without a `pow` per pixel: a table finds the 8-bit code of a bin's lower edge, and one
comparison with the next code's threshold settles the rest (no bin holds two thresholds).
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import Any, Literal, Protocol, get_args

import numpy as np
from numba import njit

from phrt.errors import OptionError, did_you_mean


class Pool(Protocol):
    """Runs a function over items on threads: `phrt.workers.Workers`, or an executor."""

    def map(self, function: Callable[[Any], Any], items: Iterable[Any], /) -> Iterable[Any]: ...


ToneMap = Literal["srgb", "aces", "neutral"]
CURVE_CODES: dict[str, int] = {name: code for code, name in enumerate(get_args(ToneMap))}

_SRGB, _ACES, _NEUTRAL = 0, 1, 2
_BINS = 4096
_BLOCK = 64
_BRIGHTEST = np.float32(1e6)
"""Inputs above this are taken as this: an infinite highlight is white, not NaN."""


def linear_from_srgb(encoded: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1 decoding of `encoded` (any shape, 0..1), float64."""
    encoded = np.asarray(encoded, dtype=np.float64)
    return np.where(encoded <= 0.04045, encoded / 12.92, ((np.maximum(encoded, 0.0) + 0.055) / 1.055) ** 2.4)


def _encoding_tables() -> tuple[np.ndarray, np.ndarray]:
    """thresholds (257,) float32: least linear value whose rounded code is at least the index.
    codes (_BINS + 1,) uint8: the code of each bin's lower edge."""
    thresholds = np.full(257, np.inf, dtype=np.float32)
    thresholds[0] = -np.inf
    thresholds[1:256] = linear_from_srgb((np.arange(1, 256) - 0.5) / 255.0)
    edges = (np.arange(_BINS + 1) / _BINS).astype(np.float32)
    codes = np.searchsorted(thresholds, edges, side="right") - 1
    return thresholds, codes.astype(np.uint8)


_THRESHOLDS, _CODES = _encoding_tables()


@njit(inline="always", error_model="numpy")
def _encode(value: np.float32, codes: np.ndarray, thresholds: np.ndarray) -> np.uint32:
    """The sRGB code of linear `value`, rounded to nearest."""
    clipped = min(max(value, np.float32(0.0)), np.float32(1.0))
    code = np.uint32(codes[np.uint32(clipped * np.float32(_BINS))])
    return code + np.uint32(clipped >= thresholds[code + np.uint32(1)])


@njit(inline="always", error_model="numpy")
def _aces_fit(v: np.float32) -> np.float32:
    """Hill's rational fit of RRT and ODT, per channel of his RRT space."""
    return (v * (v + np.float32(0.0245786)) - np.float32(0.000090537)) / (
        v * (np.float32(0.983729) * v + np.float32(0.4329510)) + np.float32(0.238081)
    )


@njit(inline="always", error_model="numpy")
def neutral(r: np.float32, g: np.float32, b: np.float32) -> tuple[np.float32, np.float32, np.float32]:
    """Khronos PBR Neutral. Without branches: below the start of compression scale and keep come out as 1."""
    one, start = np.float32(1.0), np.float32(0.8 - 0.04)
    room = one - start
    darkest = min(r, min(g, b))
    offset = darkest - np.float32(6.25) * darkest * darkest if darkest < np.float32(0.08) else np.float32(0.04)
    peak = max(r, max(g, b)) - offset
    compressed = max(peak, start)
    new_peak = one - room * room / (compressed + room - start)
    keep = one / (np.float32(0.15) * (compressed - new_peak) + one)
    scale = new_peak / compressed * keep
    white = new_peak * (one - keep)
    return (r - offset) * scale + white, (g - offset) * scale + white, (b - offset) * scale + white


@njit(inline="always", error_model="numpy")
def _aces(r: np.float32, g: np.float32, b: np.float32) -> tuple[np.float32, np.float32, np.float32]:
    """Hill's fit: Rec.709 to his RRT space, the rational curve, back to Rec.709."""
    u = _aces_fit(np.float32(0.59719) * r + np.float32(0.35458) * g + np.float32(0.04823) * b)
    v = _aces_fit(np.float32(0.07600) * r + np.float32(0.90834) * g + np.float32(0.01566) * b)
    w = _aces_fit(np.float32(0.02840) * r + np.float32(0.13383) * g + np.float32(0.83777) * b)
    return (
        np.float32(1.60475) * u - np.float32(0.53108) * v - np.float32(0.07367) * w,
        np.float32(-0.10208) * u + np.float32(1.10813) * v - np.float32(0.00605) * w,
        np.float32(-0.00327) * u - np.float32(0.07276) * v + np.float32(1.07602) * w,
    )


# No fastmath: it would let the compiler drop the NaN check and give other codes on other machines. Curve and table
# look-ups run as two passes over a block of a row, so that the first becomes SIMD.
@njit(cache=True, nogil=True, error_model="numpy")
def _tone_map_rows(
    image: np.ndarray,
    out: np.ndarray,
    first_row: int,
    last_row: int,
    curve_code: int,
    codes: np.ndarray,
    thresholds: np.ndarray,
) -> None:
    width = image.shape[1]
    zero = np.float32(0.0)
    curved = np.zeros((3, _BLOCK), dtype=np.float32)
    for y in range(first_row, last_row):
        for first in range(0, width, _BLOCK):
            size = min(_BLOCK, width - first)
            for i in range(size):
                x = np.uint64(first + i)
                curved[0, i] = min(max(image[y, x, 0], zero), _BRIGHTEST)
                curved[1, i] = min(max(image[y, x, 1], zero), _BRIGHTEST)
                curved[2, i] = min(max(image[y, x, 2], zero), _BRIGHTEST)
            if curve_code == _NEUTRAL:
                for i in range(_BLOCK):
                    curved[0, i], curved[1, i], curved[2, i] = neutral(curved[0, i], curved[1, i], curved[2, i])
            elif curve_code == _ACES:
                for i in range(_BLOCK):
                    curved[0, i], curved[1, i], curved[2, i] = _aces(curved[0, i], curved[1, i], curved[2, i])
            for i in range(size):
                x = np.uint64(first + i)
                r, g, b = image[y, x, 0], image[y, x, 1], image[y, x, 2]
                if r != r or g != g or b != b:
                    out[y, x, 0], out[y, x, 1], out[y, x, 2] = 255, 0, 255
                else:
                    out[y, x, 0] = _encode(curved[0, i], codes, thresholds)
                    out[y, x, 1] = _encode(curved[1, i], codes, thresholds)
                    out[y, x, 2] = _encode(curved[2, i], codes, thresholds)


def tone_map_rows(image: np.ndarray, out: np.ndarray, first_row: int, last_row: int, curve_code: int) -> None:
    """Tone map rows `first_row` up to, not including, `last_row`. Releases the GIL; disjoint rows may run at once.

    image : (H, W, 3) float32, linear, C-contiguous, exposure applied
    out : (H, W, 3) uint8, sRGB, written in place; NaN becomes magenta, so that our fault is seen
    curve_code : a value of `CURVE_CODES`
    """
    _tone_map_rows(image, out, first_row, last_row, curve_code, _CODES, _THRESHOLDS)


def curve_code(tone_map: str) -> int:
    """The code of curve `tone_map`. Raises OptionError naming the allowed ones."""
    if tone_map not in CURVE_CODES:
        allowed = list(CURVE_CODES)
        raise OptionError(f"tone map '{tone_map}' is not one of {', '.join(allowed)}.{did_you_mean(tone_map, allowed)}")
    return CURVE_CODES[tone_map]


def to_8bit(
    image: np.ndarray, tone_map: str = "neutral", pool: Pool | None = None, out: np.ndarray | None = None
) -> np.ndarray:
    """(H, W, 3) uint8 sRGB of linear `image` (H, W, 3), in bands of rows on `pool` where one is given.

    The result is the same whatever the pool. Raises OptionError for an unknown curve, ValueError for another shape.
    """
    if image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(f"expected an image (H, W, 3), got {image.shape}")
    code = curve_code(tone_map)
    image = np.ascontiguousarray(image, dtype=np.float32)
    height = image.shape[0]
    result = np.empty(image.shape, dtype=np.uint8) if out is None else out
    if pool is None:
        tone_map_rows(image, result, 0, height, code)
        return result
    band = max(16, -(-height // (2 * (os.cpu_count() or 1))))

    def part(row: int) -> None:
        tone_map_rows(image, result, row, min(row + band, height), code)

    # A list, because an executor's map is lazy about errors.
    list(pool.map(part, range(0, height, band)))
    return result
