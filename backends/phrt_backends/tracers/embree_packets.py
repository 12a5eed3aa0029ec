"""Embree through its own C interface, in packets of 16 rays from numba. The fast way of the `embree` tracer.

Every object is a geometry whose id is the object's. One static scene holds those that stand still and is the root while
none moves. Objects that the scene's animation moves get scenes of their own from the start, each in its local space, and are
instances in a small top scene: moving them costs a commit of the top alone. An object that is moved by hand leaves the
static scene the first time, at the price of one rebuild.
"""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING

import numpy as np

from phrt.interfaces.tracer import Tracer, TracerCapabilities
from phrt.rays import HitBatch, RayBatch
from phrt_backends.options import EmbreeOptions
from phrt_backends.tracers import embree_abi as abi
from phrt_backends.tracers import embree_kernels as kernels
from phrt_backends.tracers.embree_scene import EmbreeDevice, EmbreeScene

if TYPE_CHECKING:
    from phrt.world import Changes, World

_STATIC_INSTANCE = 0
"""Geometry id of the static scene in the top scene: object 0 is the background and has no geometry."""

_SMALLEST_SCALE = 1e-6
"""Matrices with a smaller ratio of singular values are not inverted: the object is placed by its world positions."""


class EmbreePackets(Tracer):
    """See the module. Raises `EmbreeError` where the library is missing or not Embree 4."""

    def __init__(self, options: EmbreeOptions) -> None:
        self.options = options
        self.library = abi.load_library()
        kernels.bind_queries(self.library)
        version = ".".join(map(str, self.library.version))
        self.capabilities = TracerCapabilities(
            description=f"Embree {version}, packets of {abi.LANES} through its C interface ({self.library.path.name})",
        )
        self._arguments = {flag: _query_arguments(flag) for flag in (False, True)}
        self._device: EmbreeDevice | None = None
        self._scenes: dict[int, EmbreeScene] = {}
        self._top: EmbreeScene | None = None
        self._flat: set[int] = set()
        self._root = 0

    def build(self, world: World) -> None:
        self.close()
        self._device = EmbreeDevice(self.library)
        self._first_triangle = np.ascontiguousarray(world.first_triangle, dtype=np.int32)
        vertices = _padded(world.positions)
        triangles = np.ascontiguousarray(world.triangles, dtype=np.int32)
        static = self._new_scene()
        movers = [object_id for object_id in world.moving_objects if world.triangle_count[object_id]]
        for object_id in np.setdiff1d(np.flatnonzero(world.triangle_count), movers):
            first = int(world.first_triangle[object_id])
            part = triangles[first : first + int(world.triangle_count[object_id])]
            static.attach_triangles(int(object_id), vertices, part, _mask(world, int(object_id)))
        static.commit()
        self._scenes[_STATIC_INSTANCE] = static
        self._root = static.handle
        if movers:
            self._place_movers(world, movers)

    def update(self, world: World, changes: Changes) -> None:
        moved = [object_id for object_id in changes.objects if world.triangle_count[object_id]]
        if not moved:
            return
        known = [object_id for object_id in moved if object_id in self._scenes]
        self._leave_static([object_id for object_id in moved if object_id not in self._scenes])
        for object_id in set(known) & set(changes.turned):
            self._scenes[object_id].rewrite_triangles(object_id, _object_triangles(world, object_id))
            self._scenes[object_id].commit()
        self._place_movers(world, moved)

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        count = len(rays)
        distance, primitive = np.empty(count, np.float32), np.empty(count, np.uint32)
        barycentric = np.empty((count, 2), np.float32)
        arguments = ctypes.addressof(self._arguments[rays.coherent])
        mask = kernels.OPAQUE if rays.opaque_only else kernels.SEEN
        if rays.casters_only:
            mask = kernels.CASTS_SHADOW
        kernels.closest_hit_packets(
            self._committed_root(),
            arguments,
            mask,
            self._first_triangle,
            *_plain(rays),
            distance,
            primitive,
            barycentric,
        )
        return HitBatch(distance, primitive, barycentric)

    def occluded(self, rays: RayBatch) -> np.ndarray:
        blocked = np.empty(len(rays), bool)
        arguments = ctypes.addressof(self._arguments[rays.coherent])
        kernels.occluded_packets(self._committed_root(), arguments, *_plain(rays), blocked)
        return blocked

    def close(self) -> None:
        self._root = 0
        scenes = [*self._scenes.values(), *([self._top] if self._top else [])]
        for scene in scenes:
            scene.release()
        self._scenes, self._top, self._flat = {}, None, set()
        if self._device is not None:
            self._device.release()
            self._device = None

    def _committed_root(self) -> int:
        if not self._root:
            raise abi.EmbreeError("the tracer has no scene: call build first, and nothing after close")
        return self._root

    def _new_scene(self) -> EmbreeScene:
        assert self._device is not None
        return EmbreeScene(self._device, self.options.build_quality, self.options.robust)

    def _leave_static(self, objects: list[int]) -> None:
        """Take `objects` out of the static scene, once."""
        if not objects:
            return
        static = self._scenes[_STATIC_INSTANCE]
        for object_id in objects:
            static.detach(object_id)
        static.commit()
        if self._top is not None:
            self._top.move_instance(_STATIC_INSTANCE, np.eye(4))  # its bounds may have shrunk

    def _place_movers(self, world: World, objects: list[int]) -> None:
        """Bring `objects` to where they are now, as instances of their own scenes in the top scene, which becomes the root."""
        if self._top is None:
            self._top = self._new_scene()
            self._top.attach_instance(_STATIC_INSTANCE, self._scenes[_STATIC_INSTANCE], np.eye(4))
        for object_id in objects:
            if object_id not in self._scenes:
                scene = self._new_scene()
                vertices = _padded(world.local_positions[_vertex_range(world, object_id)])
                scene.attach_triangles(
                    object_id, vertices, _object_triangles(world, object_id), _mask(world, object_id)
                )
                scene.commit()
                self._scenes[object_id] = scene
                self._top.attach_instance(object_id, scene, np.eye(4))
            self._top.move_instance(object_id, self._placement(world, object_id))
        self._top.commit()
        self._root = self._top.handle

    def _placement(self, world: World, object_id: int) -> np.ndarray:
        """The instance's transform (4, 4). A matrix Embree cannot invert gives way to world positions and identity."""
        matrix = np.asarray(world.object_matrix[object_id], dtype=np.float64)
        scales = np.linalg.svd(matrix[:3, :3], compute_uv=False)
        flat = bool(scales[2] <= _SMALLEST_SCALE * scales[0])
        if flat or object_id in self._flat:
            source = world.positions if flat else world.local_positions
            self._scenes[object_id].rewrite_vertices(object_id, source[_vertex_range(world, object_id)])
            self._scenes[object_id].commit()
            (self._flat.add if flat else self._flat.discard)(object_id)
        return np.eye(4) if flat else matrix


def _query_arguments(coherent: bool) -> abi.QueryArguments:
    return abi.QueryArguments(flags=abi.QUERY_COHERENT if coherent else 0, feature_mask=abi.FEATURES_ALL)


def _mask(world: World, object_id: int) -> int:
    mask = kernels.SEEN
    if world.object_casts_shadow[object_id]:
        mask |= kernels.CASTS_SHADOW
    if world.object_opaque[object_id]:
        mask |= kernels.OPAQUE
    return int(mask)


def _padded(positions: np.ndarray) -> np.ndarray:
    """A copy of `positions` (V, 3) as float32 (V + 1, 3): Embree reads four bytes past the last vertex."""
    vertices = np.zeros((len(positions) + 1, 3), np.float32)
    vertices[:-1] = positions
    return vertices


def _vertex_range(world: World, object_id: int) -> slice:
    first = int(world.first_vertex[object_id])
    return slice(first, first + int(world.vertex_count[object_id]))


def _object_triangles(world: World, object_id: int) -> np.ndarray:
    """The triangles (T, 3) int32 of one object, counting from its first vertex; a copy."""
    first = int(world.first_triangle[object_id])
    triangles = world.triangles[first : first + int(world.triangle_count[object_id])] - world.first_vertex[object_id]
    return np.ascontiguousarray(triangles, np.int32)


def _plain(rays: RayBatch) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The three arrays as the kernels are compiled for; no copy where the batch keeps its contract."""
    return (
        np.ascontiguousarray(rays.origin, np.float32),
        np.ascontiguousarray(rays.direction, np.float32),
        np.ascontiguousarray(rays.t_max, np.float32),
    )
