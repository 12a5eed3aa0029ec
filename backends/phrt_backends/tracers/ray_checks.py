"""What the contract says about odd rays, for tracers whose library does not say it: which rays can hit at all."""

from __future__ import annotations

import numpy as np

from phrt.rays import RayBatch


def usable_rays(rays: RayBatch) -> np.ndarray:
    """(n,) bool: finite origin and direction, and a t_max above 0. All other rays miss."""
    with np.errstate(invalid="ignore", over="ignore"):
        total = rays.origin.sum(axis=1) + rays.direction.sum(axis=1)
    return np.isfinite(total) & (rays.t_max > 0)


def just_below(t_max: np.ndarray) -> np.ndarray:
    """(n,) float32, one step below `t_max`, always a new array: for libraries that count a hit at exactly the limit."""
    return np.asarray(t_max, np.float32) * np.float32(1.0 - 2.0**-23)
