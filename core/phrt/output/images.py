"""PNG and EXR files, written whole or not at all."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from phrt.output.files import check_output, complete_file

PICTURE_SUFFIXES = (".png", ".exr")

_EXR_COMPONENTS = {1: ("Y",), 2: ("X", "Y"), 3: ("R", "G", "B"), 4: ("R", "G", "B", "A")}


def write_png(path: str | Path, pixels: np.ndarray) -> Path:
    """Write `pixels`, (H, W) grey or (H, W, 3 or 4) uint8, sRGB-encoded. Raises OptionError where it cannot be."""
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    path = check_output(path, (".png",))
    if pixels.dtype != np.uint8 or 0 in pixels.shape:
        raise ValueError(f"expected non-empty uint8 pixels, got {pixels.dtype}{pixels.shape}")
    # An sRGB chunk says that the numbers are what they look like (rendering intent 0, perceptual).
    information = PngInfo()
    information.add(b"sRGB", b"\x00")
    with complete_file(path) as temporary:
        Image.fromarray(pixels).save(temporary, format="PNG", pnginfo=information, compress_level=4)
    return path


def write_exr(
    path: str | Path,
    layers: Mapping[str, np.ndarray],
    *,
    half: bool = False,
    names: Mapping[str, tuple[str, ...]] | None = None,
) -> Path:
    """Write one scan-line EXR with ZIP compression.

    layers : (H, W) or (H, W, C) arrays of equal size by layer name; "" is the unnamed main layer (R, G, B). Floats
        become float32, or float16 with `half`; unsigned integers become uint32, which EXR keeps exactly.
    names : component names per layer, where not Y, X Y, R G B or R G B A; more than four are numbered.

    Channels are named "layer.component". Raises OptionError where it cannot be written.
    """
    import OpenEXR

    path = check_output(path, (".exr",))
    channels: dict[str, np.ndarray] = {}
    for layer, array in layers.items():
        planes = array[:, :, None] if array.ndim == 2 else array
        count = planes.shape[2]
        components = (names or {}).get(layer) or _EXR_COMPONENTS.get(count) or tuple(str(i) for i in range(count))
        for index, component in enumerate(components):
            channels[f"{layer}.{component}" if layer else component] = _exr_plane(planes[:, :, index], half)
    if len({plane.shape for plane in channels.values()}) != 1 or 0 in next(iter(channels.values())).shape:
        raise ValueError(f"layers of one non-empty size expected, got { {n: a.shape for n, a in layers.items()} }")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with complete_file(path) as temporary:
        try:
            with OpenEXR.File(header, channels) as file:
                file.write(str(temporary))
        except RuntimeError as error:
            # OpenEXR reports a full disk or a refused file as RuntimeError.
            raise OSError(str(error)) from error
    return path


def _exr_plane(plane: np.ndarray, half: bool) -> np.ndarray:
    """(H, W) in one of EXR's three types: uint32, float16 or float32."""
    if plane.dtype.kind in "ub":
        return np.ascontiguousarray(plane, dtype=np.uint32)
    if not half:
        return np.ascontiguousarray(plane, dtype=np.float32)
    # Halves end at 65504; a brighter pixel saturates instead of turning into infinity, infinity stays.
    finite = np.where(np.isinf(plane), plane, np.clip(plane, -65504.0, 65504.0))
    return np.ascontiguousarray(finite, dtype=np.float16)


def write_picture(path: str | Path, image: np.ndarray, tone_map: str = "neutral") -> Path:
    """Write linear `image` (H, W, 3) float32: tone mapped to .png, or as it is to .exr. Raises OptionError."""
    from phrt.output.tonemap import to_8bit

    path = check_output(path, PICTURE_SUFFIXES)
    if path.suffix.lower() == ".exr":
        return write_exr(path, {"": image})
    return write_png(path, to_8bit(image, tone_map))
