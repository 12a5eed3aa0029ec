"""Materials on the graphics side: one uniform block row each, their textures, and what a draw needs to have bound."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from phrt.materials import ALPHA_BLEND, ALPHA_MASK, NO_TEXTURE, texture_refs
from phrt.textures import SRGB_SLOTS, WRAPS
from phrt.world import World
from phrt_backends.gbuffers.moderngl_shaders import SAMPLERS

BLOCK_BYTES = 256
"""A row of the uniform buffer: the block's 256 bytes at the largest offset alignment OpenGL may ask for."""
SRGB8_ALPHA8 = 0x8C43


@dataclass(frozen=True)
class DrawState:
    """What must be set for a draw; equal states may share one. block: row of the uniform buffer, or -1 when unused;
    textures: (unit, texture table row) for every map the requested channels need."""

    features: frozenset[str]
    block: int
    double_sided: bool
    textures: tuple[tuple[int, int], ...]


class MaterialSet:
    """Uniform buffer, textures and samplers of a world's materials."""

    def __init__(self, gl: Any, world: World) -> None:
        self._gl = gl
        self._materials = world.materials
        self._table = world.textures.table
        self._has_uv1, self._has_colors, self._has_tangents = (
            len(world.uv1) > 0,
            len(world.colors) > 0,
            len(world.tangents) > 0,
        )
        self._blocks = gl.buffer(_block_rows(world).tobytes())
        self._textures: dict[int, Any] = {}
        self._owned: list[Any] = [self._blocks]
        self._upload(world)

    def state(self, row: int, channels: frozenset[str]) -> DrawState:
        """What material `row` needs bound when `channels` (`Layout.drawn`) are drawn."""
        material = self._materials[row]
        masked, blended = material["alpha_mode"] == ALPHA_MASK, material["alpha_mode"] == ALPHA_BLEND
        unlit = bool(material["unlit"]) and "emissive" in channels
        needs_color = bool(masked or unlit or "base_color" in channels or (blended and "alpha" in channels))
        wanted = {
            "base_color_texture": needs_color,
            "metallic_roughness_texture": bool({"metallic", "roughness"} & channels),
            "normal_texture": "normal_world" in channels and self._has_tangents,
            "emissive_texture": "emissive" in channels and not unlit,
            "transmission_texture": "transmission" in channels,
            "occlusion_texture": "occlusion" in channels,
        }
        slots = [slot for slot, needed in wanted.items() if needed and material[slot] != NO_TEXTURE]
        switches = {
            "COLORS": needs_color and self._has_colors,
            "ALPHA_MASK": bool(masked),
            "ALPHA_BLEND": bool(blended) and "alpha" in channels,
            "UNLIT": unlit,
            "UV1": self._has_uv1 and any(self._table[material[slot]]["uv_set"] for slot in slots),
            "UV_TRANSFORM": any(_is_transformed(self._table[material[slot]]) for slot in slots),
            "UV_MIRROR": any(_mirrored(self._table[material[slot]]) for slot in slots),
        }
        features = frozenset({SAMPLERS[slot] for slot in slots} | {name for name, on in switches.items() if on})
        units = list(SAMPLERS)
        return DrawState(
            features=features,
            block=row if features or channels - {"alpha", "normal_world"} else -1,
            double_sided=bool(material["double_sided"]),
            textures=tuple((units.index(slot), int(material[slot])) for slot in slots),
        )

    def constant(self, channel: str) -> np.ndarray:
        """(materials, components) float32: the values of a channel that is not in `varying_channels`."""
        fields = ["emissive_r", "emissive_g", "emissive_b"] if channel == "emissive" else [channel]
        if channel in ("alpha", "occlusion"):
            return np.ones((len(self._materials), 1), np.float32)
        return np.stack([self._materials[field] for field in fields], axis=1).astype(np.float32)

    def bind(self, state: DrawState) -> None:
        """Bind the uniform block and the textures of `state`."""
        if state.block >= 0:
            self._blocks.bind_to_uniform_block(0, offset=state.block * BLOCK_BYTES, size=BLOCK_BYTES)
        for unit, row in state.textures:
            texture, sampler = self._textures[row]
            texture.use(location=unit)
            sampler.use(location=unit)

    def release(self) -> None:
        """Give textures, samplers and buffers back."""
        for resource in self._owned:
            resource.release()
        self._owned.clear()

    def _upload(self, world: World) -> None:
        images: dict[tuple[int, bool, bool], Any] = {}
        samplers: dict[tuple[bool, bool, bool, bool], Any] = {}
        for (material, slot), ref in texture_refs(world.scene.materials):
            row = world.textures.rows[material, slot]
            if slot not in SAMPLERS or row in self._textures:
                continue
            mipmaps = ref.mipmaps and not ref.nearest
            source = (ref.image, slot in SRGB_SLOTS, mipmaps)
            if source not in images:
                images[source] = self._texture(world.scene.images[ref.image].pixels, srgb=source[1], mipmaps=mipmaps)
            kind = (ref.wrap_s == "repeat", ref.wrap_t == "repeat", ref.nearest, mipmaps)
            if kind not in samplers:
                samplers[kind] = self._sampler(*kind)
            self._textures[row] = (images[source], samplers[kind])
        self._owned += [*images.values(), *samplers.values()]

    def _texture(self, pixels: np.ndarray, *, srgb: bool, mipmaps: bool) -> Any:
        """pixels (H, W, 4) uint8, row 0 at v = 0: the first row OpenGL stores, so v needs no flip."""
        limit = int(self._gl.info["GL_MAX_TEXTURE_SIZE"])
        while max(pixels.shape[:2]) > limit:
            pixels = pixels[::2, ::2]
        height, width = pixels.shape[:2]
        internal = {"internal_format": SRGB8_ALPHA8} if srgb else {}
        texture = self._gl.texture((width, height), 4, np.ascontiguousarray(pixels), alignment=1, **internal)
        if mipmaps:
            texture.build_mipmaps()
        return texture

    def _sampler(self, repeat_s: bool, repeat_t: bool, nearest: bool, mipmaps: bool) -> Any:
        """Mirrored coordinates are folded in the shader and then clamp, which is the same at every mip level."""
        gl = self._gl
        if nearest:
            filters = (gl.NEAREST, gl.NEAREST)
        else:
            filters = (gl.LINEAR_MIPMAP_LINEAR if mipmaps else gl.LINEAR, gl.LINEAR)
        return gl.sampler(repeat_x=repeat_s, repeat_y=repeat_t, filter=filters)


def varying_channels(world: World) -> frozenset[str]:
    """The material channels that some material in use does not give one value all over. Base colour always counts: its
    clear value is not the default material's."""
    materials = world.materials[world.object_materials.any(axis=0)]
    reasons = {
        "base_color": True,
        "alpha": (materials["alpha_mode"] == ALPHA_BLEND).any(),
        "metallic": (materials["metallic_roughness_texture"] != NO_TEXTURE).any(),
        "roughness": (materials["metallic_roughness_texture"] != NO_TEXTURE).any(),
        "transmission": (materials["transmission_texture"] != NO_TEXTURE).any(),
        "occlusion": (materials["occlusion_texture"] != NO_TEXTURE).any(),
        "emissive": ((materials["emissive_texture"] != NO_TEXTURE) | (materials["unlit"] != 0)).any(),
    }
    return frozenset(name for name, varies in reasons.items() if varies)


def _block_rows(world: World) -> np.ndarray:
    """(materials, 64) float32: the `Material` uniform block (std140) of every material."""
    rows = np.zeros((len(world.materials), BLOCK_BYTES // 4), np.float32)
    for row, material in zip(rows, world.materials, strict=True):
        row[0:4] = [material[name] for name in ("base_r", "base_g", "base_b", "alpha")]
        row[4:8] = [material[name] for name in ("emissive_r", "emissive_g", "emissive_b", "alpha_cutoff")]
        row[8:12] = [material[name] for name in ("metallic", "roughness", "transmission", "normal_scale")]
        row[60] = material["occlusion_strength"]
        for slot, name in enumerate(SAMPLERS):
            if material[name] == NO_TEXTURE:
                continue
            texture = world.textures.table[material[name]]
            first = 12 + 8 * slot
            row[first : first + 4] = [texture[key] for key in ("m00", "m01", "m02", "uv_set")]
            row[first + 4 : first + 8] = [*(texture[key] for key in ("m10", "m11", "m12")), _mirrored(texture)]
    return rows


def _is_transformed(texture: np.void) -> bool:
    return tuple(float(texture[key]) for key in ("m00", "m01", "m02", "m10", "m11", "m12")) != (
        1.0,
        0.0,
        0.0,
        0.0,
        1.0,
        0.0,
    )


def _mirrored(texture: np.void) -> int:
    """1 when s mirrors, plus 2 when t does."""
    return int(texture["wrap_s"] == WRAPS["mirror"]) + 2 * int(texture["wrap_t"] == WRAPS["mirror"])
