"""Rays and hits, as plain arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class RayBatch:
    """n rays. Everything float32 and C-contiguous.

    origin    : (n, 3) world space, metres
    direction : (n, 3) world space, unit length
    t_max     : (n,)   metres; hits at or beyond it do not count; +inf for no limit
    coherent  : a hint: neighbours in the batch start together and point the same way (primary, mirror, shadow in tiles)
    opaque_only: a hint: whoever asks for closest hits passes objects that are not `World.object_opaque`; a tracer may
                 leave them out at once
    casters_only: a hint: the same for objects that cast no shadow
    """

    origin: np.ndarray
    direction: np.ndarray
    t_max: np.ndarray
    coherent: bool = False
    opaque_only: bool = False
    casters_only: bool = False

    def __len__(self) -> int:
        return len(self.origin)


@dataclass(frozen=True)
class HitBatch:
    """The nearest hit of n rays.

    distance    : (n,)   float32, metres along the ray; +inf for a miss
    primitive   : (n,)   uint32, triangle of the scene (`World.triangles`); `NO_PRIMITIVE` for a miss
    barycentric : (n, 2) float32, weights of the triangle's second and third vertex
    """

    distance: np.ndarray
    primitive: np.ndarray
    barycentric: np.ndarray
