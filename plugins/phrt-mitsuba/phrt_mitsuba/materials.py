"""Materials of PHRT (glTF 2.0) as Mitsuba's BSDFs: dictionaries for `load_dict`.

    dielectric without specular                     diffuse                     the same
    metal below MIRROR_ROUGHNESS                    conductor                   reflects its colour; no Fresnel at grazing angles
    dielectric below MIRROR_ROUGHNESS               plastic                     a coat over a diffuse base
    other opaque ones                               principled                  Disney's diffuse lobe, which brightens towards edges
    glass                                           dielectric, roughdielectric the same; see `phrt_mitsuba.surfaces` for absorption
    thin walls                                      thindielectric              reflects within the wall, too
    part transmission                               blendbsdf of the two
    alpha                                           mask
    normal map                                      normalmap

PHRT takes from a diffuse body what its surface reflects, Disney's model does not: base colours of `principled` are smaller by
the reflectance at normal incidence, which makes both equal there. docs/packages/mitsuba.md has what remains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from phrt.materials import absorption
from phrt.model import Material
from phrt_mitsuba.textures import Spectrum, Textures, constant

MIRROR_ROUGHNESS = 0.02
"""Below this PHRT takes surfaces for perfect mirrors (`phrt.kernels.light`)."""
BLACK = (0.0, 0.0, 0.0)


@dataclass
class Materials:
    """glowing: for the picture of what surfaces emit by themselves, in which nothing is diffuse: PHRT shows emission, in mirrors
    and through glass, too, and lights nothing with it."""

    textures: Textures
    glowing: bool = False

    def bsdf(self, material: Material, *, normal_mapped: bool) -> Spectrum:
        """normal_mapped: has the mesh what normal maps need?"""
        if material.unlit:
            made: Spectrum = {"type": "diffuse", "reflectance": constant(BLACK)}
        else:
            made = self.mixed(material, normal_mapped)
        if material.alpha_mode == "OPAQUE":
            return made
        cutoff = material.alpha_cutoff if material.alpha_mode == "MASK" else None
        opacity = self.textures.opacity(material.base_color_texture, material.base_color[3], cutoff)
        return {"type": "mask", "opacity": opacity, "bsdf": made}

    def mixed(self, material: Material, normal_mapped: bool) -> Spectrum:
        """What reflects and what lets through, by their shares."""
        share = self.textures.channel(material.transmission_texture, 0, material.transmission)
        if share == 0.0:
            return self.facing(self.opaque(material), material, normal_mapped, both_sides=True)
        through = self.facing(self.glass(material), material, normal_mapped, both_sides=False)
        if share == 1.0:
            return through
        opaque = self.facing(self.opaque(material), material, normal_mapped, both_sides=True)
        return {"type": "blendbsdf", "weight": share, "bsdf_0": opaque, "bsdf_1": through}

    def facing(self, bsdf: Spectrum, material: Material, normal_mapped: bool, *, both_sides: bool) -> Spectrum:
        """`bsdf` with its normal map, and on both sides."""
        if material.normal_texture is not None and normal_mapped:
            bends = self.textures.normals(material.normal_texture, material.normal_scale)
            bsdf = {"type": "normalmap", "normalmap": bends, "bsdf": bsdf}
        return {"type": "twosided", "bsdf": bsdf} if both_sides else bsdf

    def opaque(self, material: Material) -> Spectrum:
        textures, rough = self.textures, material.metallic_roughness_texture
        f0 = ((material.ior - 1) / (material.ior + 1)) ** 2 * material.specular
        metallic = self.metallic(material)
        smooth = rough is None and material.roughness < MIRROR_ROUGHNESS
        if metallic == 0.0 and f0 == 0.0:
            return {"type": "diffuse", "reflectance": self.base_color(material, body=True)}
        if metallic == 1.0 and smooth:
            color = self.base_color(material, body=False)
            return {"type": "conductor", "material": "none", "specular_reflectance": color}
        eta = (1 + math.sqrt(f0)) / (1 - math.sqrt(f0)) if f0 < 1 else 100.0
        if metallic == 0.0 and smooth:
            color = self.base_color(material, body=True)
            return {"type": "plastic", "diffuse_reflectance": color, "int_ior": eta, "ext_ior": 1.0}
        return {
            "type": "principled",
            "base_color": self.base_color(material, body=metallic != 1.0, share=1 - f0 if metallic == 0.0 else 1.0),
            "roughness": textures.channel(rough, 1, material.roughness),
            "metallic": metallic,
            "eta": max(eta, 1.0001),
        }

    def metallic(self, material: Material) -> Spectrum | float:
        """0 also where the texture is 0 nearly everywhere, as it is for what is no metal."""
        ref = material.metallic_roughness_texture
        if ref is not None and self.textures.values(ref, 2).mean() * material.metallic < 0.01:
            return 0.0
        return self.textures.channel(ref, 2, material.metallic)

    def base_color(self, material: Material, *, body: bool, share: float = 1.0) -> Spectrum:
        """body: is it the colour of a diffuse body, which the picture of what glows has not?"""
        if self.glowing and body:
            return constant(BLACK)
        factor = [channel * share for channel in material.base_color[:3]]
        return self.textures.color(material.base_color_texture, factor)

    def glass(self, material: Material) -> Spectrum:
        if material.metallic_roughness_texture is not None:
            self.textures.notes.add("roughness maps of glass")
        rough = material.thickness > 0 and material.roughness >= MIRROR_ROUGHNESS
        kind = "thindielectric" if material.thickness <= 0 else "roughdielectric" if rough else "dielectric"
        made: Spectrum = {
            "type": kind,
            "int_ior": float(material.ior),
            "ext_ior": 1.0,
            "specular_transmittance": self.textures.color(material.base_color_texture, material.base_color[:3]),
        }
        return made | ({"distribution": "ggx", "alpha": material.roughness**2} if rough else {})

    def emission(self, material: Material) -> Spectrum | None:
        """What the surface shows by itself, nits; None for nothing."""
        if material.unlit:
            return self.textures.color(material.base_color_texture, material.base_color[:3])
        if not any(material.emissive):
            return None
        return self.textures.color(material.emissive_texture, material.emissive)


def absorbed_inside(material: Material) -> tuple[float, float, float]:
    """What a thick body absorbs, per metre."""
    return absorption(material) if material.transmission and material.thickness > 0 else BLACK


def lets_light_pass(material: Material) -> bool:
    """Do shadow rays go through it, at least in part?"""
    thin = material.transmission > 0 and material.thickness <= 0
    return thin or material.alpha_mode != "OPAQUE"
