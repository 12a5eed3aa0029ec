"""glTF materials, textures and samplers as phrt.model.Material and TextureRef."""

from __future__ import annotations

import math
from typing import cast

from phrt.model import AlphaMode, Material, TextureRef, Wrap
from phrt_plugins.loaders.gltf_images import Images
from phrt_plugins.loaders.gltf_json import Document, Element

WRAPS: dict[int, Wrap] = {33071: "clamp", 33648: "mirror", 10497: "repeat"}
NEAREST = 9728
MIN_FILTERS_WITHOUT_MIPMAPS = (9728, 9729)
MAX_UV_SETS = 2
EMPTY = Element({}, "")


def read_materials(document: Document, images: Images) -> list[Material]:
    """Every material of the file, by its glTF index."""
    reader = MaterialReader(document, images)
    return [reader.read(element) for element in document.lists["materials"]]


class MaterialReader:
    def __init__(self, document: Document, images: Images) -> None:
        self.document = document
        self.images = images

    def read(self, element: Element) -> Material:
        """One material with the KHR extensions PHRT shades."""
        pbr = element.child("pbrMetallicRoughness") or EMPTY
        material = Material(
            name=element.string("name", ""),
            base_color=cast(
                tuple[float, float, float, float], pbr.numbers("baseColorFactor", 4, (1.0, 1.0, 1.0, 1.0), low=0.0)
            ),
            metallic=pbr.number("metallicFactor", 1.0, 0.0, 1.0),
            roughness=pbr.number("roughnessFactor", 1.0, 0.0, 1.0),
            emissive=color(element, "emissiveFactor", (0.0, 0.0, 0.0)),
            alpha_mode=self.alpha_mode(element),
            alpha_cutoff=element.number("alphaCutoff", 0.5, low=0.0),
            double_sided=element.boolean("doubleSided"),
            unlit=element.extension("KHR_materials_unlit") is not None,
            base_color_texture=self.texture(pbr, "baseColorTexture"),
            metallic_roughness_texture=self.texture(pbr, "metallicRoughnessTexture"),
            normal_texture=self.texture(element, "normalTexture"),
            occlusion_texture=self.texture(element, "occlusionTexture"),
            emissive_texture=self.texture(element, "emissiveTexture"),
        )
        material.normal_scale = (element.child("normalTexture") or EMPTY).number("scale", 1.0)
        material.occlusion_strength = (element.child("occlusionTexture") or EMPTY).number("strength", 1.0, 0.0, 1.0)
        self.read_extensions(element, material)
        return material

    def read_extensions(self, element: Element, material: Material) -> None:
        """KHR_materials_emissive_strength, _ior, _specular, _transmission and _volume."""
        strength = (element.extension("KHR_materials_emissive_strength") or EMPTY).number(
            "emissiveStrength", 1.0, low=0.0
        )
        r, g, b = material.emissive
        material.emissive = (r * strength, g * strength, b * strength)
        # An index of refraction of 0 is KHR_materials_ior's way to say "infinite": reflect everything.
        ior = (element.extension("KHR_materials_ior") or EMPTY).number("ior", 1.5, low=0.0, high=100.0)
        material.ior = 100.0 if ior == 0 else max(ior, 1.0)
        specular = element.extension("KHR_materials_specular") or EMPTY
        material.specular = specular.number("specularFactor", 1.0, 0.0, 1.0)
        if color(specular, "specularColorFactor", (1.0, 1.0, 1.0)) != (1.0, 1.0, 1.0):
            self.document.warn("KHR_materials_specular's colour is not shaded; the factor alone is")
        self.warn_of_textures(specular, "KHR_materials_specular", ("specularTexture", "specularColorTexture"))
        transmission = element.extension("KHR_materials_transmission") or EMPTY
        material.transmission = transmission.number("transmissionFactor", 0.0, 0.0, 1.0)
        material.transmission_texture = self.texture(transmission, "transmissionTexture")
        volume = element.extension("KHR_materials_volume") or EMPTY
        material.thickness = volume.number("thicknessFactor", 0.0, low=0.0)
        # 0 is not allowed by the extension; exporters mean "no attenuation" by it.
        material.attenuation_distance = volume.number("attenuationDistance", math.inf, low=0.0) or math.inf
        material.attenuation_color = color(volume, "attenuationColor", (1.0, 1.0, 1.0))

    def warn_of_textures(self, element: Element, extension: str, keys: tuple[str, ...]) -> None:
        for key in keys:
            if key in element:
                self.document.warn(f"{extension}'s {key} is not shaded; the factor alone is")

    def alpha_mode(self, element: Element) -> AlphaMode:
        mode = element.string("alphaMode", "OPAQUE")
        if mode not in ("OPAQUE", "MASK", "BLEND"):
            element.fail("alphaMode", f"is '{mode}'; it must be OPAQUE, MASK or BLEND")
        return cast(AlphaMode, mode)

    def texture(self, owner: Element, key: str) -> TextureRef | None:
        """The texture a material names under `key`; None where there is none or its UV set is not read."""
        info = owner.child(key)
        if info is None:
            return None
        texture = self.document.lists["textures"][self.document.refer_required(info, "index", "textures")]
        transform = info.extension("KHR_texture_transform") or EMPTY
        uv_set = transform.integer("texCoord", info.integer("texCoord", 0))
        if uv_set >= MAX_UV_SETS:
            self.document.warn(
                f"{info.where} uses TEXCOORD_{uv_set}; only TEXCOORD_0 and TEXCOORD_1 are read, so it is left out"
            )
            return None
        sampler = self.sampler(texture)
        return TextureRef(
            image=self.images.use(texture),
            uv_set=uv_set,
            wrap_s=self.wrap(sampler, "wrapS"),
            wrap_t=self.wrap(sampler, "wrapT"),
            nearest=sampler.integer("magFilter", 9729) == NEAREST,
            mipmaps=sampler.integer("minFilter", 9987) not in MIN_FILTERS_WITHOUT_MIPMAPS,
            offset=cast(tuple[float, float], transform.numbers("offset", 2, (0.0, 0.0))),
            rotation=transform.number("rotation", 0.0),
            scale=cast(tuple[float, float], transform.numbers("scale", 2, (1.0, 1.0))),
        )

    def sampler(self, texture: Element) -> Element:
        index = self.document.refer(texture, "sampler", "samplers")
        return EMPTY if index is None else self.document.lists["samplers"][index]

    def wrap(self, sampler: Element, key: str) -> Wrap:
        mode = sampler.integer(key, 10497)
        if mode not in WRAPS:
            self.document.warn(f"{sampler.place(key)} is {mode}, which is no wrap mode; 'repeat' is used")
        return WRAPS.get(mode, "repeat")


def color(element: Element, key: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
    return cast(tuple[float, float, float], element.numbers(key, 3, default, low=0.0))
