"""Mip pyramids: 2x2 box filter, in linear light for colour textures."""

from __future__ import annotations

import numba
import numpy as np

SRGB_TO_LINEAR = np.array(
    [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (np.arange(256) / 255.0)], dtype=np.float32
)
_STEPS = 8192
_LINEAR = np.arange(_STEPS) / (_STEPS - 1)
LINEAR_TO_SRGB = np.round(
    255 * np.where(_LINEAR <= 0.0031308, _LINEAR * 12.92, 1.055 * np.maximum(_LINEAR, 1e-9) ** (1 / 2.4) - 0.055)
).astype(np.uint8)


def pyramid(pixels: np.ndarray, *, srgb: bool, levels: int) -> list[np.ndarray]:
    """Mip levels of `pixels` (H, W, 4) uint8, level 0 first, each half the size of the one before (odd sizes round down)."""
    result = [np.ascontiguousarray(pixels)]
    while len(result) < levels and max(result[-1].shape[:2]) > 1:
        height, width = result[-1].shape[:2]
        half = np.empty((max(height // 2, 1), max(width // 2, 1), 4), np.uint8)
        _halve(result[-1], half, srgb)
        result.append(half)
    return result


@numba.njit(nogil=True, cache=True)
def _halve(source, target, srgb):
    height, width = source.shape[0], source.shape[1]
    for y in range(target.shape[0]):
        y0 = min(2 * y, height - 1)
        y1 = min(2 * y + 1, height - 1)
        for x in range(target.shape[1]):
            x0 = min(2 * x, width - 1)
            x1 = min(2 * x + 1, width - 1)
            for c in range(4):
                a, b, d, e = source[y0, x0, c], source[y0, x1, c], source[y1, x0, c], source[y1, x1, c]
                if srgb and c < 3:
                    mean = (SRGB_TO_LINEAR[a] + SRGB_TO_LINEAR[b] + SRGB_TO_LINEAR[d] + SRGB_TO_LINEAR[e]) * 0.25
                    target[y, x, c] = LINEAR_TO_SRGB[int(mean * (_STEPS - 1) + 0.5)]
                else:
                    target[y, x, c] = (int(a) + int(b) + int(d) + int(e) + 2) >> 2
