"""The G-buffer: one table of channels, and the arrays of one frame.

The table is the only place that says what a channel is; it allocates, validates, drives both producers and writes
its page in the docs (Falcor's `GBuffer.cpp` and Hydra's `aov.h` do the same).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from phrt.conventions import NO_PRIMITIVE


@dataclass(frozen=True)
class Channel:
    """One G-buffer channel. `components` 1 gives arrays (H, W), more gives (H, W, components)."""

    name: str
    dtype: type[np.generic]
    components: int
    space_unit: str
    clear: float | int
    meaning: str

    def shape(self, height: int, width: int) -> tuple[int, ...]:
        """Shape of its array in a picture of `width` x `height` pixels."""
        return (height, width) if self.components == 1 else (height, width, self.components)


CHANNELS: dict[str, Channel] = {
    channel.name: channel
    for channel in (
        Channel("depth", np.float32, 1, "view space, metres", np.inf, "distance along the camera's -Z"),
        Channel("position_world", np.float32, 3, "world space, metres", 0.0, "the visible point"),
        Channel(
            "normal_world",
            np.float32,
            3,
            "world space, unit",
            0.0,
            "shading normal, normal map applied, facing the eye",
        ),
        Channel(
            "normal_geometric_world", np.float32, 3, "world space, unit", 0.0, "the triangle's normal, facing the eye"
        ),
        Channel("uv", np.float32, 2, "texture space", 0.0, "first texture coordinate set; v runs down as in glTF"),
        Channel("object_id", np.uint32, 1, "id", 0, "which object; 0 is the background"),
        Channel("primitive_id", np.uint32, 1, "id", int(NO_PRIMITIVE), "which triangle of the scene"),
        Channel("material_id", np.uint32, 1, "id", 0, "which material of the scene"),
        Channel("base_color", np.float32, 3, "linear Rec.709", 0.0, "albedo, or F0 of metals"),
        Channel("alpha", np.float32, 1, "0..1", 1.0, "coverage; below 1 only on alpha-blended surfaces"),
        Channel("metallic", np.float32, 1, "0..1", 0.0, "metalness"),
        Channel("roughness", np.float32, 1, "0..1", 1.0, "perceptual roughness; alpha of GGX is its square"),
        Channel("transmission", np.float32, 1, "0..1", 0.0, "share of the non-specular light that passes through"),
        Channel("occlusion", np.float32, 1, "0..1", 1.0, "ambient occlusion baked into a texture; 1 is open"),
        Channel("emissive", np.float32, 3, "linear Rec.709, nits", 0.0, "light the surface sends out itself"),
        Channel(
            "motion",
            np.float32,
            2,
            "pixels, x right, y down",
            0.0,
            "where the point was in the previous frame, minus here",
        ),
    )
}


@dataclass
class GBuffer:
    """Which surface is behind every pixel: the requested channels of one frame, C-contiguous arrays by name."""

    width: int
    height: int
    arrays: dict[str, np.ndarray] = field(default_factory=dict)

    def __getattr__(self, name: str) -> np.ndarray:
        arrays = self.__dict__.get("arrays", {})
        if name not in arrays:
            held = ", ".join(arrays) or "none"
            raise AttributeError(f"the G-buffer has no channel '{name}'; this one holds {held}")
        array: np.ndarray = arrays[name]
        return array

    def flat(self, name: str) -> np.ndarray:
        """Channel `name` with its pixels in one row: (H * W,) or (H * W, components), a view."""
        array = self.arrays[name]
        return array.reshape(self.width * self.height, *array.shape[2:])

    def validate(self) -> None:
        """Raise `ValueError` where a channel's shape, dtype or values break the table. Used by tests, not per frame."""
        for name, array in self.arrays.items():
            channel = CHANNELS[name]
            shape = channel.shape(self.height, self.width)
            if array.shape != shape or array.dtype != channel.dtype:
                raise ValueError(
                    f"channel '{name}' is {array.dtype}{array.shape}, expected {np.dtype(channel.dtype)}{shape}"
                )
            if np.isnan(array).any() or (name != "depth" and np.isinf(array).any()):
                raise ValueError(f"channel '{name}' holds NaN or infinity")
