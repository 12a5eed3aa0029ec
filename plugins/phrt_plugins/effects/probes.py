"""Probes: a cube map of the surroundings for every object that mirrors or lets light through, captured when the scene changed.

A mirror ball that falls back to one sky colour is a white disc; with a probe it is a good mirror of what stands still.
Source: Greene 1986 (environment mapping); Lagarde and Zanuttini 2012 (parallax correction by a box).
"""

from __future__ import annotations

import numpy as np

from phrt.composite import all_rows, shade_flat
from phrt.frame import Frame
from phrt.interfaces.gbuffer import POINT_CHANNELS
from phrt.kernels.arrays import surface_arrays
from phrt.workers import chunks
from phrt_plugins.effects.cube_kernels import probe_lookup
from phrt_plugins.effects.cube_maps import face_views
from phrt_plugins.effects.shadow_maps import ShadowMaps

MAX_PROBES = 32
"""More objects than this share: each takes the probe nearest to it."""
CHUNK = 8192


class Probes:
    """Radiance cube maps at the centres of the objects asked for."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._shadows = ShadowMaps(256)

    def prepare(self, frame: Frame, objects: np.ndarray) -> None:
        """Capture probes for `objects` (N + 1,) bool; lit by every light with the shadows of small shadow maps."""
        low, high = frame.world.object_bounds()
        wanted = np.flatnonzero(objects & (frame.world.triangle_count > 0))
        self._centres, owners, self._probe_of = spread(low, high, wanted, MAX_PROBES)
        self._cubes = np.zeros((max(len(self._centres), 1), 6, self._size, self._size, 3), np.float32)
        self._shadows.prepare(frame)
        for index, (centre, owner) in enumerate(zip(self._centres, owners, strict=True)):
            # Glass would be black in a probe, whose pixels are not traced; the object itself must not hide the rest.
            hidden = ~frame.world.object_opaque
            hidden[owner] = True
            for face, view in enumerate(face_views(centre, self._size)):
                gbuffer = frame.producer.render(view, channels=POINT_CHANNELS, hidden=hidden)
                surfaces = surface_arrays(gbuffer)
                rows = all_rows(self._size**2)
                everywhere = np.ones((len(rows), len(frame.world.lights), 3), np.float32)
                visibility = self._shadows.visibility_of(frame, surfaces, everywhere, rows)
                image = shade_flat(frame, surfaces, view, rows, visibility)
                self._cubes[index, face] = image.reshape(self._size, self._size, 3)
        self._low, self._high = (np.ascontiguousarray(corner, dtype=np.float32) for corner in frame.world.bounds())

    def reflected(self, frame: Frame, pixels: np.ndarray) -> np.ndarray:
        """(n, 3) float32 radiance from the mirror directions of `pixels`."""
        return self._lookup(frame, pixels, straight=False)

    def straight(self, frame: Frame, pixels: np.ndarray) -> np.ndarray:
        """(n, 3) float32 radiance straight behind `pixels`."""
        return self._lookup(frame, pixels, straight=True)

    def _lookup(self, frame: Frame, pixels: np.ndarray, *, straight: bool) -> np.ndarray:
        out = np.empty((len(pixels), 3), np.float32)

        def part(piece: slice) -> None:
            view, is_point = frame.view_vectors(pixels[piece])
            probe_lookup(
                pixels[piece], frame.surfaces, view, is_point, straight, self._cubes, self._centres, self._probe_of,
                self._low, self._high, out[piece],
            )  # fmt: skip

        frame.workers.map(part, chunks(len(pixels), CHUNK, frame.workers.threads))
        return out


def spread(
    low: np.ndarray, high: np.ndarray, wanted: np.ndarray, most: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Probe centres (K, 3) float32, K <= most, the objects (K,) they are captured for, and each object's probe (N + 1,) int32.

    With more objects than `most`, they are chosen far from each other (Gonzalez 1985), the largest first.
    """
    centres = ((low + high) / 2).astype(np.float32)
    chosen = list(wanted[:most])
    if len(wanted) > most:
        size = np.linalg.norm((high - low)[wanted], axis=1)
        chosen = [wanted[int(np.argmax(size))]]
        nearest = np.linalg.norm(centres[wanted] - centres[chosen[0]], axis=1)
        while len(chosen) < most:
            chosen.append(wanted[int(np.argmax(nearest))])
            nearest = np.minimum(nearest, np.linalg.norm(centres[wanted] - centres[chosen[-1]], axis=1))
    owners = np.array(chosen, np.int32)
    places = np.ascontiguousarray(centres[owners])
    probe_of = np.zeros(len(low), np.int32)
    for object_id in wanted:
        probe_of[object_id] = int(np.argmin(np.linalg.norm(places - centres[object_id], axis=1)))
    return places, owners, probe_of
