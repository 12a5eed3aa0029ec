"""Shadow maps: what every light sees, found tile by tile when it is first looked up, and again where something moved.

Point, spot, sphere and rect lights get a cube of six square depth pictures, directional ones an orthographic picture of the
whole scene. Where the G-buffer is made by rays, so are the maps, and only the tiles that a visible point falls into: what lets
a shadow ray pass is not in them. A rasterizer draws whole faces.

What moved makes the tiles stale that its bounding sphere falls into, before and after. Stale tiles that are looked up are found
again, the oldest first, but not more than `MOST_STALE` a frame; the others show what they hold.
Source: Williams 1978; Reeves et al. 1987 (percentage-closer filtering); tiles as they are needed: Fernando et al. 2001.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import proxy

import numpy as np

from phrt.camera import CameraView, look_at
from phrt.frame import Frame
from phrt.kernels.arrays import SurfaceArrays
from phrt.kernels.primary import eye_rays
from phrt.lights import DIRECTIONAL
from phrt.movers import BoundingSpheres
from phrt.rays import RayBatch
from phrt.tracing import pass_holes
from phrt.workers import chunks
from phrt.world import World
from phrt_plugins.effects.cube_kernels import FRESH, TILE, age_tiles, shadow_map_lookup
from phrt_plugins.effects.cube_maps import face_views
from phrt_plugins.effects.tiles import tile_texels, touched_tiles

CHUNK = 8192
TILES_A_TASK = 8
MISSING, STALE = 0, 2
"""States of a tile beside FRESH: not found yet; something moved in it since."""
MOST_STALE = 128
"""Stale tiles that are found again in a frame: some 140,000 rays."""
CUT_SECONDS = 0.5
"""A step in time from here on is a cut: what was known of things that move is worth nothing."""
ROOM = 1.1
"""How much larger than the scene a directional light's picture is, so that what moves has room."""


@dataclass
class _Known:
    """Of a world, when the maps were last brought up to it. lights: their table; matrix (N + 1, 4, 4); centre (3,), radius:
    what the pictures of directional lights show; moved: did anything move since the maps were begun?"""

    lights: np.ndarray
    matrix: np.ndarray
    time: float
    centre: np.ndarray
    radius: float
    moved: bool = False


class ShadowMaps:
    """Depth pictures of all lights that cast shadows: (L, 6, size, size) float32 metres along each face's axis.

    A picture of a still scene depends on nothing but the scene. Of a moving one it depends on the frames before, so that
    another run must begin with `begin_run`.
    """

    def __init__(self, size: int, most_stale: int = MOST_STALE) -> None:
        self._size = size
        self._across = -(-size // TILE)
        self._most_stale = most_stale
        self._known: _Known | None = None
        self._frame_index = -1

    def begin_run(self) -> None:
        """Another run begins: forget what a new one would not have."""
        self._frame_index = -1
        if self._known is not None and self._known.moved:
            self._known = None

    def prepare(self, frame: Frame) -> None:
        """The scene was built or changed: note which tiles no longer hold. Nothing is rendered here."""
        self._left = self._most_stale
        world, known = frame.world, self._known
        if known is None or len(known.lights) != len(world.lights) or abs(frame.time - known.time) >= CUT_SECONDS:
            self._begin(frame)
            return
        known.time = frame.time
        self._forget_lights(known, world.lights)
        moved = np.flatnonzero((world.object_matrix != known.matrix).any(axis=(1, 2)) & world.object_casts_shadow)
        if len(moved):
            known.moved = True
            both = [self._spheres.of_all(moved, matrix) for matrix in (known.matrix, world.object_matrix)]
            spheres = np.concatenate([found[found[:, 3] >= 0] for found in both])
            known.matrix = world.object_matrix.copy()
            if (np.linalg.norm(spheres[:, :3] - known.centre, axis=1) + spheres[:, 3] > known.radius).any():
                known.centre, known.radius = _scene_sphere(frame)
                self._forget(np.flatnonzero(world.lights["kind"] == DIRECTIONAL))
            self._age(spheres)

    def _begin(self, frame: Frame) -> None:
        """All of it anew."""
        world, moved = frame.world, self._known is not None
        lights, size = world.lights, self._size
        centre, radius = _scene_sphere(frame)
        self._known = _Known(lights.copy(), world.object_matrix.copy(), frame.time, centre, radius, moved)
        self._spheres = BoundingSpheres(proxy(world))
        # Not filled: what was not found is not read, and takes no memory.
        self._maps = np.empty((len(lights), 6, size, size), np.float32)
        self._state = np.zeros((len(lights), 6 * self._across**2), np.uint8)
        self._wanted = np.zeros_like(self._state)
        self._since = np.zeros(self._state.shape, np.int64)
        self._age_now = 0
        self._views: list[list[CameraView]] = [[] for _ in lights]
        self._frames = np.zeros((len(lights), 4, 4), np.float32)
        self._forget(np.arange(len(lights)))

    def _forget_lights(self, known: _Known, lights: np.ndarray) -> None:
        """Maps of lights that changed."""
        changed = [k for k in range(len(lights)) if lights[k].tobytes() != known.lights[k].tobytes()]
        if changed:
            known.lights, known.moved = lights.copy(), True
            self._forget(np.array(changed))

    def _forget(self, lights: np.ndarray) -> None:
        """Nothing is known of what `lights` (k,) see; where they are is taken over."""
        known = self._known
        assert known is not None
        for index in lights.tolist():
            light = known.lights[index]
            self._state[index] = MISSING
            if light["kind"] == DIRECTIONAL:
                direction = light["direction"].astype(np.float64)
                view, self._frames[index] = sun_view(known.centre, known.radius, direction, self._size)
                self._views[index] = [view]
            else:
                self._views[index] = face_views(light["position"], self._size)

    def _age(self, spheres: np.ndarray) -> None:
        """What `spheres` (m, 4) fall into is stale from now on, where it is known."""
        self._age_now += 1
        for index, views in enumerate(self._views):
            places = touched_tiles(spheres, views)
            age_tiles(places, self._across, self._age_now, FRESH, STALE, self._state[index], self._since[index])

    def visibility(self, frame: Frame, pixels: np.ndarray) -> np.ndarray:
        """(n, L) float32 share of every light at `pixels`, by lookup; of `frame.only_light` alone where there is one."""
        return self.visibility_of(frame, frame.surfaces, frame.direct, pixels)

    def visibility_of(self, frame: Frame, surfaces: SurfaceArrays, direct: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(n, L) float32 share of every light at points `rows` of any surfaces; 1 where its direct light (s, L, 3) is black.

        `prepare` must have been called since the scene changed.
        """
        if self._known is None:
            self.prepare(frame)
        assert self._known is not None
        self._known.time = frame.time
        if frame.index != self._frame_index:
            self._frame_index, self._left = frame.index, self._most_stale
        lights = frame.world.lights
        if frame.only_light is not None:
            lights = lights.copy()
            lights["casts_shadow"][np.arange(len(lights)) != frame.only_light] = 0
        out = np.ones((len(rows), len(lights)), np.float32)

        def part(piece: slice) -> int:
            return int(
                shadow_map_lookup(
                    rows[piece],
                    surfaces,
                    direct,
                    lights,
                    self._maps,
                    self._frames,
                    self._state,
                    self._wanted,
                    out[piece],
                )
            )

        pieces = chunks(len(rows), CHUNK, frame.workers.threads)
        unfound = frame.workers.map(part, pieces)
        if any(unfound) and self._find_wanted(frame):
            frame.workers.map(part, [piece for piece, count in zip(pieces, unfound, strict=True) if count])
            self._wanted.fill(0)
        return out

    def _find_wanted(self, frame: Frame) -> bool:
        """Find the tiles that were looked up and are not there, and stale ones as far as the frame allows. Were there any?"""
        wanted = np.flatnonzero(self._wanted)
        self._wanted.reshape(-1)[wanted] = 0
        state, since = self._state.reshape(-1), self._since.reshape(-1)
        missing, stale = wanted[state[wanted] == MISSING], wanted[state[wanted] == STALE]
        stale = stale[np.argsort(since[stale], kind="stable")][: max(self._left, 0)]
        self._left -= len(stale)
        tiles = np.sort(np.concatenate([missing, stale]))
        if not len(tiles):
            return False
        light, tile = np.divmod(tiles, self._state.shape[1])
        if frame.producer.few_are_cheap:
            self._cast(frame, light, tile)
            state[tiles] = FRESH
        else:
            self._draw(frame, light, tile // self._across**2)
        return True

    def _cast(self, frame: Frame, light: np.ndarray, tile: np.ndarray) -> None:
        """Find tiles `tile` (k,) of `light` (k,), sorted, by rays."""
        face, place = np.divmod(tile, self._across**2)
        tasks: list[tuple[int, int, np.ndarray]] = []
        picture = light * 6 + face
        for number in np.unique(picture).tolist():
            own = place[picture == number]
            for first in range(0, len(own), TILES_A_TASK):
                parts = [tile_texels(int(p), self._across, self._size) for p in own[first : first + TILES_A_TASK]]
                tasks.append((number // 6, number % 6, np.concatenate(parts)))
        views = self._views

        def depths(task: tuple[int, int, np.ndarray]) -> np.ndarray:
            return cast_depths(frame, views[task[0]][task[1]], task[2])

        # Neighbours share a border of texels: written one after the other, so that threads do not matter.
        for (at_light, at_face, texels), found in zip(tasks, frame.workers.map(depths, tasks), strict=True):
            self._maps[at_light, at_face].reshape(-1)[texels] = found

    def _draw(self, frame: Frame, light: np.ndarray, face: np.ndarray) -> None:
        """Draw whole faces `face` (k,) of `light` (k,)."""
        hidden, area = ~frame.world.object_casts_shadow, self._across**2
        for at_light, at_face in sorted(set(zip(light.tolist(), face.tolist(), strict=True))):
            view = self._views[at_light][at_face]
            self._maps[at_light, at_face] = frame.producer.render(view, channels=("depth",), hidden=hidden).depth
            self._state[at_light, at_face * area : (at_face + 1) * area] = FRESH


def cast_depths(frame: Frame, view: CameraView, texels: np.ndarray) -> np.ndarray:
    """(n,) float32 depth of the nearest shadow caster behind `texels` (n,) int32 of `view`, +inf where there is none."""
    count = len(texels)
    origin, direction = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
    t_max, matrix = np.empty(count, np.float32), view.world_from_view.astype(np.float32)
    eye_rays(
        texels, view.width, view.height, matrix, np.array(view.tan_half, np.float32), np.zeros(2, np.float32),
        view.orthographic, np.float32(view.near), np.float32(view.far), origin, direction, t_max,
    )  # fmt: skip
    rays = RayBatch(origin, direction, t_max, coherent=True, casters_only=True)
    hits, world = frame.tracer.closest_hit(rays), frame.world
    if world.has_cutouts or not world.object_casts_shadow[1:].all():
        pass_holes(frame, rays, hits, shadow=True)
    forward = direction @ -matrix[:3, 2]
    return (np.float32(view.near) + hits.distance * forward).astype(np.float32)


def _scene_sphere(frame: Frame) -> tuple[np.ndarray, float]:
    """Centre (3,) and radius of a sphere around everything, with room where things move."""
    low, high = (corner.astype(np.float64) for corner in frame.world.bounds())
    radius = max(float(np.linalg.norm(high - low)) / 2, 0.1) * 1.01
    return (low + high) / 2, radius * (ROOM if _moves(frame.world) else 1.0)


def _moves(world: World) -> bool:
    return bool(world.moving_objects or world.overrides)


def sun_view(centre: np.ndarray, radius: float, direction: np.ndarray, size: int) -> tuple[CameraView, np.ndarray]:
    """An orthographic view of a sphere along `direction`, and map_from_world (4, 4) float32: x, y in -1..1, z depth."""
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
