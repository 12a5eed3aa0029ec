"""The dome along the view, through a surface."""

from __future__ import annotations

import math

import numpy as np

from phrt.kernels.environment import environment_radiance
from phrt.kernels.jit import kernel

f32 = np.float32


@kernel
def environment_along(rows, position, view, view_is_point, environment, out):
    """out (n, 3): radiance of the dome in the direction from the eye through surface points `rows`."""
    for i in range(len(rows)):
        row = rows[i]
        if view_is_point:
            x, y, z = position[row, 0] - view[0, 0], position[row, 1] - view[0, 1], position[row, 2] - view[0, 2]
        else:
            x, y, z = view[i, 0], view[i, 1], view[i, 2]
        scale = f32(1.0) / math.sqrt(x * x + y * y + z * z + f32(1e-20))
        r, g, b = environment_radiance(
            environment.sharp, environment.blurred, x * scale, y * scale, z * scale, f32(0.0)
        )
        out[i, 0], out[i, 1], out[i, 2] = r, g, b
