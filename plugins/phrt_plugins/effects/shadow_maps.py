"""Shadow maps: what every light sees, rendered by the G-buffer producer when the scene changed.

Point, spot, sphere and rect lights get a cube of six square depth pictures, directional ones an orthographic picture of the
whole scene. Objects that cast no shadow are left out.
Source: Williams 1978; Reeves et al. 1987 (percentage-closer filtering).
"""

from __future__ import annotations

import numpy as np

from phrt.camera import CameraView, look_at
from phrt.frame import Frame
from phrt.kernels.arrays import SurfaceArrays
from phrt.lights import DIRECTIONAL
from phrt.workers import chunks
from phrt_plugins.effects.cube_kernels import shadow_map_lookup
from phrt_plugins.effects.cube_maps import face_views

CHUNK = 8192


class ShadowMaps:
    """Depth pictures of all lights that cast shadows; maps (L, 6, S, S) float32 metres."""

    def __init__(self, size: int) -> None:
        self._size = size

    def prepare(self, frame: Frame) -> None:
        """Render every map anew."""
        lights = frame.world.lights
        self._maps = np.full((len(lights), 6, self._size, self._size), np.inf, np.float32)
        self._frames = np.zeros((len(lights), 4, 4), np.float32)
        hidden = ~frame.world.object_casts_shadow
        for index, light in enumerate(lights):
            if not light["casts_shadow"]:
                continue
            if light["kind"] == DIRECTIONAL:
                view, self._frames[index] = sun_view(frame, light["direction"].astype(np.float64), self._size)
                views = [view]
            else:
                views = face_views(light["position"], self._size)
            for face, view in enumerate(views):
                self._maps[index, face] = frame.producer.render(view, channels=("depth",), hidden=hidden).depth

    def visibility(self, frame: Frame, pixels: np.ndarray) -> np.ndarray:
        """(n, L) float32 share of every light at `pixels`, by lookup."""
        return self.visibility_of(frame, frame.surfaces, frame.direct, pixels)

    def visibility_of(self, frame: Frame, surfaces: SurfaceArrays, direct: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(n, L) float32 share of every light at points `rows` of any surfaces; 1 where its direct light (s, L, 3) is black."""
        lights = frame.world.lights
        out = np.ones((len(rows), len(lights)), np.float32)

        def part(piece: slice) -> None:
            shadow_map_lookup(rows[piece], surfaces, direct, lights, self._maps, self._frames, out[piece])

        frame.workers.map(part, chunks(len(rows), CHUNK, frame.workers.threads))
        return out


def sun_view(frame: Frame, direction: np.ndarray, size: int) -> tuple[CameraView, np.ndarray]:
    """An orthographic view of the whole scene along `direction`, and map_from_world (4, 4) float32: x, y in -1..1, z depth."""
    low, high = (corner.astype(np.float64) for corner in frame.world.bounds())
    centre, radius = (low + high) / 2, max(float(np.linalg.norm(high - low)) / 2, 0.1) * 1.01
    eye = centre - direction * radius * 2
    x, y, z = (float(c) for c in eye)
    view = CameraView(
        width=size,
        height=size,
        world_from_view=look_at((x, y, z), tuple(float(c) for c in eye + direction)),  # type: ignore[arg-type]
        tan_half=(radius, radius),
        orthographic=True,
        near=radius * 0.5,
        far=radius * 4,
    )
    map_from_world = view.view_from_world()
    map_from_world[:2] /= radius
    map_from_world[2] *= -1
    return view, map_from_world.astype(np.float32)
