"""Lights, cameras and the list of extensions of a glTF file."""

from __future__ import annotations

import math
from typing import cast

from phrt.errors import AssetError
from phrt.model import CameraLens, Light, LightKind
from phrt_plugins.loaders.gltf_json import Document, Element
from phrt_plugins.loaders.gltf_materials import EMPTY, color

SUPPORTED = frozenset(
    {
        "EXT_mesh_gpu_instancing",
        "EXT_texture_webp",
        "KHR_draco_mesh_compression",
        "KHR_lights_punctual",
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_specular",
        "KHR_materials_transmission",
        "KHR_materials_unlit",
        "KHR_materials_volume",
        "KHR_mesh_quantization",
        "KHR_texture_transform",
    }
)
WITHOUT_EFFECT = frozenset({"KHR_xmp", "KHR_xmp_json_ld", "KHR_materials_variants", "MSFT_lod"})
"""Optional extensions whose absence changes nothing in the default picture."""


def check_version(document: Document) -> None:
    """AssetError unless the file is glTF 2.x, and readable by a reader of 2.0."""
    asset = document.root.required("asset")
    version = asset.string("version")
    if version.split(".")[0] != "2":
        asset.fail("version", f"is '{version}'; only glTF 2.0 is read")
    if asset.string("minVersion", "2.0") != "2.0":
        asset.fail("minVersion", f"is '{asset.string('minVersion')}'; only glTF 2.0 is read")


def check_extensions(document: Document) -> None:
    """AssetError for a required extension PHRT does not know, a warning for an optional one."""
    required = document.root.strings("extensionsRequired")
    unknown = sorted(set(required) - SUPPORTED)
    if unknown:
        raise AssetError(
            f"requires {', '.join(unknown)}, which PHRT does not support; it supports {', '.join(sorted(SUPPORTED))}"
        )
    for name in sorted(set(document.root.strings("extensionsUsed")) - SUPPORTED - WITHOUT_EFFECT):
        document.warn(f"uses the extension {name}, which is ignored")


def read_lights(document: Document) -> list[Light]:
    """The lights of KHR_lights_punctual, by their index."""
    return [read_light(element) for element in document.lists["lights"]]


def read_light(element: Element) -> Light:
    kind = element.string("type")
    if kind not in ("point", "spot", "directional"):
        element.fail("type", f"is '{kind}'; it must be point, spot or directional")
    spot = (element.child("spot") or EMPTY) if kind == "spot" else EMPTY
    outer = spot.number("outerConeAngle", math.pi / 4, 0.0, math.pi / 2)
    inner = spot.number("innerConeAngle", 0.0, 0.0, math.pi / 2)
    return Light(
        kind=cast(LightKind, kind),
        name=element.string("name", ""),
        color=color(element, "color", (1.0, 1.0, 1.0)),
        intensity=element.number("intensity", 1.0, low=0.0),
        # 0 is not allowed by the extension; exporters mean "no limit" by it.
        range=element.number("range", math.inf, low=0.0) or math.inf,
        inner_angle=min(inner, outer),
        outer_angle=outer,
    )


def read_cameras(document: Document) -> list[CameraLens]:
    """The cameras, by their glTF index."""
    return [read_camera(element) for element in document.lists["cameras"]]


def read_camera(element: Element) -> CameraLens:
    kind = element.string("type")
    if kind not in ("perspective", "orthographic"):
        element.fail("type", f"is '{kind}'; it must be perspective or orthographic")
    lens, name = element.required(kind), element.string("name", "")
    near = lens.number("znear", low=0.0)
    far = lens.number("zfar", math.inf, low=0.0)
    if far <= near:
        lens.fail("zfar", f"is {far:g}, not beyond znear, {near:g}")
    if kind == "perspective":
        fov = lens.number("yfov", low=1e-6, high=math.pi - 1e-6)
        aspect = lens.number("aspectRatio", low=1e-6) if "aspectRatio" in lens else None
        return CameraLens(name, fov, max(near, 1e-6), far, aspect=aspect)
    width, height = abs(lens.number("xmag")), abs(lens.number("ymag"))
    if not width or not height:
        lens.fail("ymag" if width else "xmag", "is 0")
    return CameraLens(name, near=near, far=far, ortho_height=2 * height, aspect=width / height)
