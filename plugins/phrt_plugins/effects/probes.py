"""Probes: cube maps of the surroundings of objects that mirror or let light through, captured when they are first looked up, and
again where something moved.

A mirror ball that falls back to one sky colour is a white disc; with a probe it is a good mirror of what stands still. What is seen
through solid, round glass is taken from where a ball would send the view.

What moved makes the probes stale that see it larger than a few texels. Stale probes that are looked up are captured again: a few a
frame, those first that most pixels have waited for longest.
Source: Greene 1986 (environment mapping); Lagarde and Zanuttini 2012 (parallax correction by a box).
"""

from __future__ import annotations

from typing import cast
from weakref import proxy

import numpy as np

from phrt.composite import all_rows, light_surfaces, shade_flat
from phrt.frame import Frame
from phrt.interfaces.gbuffer import POINT_CHANNELS
from phrt.kernels.arrays import surface_arrays
from phrt.movers import BoundingSpheres
from phrt.workers import chunks
from phrt.world import World
from phrt_plugins.effects.cube_kernels import FRESH, probe_lookup
from phrt_plugins.effects.cube_maps import face_views
from phrt_plugins.effects.shadow_maps import CUT_SECONDS, MISSING, STALE, ShadowMaps

MAX_PROBES = 32
"""More objects than this share: each takes the probe nearest to it."""
SHADOW_SIZE, STALE_SHADOWS = 256, 32
"""Of the shadow maps that light probes: texels along a face, and stale tiles that are found again in a frame."""
STALE_TEXELS = 32768
"""Of stale probes that are captured again in a frame: one of 64 texels a side; and of larger ones always one."""
SEEN_TEXELS = 2.0
"""What looks smaller than so many texels makes no probe stale."""
CHUNK = 8192


class Probes:
    """Radiance cube maps at the centres of the objects asked for, by all effects of a renderer together: see `probes_of`.

    In a still scene they depend on nothing but the scene. In a moving one they depend on the frames before, so that another run
    must begin with `begin_run`. They hold no reference to their world, which holds them.
    """

    def __init__(self, size: int) -> None:
        self._size = size
        self._shadows = ShadowMaps(SHADOW_SIZE, STALE_SHADOWS)
        self._most_stale = max(STALE_TEXELS // (6 * size**2), 1)
        self._asked: np.ndarray | None = None
        self._matrix: np.ndarray | None = None
        self._time = 0.0
        self._moved = False
        self._frame_index = -1

    def begin_run(self) -> None:
        """Another run begins: forget what a new one would not have."""
        self._frame_index = -1
        if self._moved:
            self._matrix = None
        self._shadows.begin_run()

    def prepare(self, frame: Frame, objects: np.ndarray) -> None:
        """The scene was built or changed: `objects` (N + 1,) bool have probes, and what moved is noted. Nothing is captured."""
        self._shadows.prepare(frame)
        world, self._left = frame.world, self._most_stale
        asked = objects & (world.triangle_count > 0)
        union = asked if self._asked is None else asked | self._asked
        if self._matrix is None or (union != self._asked).any() or abs(frame.time - self._time) >= CUT_SECONDS:
            self._asked = union
            self._begin(world)
        else:
            self._note_moves(world)
        self._time = frame.time
        self._low, self._high = (np.ascontiguousarray(corner, dtype=np.float32) for corner in world.bounds())

    def _begin(self, world: World) -> None:
        """All of it anew."""
        assert self._asked is not None
        low, high = world.object_bounds()
        self._moved = self._moved or self._matrix is not None
        self._matrix, self._lights = world.object_matrix.copy(), world.lights.tobytes()
        self._spheres = BoundingSpheres(proxy(world))
        self._places, self._owners, self._probe_of = spread(low, high, np.flatnonzero(self._asked), MAX_PROBES)
        self._round, self._radius = round_bodies(world, low, high, self._asked & ~world.object_opaque)
        count = len(self._places)
        self._centres = self._places.copy()
        self._cubes = np.zeros((max(count, 1), 6, self._size, self._size, 3), np.float32)
        self._state, self._since, self._now = np.zeros(count, np.uint8), np.zeros(count, np.int64), 0

    def _note_moves(self, world: World) -> None:
        """What moved since makes the probes stale that see it."""
        assert self._matrix is not None
        self._now += 1
        lights = world.lights.tobytes()
        stale = np.full(len(self._places), lights != self._lights)
        self._lights = lights
        moved = np.flatnonzero((world.object_matrix != self._matrix).any(axis=(1, 2)))
        if len(moved):
            before, after = (self._spheres.of_all(moved, matrix) for matrix in (self._matrix, world.object_matrix))
            place_of = dict(zip(moved.tolist(), after[:, :3], strict=True))
            for index, owner in enumerate(self._owners.tolist()):
                if owner in place_of:
                    self._places[index], stale[index] = place_of[owner], True
            opaque = world.object_opaque[moved]
            for spheres in (before[opaque], after[opaque]):
                away = np.linalg.norm(self._places[:, None] - spheres[None, :, :3], axis=2)
                stale |= (spheres[:, 3] * self._size >= SEEN_TEXELS * away).any(axis=1)
        self._moved = self._moved or bool(stale.any())
        self._matrix = world.object_matrix.copy()
        stale &= self._state == FRESH
        self._state[stale], self._since[stale] = STALE, self._now

    def is_round(self, frame: Frame, pixels: np.ndarray) -> np.ndarray:
        """(n,) bool: do `pixels` show solid glass that is not made of flat faces? `bent` is for those."""
        solid = frame.world.materials["thin"] == 0
        surfaces = frame.surfaces
        return self._round[surfaces.object_id[pixels]] & solid[surfaces.material_id[pixels]]

    def reflected(self, frame: Frame, pixels: np.ndarray) -> np.ndarray:
        """(n, 3) float32 radiance from the mirror directions of `pixels`."""
        return self._lookup(frame, pixels, through=False)

    def bent(self, frame: Frame, pixels: np.ndarray) -> np.ndarray:
        """(n, 3) float32 radiance that comes through the bodies at `pixels`, were they balls, their absorption included."""
        return self._lookup(frame, pixels, through=True)

    def _lookup(self, frame: Frame, pixels: np.ndarray, *, through: bool) -> np.ndarray:
        if self._matrix is None:
            self.prepare(frame, np.zeros(frame.world.object_count + 1, bool))
        self._time = frame.time
        if (self._state != FRESH).any():
            self._capture_wanted(frame, pixels)
        out = np.empty((len(pixels), 3), np.float32)

        def part(piece: slice) -> None:
            view, is_point = frame.view_vectors(pixels[piece])
            probe_lookup(
                pixels[piece], frame.surfaces, frame.materials.materials, view, is_point, through, self._cubes,
                self._centres, self._probe_of, self._radius, self._low, self._high, out[piece],
            )  # fmt: skip

        frame.workers.map(part, chunks(len(pixels), CHUNK, frame.workers.threads))
        return out

    def _capture_wanted(self, frame: Frame, pixels: np.ndarray) -> None:
        """Capture the probes of `pixels` that are not there, and stale ones as far as the frame allows."""
        if frame.index != self._frame_index:
            self._frame_index, self._left = frame.index, self._most_stale
        looked_at = np.bincount(self._probe_of[frame.surfaces.object_id[pixels]], minlength=len(self._state))
        missing = np.flatnonzero((self._state == MISSING) & (looked_at > 0))
        stale = np.flatnonzero((self._state == STALE) & (looked_at > 0))
        waited = looked_at[stale] * (self._now - self._since[stale] + 1)
        stale = stale[np.argsort(-waited, kind="stable")][: max(self._left, 0)]
        self._left -= len(stale)
        for index in [*missing.tolist(), *stale.tolist()]:
            self._capture(frame, index)

    def _capture(self, frame: Frame, index: int) -> None:
        """Probe `index` as its surroundings are now, lit by every light with the shadows of small shadow maps."""
        world, size = frame.world, self._size
        centre = self._places[index]
        # Glass would be black in a probe, whose pixels are not traced; the object itself must not hide the rest.
        hidden = ~world.object_opaque
        hidden[self._owners[index]] = True
        rows = all_rows(size**2)
        direct = np.empty((len(rows), len(world.lights), 3), np.float32)
        for face, view in enumerate(face_views(centre, size)):
            surfaces = surface_arrays(frame.producer.render(view, channels=POINT_CHANNELS, hidden=hidden))
            # Which lights arrive: only their shadow maps are needed.
            light_surfaces(surfaces, frame.materials.materials, world.lights, view, direct, frame.workers)
            visibility = self._shadows.visibility_of(frame, surfaces, direct, rows)
            image = shade_flat(frame, surfaces, view, rows, visibility)
            self._cubes[index, face] = image.reshape(size, size, 3)
        self._centres[index], self._state[index] = centre, FRESH


def probes_of(world: World, size: int) -> Probes:
    """The probes of `world` with faces of `size` texels: a glass ball that also mirrors has one, whichever effect asks."""
    return cast(Probes, world.kept.setdefault(("probes", size), Probes(size)))


def round_bodies(world: World, low: np.ndarray, high: np.ndarray, objects: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(N + 1,) bool, which of `objects` (N + 1,) bool are shaded smoothly, and (N + 1,) float32, the radius of a ball as large
    as the box low, high (N + 1, 3) around each object."""
    is_round = np.zeros(len(objects), bool)
    for object_id in np.flatnonzero(objects).tolist():
        first = int(world.first_triangle[object_id])
        corners = world.triangles[first : first + int(world.triangle_count[object_id])]
        a, b, c = (world.positions[corners[:, k]].astype(np.float64) for k in range(3))
        flat = np.cross(b - a, c - a)
        flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-30)
        along = np.abs(np.einsum("tkc,tc->tk", world.normals[corners], flat))
        is_round[object_id] = float(along.min(axis=1).mean()) < FLAT
    return is_round, (np.cbrt(np.prod(np.maximum(high - low, 1e-6), axis=1)) / 2).astype(np.float32)


FLAT = 1.0 - 1e-5
"""Cosine between the normals of corners and of their triangle, on average, from which on a body is made of flat faces."""


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
