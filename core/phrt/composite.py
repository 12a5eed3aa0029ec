"""Composition: direct light, and the sum of all layers into the picture."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from phrt.camera import CameraView
from phrt.frame import Frame
from phrt.interfaces.effect import Adds
from phrt.kernels.added import add_light
from phrt.kernels.arrays import EnvironmentArrays, SurfaceArrays
from phrt.kernels.light import direct_light
from phrt.kernels.shade import composite
from phrt.workers import Workers, chunks

CHUNK = 32768
"""Pixels a thread takes at a time. These kernels read every array once, in order: few calls count, not the cache."""
FLAT_CHUNK = 4096
"""The same for `shade_flat`, whose layers live for one chunk only: they should stay in the cache."""
NOTHING_ADDED: Mapping[str, Adds] = MappingProxyType({})


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
    out: np.ndarray,
    workers: Workers,
) -> None:
    """Unshadowed direct light of every light at the n points of `surfaces`, into out (n, L, 3)."""
    matrix = view.world_from_view.astype(np.float32)

    def part(piece: slice) -> None:
        if view.orthographic:
            towards = np.ascontiguousarray(np.broadcast_to(-matrix[:3, 2], (piece.stop - piece.start, 3)))
        else:
            towards = matrix[None, :3, 3].copy()
        direct_light(piece.start, piece.stop, surfaces, materials, lights, towards, not view.orthographic, out)

    workers.map(part, chunks(len(out), CHUNK, workers.threads))


def compose(
    surfaces: SurfaceArrays,
    materials: np.ndarray,
    environment: EnvironmentArrays,
    background: bool,
    view: CameraView,
    pixels: np.ndarray,
    direct: np.ndarray,
    layers: dict[str, np.ndarray],
    masks: dict[str, np.ndarray],
    exposure: float,
    image: np.ndarray,
    workers: Workers,
    adds: Mapping[str, Adds] = NOTHING_ADDED,
) -> None:
    """The sum of the layers at n points into image (n, 3). pixels (n,) int32: where in the picture they are.

    layers: visibility (n, L), ambient_occlusion (n, 1), reflection and refraction (n, 3); masks: "reflection" (n,) uint8.
    adds: what further layers (n, 3) bring, by name, see `LayerSpec`.
    """
    camera = camera_rows(view)
    added = [(layers[name], what == "irradiance") for name, what in adds.items() if what]

    def part(piece: slice) -> None:
        composite(
            piece.start, piece.stop, pixels, surfaces, materials, camera, background, direct, layers["visibility"],
            layers["ambient_occlusion"].reshape(-1), layers["reflection"], masks["reflection"], layers["refraction"],
            environment, np.float32(exposure), image,
        )  # fmt: skip
        for layer, arrives in added:
            add_light(piece.start, piece.stop, surfaces, materials, camera, layer, arrives, np.float32(exposure), image)

    workers.map(part, chunks(len(image), CHUNK, workers.threads))


def flat_layers(count: int, lights: int) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray]]:
    """Layers and masks of `count` points without ray effects: lit by everything, reflecting the dome, with nothing behind them."""
    layers = {
        "visibility": np.ones((count, lights), np.float32),
        "ambient_occlusion": np.ones((count, 1), np.float32),
        "reflection": np.zeros((count, 3), np.float32),
        "refraction": np.zeros((count, 3), np.float32),
    }
    return layers, {"reflection": np.zeros(count, np.uint8)}


def shade_flat(
    frame: Frame,
    surfaces: SurfaceArrays,
    view: CameraView,
    pixels: np.ndarray,
    visibility: np.ndarray | None = None,
) -> np.ndarray:
    """(n, 3) float32 of n points of the frame's world, seen in `view` at `pixels` (n,) int32, as a raster renderer without
    ray effects sees them. visibility (n, L): of the lights; everything is lit without it.
    """
    lights, environment = frame.world.lights, frame.environment
    materials, workers = frame.materials.materials, frame.workers
    image = np.empty((len(pixels), 3), np.float32)

    def part(piece: slice) -> None:
        points, count = SurfaceArrays(*(array[piece] for array in surfaces)), piece.stop - piece.start
        direct = np.empty((count, len(lights), 3), np.float32)
        light_surfaces(points, materials, lights, view, direct, workers)
        layers, masks = flat_layers(count, len(lights))
        if visibility is not None:
            layers["visibility"] = visibility[piece]
        compose(
            points, materials, environment, True, view, pixels[piece], direct, layers, masks, 1.0, image[piece], workers
        )  # fmt: skip

    workers.map(part, chunks(len(pixels), FLAT_CHUNK, workers.threads))
    return image
