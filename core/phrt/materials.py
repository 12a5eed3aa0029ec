"""Materials as one structured array, which kernels index by material id."""

from __future__ import annotations

import numpy as np

from phrt.model import Material, TextureRef

ALPHA_OPAQUE, ALPHA_MASK, ALPHA_BLEND = 0, 1, 2
NO_TEXTURE = -1

TEXTURE_SLOTS = (
    "base_color_texture",
    "metallic_roughness_texture",
    "normal_texture",
    "occlusion_texture",
    "emissive_texture",
    "transmission_texture",
)

MATERIAL_DTYPE = np.dtype(
    [
        ("base_r", np.float32),
        ("base_g", np.float32),
        ("base_b", np.float32),
        ("alpha", np.float32),
        ("metallic", np.float32),
        ("roughness", np.float32),
        ("specular", np.float32),
        ("ior", np.float32),
        ("transmission", np.float32),
        ("thin", np.int32),
        ("absorb_r", np.float32),
        ("absorb_g", np.float32),
        ("absorb_b", np.float32),
        ("emissive_r", np.float32),
        ("emissive_g", np.float32),
        ("emissive_b", np.float32),
        ("alpha_mode", np.int32),
        ("alpha_cutoff", np.float32),
        ("double_sided", np.int32),
        ("unlit", np.int32),
        ("normal_scale", np.float32),
        ("occlusion_strength", np.float32),
        *((slot, np.int32) for slot in TEXTURE_SLOTS),
    ]
)
"""absorb_*: Beer-Lambert coefficient per metre. *_texture: row of the texture table, or NO_TEXTURE."""


def absorption(material: Material) -> tuple[float, float, float]:
    """Beer-Lambert coefficient per metre: exp(-absorption * attenuation_distance) = attenuation_color (KHR_materials_volume)."""
    if not np.isfinite(material.attenuation_distance) or material.attenuation_distance <= 0:
        return (0.0, 0.0, 0.0)
    r, g, b = (-np.log(max(c, 1e-4)) / material.attenuation_distance for c in material.attenuation_color)
    return (float(r), float(g), float(b))


def material_table(materials: list[Material], texture_row: dict[tuple[int, str], int]) -> np.ndarray:
    """The table of `materials`, row 0 a white default and `materials[i]` in row i + 1.

    texture_row : row of the texture table of material i's slot, for every slot that has a texture.
    """
    table = np.zeros(len(materials) + 1, dtype=MATERIAL_DTYPE)
    for row, material in enumerate([Material(), *materials]):
        record = table[row]
        record["base_r"], record["base_g"], record["base_b"], record["alpha"] = material.base_color
        for name in (
            "metallic",
            "roughness",
            "specular",
            "ior",
            "transmission",
            "alpha_cutoff",
            "normal_scale",
            "occlusion_strength",
        ):
            record[name] = getattr(material, name)
        record["absorb_r"], record["absorb_g"], record["absorb_b"] = absorption(material)
        record["emissive_r"], record["emissive_g"], record["emissive_b"] = material.emissive
        record["alpha_mode"] = {"OPAQUE": ALPHA_OPAQUE, "MASK": ALPHA_MASK, "BLEND": ALPHA_BLEND}[material.alpha_mode]
        record["thin"] = material.thickness <= 0
        record["double_sided"] = material.double_sided
        record["unlit"] = material.unlit
        for slot in TEXTURE_SLOTS:
            record[slot] = texture_row.get((row - 1, slot), NO_TEXTURE)
    return table


def texture_refs(materials: list[Material]) -> list[tuple[tuple[int, str], TextureRef]]:
    """Every (material index, slot) that has a texture, with its reference, in a fixed order."""
    return [
        ((index, slot), ref)
        for index, material in enumerate(materials)
        for slot in TEXTURE_SLOTS
        if (ref := getattr(material, slot)) is not None
    ]
