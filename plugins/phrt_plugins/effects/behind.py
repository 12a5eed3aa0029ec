"""What a raster renderer shows through glass: the opaque surface straight behind, shaded without rays, or the dome."""

from __future__ import annotations

import numpy as np

from phrt.composite import shade_flat
from phrt.frame import Frame
from phrt.kernels.along import environment_along


def behind(frame: Frame, pixels: np.ndarray) -> np.ndarray:
    """(n, 3) float32 light from the nearest opaque surface behind `pixels` (n,), lit by every light without shadows."""
    surfaces = frame.producer.points(frame.view, pixels, hidden=~frame.world.object_opaque)
    return shade_flat(frame, surfaces, frame.view, pixels)


def environment_through(frame: Frame, pixels: np.ndarray) -> np.ndarray:
    """(n, 3) float32 light of the dome straight behind `pixels` (n,)."""
    view, is_point = frame.view_vectors(pixels)
    out = np.empty((len(pixels), 3), np.float32)
    environment_along(pixels, frame.surfaces.position, view, is_point, frame.environment, out)
    return out
