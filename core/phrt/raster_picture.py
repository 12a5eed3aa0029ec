"""The raster picture of a frame in the making, for heuristics that look at it."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from phrt.composite import compose, flat_layers
from phrt.errors import OptionError
from phrt.frame import Frame
from phrt.interfaces.heuristic import RasterPicture
from phrt.kernels.along import environment_along
from phrt.kernels.arrays import SurfaceArrays, empty_surfaces
from phrt.kernels.change import gather_surfaces
from phrt.kernels.picture import sum_by_object
from phrt.workers import chunks

CHUNK = 4096
"""Points a thread takes at a time; their surfaces and layers should stay in the cache."""
SAMPLES = ((0.25, 0.25), (0.75, 0.75))
"""Where in its place a pixel of the small picture looks at the frame, x and y; it is the mean of these. More of them would take as
much more time: it goes into fetching surfaces from memory."""


class FramePicture(RasterPicture):
    """Composed from the G-buffer and the direct light of `frame` when it is asked for; nothing else of the frame is read, so that
    neither what was traced nor what earlier frames left can be seen in it.

    exposure: of the camera and the scene.
    """

    def __init__(self, frame: Frame, exposure: float) -> None:
        self._frame, self._exposure = frame, exposure
        self._made: dict[int, np.ndarray] = {}

    def picture(self, width: int) -> np.ndarray:
        if width < 1:
            raise OptionError(f"the raster picture cannot be {width} pixels wide; it must be 1 or more")
        width = min(width, self._frame.view.width)
        if width not in self._made:
            made = self._compose(width)
            made.flags.writeable = False
            self._made[width] = made
        return self._made[width]

    def object_means(self, values: np.ndarray) -> np.ndarray:
        if values.ndim != 2 or not values.size:
            raise OptionError(f"object_means takes values (h, w), not an array of shape {values.shape}")
        view, objects = self._frame.view, self._frame.world.object_count
        sums, counts = np.zeros(objects + 1), np.zeros(objects + 1, np.int64)
        sum_by_object(
            self._frame.surfaces.object_id.reshape(view.height, view.width),
            places(view.width, values.shape[1]), places(view.height, values.shape[0]), np.asarray(values, np.float32),
            sums, counts,
        )  # fmt: skip
        return (sums / np.maximum(counts, 1)).astype(np.float32)

    def _compose(self, width: int) -> np.ndarray:
        """(h, w, 3) float32."""
        frame = self._frame
        height = small_height(frame.view.width, frame.view.height, width)
        pixels, points = sampled_pixels(frame.view.width, frame.view.height, width, height)
        out = np.empty((height * width, 3), np.float32)

        def part(piece: slice) -> None:
            image = self._shade(pixels[piece.start * points : piece.stop * points])
            out[piece] = image[::points]
            for other in range(1, points):
                out[piece] += image[other::points]
            out[piece] /= np.float32(points)

        frame.workers.map(part, chunks(len(out), CHUNK // points, frame.workers.threads))
        return out.reshape(height, width, 3)

    def _shade(self, pixels: np.ndarray) -> np.ndarray:
        """(n, 3) float32: `pixels` (n,) of the frame without rays."""
        frame, count = self._frame, len(pixels)
        surfaces, direct = empty_surfaces(count), np.empty((count, *frame.direct.shape[1:]), np.float32)
        gather_surfaces(pixels, frame.surfaces, frame.direct, surfaces, direct)
        layers, masks = flat_layers(count, direct.shape[1])
        self._see_through(pixels, surfaces, layers["refraction"])
        image = np.empty((count, 3), np.float32)
        compose(
            surfaces, frame.materials.materials, frame.environment, frame.world.environment.visible, frame.view, pixels,
            direct, layers, masks, self._exposure, image, frame.workers,
        )  # fmt: skip
        return image

    def _see_through(self, pixels: np.ndarray, surfaces: SurfaceArrays, refraction: np.ndarray) -> None:
        """Glass shows the dome straight behind it: the least that a rasterizer can do."""
        frame, clear = self._frame, np.flatnonzero((surfaces.transmission > 0) | (surfaces.alpha < 1))
        if len(clear):
            view, is_point = frame.view_vectors(clear)
            dome = np.empty((len(clear), 3), np.float32)
            environment_along(pixels[clear], frame.surfaces.position, view, is_point, frame.environment, dome)
            refraction[clear] = dome


def small_height(frame_width: int, frame_height: int, width: int) -> int:
    """How high a picture is that is `width` wide and shows the same."""
    return max(1, round(frame_height * width / frame_width))


@lru_cache(maxsize=16)
def places(frame_side: int, side: int) -> np.ndarray:
    """(frame_side,) int32, in which of `side` equal parts the centre of every pixel along a side of the frame lies."""
    made = ((2 * np.arange(frame_side, dtype=np.int64) + 1) * side // (2 * frame_side)).astype(np.int32)
    made.flags.writeable = False
    return made


@lru_cache(maxsize=8)
def sampled_pixels(frame_width: int, frame_height: int, width: int, height: int) -> tuple[np.ndarray, int]:
    """(width * height * points,) int32 pixels of the frame, those of a pixel of the small picture one after the other, and how
    many points that is."""
    samples = np.array(SAMPLES) if frame_width >= 2 * width and frame_height >= 2 * height else np.array([[0.5, 0.5]])
    columns = _at(np.arange(width)[:, None] + samples[:, 0], frame_width / width, frame_width)
    rows = _at(np.arange(height)[:, None] + samples[:, 1], frame_height / height, frame_height)
    pixels = (rows[:, None] * frame_width + columns[None]).reshape(-1).astype(np.int32)
    pixels.flags.writeable = False
    return pixels, len(samples)


def _at(places: np.ndarray, scale: float, frame_side: int) -> np.ndarray:
    """(n, k) int64 pixels along a side of the frame in which `places` of the small picture are."""
    return np.minimum((places * scale).astype(np.int64), frame_side - 1)
