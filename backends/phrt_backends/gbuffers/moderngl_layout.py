"""Which channels are drawn, how they share colour attachments, and which are worked out on the processor instead.

A software rasterizer pays for every attachment at every block of pixels that a triangle touches, small ones most
(measured on llvmpipe, 150 k triangles: 24 ms with three attachments, 50 ms with six, hardly a pixel shaded more). So
few are drawn:
- `point`: world position and a code, (row + 1) * 2 + (1 when seen from behind), from which ids, the triangle's normal,
  depth and motion follow (`moderngl_resolve`);
- `normal_uv`: the shading normal on the octahedron (Cigolle et al. 2014) and the texture coordinates;
- material channels, but only those that some material of the scene lets vary; the others are a table look-up.
Depth alone is one float, its reciprocal. All are written so that the clear value is zero bits: one glClear clears all.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from phrt.channels import CHANNELS

CODE_TAG = 0x40000000
"""Added to a code, its bits are those of a normal float: no driver takes it for a NaN or flushes it to zero."""
MATERIAL_CHANNELS = ("base_color", "emissive", "alpha", "metallic", "roughness", "transmission", "occlusion")

EXPRESSIONS = {
    "inverse_depth": ("inverse_depth()",),
    "point": ("v_position.x", "v_position.y", "v_position.z", "tagged_code()"),
    "normal_uv": ("folded.x", "folded.y", "v_uv0.x", "v_uv0.y"),
    "base_color": ("base.r", "base.g", "base.b"),
    "emissive": ("emissive.r", "emissive.g", "emissive.b"),
    "alpha": ("1.0 - alpha",),
    "metallic": ("metallic",),
    "roughness": ("1.0 - roughness",),
    "transmission": ("transmission",),
    "occlusion": ("1.0 - occlusion",),
}
"""What the fragment shader writes for each component of what is drawn."""


@dataclass(frozen=True)
class Attachment:
    """One float32 colour attachment of 1, 2 or 4 components; parts: (what is drawn, its first component here)."""

    parts: tuple[tuple[str, int], ...]
    components: int


@dataclass(frozen=True)
class Layout:
    """channels: asked for, in the table's order; drawn: what material shaders compute; constants: looked up."""

    channels: tuple[str, ...]
    drawn: frozenset[str]
    constants: tuple[str, ...]
    attachments: tuple[Attachment, ...]


@lru_cache(maxsize=64)
def layout_for(channels: frozenset[str], varying: frozenset[str]) -> Layout:
    """Fewest attachments for `channels` (first fit, widest first): at most five, OpenGL grants eight.

    varying: the material channels that are not one value a material in this scene.
    """
    ordered = tuple(c for c in CHANNELS if c in channels)
    if channels == {"depth"}:
        return Layout(ordered, frozenset(), (), (Attachment((("inverse_depth", 0),), 1),))
    material = [c for c in MATERIAL_CHANNELS if c in channels and c in varying]
    names = ["point", *(["normal_uv"] if {"normal_world", "uv"} & channels else []), *material]
    groups: list[list[tuple[str, int]]] = []
    used: list[int] = []
    for name in names:
        width = len(EXPRESSIONS[name])
        group = next((i for i, taken in enumerate(used) if taken + width <= 4), None)
        if group is None:
            groups.append([])
            used.append(0)
            group = len(groups) - 1
        groups[group].append((name, used[group]))
        used[group] += width
    return Layout(
        channels=ordered,
        drawn=frozenset(material) | (channels & {"normal_world"}),
        constants=tuple(c for c in MATERIAL_CHANNELS if c in channels and c not in varying),
        attachments=tuple(Attachment(tuple(p), 4 if u == 3 else u) for p, u in zip(groups, used, strict=True)),
    )


def checked_channels(channels: Iterable[str]) -> frozenset[str]:
    """`channels` as a set. Raises `ValueError` naming one that is not in the channel table."""
    wanted = frozenset(channels)
    unknown = sorted(wanted - CHANNELS.keys())
    if unknown:
        raise ValueError(f"unknown G-buffer channel '{unknown[0]}'; allowed: {', '.join(CHANNELS)}")
    return wanted


def output_declarations(layout: Layout) -> str:
    """GLSL: the `out` variables of the fragment shader."""
    return "\n".join(
        f"layout(location = {i}) out {_glsl_type(attachment.components)} target_{i};"
        for i, attachment in enumerate(layout.attachments)
    )


def output_statements(layout: Layout) -> str:
    """GLSL: the assignments to them."""
    lines = []
    for i, attachment in enumerate(layout.attachments):
        terms = [term for name, _ in attachment.parts for term in EXPRESSIONS[name]]
        terms += ["0.0"] * (attachment.components - len(terms))
        lines.append(f"    target_{i} = {_glsl_type(attachment.components)}({', '.join(terms)});")
    return "\n".join(lines)


def unpack(channel: str, first: int, packed: np.ndarray, out: np.ndarray) -> None:
    """Decode material `channel`, from component `first` on, of packed (pixels, n) float32 into out (pixels[, m])."""
    if channel in ("alpha", "roughness", "occlusion"):
        np.subtract(np.float32(1.0), packed[:, first], out=out)
    elif out.ndim == 1:
        out[:] = packed[:, first]
    else:
        # Component by component: numpy's inner loop is then as long as the picture, not 3.
        for k in range(out.shape[1]):
            out[:, k] = packed[:, first + k]


def _glsl_type(components: int) -> str:
    return "float" if components == 1 else f"vec{components}"
