"""Composition: direct light, and the sum of all layers into the picture."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from phrt.camera import CameraView
from phrt.channels import GBuffer
from phrt.frame import Frame
from phrt.kernels.arrays import EnvironmentArrays, SurfaceArrays, surface_arrays
from phrt.kernels.light import direct_light
from phrt.kernels.shade import composite
from phrt.workers import Workers, chunks

CHUNK = 8192


@lru_cache(maxsize=16)
def all_rows(count: int) -> np.ndarray:
    """0..count - 1, int32, read-only."""
    rows = np.arange(count, dtype=np.int32)
    rows.flags.writeable = False
    return rows


def camera_rows(view: CameraView) -> np.ndarray:
    """(5, 3) float32, the camera as the composite kernel takes it."""
    matrix = view.world_from_view
    return np.array(
        [
            matrix[:3, 3],
            matrix[:3, 0] * view.tan_half[0],
            matrix[:3, 1] * view.tan_half[1],
            -matrix[:3, 2],
            [float(view.orthographic), 1.0 / view.width, 1.0 / view.height],
        ],
        dtype=np.float32,
    )


def light_surfaces(
    surfaces: SurfaceArrays,
    materials: np.ndarray,
    lights: np.ndarray,
    view: CameraView,
    rows: np.ndarray,
    out: np.ndarray,
    workers: Workers,
) -> None:
    """Unshadowed direct light of every light at `rows` into out (P, L, 3)."""
    matrix = view.world_from_view.astype(np.float32)

    def part(piece: slice) -> None:
        some = rows[piece]
        if view.orthographic:
            directions = np.ascontiguousarray(np.broadcast_to(-matrix[:3, 2], (len(some), 3)))
            direct_light(some, surfaces, materials, lights, directions, False, out)
        else:
            direct_light(some, surfaces, materials, lights, matrix[None, :3, 3].copy(), True, out)

    workers.map(part, chunks(len(rows), CHUNK, workers.threads))


def compose(
    surfaces: SurfaceArrays,
    materials: np.ndarray,
    environment: EnvironmentArrays,
    background: bool,
    view: CameraView,
    rows: np.ndarray,
    direct: np.ndarray,
    layers: dict[str, np.ndarray],
    masks: dict[str, np.ndarray],
    exposure: float,
    image: np.ndarray,
    workers: Workers,
) -> None:
    """The sum of the layers at `rows` into image (P, 3). layers: visibility (P, L), ambient_occlusion (P, 1), reflection and
    refraction (P, 3); masks: "reflection" (P,) uint8."""
    camera = camera_rows(view)

    def part(piece: slice) -> None:
        composite(
            rows[piece], surfaces, materials, camera, background, direct, layers["visibility"],
            layers["ambient_occlusion"].reshape(-1), layers["reflection"], masks["reflection"], layers["refraction"],
            environment, np.float32(exposure), image,
        )  # fmt: skip

    workers.map(part, chunks(len(rows), CHUNK, workers.threads))


def shade_flat(
    frame: Frame, gbuffer: GBuffer, view: CameraView, rows: np.ndarray, visibility: np.ndarray | None = None
) -> np.ndarray:
    """(P, 3) float32 of another G-buffer of the same world at `rows`, as a raster renderer without ray effects sees it.

    visibility (P, L): of the lights; everything is lit without it.
    """
    surfaces = surface_arrays(gbuffer)
    count = gbuffer.width * gbuffer.height
    lights = frame.world.lights
    direct = np.empty((count, len(lights), 3), np.float32)
    light_surfaces(surfaces, frame.materials.materials, lights, view, rows, direct, frame.workers)
    layers = {
        "visibility": np.ones((count, len(lights)), np.float32) if visibility is None else visibility,
        "ambient_occlusion": np.ones((count, 1), np.float32),
        "reflection": np.zeros((count, 3), np.float32),
        "refraction": np.zeros((count, 3), np.float32),
    }
    masks = {"reflection": np.zeros(count, np.uint8)}
    image = np.empty((count, 3), np.float32)
    compose(
        surfaces, frame.materials.materials, frame.environment, True, view, rows, direct, layers, masks, 1.0, image,
        frame.workers,
    )  # fmt: skip
    return image
