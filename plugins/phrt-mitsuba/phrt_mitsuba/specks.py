"""Pictures without the bright specks that a few paths of very many make, which would count in every measure.

The samples of a pixel come in parts. Where the parts agree their mean is taken; where they do not, the more of the brightest and of
the darkest are left out the larger their Gini coefficient is. Light that only such paths find is lost with them.
Source: Buisine, Delepoulle, Renaud 2021, "Firefly removal in Monte Carlo rendering with adaptive Median of meaNs". Ours: parts
agree up to AGREED, so that plain noise loses no light.
"""

from __future__ import annotations

import numpy as np

AGREED = 0.5
"""Gini coefficient up to which parts differ by noise alone: also highlights that only some samples find."""
MOST_PARTS = 16
LEAST_SAMPLES = 16
"""Of a part, so that it is stratified. Fewer than FEWEST_PARTS of them are not worth telling apart."""
FEWEST_PARTS = 4


def parts_of(samples: int) -> int:
    """Into how many parts the samples of a pixel are best cut."""
    parts = min(samples // LEAST_SAMPLES, MOST_PARTS)
    return parts if parts >= FEWEST_PARTS else 1


def without_specks(parts: np.ndarray) -> np.ndarray:
    """(H, W, 3) float32 of `parts` (m, H, W, 3), each a picture by itself."""
    count = len(parts)
    brightness = parts.mean(axis=3)
    order = np.argsort(brightness, axis=0)
    ranked = np.take_along_axis(brightness, order, axis=0)
    place = np.arange(1, count + 1, dtype=np.float32)[:, None, None]
    total = np.maximum(ranked.sum(axis=0), np.float32(1e-30))
    gini = 2 * (place * ranked).sum(axis=0) / (count * total) - (count + 1) / count
    apart = np.maximum(gini - AGREED, 0.0) / (1 - AGREED)
    cut = np.minimum(np.floor(apart * count / 2), (count - 1) // 2)
    kept = (place > cut) & (place <= count - cut)
    sorted_parts = np.take_along_axis(parts, order[..., None], axis=0)
    return np.asarray((sorted_parts * kept[..., None]).sum(axis=0) / kept.sum(axis=0)[..., None], np.float32)
