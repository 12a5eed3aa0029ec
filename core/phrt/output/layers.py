"""Everything a frame is made of, as files: previews to look at and one EXR to compute with.

The first files are the four images of Andrade et al. 2014, Figure 1: the rasterized picture without ray effects, the
shadows, the reflections (and refractions), and the composite.

In EXR files a layer with one component per light has `light0`, `light1`, ... for components, however many lights there are.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from phrt.errors import OptionError
from phrt.output.images import write_exr, write_png
from phrt.output.raster import raster_picture
from phrt.output.tonemap import to_8bit

if TYPE_CHECKING:
    from phrt.frame import FrameResult


FIGURE_1 = (
    ("figure1_b_shadows.png", "visibility"),
    ("figure1_c_reflections.png", "reflection"),
    ("figure1_c_refractions.png", "refraction"),
)
"""File and layer; `figure1_a_raster.png` is `raster_picture`, `figure1_d_composite.png` the frame's image."""

SHARES = frozenset({"visibility", "ambient_occlusion"})
"""Layers whose components are shares of light in 0..1, however many: shown in grey, as their mean."""

MASK_SHADES = np.array([0, 85, 255, 170], dtype=np.uint8)
"""Grey by `phrt.frame.MASK_*`: nothing black, fallback dark, traced white, filled from neighbours light."""

_COMPONENTS = {"uv": ("U", "V"), "depth": ("Z",), "motion": ("X", "Y"), "object_id": ("id",)}
_COMPONENTS |= {"primitive_id": ("id",), "material_id": ("id",)}
_COMPONENTS |= dict.fromkeys(("position_world", "normal_world", "normal_geometric_world"), ("X", "Y", "Z"))


def write_layers(folder: str | Path, frame: FrameResult, *, tone_map: str = "neutral") -> list[Path]:
    """Write every layer of `frame` into `folder` (made where missing), PNG previews and `layers.exr`; gives the paths.

    Previews of colours are multiplied with the frame's exposure, the EXR's layers are not.
    Raises OptionError where the folder cannot be written.
    """
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OptionError(f"cannot make the folder '{folder}' for layers: {error.strerror or error}") from error
    previews = layer_previews(frame, tone_map)
    written = [write_png(folder / name, pixels) for name, pixels in previews.items()]
    written.append(write_exr(folder / "layers.exr", exr_layers(frame), names=_COMPONENTS | light_components(frame)))
    return written


def layer_previews(frame: FrameResult, tone_map: str = "neutral") -> dict[str, np.ndarray]:
    """uint8 pictures by file name, in the order one wants to look at them."""
    layers, exposure = frame.layers, frame.exposure
    previews = {"figure1_a_raster.png": to_8bit(raster_picture(frame), tone_map)}
    for file_name, name in FIGURE_1:
        if name in layers:
            previews[file_name] = layer_preview(name, layers[name], tone_map, exposure)
    previews["figure1_d_composite.png"] = to_8bit(frame.image, tone_map)
    for name, layer in layers.items():
        previews[f"layer_{_safe(name)}.png"] = layer_preview(name, layer, tone_map, exposure)
        if name in SHARES and layer.ndim == 3 and layer.shape[2] > 1:
            for index in range(layer.shape[2]):
                previews[f"layer_{_safe(name)}_{index}.png"] = _grey(layer[:, :, index])
    for name, preview in GBUFFER_PREVIEWS.items():
        if name in frame.gbuffer.arrays:
            previews[f"gbuffer_{name}.png"] = preview(frame.gbuffer.arrays[name])
    for name, mask in frame.masks.items():
        previews[f"traced_{_safe(name)}.png"] = MASK_SHADES[np.minimum(mask, len(MASK_SHADES) - 1)]
    return previews


def layer_preview(name: str, layer: np.ndarray, tone_map: str, exposure: float = 1.0) -> np.ndarray:
    """uint8 preview of `layer` (H, W) or (H, W, C): shares and odd counts in grey, colours tone mapped."""
    planes = layer[:, :, None] if layer.ndim == 2 else layer
    count = planes.shape[2]
    if count == 0:
        return np.zeros(planes.shape[:2], dtype=np.uint8)
    if name not in SHARES and count in (3, 4):
        return to_8bit(planes[:, :, :3] * np.float32(exposure), tone_map)
    return _grey(planes.mean(axis=2))


def write_light_exr(path: str | Path, frame: FrameResult) -> Path:
    """Write the picture and every layer of light of `frame`, linear, into one EXR. Raises OptionError where it cannot be."""
    return write_exr(path, light_arrays(frame), names=light_components(frame))


def light_arrays(frame: FrameResult) -> dict[str, np.ndarray]:
    """The image, unnamed, and the layers of light by EXR layer name."""
    return {"": frame.image} | {_safe(name): layer for name, layer in frame.layers.items() if layer.shape[2]}


def light_components(frame: FrameResult) -> dict[str, tuple[str, ...]]:
    """`light0`, `light1`, ... for the components of every layer with one per light."""
    lights = tuple(f"light{number}" for number in range(frame.direct.shape[2]))
    return {_safe(name): lights for name in frame.light_layers}


def exr_layers(frame: FrameResult) -> dict[str, np.ndarray]:
    """Every array by EXR layer name: the image unnamed, layers, `direct_*` by light, G-buffer channels, masks."""
    arrays = light_arrays(frame)
    arrays |= {f"direct_{light}": frame.direct[:, :, light] for light in range(frame.direct.shape[2])}
    arrays |= {
        (name if name not in arrays else f"gbuffer_{name}"): array for name, array in frame.gbuffer.arrays.items()
    }
    return arrays | {f"traced_{_safe(name)}": mask for name, mask in frame.masks.items()}


def depth_preview(depth: np.ndarray) -> np.ndarray:
    """(H, W) uint8: near white, far dark grey, background black; log scale between the 1st and 99th percentile."""
    seen = np.isfinite(depth) & (depth > 0)
    pixels = np.zeros(depth.shape, dtype=np.uint8)
    if seen.any():
        logs = np.log(depth[seen].astype(np.float64))
        near, far = np.percentile(logs, (1, 99))
        share = np.clip((logs - near) / max(far - near, 1e-6), 0.0, 1.0)
        pixels[seen] = np.rint(255 - 215 * share).astype(np.uint8)
    return pixels


def normal_preview(normals: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8: x, y, z of -1..1 as red, green, blue of 0..255; black where there is no surface."""
    pixels = np.rint(np.clip(normals * 0.5 + 0.5, 0.0, 1.0) * 255).astype(np.uint8)
    pixels[~np.any(normals, axis=2)] = 0
    return pixels


def id_preview(ids: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8: neighbouring ids get colours far apart (steps of the golden ratio around the hue circle), the
    same in every frame; 0 is black, as is the largest id, which marks "none"."""
    none = (ids == 0) | (ids == np.uint32(0xFFFFFFFF))
    number = ids.astype(np.float64)
    hue = (number * 0.6180339887498949) % 1.0
    value = 1.0 - 0.35 * ((number * 0.7548776662466927) % 1.0)
    # HSV to RGB at saturation 0.75, all channels at once.
    turn = (hue[..., None] * 6.0 + np.array([5.0, 3.0, 1.0])) % 6.0
    color = value[..., None] * (1.0 - 0.75 * np.clip(np.minimum(turn, 4.0 - turn), 0.0, 1.0))
    color[none] = 0.0
    return np.rint(color * 255).astype(np.uint8)


def albedo_preview(base_color: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8, sRGB without a curve."""
    return to_8bit(base_color, "srgb")


GBUFFER_PREVIEWS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "depth": depth_preview,
    "normal_world": normal_preview,
    "base_color": albedo_preview,
    "object_id": id_preview,
    "material_id": id_preview,
    "roughness": lambda array: _grey(array),
    "metallic": lambda array: _grey(array),
    "transmission": lambda array: _grey(array),
    "occlusion": lambda array: _grey(array),
}


def _grey(values: np.ndarray) -> np.ndarray:
    """(H, W) uint8 of linear `values` 0..1, sRGB-encoded like a photograph of them."""
    return to_8bit(np.repeat(values[:, :, None], 3, axis=2), "srgb")[:, :, 0]


def _safe(name: str) -> str:
    """`name` with nothing that a file name or an EXR channel would stumble over."""
    return re.sub(r"[^A-Za-z0-9_-]+", "_", name)
