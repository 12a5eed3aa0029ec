"""Textures of a scene as Mitsuba's `bitmap`: decoded and multiplied here, so that no colour conversion is left to do.

Texture coordinates are PHRT's: (0, 0) is the top left corner, which is Mitsuba's convention, too. Mitsuba looks up full
resolution, bilinear; many paths a pixel do what mip levels do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from phrt.kernels.mipmaps import SRGB_TO_LINEAR
from phrt.model import Image, TextureRef

Spectrum = dict[str, Any]
"""A texture, or a value that is the same everywhere, for `load_dict`."""


def constant(value: Sequence[float]) -> Spectrum:
    return {"type": "rgb", "value": [float(each) for each in value]}


@dataclass
class Textures:
    """mitsuba: the package; notes: takes up what cannot be had."""

    mitsuba: Any
    images: list[Image]
    notes: set[str]

    def color(self, ref: TextureRef | None, factor: Sequence[float]) -> Spectrum:
        """An sRGB texture times `factor` (3,), linear."""
        if ref is None:
            return constant(factor)
        decoded = np.asarray(SRGB_TO_LINEAR, np.float32)[self.images[ref.image].pixels[..., :3]]
        return self.bitmap(ref, decoded * np.asarray(factor, np.float32))

    def channel(self, ref: TextureRef | None, channel: int, factor: float) -> Spectrum | float:
        """One channel of a linear texture times `factor`."""
        if ref is None:
            return float(factor)
        return self.bitmap(ref, self.values(ref, channel)[..., None] * np.float32(factor))

    def values(self, ref: TextureRef, channel: int) -> np.ndarray:
        """(H, W) float32, 0 to 1."""
        return self.images[ref.image].pixels[..., channel].astype(np.float32) / np.float32(255)

    def normals(self, ref: TextureRef, scale: float) -> Spectrum:
        """A normal map whose slopes are multiplied by `scale`."""
        pixels = self.images[ref.image].pixels[..., :3].astype(np.float32) / np.float32(255)
        pixels[..., :2] = (pixels[..., :2] - 0.5) * np.float32(scale) + 0.5
        return self.bitmap(ref, pixels)

    def opacity(self, ref: TextureRef | None, alpha: float, cutoff: float | None) -> Spectrum | float:
        """Coverage: the colour texture's alpha times `alpha`; 0 or 1 where there is a `cutoff`."""
        if ref is None:
            return float(alpha if cutoff is None else alpha >= cutoff)
        covered = self.values(ref, 3) * np.float32(alpha)
        return self.bitmap(ref, (covered if cutoff is None else (covered >= cutoff).astype(np.float32))[..., None])

    def bitmap(self, ref: TextureRef, values: np.ndarray) -> Spectrum:
        """values (H, W, 1 or 3) float32, linear."""
        if ref.wrap_s != ref.wrap_t:
            self.notes.add("textures that repeat in one direction alone repeat in both as along u")
        # Mitsuba wants two texels a side.
        values = np.repeat(values, 2, axis=0) if values.shape[0] < 2 else values
        values = np.repeat(values, 2, axis=1) if values.shape[1] < 2 else values
        return {
            "type": "bitmap",
            "bitmap": self.mitsuba.Bitmap(np.ascontiguousarray(values, np.float32)),
            "raw": True,
            "format": "fp16",
            "wrap_mode": ref.wrap_s,
            "filter_type": "nearest" if ref.nearest else "bilinear",
            "to_uv": self.mitsuba.ScalarTransform3f(uv_transform(ref)),
        }


def uv_transform(ref: TextureRef) -> np.ndarray:
    """(3, 3) float32: KHR_texture_transform, translation * rotation * scale, as `phrt.textures` has it."""
    cosine, sine = np.cos(ref.rotation), np.sin(ref.rotation)
    turn = np.array([[cosine, sine, ref.offset[0]], [-sine, cosine, ref.offset[1]], [0, 0, 1]])
    return np.asarray(turn @ np.diag([*ref.scale, 1.0]), np.float32)
