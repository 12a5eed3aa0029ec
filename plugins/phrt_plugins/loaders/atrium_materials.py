"""The atrium's materials by name: glTF metallic-roughness over the painted textures."""

from __future__ import annotations

from collections.abc import Sequence

from phrt.model import Image, Material, TextureRef

DYES = {
    "cloth_red": (0.55, 0.06, 0.05),
    "cloth_blue": (0.05, 0.13, 0.42),
    "cloth_green": (0.06, 0.28, 0.12),
    "cloth_ochre": (0.72, 0.38, 0.06),
}
GLASS_TINTS = {"glass_clear": (1.0, 1.0, 1.0), "glass_amber": (0.95, 0.62, 0.25), "glass_teal": (0.4, 0.85, 0.8)}


def make_materials(images: Sequence[Image]) -> list[Material]:
    """Every material of the atrium, in a fixed order. Texture coordinates are metres; textures scale them."""
    row = {image.name: index for index, image in enumerate(images)}

    def texture(name: str, metres: float) -> TextureRef:
        return TextureRef(image=row[name], scale=(1.0 / metres, 1.0 / metres))

    return [
        Material(
            "stone_blocks",
            roughness=0.9,
            base_color_texture=texture("stone_blocks", 2.4),
            normal_texture=texture("stone_blocks_normal", 2.4),
            normal_scale=0.7,
        ),
        Material("limestone", roughness=0.8, base_color_texture=texture("limestone", 1.5)),
        Material("voussoirs", roughness=0.85, base_color_texture=texture("voussoirs", 1.0)),
        Material("marble_white", roughness=0.35, base_color_texture=texture("marble_white", 1.2)),
        Material("marble_polished", roughness=0.06, base_color_texture=texture("marble_dark", 1.4)),
        Material(
            "floor_tiles",
            roughness=1.0,
            base_color_texture=texture("floor_tiles", 1.5),
            metallic_roughness_texture=texture("floor_tiles_roughness", 1.5),
        ),
        Material("gallery_tiles", roughness=0.75, base_color_texture=texture("gallery_tiles", 1.2)),
        Material("plaster", roughness=0.95, base_color_texture=texture("plaster", 2.0)),
        Material("terracotta", roughness=0.85, base_color_texture=texture("terracotta", 0.8)),
        Material("roof_tile", roughness=0.9, double_sided=True, base_color_texture=texture("terracotta", 1.6)),
        Material("wood", roughness=0.7, base_color_texture=texture("wood", 0.9)),
        Material("bronze", base_color=(0.72, 0.47, 0.22, 1.0), metallic=1.0, roughness=0.22),
        Material("iron", base_color=(0.09, 0.085, 0.08, 1.0), metallic=1.0, roughness=0.55),
        Material("leaf", base_color=(0.07, 0.2, 0.06, 1.0), roughness=0.5, double_sided=True),
        Material("earth", base_color=(0.09, 0.06, 0.04, 1.0), roughness=1.0),
        Material("water", base_color=(0.02, 0.07, 0.075, 1.0), roughness=0.02, ior=1.33),
        Material("mirror", base_color=(0.95, 0.95, 0.95, 1.0), metallic=1.0, roughness=0.0),
        Material("gold", base_color=(1.0, 0.77, 0.34, 1.0), metallic=1.0, roughness=0.05),
        Material("lamp", base_color=(1.0, 0.85, 0.6, 1.0), emissive=(6.0, 4.2, 2.2), roughness=0.4),
        *(
            Material(
                name,
                base_color=(*dye, 1.0),
                roughness=0.95,
                double_sided=True,
                base_color_texture=texture("cloth", 0.9),
                normal_texture=texture("cloth_normal", 0.225),
                normal_scale=0.4,
            )
            for name, dye in DYES.items()
        ),
        *(
            Material(
                name,
                roughness=0.0,
                transmission=1.0,
                ior=1.5,
                thickness=0.8,
                attenuation_color=tint,
                attenuation_distance=0.8 if min(tint) < 1 else float("inf"),
            )
            for name, tint in GLASS_TINTS.items()
        ),
    ]
