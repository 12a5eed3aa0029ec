"""Cube maps from the G-buffer producer: six square views around a point."""

from __future__ import annotations

import numpy as np

from phrt.camera import CameraView, look_at

FACES = (
    ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    ((-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    ((0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
    ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0)),
    ((0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
)
"""Direction and up of every face: +X -X +Y -Y +Z -Z. `phrt_plugins.effects.cube_kernels.cube_face` is its inverse."""


NEAR = 0.01
"""Near plane of a face, metres."""


def face_views(centre: np.ndarray, size: int) -> list[CameraView]:
    """Six 90 degree views of `size` x `size` pixels from `centre` (3,), in the order of FACES."""
    x, y, z = (float(c) for c in centre)
    return [
        CameraView(
            width=size,
            height=size,
            world_from_view=look_at((x, y, z), (x + d[0], y + d[1], z + d[2]), up),
            tan_half=(1.0, 1.0),
            near=NEAR,
        )
        for d, up in FACES
    ]
