"""The groups of arrays kernels take, by name; made by `World`, by the G-buffer and by chunks of secondary hits."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from phrt.channels import GBuffer
    from phrt.world import World


class GeometryArrays(NamedTuple):
    """See `World` for shapes and meaning."""

    positions: np.ndarray
    normals: np.ndarray
    tangents: np.ndarray
    uv0: np.ndarray
    uv1: np.ndarray
    colors: np.ndarray
    triangles: np.ndarray
    triangle_object: np.ndarray
    triangle_material: np.ndarray
    triangle_lod: np.ndarray


class MaterialArrays(NamedTuple):
    """Material table and texture atlas, see phrt.materials and phrt.textures. texels: (n,) uint32, r g b a from the lowest byte."""

    materials: np.ndarray
    texels: np.ndarray
    textures: np.ndarray
    level_start: np.ndarray


class EnvironmentArrays(NamedTuple):
    """See `Environment`; `sharp` is (1, S, S, 3) here, so that one lookup serves both."""

    sharp: np.ndarray
    blurred: np.ndarray
    irradiance: np.ndarray


class SurfaceArrays(NamedTuple):
    """n surface points: a G-buffer's pixels in one row, or the hits of a chunk of rays. Shapes and units as in CHANNELS."""

    position: np.ndarray
    normal: np.ndarray
    geometric_normal: np.ndarray
    uv: np.ndarray
    depth: np.ndarray
    object_id: np.ndarray
    primitive_id: np.ndarray
    material_id: np.ndarray
    base_color: np.ndarray
    alpha: np.ndarray
    metallic: np.ndarray
    roughness: np.ndarray
    transmission: np.ndarray
    occlusion: np.ndarray
    emissive: np.ndarray


CHANNEL_OF = {
    "position": "position_world",
    "normal": "normal_world",
    "geometric_normal": "normal_geometric_world",
}


def geometry_arrays(world: World) -> GeometryArrays:
    return GeometryArrays(*(getattr(world, name) for name in GeometryArrays._fields))


def material_arrays(world: World) -> MaterialArrays:
    atlas = world.textures
    return MaterialArrays(world.materials, atlas.texels.reshape(-1).view("<u4"), atlas.table, atlas.level_start)


def environment_arrays(world: World) -> EnvironmentArrays:
    environment = world.environment
    return EnvironmentArrays(environment.sharp[None], environment.blurred, environment.irradiance)


def surface_arrays(gbuffer: GBuffer) -> SurfaceArrays:
    """The pixels of `gbuffer` as surface points: views, not copies."""
    return SurfaceArrays(*(gbuffer.flat(CHANNEL_OF.get(name, name)) for name in SurfaceArrays._fields))


def empty_surfaces(count: int) -> SurfaceArrays:
    """Uninitialised surface points for `count` hits."""
    f, u = np.float32, np.uint32
    return SurfaceArrays(
        np.empty((count, 3), f),
        np.empty((count, 3), f),
        np.empty((count, 3), f),
        np.empty((count, 2), f),
        np.empty(count, f),
        np.empty(count, u),
        np.empty(count, u),
        np.empty(count, u),
        np.empty((count, 3), f),
        np.empty(count, f),
        np.empty(count, f),
        np.empty(count, f),
        np.empty(count, f),
        np.empty(count, f),
        np.empty((count, 3), f),
    )
