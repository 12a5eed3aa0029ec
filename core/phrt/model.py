"""What a loader returns: meshes, materials, textures, lights, cameras and a node hierarchy, as plain data.

Everything here is independent of file formats and of backends. glTF 2.0 names and meanings are used throughout; the
`Scene` (phrt.scene) flattens one or several models into arrays.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

AlphaMode = Literal["OPAQUE", "MASK", "BLEND"]
Wrap = Literal["repeat", "clamp", "mirror"]


@dataclass
class Image:
    """Decoded pixels. `pixels` is (H, W, 4) uint8, row 0 at the top (v = 0, as in glTF)."""

    name: str
    pixels: np.ndarray


@dataclass
class TextureRef:
    """How a material looks into an image: sampler, UV set and KHR_texture_transform."""

    image: int
    uv_set: int = 0
    wrap_s: Wrap = "repeat"
    wrap_t: Wrap = "repeat"
    nearest: bool = False
    mipmaps: bool = True
    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0
    scale: tuple[float, float] = (1.0, 1.0)


@dataclass
class Material:
    """glTF 2.0 metallic-roughness with the KHR extensions PHRT shades. Colours linear, emissive in nits.

    `specular` is KHR_materials_specular's factor: 0 makes a dielectric purely diffuse.
    `attenuation_distance` is in metres; +inf means clear. `thickness` 0 means thin-walled: rays pass unbent.
    """

    name: str = ""
    base_color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    metallic: float = 0.0
    roughness: float = 1.0
    specular: float = 1.0
    ior: float = 1.5
    transmission: float = 0.0
    thickness: float = 0.0
    attenuation_color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    attenuation_distance: float = float("inf")
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    alpha_mode: AlphaMode = "OPAQUE"
    alpha_cutoff: float = 0.5
    double_sided: bool = False
    unlit: bool = False
    normal_scale: float = 1.0
    occlusion_strength: float = 1.0
    base_color_texture: TextureRef | None = None
    metallic_roughness_texture: TextureRef | None = None
    normal_texture: TextureRef | None = None
    occlusion_texture: TextureRef | None = None
    emissive_texture: TextureRef | None = None
    transmission_texture: TextureRef | None = None


@dataclass
class Mesh:
    """Triangles in local space. V vertices, T triangles; `None` where a file has no such attribute.

    positions (V, 3) float32 metres; normals (V, 3) float32 unit; tangents (V, 4) float32, w the handedness;
    uv0, uv1 (V, 2) float32; colors (V, 4) float32 linear; triangles (T, 3) int32;
    triangle_material (T,) int32, index into `Model.materials`, -1 for the default material.
    Counter-clockwise triangles face the front. Missing normals are made by `Scene` (flat, as glTF asks, unless
    `smooth` asks for area-weighted vertex normals).
    """

    name: str
    positions: np.ndarray
    triangles: np.ndarray
    triangle_material: np.ndarray
    normals: np.ndarray | None = None
    tangents: np.ndarray | None = None
    uv0: np.ndarray | None = None
    uv1: np.ndarray | None = None
    colors: np.ndarray | None = None
    smooth: bool = False


LightKind = Literal["point", "spot", "directional", "sphere", "rect"]


@dataclass
class Light:
    """A light in its node's local space; directional, spot and rect lights shine down -Z.

    intensity: candela (point, spot, sphere), lux (directional), nits (rect).
    radius: metres, of spheres. angle: full angular diameter of directional lights, radians. size: rect width, height.
    range: metres, glTF's cut-off; +inf for none. inner_angle, outer_angle: half-angles of spots, radians.
    """

    kind: LightKind
    name: str = ""
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    intensity: float = 1.0
    radius: float = 0.0
    angle: float = 0.0
    size: tuple[float, float] = (1.0, 1.0)
    range: float = float("inf")
    inner_angle: float = 0.0
    outer_angle: float = 0.7853981633974483
    casts_shadow: bool = True


@dataclass
class CameraLens:
    """A camera in its node's local space, looking down -Z. fov_y: radians; ortho_height: metres, makes it orthographic."""

    name: str = ""
    fov_y: float = 0.8
    near: float = 0.01
    far: float = float("inf")
    ortho_height: float | None = None
    exposure: float = 1.0
    aspect: float | None = None


@dataclass
class Track:
    """Keyframes of one property of one node: times (K,) seconds; values (K, 3), or (K, 4) quaternions x y z w.

    `cubic` values are (K, 3, C): in-tangent, value, out-tangent, as in glTF.
    """

    node: int
    target: Literal["translation", "rotation", "scale"]
    times: np.ndarray
    values: np.ndarray
    interpolation: Literal["step", "linear", "cubic"] = "linear"


@dataclass
class Node:
    """One node of the hierarchy. `matrix` is its local transform (4, 4) float64 at rest; parents precede children."""

    name: str
    parent: int = -1
    matrix: np.ndarray = field(default_factory=lambda: np.eye(4))
    meshes: list[int] = field(default_factory=list)
    light: int | None = None
    camera: int | None = None


@dataclass
class Model:
    """A file, read. `nodes` in an order where parents precede children; `tracks` animate nodes over time."""

    nodes: list[Node] = field(default_factory=list)
    meshes: list[Mesh] = field(default_factory=list)
    materials: list[Material] = field(default_factory=list)
    images: list[Image] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    cameras: list[CameraLens] = field(default_factory=list)
    tracks: list[Track] = field(default_factory=list)
