"""Embree 4's C interface, as much of it as the `embree` tracer uses: where the library is, its functions, its numbers.

Everything that has to agree with `embree4/rtcore.h` byte for byte is in this file; tests/backends/test_embree_abi.py
holds it to the answers of embreex's own compiled binding. Source: Embree 4 API (Wald et al. 2014, "Embree: A Kernel
Framework for Efficient CPU Ray Tracing"), https://github.com/RenderKit/embree.

A packet of 16 rays is a block of 32-bit words, row by row, 16 lanes a row, 64-byte aligned: `RTCRay16` is rows 0 to 11,
`RTCHit16` follows. Rows the tracer writes or reads have names here.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from phrt.errors import PhrtError

LANES = 16
ORIGIN_ROW, T_NEAR_ROW, DIRECTION_ROW, TIME_ROW, T_FAR_ROW, MASK_ROW, ID_ROW, FLAGS_ROW = 0, 3, 4, 7, 8, 9, 10, 11
NORMAL_ROW, U_ROW, V_ROW, PRIMITIVE_ROW, GEOMETRY_ROW, INSTANCE_ROW = 12, 15, 16, 17, 18, 19
PACKET_ROWS = 32
"""Rows to allocate: 21 are used with one level of instances, each further level would add two."""

INVALID_ID = 0xFFFFFFFF
GEOMETRY_TRIANGLE, GEOMETRY_INSTANCE = 0, 121
BUFFER_INDEX, BUFFER_VERTEX = 0, 1
FORMAT_UINT3, FORMAT_FLOAT3, FORMAT_FLOAT3X4_ROW_MAJOR = 0x5003, 0x9003, 0x9134
SCENE_ROBUST = 1 << 2
BUILD_QUALITY = {"low": 0, "medium": 1, "high": 2}
QUERY_COHERENT = 1 << 16
FEATURES_ALL = 0xFFFFFFFF
PROPERTY_VERSION_MAJOR, PROPERTY_VERSION_MINOR, PROPERTY_VERSION_PATCH = 1, 2, 3
PROPERTY_RAY16_SUPPORTED, PROPERTY_RAY_MASK_SUPPORTED = 34, 64

ERRORS = {1: "unknown error", 2: "invalid argument", 3: "invalid operation", 4: "out of memory", 5: "unsupported CPU"}

_HANDLE, _UINT, _SIZE = ctypes.c_void_p, ctypes.c_uint, ctypes.c_size_t
_PROTOTYPES: dict[str, tuple[type | None, list[type]]] = {
    "rtcNewDevice": (_HANDLE, [ctypes.c_char_p]),
    "rtcReleaseDevice": (None, [_HANDLE]),
    "rtcGetDeviceProperty": (ctypes.c_ssize_t, [_HANDLE, ctypes.c_int]),
    "rtcGetDeviceError": (ctypes.c_int, [_HANDLE]),
    "rtcNewScene": (_HANDLE, [_HANDLE]),
    "rtcReleaseScene": (None, [_HANDLE]),
    "rtcSetSceneFlags": (None, [_HANDLE, ctypes.c_int]),
    "rtcSetSceneBuildQuality": (None, [_HANDLE, ctypes.c_int]),
    "rtcCommitScene": (None, [_HANDLE]),
    "rtcAttachGeometryByID": (None, [_HANDLE, _HANDLE, _UINT]),
    "rtcDetachGeometry": (None, [_HANDLE, _UINT]),
    "rtcGetGeometry": (_HANDLE, [_HANDLE, _UINT]),
    "rtcNewGeometry": (_HANDLE, [_HANDLE, ctypes.c_int]),
    "rtcReleaseGeometry": (None, [_HANDLE]),
    "rtcCommitGeometry": (None, [_HANDLE]),
    "rtcSetGeometryMask": (None, [_HANDLE, _UINT]),
    "rtcSetGeometryInstancedScene": (None, [_HANDLE, _HANDLE]),
    "rtcSetGeometryTransform": (None, [_HANDLE, _UINT, ctypes.c_int, ctypes.c_void_p]),
    "rtcUpdateGeometryBuffer": (None, [_HANDLE, ctypes.c_int, _UINT]),
    "rtcSetSharedGeometryBuffer": (
        None,
        [_HANDLE, ctypes.c_int, _UINT, ctypes.c_int, ctypes.c_void_p, _SIZE, _SIZE, _SIZE],
    ),
}
_QUERIES = ("rtcIntersect16", "rtcOccluded16")


class QueryArguments(ctypes.Structure):
    """`RTCIntersectArguments` and `RTCOccludedArguments`, which have one layout. The null pointers mean "default"."""

    _fields_ = (
        ("flags", ctypes.c_uint32),
        ("feature_mask", ctypes.c_uint32),
        ("context", ctypes.c_void_p),
        ("filter", ctypes.c_void_p),
        ("intersect", ctypes.c_void_p),
        ("min_width_distance_factor", ctypes.c_float),
    )


class EmbreeError(PhrtError):
    """Embree refused a call, or the library cannot be used. The message says which and why."""


@dataclass(frozen=True)
class EmbreeLibrary:
    """The loaded library. functions: ctypes entry points; query_address: where the packet queries are."""

    path: Path
    functions: ctypes.CDLL
    query_address: dict[str, int]
    version: tuple[int, int, int]


def library_candidates() -> list[Path]:
    """Embree 4 libraries of the installed embreex package: wheels put them beside or inside it."""
    spec = importlib.util.find_spec("embreex")
    if spec is None or spec.origin is None:
        return []
    package = Path(spec.origin).parent
    folders = (package.parent / "embreex.libs", package / ".dylibs", package, package / "lib")
    patterns = {"win32": ("embree4*.dll",), "darwin": ("libembree4*.dylib",)}.get(sys.platform, ("libembree4*.so*",))
    return [
        path for folder in folders if folder.is_dir() for pattern in patterns for path in sorted(folder.glob(pattern))
    ]


@cache
def load_library() -> EmbreeLibrary:
    """Load Embree, check that it is version 4 with packets of 16 and ray masks, and declare its functions.

    Raises `EmbreeError` with the reason where there is no such library.
    """
    candidates = library_candidates()
    if not candidates:
        raise EmbreeError("no Embree 4 library beside the embreex package")
    path = candidates[0]
    try:
        if sys.platform == "win32":
            os.add_dll_directory(str(path.parent))
        functions = ctypes.CDLL(str(path))
        for name, (result, arguments) in _PROTOTYPES.items():
            function = getattr(functions, name)
            function.restype, function.argtypes = result, arguments
        addresses = {name: ctypes.cast(getattr(functions, name), ctypes.c_void_p).value or 0 for name in _QUERIES}
    except (OSError, AttributeError) as error:
        raise EmbreeError(f"{path.name} does not load as Embree 4: {error}") from error
    return EmbreeLibrary(path, functions, addresses, _checked_version(path, functions))


def _checked_version(path: Path, functions: ctypes.CDLL) -> tuple[int, int, int]:
    """Ask a device of the library what it is and what it can do."""
    device = functions.rtcNewDevice(None)
    if not device:
        raise EmbreeError(
            f"{path.name} cannot make a device: {ERRORS.get(functions.rtcGetDeviceError(None), 'unknown')}"
        )
    try:
        read = functions.rtcGetDeviceProperty
        version = tuple(
            read(device, p) for p in (PROPERTY_VERSION_MAJOR, PROPERTY_VERSION_MINOR, PROPERTY_VERSION_PATCH)
        )
        if version[0] != 4:
            raise EmbreeError(f"{path.name} is Embree {'.'.join(map(str, version))}, expected 4.x")
        if not read(device, PROPERTY_RAY16_SUPPORTED):
            raise EmbreeError(f"{path.name} has no packets of {LANES} rays on this processor")
        if not read(device, PROPERTY_RAY_MASK_SUPPORTED):
            raise EmbreeError(f"{path.name} is built without ray masks")
    finally:
        functions.rtcReleaseDevice(device)
    return version[0], version[1], version[2]
