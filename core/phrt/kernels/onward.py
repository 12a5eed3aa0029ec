"""Rays that go on behind a hit they pass: holes, culled faces, hidden objects."""

from __future__ import annotations

import numpy as np

from phrt.kernels.jit import kernel
from phrt.kernels.shadow import bias_at
from phrt.rays import RayBatch

f32 = np.float32


def continued(rays: RayBatch, distance: np.ndarray, index: np.ndarray) -> tuple[RayBatch, np.ndarray]:
    """Rays `index` (k,) of `rays` from just behind their hits at `distance` (n,) on, and how far (k,) they were moved."""
    count = len(index)
    origin, direction, t_max = np.empty((count, 3), f32), np.empty((count, 3), f32), np.empty(count, f32)
    onward = RayBatch(origin, direction, t_max, rays.coherent, rays.opaque_only, rays.casters_only)
    step = np.empty(count, f32)
    onward_rays(
        index, rays.origin, rays.direction, rays.t_max, distance, onward.origin, onward.direction, onward.t_max, step
    )
    return onward, step


@kernel
def onward_rays(index, origin, direction, t_max, distance, next_origin, next_direction, next_t_max, step):
    """See `continued`."""
    for j in range(len(index)):
        i = np.uint32(index[j])
        t = distance[i]
        dx, dy, dz = direction[i, 0], direction[i, 1], direction[i, 2]
        x, y, z = origin[i, 0] + dx * t, origin[i, 1] + dy * t, origin[i, 2] + dz * t
        bias = bias_at(x, y, z)
        step[j] = t + bias
        next_origin[j, 0], next_origin[j, 1], next_origin[j, 2] = x + dx * bias, y + dy * bias, z + dz * bias
        next_direction[j, 0], next_direction[j, 1], next_direction[j, 2] = dx, dy, dz
        next_t_max[j] = t_max[i] - step[j]
