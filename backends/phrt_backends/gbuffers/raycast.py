"""raycast: the G-buffer by eye rays, through whichever tracer is chosen. Needs no GL.

Options: chunk_pixels, how many pixels a thread takes at a time.
Source: primary visibility by ray casting (Appel 1968); texture filtering by ray cones (Akenine-Moller et al. 2021).
Example: `phrt render scenes/spheres.yaml -o out.png --gbuffer raycast --tracer embree`
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from phrt.buffers import BufferPool
from phrt.camera import CameraView
from phrt.channels import CHANNELS, GBuffer
from phrt.interfaces.gbuffer import GBufferProducer
from phrt.interfaces.tracer import Tracer
from phrt.kernels.arrays import SurfaceArrays, empty_surfaces, geometry_arrays, material_arrays, surface_arrays
from phrt.kernels.motion import motion_vectors
from phrt.kernels.onward import continued
from phrt.kernels.primary import eye_rays, put_in_place, tile_order
from phrt.kernels.surface import surface
from phrt.rays import RayBatch
from phrt.workers import Workers, chunks
from phrt.world import Changes, World
from phrt_backends.gbuffers.raycast_options import RaycastOptions

MAX_LAYERS = 64
"""Holes and culled faces an eye ray may pass before it counts as a miss."""


class RaycastProducer(GBufferProducer):
    """Eye rays in tile order, chunk by chunk: rays, hits, surface. Holes and culled faces are traced again behind."""

    def __init__(self, options: RaycastOptions, *, tracer: Tracer, workers: Workers | None = None) -> None:
        self._options = options
        self._tracer = tracer
        self._workers = workers or Workers()
        self._buffers = BufferPool()
        self._previous_clip: np.ndarray | None = None
        self._previous_matrix: np.ndarray | None = None

    def build(self, world: World) -> None:
        self._world = world
        self._geometry = geometry_arrays(world)
        self._materials = material_arrays(world)
        self._all_seen = np.zeros(world.object_count + 1, np.uint8)
        self._previous_clip = None

    def update(self, world: World, changes: Changes) -> None:
        """Nothing to do: the tracer was updated, and the world's arrays are shared."""

    def render(
        self,
        view: CameraView,
        *,
        channels: Iterable[str] = tuple(CHANNELS),
        hidden: np.ndarray | None = None,
        pixels: np.ndarray | None = None,
    ) -> GBuffer:
        gbuffer = GBuffer(view.width, view.height)
        # Motion is left out unless asked for: what nobody fills would hold an old frame's bytes.
        for channel in (c for c in CHANNELS.values() if c.name != "motion" or "motion" in channels):
            gbuffer.arrays[channel.name] = self._buffers.take(channel.shape(view.height, view.width), channel.dtype)
        out = surface_arrays(gbuffer)
        order = tile_order(view.width, view.height) if pixels is None else pixels
        world_from_view = view.world_from_view.astype(np.float32)

        left_out = self._all_seen if hidden is None else hidden.astype(np.uint8)

        def chunk(part: slice) -> None:
            self._chunk(order[part], view, world_from_view, out, left_out)

        self._workers.map(chunk, chunks(len(order), self._options.chunk_pixels, self._workers.threads))
        if "motion" in channels:
            self._motion(view, gbuffer, pixels)
        return gbuffer

    def _chunk(
        self, pixels: np.ndarray, view: CameraView, world_from_view: np.ndarray, out: SurfaceArrays, hidden: np.ndarray
    ) -> None:
        count = len(pixels)
        rays = RayBatch(
            np.empty((count, 3), np.float32),
            np.empty((count, 3), np.float32),
            np.empty(count, np.float32),
            coherent=True,
        )
        eye_rays(
            pixels,
            view.width,
            view.height,
            world_from_view,
            np.array(view.tan_half, np.float32),
            np.array(view.jitter, np.float32),
            view.orthographic,
            np.float32(view.near),
            np.float32(view.far),
            rays.origin,
            rays.direction,
            rays.t_max,
        )
        cone = np.array([view.pixel_spread, 0.0] if view.orthographic else [0.0, view.pixel_spread], np.float32)
        eye, forward = world_from_view[:3, 3].copy(), -world_from_view[:3, 2].copy()
        hits = self._tracer.closest_hit(rays)
        travelled = hits.distance + np.float32(view.near)
        points, target, passed = empty_surfaces(count), np.arange(count, dtype=np.int32), np.empty(count, np.uint8)
        again = surface(
            rays.direction, travelled, hits.primitive, hits.barycentric, self._geometry, self._materials,
            eye, forward, cone, hidden, True, target, points, passed,
        )  # fmt: skip
        layers = 0
        while again and layers < MAX_LAYERS:
            layers += 1
            index = np.flatnonzero(passed)
            rays, step = continued(rays, hits.distance, index)
            travelled = travelled[index] + step - hits.distance[index]
            hits, target = self._tracer.closest_hit(rays), target[index]
            travelled += hits.distance
            passed = np.empty(len(index), np.uint8)
            again = surface(
                rays.direction, travelled, hits.primitive, hits.barycentric, self._geometry, self._materials,
                eye, forward, cone, hidden, True, target, points, passed,
            )  # fmt: skip
        if again:
            self._miss(target[np.flatnonzero(passed)], points, eye, forward, cone)
        put_in_place(pixels, points, out)

    def _miss(
        self, target: np.ndarray, points: SurfaceArrays, eye: np.ndarray, forward: np.ndarray, cone: np.ndarray
    ) -> None:
        """Clear values for rays that passed MAX_LAYERS surfaces."""
        count = len(target)
        surface(
            np.zeros((count, 3), np.float32), np.zeros(count, np.float32), np.full(count, 0xFFFFFFFF, np.uint32),
            np.zeros((count, 2), np.float32), self._geometry, self._materials, eye, forward, cone, self._all_seen, True,
            target, points, np.empty(count, np.uint8),
        )  # fmt: skip

    def _motion(self, view: CameraView, gbuffer: GBuffer, pixels: np.ndarray | None) -> None:
        """Motion since the last view that was rendered whole, at `pixels` (n,) or everywhere; the others are not read."""
        clip = view.with_jitter(0.0, 0.0).clip_from_world().astype(np.float32)
        matrix = self._world.object_matrix
        previous_clip = clip if self._previous_clip is None else self._previous_clip
        previous_matrix = matrix if self._previous_matrix is None else self._previous_matrix
        moved = (matrix != previous_matrix).any(axis=(1, 2))
        delta = np.tile(np.eye(4, dtype=np.float32), (len(matrix), 1, 1))
        for object_id in np.flatnonzero(moved):
            if abs(np.linalg.det(matrix[object_id])) > 1e-12:
                delta[object_id] = previous_matrix[object_id] @ np.linalg.inv(matrix[object_id])
        size = np.array([view.width, view.height], np.float32)
        position, ids, out = gbuffer.flat("position_world"), gbuffer.flat("object_id"), gbuffer.flat("motion")
        if pixels is not None:
            position, ids = position[pixels], ids[pixels]
        motion = out if pixels is None else np.empty((len(ids), 2), np.float32)
        still = bool(not moved.any() and np.array_equal(clip, previous_clip))

        def part(rows: slice) -> None:
            motion_vectors(position[rows], ids[rows], delta, clip, previous_clip, size, motion[rows])

        if still:
            motion.fill(0.0)
        else:
            self._workers.map(part, chunks(len(ids), self._options.chunk_pixels, self._workers.threads))
        if pixels is None:
            self._previous_clip, self._previous_matrix = clip, matrix.copy()
        else:
            out[pixels] = motion
