"""Where inside a pixel its samples lie."""

from __future__ import annotations

import numpy as np


def jitter_pattern(samples: int) -> list[tuple[float, float]]:
    """`samples` sub-pixel offsets (x, y) in -0.5..0.5: the centre alone, or the R2 sequence (Roberts 2018), which stays even
    for every count."""
    if samples == 1:
        return [(0.0, 0.0)]
    index = np.arange(1, samples + 1)
    x = (0.5 + index * 0.7548776662466927) % 1.0 - 0.5
    y = (0.5 + index * 0.5698402909980532) % 1.0 - 0.5
    return [(float(a), float(b)) for a, b in zip(x, y, strict=True)]
