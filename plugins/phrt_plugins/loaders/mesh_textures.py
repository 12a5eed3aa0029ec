"""Textures of MTL files: decoded with limits; one that cannot be read becomes a visible placeholder and a warning."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
from PIL import Image as Pillow

from phrt.errors import AssetError
from phrt.interfaces.loader import MAX_FILE_BYTES, LoadContext

FORMATS = ("PNG", "JPEG", "WEBP", "TGA", "BMP", "GIF", "TIFF")
MAX_PIXELS = 8192 * 8192


def read_texture(
    context: LoadContext, reference: str, opacity_reference: str, max_size: int
) -> tuple[np.ndarray, bool]:
    """(H, W, 4) uint8 of image file `reference`, alpha from image `opacity_reference` where one is named; and whether
    any alpha is below 1. Sides are at most `max_size` pixels."""
    from phrt_plugins.loaders.mesh_mtl import resolve_loosely

    try:
        pixels = _read(resolve_loosely(context, reference), max_size)
    except AssetError as error:
        context.warn(f"texture '{reference}' is replaced by a checker: {error}")
        return placeholder(), False
    if opacity_reference:
        try:
            _set_alpha(pixels, _read(resolve_loosely(context, opacity_reference), max_size))
        except AssetError as error:
            context.warn(f"opacity texture '{opacity_reference}' is left out: {error}")
    return pixels, bool((pixels[:, :, 3] < 255).any())


def _read(path: Path, max_size: int) -> np.ndarray:
    """(H, W, 4) uint8, writable. Raises AssetError for what Pillow cannot read, or should not."""
    if path.stat().st_size > MAX_FILE_BYTES:
        raise AssetError(f"'{path.name}' is larger than {MAX_FILE_BYTES} bytes")
    try:
        with warnings.catch_warnings():
            # Pillow warns from 89 million pixels on; ours is an error, at our own limit.
            warnings.simplefilter("ignore")
            with Pillow.open(path, formats=FORMATS) as image:
                if image.width * image.height > MAX_PIXELS:
                    raise AssetError(f"'{path.name}' is {image.width}x{image.height}, more than {MAX_PIXELS} pixels")
                image.draft("RGB", (max_size, max_size))
                rgba = image.convert("RGBA")
    except AssetError:
        raise
    except Pillow.DecompressionBombError:
        raise AssetError(f"'{path.name}' has more than {MAX_PIXELS} pixels") from None
    except Exception as error:  # what image decoders raise on broken data is open-ended
        raise AssetError(f"'{path.name}' is not a readable image: {error}") from error
    if max(rgba.size) > max_size:
        rgba.thumbnail((max_size, max_size))
    return np.array(rgba, dtype=np.uint8)


def _set_alpha(pixels: np.ndarray, opacity: np.ndarray) -> None:
    """Write `opacity`'s grey, or its alpha where it has some, into the alpha of `pixels`."""
    grey = opacity[:, :, 3] if (opacity[:, :, 3] < 255).any() else opacity[:, :, :3].max(axis=2)
    if grey.shape != pixels.shape[:2]:
        grey = np.asarray(Pillow.fromarray(grey).resize((pixels.shape[1], pixels.shape[0])))
    pixels[:, :, 3] = grey


def placeholder(size: int = 64, squares: int = 8) -> np.ndarray:
    """(size, size, 4) uint8: a magenta and black checker, which nobody takes for the real texture."""
    row, column = np.indices((size, size)) * squares // size
    pixels = np.zeros((size, size, 4), dtype=np.uint8)
    pixels[(row + column) % 2 == 0] = (255, 0, 255, 0)
    pixels[:, :, 3] = 255
    return pixels
