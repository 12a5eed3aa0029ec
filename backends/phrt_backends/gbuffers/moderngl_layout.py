"""How channels share colour attachments, and how the bytes that come back turn into channels.

Every float channel is written so that its clear value is zero bits, because one glClear clears all attachments:
depth as its reciprocal (0 = infinitely far), alpha and roughness as 1 - value. Ids and the geometric normal are not
drawn at all: one uint32 code, (row + 1) * 2 + (1 when seen from behind), looks them up in tables on the processor.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from phrt.channels import CHANNELS

CODE_CHANNELS = ("object_id", "primitive_id", "material_id", "normal_geometric_world")

EXPRESSIONS = {
    "depth": ("inverse_depth()",),
    "position_world": ("v_position.x", "v_position.y", "v_position.z"),
    "normal_world": ("normal.x", "normal.y", "normal.z"),
    "uv": ("v_uv0.x", "v_uv0.y"),
    "base_color": ("base.r", "base.g", "base.b"),
    "alpha": ("1.0 - alpha",),
    "metallic": ("metallic",),
    "roughness": ("1.0 - roughness",),
    "transmission": ("transmission",),
    "emissive": ("emissive.r", "emissive.g", "emissive.b"),
    "motion": ("motion.x", "motion.y"),
}
"""What the fragment shader writes for each component."""


@dataclass(frozen=True)
class Attachment:
    """One float32 colour attachment of 1, 2 or 4 components; parts: (channel, first component here)."""

    parts: tuple[tuple[str, int], ...]
    components: int


@dataclass(frozen=True)
class Layout:
    """The attachments of a set of channels; `code` adds a uint32 one after the float ones."""

    channels: tuple[str, ...]
    floats: tuple[Attachment, ...]
    code: bool


@lru_cache(maxsize=64)
def layout_for(channels: frozenset[str]) -> Layout:
    """Fewest attachments for `channels` (first fit, widest first): at most seven, OpenGL grants eight."""
    drawn = sorted((c for c in EXPRESSIONS if c in channels), key=lambda c: -CHANNELS[c].components)
    groups: list[list[tuple[str, int]]] = []
    used: list[int] = []
    for channel in drawn:
        width = CHANNELS[channel].components
        group = next((i for i, taken in enumerate(used) if taken + width <= 4), None)
        if group is None:
            groups.append([])
            used.append(0)
            group = len(groups) - 1
        groups[group].append((channel, used[group]))
        used[group] += width
    floats = tuple(
        Attachment(tuple(parts), 4 if taken == 3 else taken) for parts, taken in zip(groups, used, strict=True)
    )
    return Layout(tuple(c for c in CHANNELS if c in channels), floats, any(c in channels for c in CODE_CHANNELS))


def checked_channels(channels: Iterable[str]) -> frozenset[str]:
    """`channels` as a set. Raises `ValueError` naming one that is not in the channel table."""
    wanted = frozenset(channels)
    unknown = sorted(wanted - CHANNELS.keys())
    if unknown:
        raise ValueError(f"unknown G-buffer channel '{unknown[0]}'; allowed: {', '.join(CHANNELS)}")
    return wanted


def output_declarations(layout: Layout) -> str:
    """GLSL: the `out` variables of the fragment shader."""
    lines = [
        f"layout(location = {i}) out {_glsl_type(attachment.components)} target_{i};"
        for i, attachment in enumerate(layout.floats)
    ]
    if layout.code:
        lines.append(f"layout(location = {len(layout.floats)}) out uint target_code;")
    return "\n".join(lines)


def output_statements(layout: Layout) -> str:
    """GLSL: the assignments to them."""
    lines = []
    for i, attachment in enumerate(layout.floats):
        terms = [term for channel, _ in attachment.parts for term in EXPRESSIONS[channel]]
        terms += ["0.0"] * (attachment.components - len(terms))
        lines.append(f"    target_{i} = {_glsl_type(attachment.components)}({', '.join(terms)});")
    if layout.code:
        lines.append("    target_code = uint(first_row + gl_PrimitiveID + 1) * 2u + (gl_FrontFacing ? 0u : 1u);")
    return "\n".join(lines)


def unpack(channel: str, first: int, packed: np.ndarray, out: np.ndarray) -> None:
    """Decode `channel`, from component `first` on, of packed (pixels, components) float32 into out (pixels[, n])."""
    if channel == "depth":
        with np.errstate(divide="ignore"):
            np.divide(np.float32(1.0), packed[:, first], out=out)
    elif channel in ("alpha", "roughness"):
        np.subtract(np.float32(1.0), packed[:, first], out=out)
    elif out.ndim == 1:
        out[:] = packed[:, first]
    else:
        # Component by component: numpy's inner loop is then as long as the picture, not 2 or 3.
        for k in range(out.shape[1]):
            out[:, k] = packed[:, first + k]


def _glsl_type(components: int) -> str:
    return "float" if components == 1 else f"vec{components}"
