"""Embree's device, scenes and geometries as small objects: every step checked, every handle released once."""

from __future__ import annotations

import weakref

import numpy as np

from phrt_backends.tracers import embree_abi as abi

ALL_MASK = 0xFFFFFFFF


class EmbreeDevice:
    """One RTCDevice. `check` turns Embree's silent error code into an exception."""

    def __init__(self, library: abi.EmbreeLibrary) -> None:
        self.functions = library.functions
        self.handle: int = self.functions.rtcNewDevice(None)
        if not self.handle:
            raise abi.EmbreeError("Embree cannot make a device")
        self.release = weakref.finalize(self, self.functions.rtcReleaseDevice, self.handle)

    def check(self, doing: str) -> None:
        """Raise `EmbreeError` when a call since the last check failed on this thread; `doing` says what it was for."""
        code = self.functions.rtcGetDeviceError(self.handle)
        if code:
            raise abi.EmbreeError(f"Embree failed while {doing}: {abi.ERRORS.get(code, f'error {code}')}")


class EmbreeScene:
    """One RTCScene and the numpy arrays its geometries share with it."""

    def __init__(self, device: EmbreeDevice, build_quality: str, robust: bool) -> None:
        self.device = device
        functions = device.functions
        self.handle: int = functions.rtcNewScene(device.handle)
        device.check("making a scene")
        self.release = weakref.finalize(self, functions.rtcReleaseScene, self.handle)
        functions.rtcSetSceneFlags(self.handle, abi.SCENE_ROBUST if robust else 0)
        functions.rtcSetSceneBuildQuality(self.handle, abi.BUILD_QUALITY[build_quality])
        self._shared: dict[int, tuple[np.ndarray, ...]] = {}

    def attach_triangles(self, geometry_id: int, vertices: np.ndarray, triangles: np.ndarray, mask: int) -> None:
        """Attach triangles (T, 3) int32 of `vertices` (V + 1, 3) float32, both C-contiguous and shared, not copied.

        The last row of `vertices` is padding: Embree reads 16 bytes from the start of every vertex.
        """
        functions, vertex_count = self.device.functions, len(vertices) - 1
        geometry = functions.rtcNewGeometry(self.device.handle, abi.GEOMETRY_TRIANGLE)
        self.device.check("making a geometry")
        for kind, format_, array, count in (
            (abi.BUFFER_VERTEX, abi.FORMAT_FLOAT3, vertices, vertex_count),
            (abi.BUFFER_INDEX, abi.FORMAT_UINT3, triangles, len(triangles)),
        ):
            functions.rtcSetSharedGeometryBuffer(geometry, kind, 0, format_, array.ctypes.data, 0, 12, count)
        functions.rtcSetGeometryMask(geometry, mask)
        self._attach(geometry_id, geometry)
        self._shared[geometry_id] = (vertices, triangles)

    def attach_instance(self, geometry_id: int, scene: EmbreeScene, transform: np.ndarray) -> None:
        """Attach `scene`, committed, placed by `transform` (4, 4)."""
        functions = self.device.functions
        geometry = functions.rtcNewGeometry(self.device.handle, abi.GEOMETRY_INSTANCE)
        self.device.check("making an instance")
        functions.rtcSetGeometryInstancedScene(geometry, scene.handle)
        functions.rtcSetGeometryMask(geometry, ALL_MASK)
        self._set_transform(geometry, transform)
        self._attach(geometry_id, geometry)

    def move_instance(self, geometry_id: int, transform: np.ndarray) -> None:
        """Give instance `geometry_id` another `transform` (4, 4); takes effect with the next `commit`."""
        geometry = self.device.functions.rtcGetGeometry(self.handle, geometry_id)
        self._set_transform(geometry, transform)
        self.device.functions.rtcCommitGeometry(geometry)
        self.device.check("moving an instance")

    def rewrite_vertices(self, geometry_id: int, positions: np.ndarray) -> None:
        """Give triangles `geometry_id` new `positions` (V, 3); takes effect with the next `commit`."""
        functions = self.device.functions
        self._shared[geometry_id][0][:-1] = positions
        geometry = functions.rtcGetGeometry(self.handle, geometry_id)
        functions.rtcUpdateGeometryBuffer(geometry, abi.BUFFER_VERTEX, 0)
        functions.rtcCommitGeometry(geometry)
        self.device.check("updating vertices")

    def rewrite_triangles(self, geometry_id: int, triangles: np.ndarray) -> None:
        """Give geometry `geometry_id` as many other `triangles` (T, 3); takes effect with the next `commit`."""
        functions = self.device.functions
        self._shared[geometry_id][1][:] = triangles
        geometry = functions.rtcGetGeometry(self.handle, geometry_id)
        functions.rtcUpdateGeometryBuffer(geometry, abi.BUFFER_INDEX, 0)
        functions.rtcCommitGeometry(geometry)
        self.device.check("updating triangles")

    def detach(self, geometry_id: int) -> None:
        """Take a geometry out; takes effect with the next `commit`."""
        self.device.functions.rtcDetachGeometry(self.handle, geometry_id)
        self._shared.pop(geometry_id, None)
        self.device.check("detaching a geometry")

    def commit(self) -> None:
        """Build or rebuild what changed."""
        self.device.functions.rtcCommitScene(self.handle)
        self.device.check("building a BVH")

    def _set_transform(self, geometry: int, transform: np.ndarray) -> None:
        rows = np.ascontiguousarray(transform[:3], dtype=np.float32)
        self.device.functions.rtcSetGeometryTransform(geometry, 0, abi.FORMAT_FLOAT3X4_ROW_MAJOR, rows.ctypes.data)

    def _attach(self, geometry_id: int, geometry: int) -> None:
        """Commit and attach, then give up our own reference: the scene keeps its own."""
        functions = self.device.functions
        functions.rtcCommitGeometry(geometry)
        functions.rtcAttachGeometryByID(self.handle, geometry, geometry_id)
        functions.rtcReleaseGeometry(geometry)
        self.device.check(f"attaching geometry {geometry_id}")
