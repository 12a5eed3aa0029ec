"""Mip pyramids, and texture lookups through the surface kernel, against plain numpy twins."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scene_kit import Stage, mesh_of

from phrt.kernels.arrays import empty_surfaces, geometry_arrays, material_arrays
from phrt.kernels.mipmaps import pyramid
from phrt.kernels.surface import surface
from phrt.model import Material, TextureRef
from phrt.world import World


def to_linear(code: np.ndarray) -> np.ndarray:
    c = np.asarray(code) / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def to_srgb(linear: np.ndarray) -> np.ndarray:
    return 255 * np.where(linear <= 0.0031308, linear * 12.92, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def random_pixels(height: int, width: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 4)).astype(np.uint8)


# --- mip pyramids ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(16, 16), (13, 7), (1, 9), (8, 2)])
@pytest.mark.parametrize("srgb", [True, False])
def test_each_mip_level_is_the_box_mean_of_the_one_before(size: tuple[int, int], srgb: bool) -> None:
    levels = pyramid(random_pixels(*size), srgb=srgb, levels=16)
    assert levels[-1].shape[:2] == (1, 1)
    for fine, coarse in pairwise(levels):
        assert coarse.shape[:2] == tuple(max(n // 2, 1) for n in fine.shape[:2])
        rows = np.minimum(np.arange(coarse.shape[0])[:, None] * 2 + [0, 1], fine.shape[0] - 1)
        columns = np.minimum(np.arange(coarse.shape[1])[:, None] * 2 + [0, 1], fine.shape[1] - 1)
        blocks = fine[rows[:, :, None, None], columns[None, None]].astype(float)
        color = to_srgb(to_linear(blocks).mean(axis=(1, 3))) if srgb else blocks.mean(axis=(1, 3))
        # The dark end of sRGB is steep for a table of 8192 steps.
        np.testing.assert_allclose(coarse[..., :3], color[..., :3], atol=1.01)
        np.testing.assert_allclose(coarse[..., 3], blocks.mean(axis=(1, 3))[..., 3], atol=0.51)


def test_a_pyramid_can_end_early() -> None:
    assert len(pyramid(random_pixels(16, 16), srgb=True, levels=1)) == 1


# --- lookups --------------------------------------------------------------------------------------------------------


def texel_index(index: np.ndarray, count: int, wrap: str) -> np.ndarray:
    """Texel that stands at any integer position, by glTF's wrap modes."""
    if wrap == "repeat":
        return index % count
    if wrap == "clamp":
        return np.clip(index, 0, count - 1)
    folded = index % (2 * count)
    return np.where(folded < count, folded, 2 * count - 1 - folded)


def lookup_twin(values: np.ndarray, uv: np.ndarray, ref: TextureRef) -> np.ndarray:
    """(n, C) of values (H, W, C) at uv (n, 2): KHR_texture_transform, wrap, then nearest or bilinear."""
    height, width = values.shape[:2]
    c, s = np.cos(ref.rotation), np.sin(ref.rotation)
    uv = np.array(ref.offset) + (uv * ref.scale) @ np.array([[c, s], [-s, c]]).T
    x, y = uv[:, 0] * width, uv[:, 1] * height
    if ref.nearest:
        column, row = np.floor(x).astype(int), np.floor(y).astype(int)
        return values[texel_index(row, height, ref.wrap_t), texel_index(column, width, ref.wrap_s)]
    x, y = x - 0.5, y - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]

    def texel(row: np.ndarray, column: np.ndarray) -> np.ndarray:
        return values[texel_index(row, height, ref.wrap_t), texel_index(column, width, ref.wrap_s)]

    top = texel(y0, x0) * (1 - fx) + texel(y0, x0 + 1) * fx
    return top * (1 - fy) + (texel(y0 + 1, x0) * (1 - fx) + texel(y0 + 1, x0 + 1) * fx) * fy


def textured(pixels: np.ndarray, ref: TextureRef, uv: np.ndarray, cone: float = 0.0) -> np.ndarray:
    """(n, 3) base colours the surface kernel finds at uv (n, 2), on a triangle whose uv are its x and y."""
    made = Stage()
    made.image(pixels)
    corners = np.array([[-100, -100, 0], [300, -100, 0], [-100, 300, 0]], np.float32)
    triangle = mesh_of(corners, [[0, 1, 2]], uv0=corners[:, :2].copy(), uv1=corners[:, :2] * np.float32(2))
    world = World(made.add("/t", triangle, Material(base_color_texture=ref)).scene)
    count = len(uv)
    barycentric = ((uv + 100) / 400).astype(np.float32)
    out, down = empty_surfaces(count), np.tile(np.float32([0, 0, -1]), (count, 1))
    surface(
        down, np.ones(count, np.float32), np.zeros(count, np.uint32), barycentric,
        geometry_arrays(world), material_arrays(world), np.zeros(3, np.float32), np.float32([0, 0, -1]),
        np.float32([cone, 0]), np.zeros(world.object_count + 1, np.uint8), True,
        np.arange(count, dtype=np.int32), np.arange(count, dtype=np.int32), out,
        np.empty(count, np.uint8),
    )  # fmt: skip
    return out.base_color


REFS = {
    "repeat": TextureRef(0),
    "clamp": TextureRef(0, wrap_s="clamp", wrap_t="clamp"),
    "mirror": TextureRef(0, wrap_s="mirror", wrap_t="mirror"),
    "mixed": TextureRef(0, wrap_s="clamp", wrap_t="mirror"),
    "nearest": TextureRef(0, nearest=True),
    "nearest_mirror": TextureRef(0, nearest=True, wrap_s="mirror"),
    "transformed": TextureRef(0, offset=(0.3, -0.2), rotation=0.7, scale=(1.5, 0.5)),
}


@pytest.mark.parametrize("name", REFS)
@pytest.mark.parametrize("size", [(5, 8), (1, 1), (1, 4)])
def test_lookups_wrap_and_filter_as_gltf_says(name: str, size: tuple[int, int]) -> None:
    pixels, ref = random_pixels(*size), REFS[name]
    uv = np.random.default_rng(2).uniform(-2.5, 3.5, (400, 2))
    expected = lookup_twin(to_linear(pixels[..., :3]), uv, ref)
    error = np.abs(textured(pixels, ref, uv) - expected)
    # Barycentrics of the wide triangle carry about 3e-5 of uv: beside an edge, nearest may take the neighbour.
    assert np.quantile(error, 0.98) < 2e-3
    if not ref.nearest:
        assert error.max() < 5e-3


def test_the_second_uv_set_is_used_where_asked_for() -> None:
    pixels, uv = random_pixels(8, 8), np.random.default_rng(2).uniform(0, 0.5, (100, 2))
    first, second = (textured(pixels, TextureRef(0, uv_set=k), at) for k, at in ((0, uv * 2), (1, uv)))
    np.testing.assert_allclose(first, second, atol=5e-3)


@pytest.mark.parametrize("level", [0, 1, 2, 3])
def test_a_footprint_of_two_to_the_k_texels_reads_mip_level_k(level: int) -> None:
    pixels, uv = random_pixels(32, 32), np.random.default_rng(2).uniform(0, 1, (300, 2))
    expected = lookup_twin(to_linear(pyramid(pixels, srgb=True, levels=16)[level][..., :3]), uv, TextureRef(0))
    np.testing.assert_allclose(textured(pixels, TextureRef(0), uv, cone=2**level / 32), expected, atol=0.02)


def test_a_texture_without_mipmaps_stays_sharp_far_away() -> None:
    pixels, uv = random_pixels(32, 32), np.random.default_rng(2).uniform(0, 1, (100, 2))
    ref = TextureRef(0, mipmaps=False)
    np.testing.assert_allclose(textured(pixels, ref, uv, cone=1.0), textured(pixels, ref, uv), atol=1e-6)
