"""Texture atlas: every image with its mip pyramid in one array of texels, and a table of samplers that look into it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phrt.model import Image, TextureRef

MAX_LEVELS = 16
WRAPS = {"repeat": 0, "clamp": 1, "mirror": 2}
SRGB_SLOTS = frozenset({"base_color_texture", "emissive_texture"})

TEXTURE_DTYPE = np.dtype(
    [
        ("width", np.int32),
        ("height", np.int32),
        ("levels", np.int32),
        ("wrap_s", np.int32),
        ("wrap_t", np.int32),
        ("nearest", np.int32),
        ("uv_set", np.int32),
        ("log2_size", np.float32),
        ("m00", np.float32),
        ("m01", np.float32),
        ("m02", np.float32),
        ("m10", np.float32),
        ("m11", np.float32),
        ("m12", np.float32),
    ]
)
"""m**: KHR_texture_transform as a 2x3 matrix. log2_size: 0.5 * log2(width * height) plus the transform's density."""


@dataclass(frozen=True)
class TextureAtlas:
    """texels (n, 4) uint8; table TEXTURE_DTYPE (rows,); level_start (rows, MAX_LEVELS) uint64, first texel of a level;
    rows: (material index, slot) -> row."""

    texels: np.ndarray
    table: np.ndarray
    level_start: np.ndarray
    rows: dict[tuple[int, str], int]


def build_atlas(images: list[Image], refs: list[tuple[tuple[int, str], TextureRef]]) -> TextureAtlas:
    """The atlas for `refs`: one row a distinct reference, one pyramid a distinct (image, colour space, mipmapped)."""
    pyramids: dict[tuple[int, bool, bool], list[np.ndarray]] = {}
    rows: dict[tuple[int, str], int] = {}
    seen: dict[tuple[tuple[int, bool, bool], str], int] = {}
    unique: list[tuple[tuple[int, bool, bool], TextureRef]] = []
    for key, ref in refs:
        source = (ref.image, key[1] in SRGB_SLOTS, ref.mipmaps)
        identity = (source, repr(ref))
        if identity not in seen:
            seen[identity] = len(unique)
            unique.append((source, ref))
            pyramids.setdefault(source, [])
        rows[key] = seen[identity]
    _fill_pyramids(images, pyramids)

    start: dict[tuple[int, bool, bool], list[int]] = {}
    total = 0
    for source, levels in pyramids.items():
        start[source] = []
        for level in levels:
            start[source].append(total)
            total += level.shape[0] * level.shape[1]
    texels = np.empty((max(total, 1), 4), np.uint8)
    for source, levels in pyramids.items():
        for first, level in zip(start[source], levels, strict=True):
            texels[first : first + level.shape[0] * level.shape[1]] = level.reshape(-1, 4)

    table = np.zeros(max(len(unique), 1), TEXTURE_DTYPE)
    level_start = np.zeros((max(len(unique), 1), MAX_LEVELS), np.uint64)
    for row, (source, ref) in enumerate(unique):
        _fill_row(table[row], ref, pyramids[source])
        level_start[row, : len(start[source])] = start[source]
    return TextureAtlas(texels, table, level_start, rows)


def _fill_pyramids(images: list[Image], pyramids: dict[tuple[int, bool, bool], list[np.ndarray]]) -> None:
    if not pyramids:
        return
    from concurrent.futures import ThreadPoolExecutor

    from phrt.kernels.mipmaps import pyramid

    def fill(source: tuple[int, bool, bool]) -> None:
        image, srgb, mipmaps = source
        pyramids[source] = pyramid(images[image].pixels, srgb=srgb, levels=MAX_LEVELS if mipmaps else 1)

    with ThreadPoolExecutor() as pool:
        list(pool.map(fill, pyramids))


def _fill_row(record: np.void, ref: TextureRef, levels: list[np.ndarray]) -> None:
    height, width = levels[0].shape[:2]
    cosine, sine = np.cos(ref.rotation), np.sin(ref.rotation)
    record["width"], record["height"], record["levels"] = width, height, len(levels)
    record["wrap_s"], record["wrap_t"] = WRAPS[ref.wrap_s], WRAPS[ref.wrap_t]
    record["nearest"], record["uv_set"] = ref.nearest, ref.uv_set
    # KHR_texture_transform: uv' = translation * rotation * scale * uv.
    record["m00"], record["m01"], record["m02"] = cosine * ref.scale[0], sine * ref.scale[1], ref.offset[0]
    record["m10"], record["m11"], record["m12"] = -sine * ref.scale[0], cosine * ref.scale[1], ref.offset[1]
    density = max(abs(ref.scale[0] * ref.scale[1]), 1e-12)
    record["log2_size"] = 0.5 * np.log2(width * height * density)
