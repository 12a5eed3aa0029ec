"""raycast: the G-buffer by eye rays, through whichever tracer is chosen. Needs no GL.

Options: chunk_pixels, how many pixels a thread takes at a time.
Source: primary visibility by ray casting (Appel 1968); texture filtering by ray cones (Akenine-Moller et al. 2021).
Example: `phrt render scenes/spheres.yaml -o out.png --gbuffer raycast --tracer embree`
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from phrt.buffers import BufferPool
from phrt.camera import CameraView
from phrt.channels import CHANNELS, GBuffer
from phrt.interfaces.gbuffer import GBufferProducer
from phrt.interfaces.tracer import Tracer
from phrt.kernels.arrays import SurfaceArrays, empty_surfaces, geometry_arrays, material_arrays, surface_arrays
from phrt.kernels.motion import motion_vectors
from phrt.kernels.onward import continued
from phrt.kernels.primary import eye_rays, row_order, tile_order
from phrt.kernels.surface import surface
from phrt.rays import RayBatch
from phrt.workers import Workers, chunks
from phrt.world import Changes, World
from phrt_backends.gbuffers.raycast_options import RaycastOptions

MAX_LAYERS = 64
"""Holes and culled faces an eye ray may pass before it counts as a miss."""


@dataclass(frozen=True)
class _Eye:
    """A view as the kernels take it, everything float32. opaque_only: see `RayBatch`."""

    view: CameraView
    world_from_view: np.ndarray
    position: np.ndarray
    forward: np.ndarray
    cone: np.ndarray
    opaque_only: bool

    @classmethod
    def of(cls, view: CameraView, opaque_only: bool) -> _Eye:
        matrix = view.world_from_view.astype(np.float32)
        cone = [view.pixel_spread, 0.0] if view.orthographic else [0.0, view.pixel_spread]
        return cls(view, matrix, matrix[:3, 3].copy(), -matrix[:3, 2], np.array(cone, np.float32), opaque_only)

    def rays(self, pixels: np.ndarray) -> RayBatch:
        """Through `pixels` (n,), from the near plane to the far one."""
        view, count = self.view, len(pixels)
        origin, direction = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
        t_max = np.empty(count, np.float32)
        eye_rays(
            pixels, view.width, view.height, self.world_from_view, np.array(view.tan_half, np.float32),
            np.array(view.jitter, np.float32), view.orthographic, np.float32(view.near), np.float32(view.far),
            origin, direction, t_max,
        )  # fmt: skip
        return RayBatch(origin, direction, t_max, coherent=True, opaque_only=self.opaque_only)


class RaycastProducer(GBufferProducer):
    """Eye rays in tile order, chunk by chunk: rays, hits, surface. Holes and culled faces are traced again behind."""

    few_are_cheap = True

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
        if pixels is None:
            every = tile_order(view.width, view.height)
            size = self._chunk_size(len(every))
            self._trace(view, every, row_order(view.width, view.height, size), every, out, hidden, size)
        else:
            self._trace_some(view, pixels, pixels, out, hidden)
        if "motion" in channels:
            self._motion(view, gbuffer, pixels)
        return gbuffer

    def points(self, view: CameraView, pixels: np.ndarray, *, hidden: np.ndarray | None = None) -> SurfaceArrays:
        out = empty_surfaces(len(pixels))
        self._trace_some(view, pixels, np.arange(len(pixels), dtype=np.int32), out, hidden)
        return out

    def _chunk_size(self, count: int) -> int:
        """Pixels a thread takes at a time: equal chunks, as many for each thread, so that they end together."""
        rounds = -(-count // (self._options.chunk_pixels * self._workers.threads))
        return max(1, -(-count // (max(rounds, 1) * self._workers.threads)))

    def _trace_some(
        self, view: CameraView, pixels: np.ndarray, target: np.ndarray, out: SurfaceArrays, hidden: np.ndarray | None
    ) -> None:
        size = self._chunk_size(len(pixels))
        self._trace(view, pixels, np.arange(len(pixels), dtype=np.int32) % size, target, out, hidden, size)

    def _trace(
        self,
        view: CameraView,
        pixels: np.ndarray,
        order: np.ndarray,
        target: np.ndarray,
        out: SurfaceArrays,
        hidden: np.ndarray | None,
        size: int,
    ) -> None:
        """The surfaces behind `pixels` (n,) into rows `target` (n,) of `out`, `size` at a time, each time in their `order`."""
        left_out = self._all_seen if hidden is None else hidden.astype(np.uint8)
        opaque_only = hidden is not None and bool((hidden | self._world.object_opaque)[1:].all())
        eye = _Eye.of(view, opaque_only)

        def chunk(first: int) -> None:
            # Copies: the orders are read-only, and kernels would be compiled once more for such arrays.
            part = slice(first, first + size)
            self._chunk(pixels[part].copy(), order[part].copy(), target[part].copy(), eye, out, left_out)

        self._workers.map(chunk, range(0, len(pixels), size))

    def _chunk(
        self,
        pixels: np.ndarray,
        order: np.ndarray,
        target: np.ndarray,
        eye: _Eye,
        out: SurfaceArrays,
        hidden: np.ndarray,
    ) -> None:
        rays = eye.rays(pixels)
        hits = self._tracer.closest_hit(rays)
        travelled = hits.distance + np.float32(eye.view.near)
        for _ in range(MAX_LAYERS + 1):
            passed = np.empty(len(target), np.uint8)
            if not surface(
                rays.direction, travelled, hits.primitive, hits.barycentric, self._geometry, self._materials,
                eye.position, eye.forward, eye.cone, hidden, True, order, target, out, passed,
            ):  # fmt: skip
                return
            # Behind holes, culled faces and what is hidden.
            index = np.flatnonzero(passed)
            rays, step = continued(rays, hits.distance, index)
            with np.errstate(invalid="ignore"):  # a hit as far away as numbers go has nothing behind it
                travelled = travelled[index] + step - hits.distance[index]
            hits, target = self._tracer.closest_hit(rays), target[index]
            order = np.arange(len(index), dtype=np.int32)
            travelled += hits.distance
        self._miss(target, eye, out)

    def _miss(self, target: np.ndarray, eye: _Eye, out: SurfaceArrays) -> None:
        """Clear values for rays that passed MAX_LAYERS surfaces."""
        count = len(target)
        surface(
            np.zeros((count, 3), np.float32), np.zeros(count, np.float32), np.full(count, 0xFFFFFFFF, np.uint32),
            np.zeros((count, 2), np.float32), self._geometry, self._materials, eye.position, eye.forward, eye.cone,
            self._all_seen, True, np.arange(count, dtype=np.int32), target, out, np.empty(count, np.uint8),
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
