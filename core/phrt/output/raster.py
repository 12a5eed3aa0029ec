"""The picture of a frame as rasterization alone shows it: Andrade et al. 2014, Figure 1 (a)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phrt.composite import all_rows, compose
from phrt.kernels.arrays import environment_arrays, surface_arrays
from phrt.workers import Workers

if TYPE_CHECKING:
    from phrt.frame import FrameResult


def raster_picture(frame: FrameResult) -> np.ndarray:
    """(H, W, 3) float32, linear, exposure applied: `frame` composed with every layer at its clear value.

    All lights arrive, nothing is occluded, mirrors show the dome alone, and nothing is behind glass. Of the last sub-pixel
    sample where there are several.
    """
    height, width, lights = frame.direct.shape[:3]
    count, world = height * width, frame.world
    layers = {
        "visibility": np.ones((count, lights), np.float32),
        "ambient_occlusion": np.ones((count, 1), np.float32),
        "reflection": np.zeros((count, 3), np.float32),
        "refraction": np.zeros((count, 3), np.float32),
    }
    masks = {"reflection": np.zeros(count, np.uint8)}
    image = np.empty((count, 3), np.float32)
    workers = Workers()
    compose(
        surface_arrays(frame.gbuffer), world.materials, environment_arrays(world), world.environment.visible, frame.view,
        all_rows(count), frame.direct.reshape(count, lights, 3), layers, masks, frame.exposure, image, workers,
    )  # fmt: skip
    workers.close()
    return image.reshape(height, width, 3)
