"""Motion vectors from both frames' matrices."""

from __future__ import annotations

import numpy as np

from phrt.kernels.jit import device, kernel

f32 = np.float32


@device
def project(clip, x, y, z, width, height):
    """Pixel coordinates (x, y) of a world point, y down; clip (4, 4) float32."""
    cx = clip[0, 0] * x + clip[0, 1] * y + clip[0, 2] * z + clip[0, 3]
    cy = clip[1, 0] * x + clip[1, 1] * y + clip[1, 2] * z + clip[1, 3]
    cw = clip[3, 0] * x + clip[3, 1] * y + clip[3, 2] * z + clip[3, 3]
    if abs(cw) < f32(1e-6):
        cw = f32(1e-6)
    return (cx / cw * f32(0.5) + f32(0.5)) * width, (f32(0.5) - cy / cw * f32(0.5)) * height


@kernel
def motion_vectors(position, object_id, delta, clip, previous_clip, size, motion):
    """Where each visible point was in the previous picture, minus where it is: motion (n, 2) pixels, y down.

    position (n, 3) world; delta (N + 1, 4, 4) previous object matrix times the inverse of the present one.
    """
    for i in range(len(object_id)):
        o = object_id[i]
        if o == 0:
            motion[i, 0] = f32(0.0)
            motion[i, 1] = f32(0.0)
            continue
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        m = delta[o]
        px = m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3]
        py = m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3]
        pz = m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3]
        here_x, here_y = project(clip, x, y, z, size[0], size[1])
        there_x, there_y = project(previous_clip, px, py, pz, size[0], size[1])
        motion[i, 0] = there_x - here_x
        motion[i, 1] = there_y - here_y
