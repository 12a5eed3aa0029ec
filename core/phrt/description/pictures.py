"""Picture files of a scene: 8-bit textures, and high dynamic range domes (.hdr Radiance RGBE, .exr)."""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np

from phrt.description.prims import Texture
from phrt.errors import AssetError
from phrt.model import Image, TextureRef

MAX_PIXELS = 8192 * 4096
MAX_BYTES = 512 * 1024 * 1024
MAX_TEXTURE_BYTES = 2 * 1024 * 1024 * 1024
"""Of all textures of a scene together, decoded."""

PLACEHOLDER = ((1.0, 0.0, 1.0), (0.0, 0.0, 0.0))
"""The checker shown for a texture that is missing: nobody takes magenta and black for the real one."""

HDR_SUFFIXES = (".hdr", ".exr")


def read_texture(path: Path) -> Image:
    """An 8-bit picture as RGBA. Raises AssetError with the file and the reason."""
    from PIL import Image as Pillow

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Pillow.open(path) as picture:
                if picture.width * picture.height > MAX_PIXELS:
                    raise AssetError(
                        f"{path}: {picture.width} x {picture.height} pixels; at most {MAX_PIXELS} are read"
                    )
                pixels = np.asarray(picture.convert("RGBA"), dtype=np.uint8)
    except AssetError:
        raise
    except Pillow.DecompressionBombError:
        raise AssetError(f"{path}: far too many pixels; at most {MAX_PIXELS} are read") from None
    except Exception as error:
        raise AssetError(f"{path}: is not a picture that can be read: {error}") from None
    return Image(path.name, pixels)


def checker_image(colors: tuple[tuple[float, float, float], tuple[float, float, float]]) -> Image:
    """2 x 2 squares of two linear colours (clipped to 0..1), stored as sRGB like every colour texture."""
    linear = np.clip(np.array(colors, dtype=np.float64), 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    rgba = np.concatenate([np.round(encoded * 255), np.full((2, 1), 255.0)], axis=1).astype(np.uint8)
    # 64 texels a square: bilinear filtering blurs only the edge, and mipmaps have something to average.
    squares = np.array([[0, 1], [1, 0]]).repeat(64, axis=0).repeat(64, axis=1)
    return Image("checker", rgba[squares])


def texture_ref(texture: Texture, image: int) -> TextureRef:
    return TextureRef(
        image=image,
        uv_set=texture.uv_set,
        wrap_s=texture.wrap,
        wrap_t=texture.wrap,
        nearest=texture.nearest,
        mipmaps=not texture.nearest,
        offset=texture.offset,
        rotation=float(np.radians(texture.rotation)),
        scale=texture.scale,
    )


def read_dome(path: Path) -> np.ndarray:
    """(H, W, 3) float32 linear pixels of a .hdr or .exr file, finite and not negative. Raises AssetError."""
    if path.suffix.lower() not in HDR_SUFFIXES:
        raise AssetError(f"{path}: a dome is a picture ending in {' or '.join(HDR_SUFFIXES)}")
    if path.stat().st_size > MAX_BYTES:
        raise AssetError(f"{path}: {path.stat().st_size} bytes; at most {MAX_BYTES} are read")
    pixels = read_radiance(path) if path.suffix.lower() == ".hdr" else _read_exr(path)
    if not np.isfinite(pixels).all():
        raise AssetError(f"{path}: holds pixels that are not finite")
    return np.ascontiguousarray(np.maximum(pixels, 0), dtype=np.float32)


def read_radiance(path: Path) -> np.ndarray:
    """(H, W, 3) float32 of a Radiance RGBE file, flat or run-length encoded, row 0 at the top.

    Raises AssetError for what is not Radiance, XYZE, turned, too large, or ends early.
    """
    data = path.read_bytes()
    header, found, rest = data.partition(b"\n\n")
    line, newline, body = rest.partition(b"\n")
    size = re.fullmatch(rb"([-+])Y (\d{1,6}) ([-+])X (\d{1,6})", line.strip())
    if not data.startswith((b"#?RADIANCE", b"#?RGBE")) or not found or not newline or size is None:
        raise AssetError(f"{path}: is not a Radiance .hdr file with a '-Y height +X width' line")
    if b"FORMAT=" in header and b"FORMAT=32-bit_rle_rgbe" not in header:
        raise AssetError(f"{path}: only FORMAT=32-bit_rle_rgbe is read")
    height, width = int(size[2]), int(size[4])
    if not 0 < height * width <= MAX_PIXELS:
        raise AssetError(f"{path}: {width} x {height} pixels; from 1 to {MAX_PIXELS} are read")
    try:
        rgbe = _scanlines(np.frombuffer(body, np.uint8), width, height)
    except (IndexError, ValueError):
        raise AssetError(f"{path}: the pixel data is broken or ends early") from None
    rgbe = rgbe[::-1] if size[1] == b"+" else rgbe
    rgbe = rgbe[:, ::-1] if size[3] == b"-" else rgbe
    exponent = rgbe[..., 3:].astype(np.int32)
    scale = np.where(exponent > 0, np.ldexp(np.float32(1), exponent - 136), np.float32(0))
    # The middle of each step, as Radiance's own reader does it.
    return ((rgbe[..., :3].astype(np.float32) + np.float32(0.5)) * scale).astype(np.float32)


def _scanlines(body: np.ndarray, width: int, height: int) -> np.ndarray:
    """(height, width, 4) uint8 of flat or run-length encoded scanlines. Raises IndexError or ValueError when broken."""
    if not (8 <= width < 32768) or body[0] != 2 or body[1] != 2 or body[2] & 0x80:
        if len(body) < width * height * 4:
            raise ValueError("too short")
        return body[: width * height * 4].reshape(height, width, 4)
    result = np.empty((height, 4, width), np.uint8)
    buffer = body.tobytes()
    place = 0
    for row in range(height):
        if buffer[place] != 2 or buffer[place + 1] != 2 or (buffer[place + 2] << 8 | buffer[place + 3]) != width:
            raise ValueError("bad scanline")
        place = _runs(buffer, place + 4, result[row].reshape(-1))
    return result.transpose(0, 2, 1)


def _runs(buffer: bytes, place: int, into: np.ndarray) -> int:
    """Decode runs until `into` (4 * width,) is full; channels follow each other. Returns where reading stopped."""
    filled, size, width = 0, len(into), len(into) // 4
    while filled < size:
        count = buffer[place]
        run = count > 128
        count = count - 128 if run else count
        end = filled + count
        if count == 0 or end > (filled // width + 1) * width:
            raise ValueError("run past the scanline")
        if run:
            into[filled:end] = buffer[place + 1]
            place += 2
        else:
            into[filled:end] = np.frombuffer(buffer, np.uint8, count, place + 1)
            place += 1 + count
        filled = end
    return place


def _read_exr(path: Path) -> np.ndarray:
    """(H, W, 3) float32 of an OpenEXR file's R, G, B channels (or its first channel as grey)."""
    import OpenEXR

    try:
        with OpenEXR.File(str(path), separate_channels=True, header_only=True) as header:
            low, high = header.header()["dataWindow"]
        width, height = int(high[0]) - int(low[0]) + 1, int(high[1]) - int(low[1]) + 1
        if not 0 < width * height <= MAX_PIXELS:
            raise AssetError(f"{path}: {width} x {height} pixels; from 1 to {MAX_PIXELS} are read")
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channels = {name: np.array(channel.pixels, dtype=np.float32) for name, channel in file.channels().items()}
    except AssetError:
        raise
    except Exception as error:
        raise AssetError(f"{path}: is not an OpenEXR file that can be read: {error}") from None
    if {"R", "G", "B"} <= channels.keys():
        return np.stack([channels["R"], channels["G"], channels["B"]], axis=2)
    if len(channels) == 1:
        return np.repeat(next(iter(channels.values()))[..., None], 3, axis=2)
    raise AssetError(f"{path}: has channels {', '.join(channels)}; wanted R, G, B")
