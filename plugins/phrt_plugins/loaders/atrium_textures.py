"""The atrium's textures, painted with seeded, tileable noise. Every image repeats without a seam in both directions."""

from __future__ import annotations

import numpy as np

from phrt.model import Image

Array = np.ndarray
SIZE = 256


def paint_textures(seed: int) -> list[Image]:
    """Every image of the atrium, in a fixed order; equal for equal seeds."""
    random = np.random.default_rng(seed)
    noise = Noise(random)
    blocks, block_normals = stone_blocks(noise, rows=8, columns=4, size=512)
    return [
        Image("stone_blocks", blocks),
        Image("stone_blocks_normal", block_normals),
        Image("limestone", limestone(noise)),
        Image("voussoirs", voussoirs(noise)),
        Image("marble_white", marble(noise, (236, 232, 224), (150, 148, 150))),
        Image("marble_dark", marble(noise, (34, 58, 50), (150, 178, 160))),
        Image("floor_tiles", floor_tiles(noise)),
        Image("floor_tiles_roughness", floor_roughness(noise)),
        Image("gallery_tiles", gallery_tiles(noise)),
        Image("plaster", plaster(noise)),
        Image("cloth", cloth(noise)),
        Image("cloth_normal", normal_map(weave(SIZE, 32), 2.0)),
        Image("terracotta", terracotta(noise)),
        Image("wood", wood(noise)),
    ]


class Noise:
    """Tileable random fields with a falling spectrum, mean 0 and deviation 1."""

    def __init__(self, random: np.random.Generator) -> None:
        self.random = random

    def field(self, size: int = SIZE, power: float = 1.6, stretch: tuple[float, float] = (1.0, 1.0)) -> Array:
        """(size, size) float32. power: how fast detail falls off; stretch (x, y) draws features out along an axis."""
        frequency_y = np.fft.fftfreq(size)[:, None] * size * stretch[1]
        frequency_x = np.fft.rfftfreq(size)[None, :] * size * stretch[0]
        amplitude = np.maximum(np.hypot(frequency_x, frequency_y), 1.0) ** -power
        amplitude[0, 0] = 0.0
        phase = np.exp(2j * np.pi * self.random.random(amplitude.shape))
        field = np.fft.irfft2(amplitude * phase, s=(size, size))
        return (field / field.std()).astype(np.float32)


def coordinates(size: int) -> tuple[Array, Array]:
    """u (1, size) and v (size, 1) of pixel centres, 0..1."""
    center = (np.arange(size, dtype=np.float32) + 0.5) / size
    return center[None, :], center[:, None]


def colored(color: Array | tuple[int, int, int], factor: Array) -> Array:
    """(H, W, 4) uint8 sRGB: `color` 0..255 times `factor` (H, W)."""
    pixels = np.full((*factor.shape, 4), 255, dtype=np.uint8)
    pixels[..., :3] = np.clip(np.asarray(color, dtype=np.float32) * factor[..., None], 0, 255)
    return pixels


def mixed(low: tuple[int, int, int], high: tuple[int, int, int], amount: Array) -> Array:
    """(H, W, 3) float32, 0..255: between two colours by `amount` 0..1."""
    a, b = np.array(low, dtype=np.float32), np.array(high, dtype=np.float32)
    return a + (b - a) * np.clip(amount, 0, 1)[..., None]


def normal_map(height: Array, strength: float) -> Array:
    """(H, W, 4) uint8 tangent-space normals of a tileable `height` (H, W) in pixels, +Y up as in glTF."""
    dx = (np.roll(height, -1, 1) - np.roll(height, 1, 1)) * 0.5 * strength
    dy = (np.roll(height, -1, 0) - np.roll(height, 1, 0)) * 0.5 * strength
    normal = np.stack([-dx, dy, np.ones_like(dx)], axis=-1)
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    pixels = np.full((*height.shape, 4), 255, dtype=np.uint8)
    pixels[..., :3] = np.rint(normal * 127.5 + 127.5)
    return pixels


def joints(u: Array, v: Array, columns: int, rows: int, shift: float, width: float) -> tuple[Array, Array]:
    """Distance to the nearest joint (0 in it, 1 clear of it) and the cell number of a running bond."""
    y = v * rows
    row = np.floor(y).astype(np.int32)
    x = u * columns + (row % 2) * shift
    column = np.floor(x).astype(np.int32) % columns
    fraction_x, fraction_y = x - np.floor(x), y - row
    edge = np.minimum(np.minimum(fraction_x, 1 - fraction_x) * (rows / columns), np.minimum(fraction_y, 1 - fraction_y))
    return np.clip(edge / width, 0, 1), row * columns + column


def stone_blocks(noise: Noise, rows: int, columns: int, size: int) -> tuple[Array, Array]:
    """Coursed limestone with mortar: colour and normal map."""
    u, v = coordinates(size)
    clear, cell = joints(u, v, columns, rows, 0.5, 0.07)
    tone = noise.random.uniform(0.86, 1.06, rows * columns).astype(np.float32)[cell]
    warmth = noise.random.uniform(-0.03, 0.03, rows * columns).astype(np.float32)[cell]
    grain, stain = noise.field(size, 1.0), noise.field(size, 1.9)
    factor = tone * (1 + 0.035 * grain + 0.05 * stain) * (0.66 + 0.34 * clear)
    color = np.stack([220 * (1 + warmth), np.full_like(tone, 190), 146 * (1 - warmth)], axis=-1)
    height = 3.0 * np.sqrt(clear) + 0.18 * grain
    return colored(color, factor), normal_map(height, 0.8)


def limestone(noise: Noise) -> Array:
    """Plain dressed stone with faint beds."""
    factor = 1 + 0.03 * noise.field(power=1.0) + 0.045 * noise.field(power=1.8, stretch=(1.0, 3.0))
    return colored((226, 203, 166), factor)


def voussoirs(noise: Noise) -> Array:
    """Wedge stones of an arch: joints across u, alternately warm and pale, four a tile."""
    u, _ = coordinates(SIZE)
    x = np.broadcast_to(u * 4, (SIZE, SIZE))
    cell = np.floor(x).astype(np.int32)
    fraction = x - cell
    clear = np.clip(np.minimum(fraction, 1 - fraction) / 0.035, 0, 1)
    warm = mixed((226, 212, 186), (196, 140, 108), (cell % 2).astype(np.float32))
    return colored(warm, (0.7 + 0.3 * clear) * (1 + 0.04 * noise.field(power=1.2)))


def marble(noise: Noise, ground: tuple[int, int, int], vein: tuple[int, int, int]) -> Array:
    """Clouded ground with thin veins where a warped field crosses zero."""
    cloud, warp = noise.field(power=1.7), noise.field(power=2.1)
    veins = np.exp(-np.abs(warp + 0.25 * cloud) * 14) + 0.5 * np.exp(-np.abs(noise.field(power=1.9) - 0.6) * 18)
    return colored(mixed(ground, vein, 0.75 * veins), 1 + 0.03 * cloud)


def floor_tiles(noise: Noise) -> Array:
    """2 x 2 marble tiles, pale and rosy in turn, with a dark joint."""
    clear, dark = tile_layout()
    cloud = noise.field(power=1.6)
    veins = np.exp(-np.abs(noise.field(power=1.9)) * 12)
    color = mixed((206, 192, 166), (164, 92, 66), dark.astype(np.float32))
    return colored(color, (1 + 0.04 * cloud + 0.08 * veins) * (0.55 + 0.45 * clear))


def floor_roughness(noise: Noise) -> Array:
    """Metallic-roughness of `floor_tiles`: worn tiles shine more than their joints."""
    clear, dark = tile_layout()
    rough = 0.5 + 0.04 * np.clip(noise.field(power=1.8), -2.0, 2.0) - 0.05 * dark
    pixels = np.zeros((SIZE, SIZE, 4), dtype=np.uint8)
    pixels[..., 1] = np.clip(255 * (rough * clear + 0.9 * (1 - clear)), 0, 255)
    pixels[..., 3] = 255
    return pixels


def tile_layout() -> tuple[Array, Array]:
    """Clear-of-joint factor and which tiles of the 2 x 2 are dark."""
    u, v = coordinates(SIZE)
    clear, cell = joints(u, v, 2, 2, 0.0, 0.018)
    return clear, np.isin(cell, (0, 3))


def gallery_tiles(noise: Noise) -> Array:
    """Small terracotta tiles in a running bond."""
    u, v = coordinates(SIZE)
    clear, cell = joints(u, v, 4, 8, 0.5, 0.06)
    tone = noise.random.uniform(0.82, 1.12, 32).astype(np.float32)[cell]
    return colored((172, 112, 82), tone * (0.6 + 0.4 * clear) * (1 + 0.05 * noise.field(power=1.1)))


def plaster(noise: Noise) -> Array:
    """Pale lime plaster, slightly blotched."""
    return colored((230, 212, 180), 1 + 0.035 * noise.field(power=2.0) + 0.012 * noise.field(power=0.6))


def weave(size: int, threads: int) -> Array:
    """(size, size) height of a plain weave, `threads` a tile (even)."""
    u, v = coordinates(size)
    warp, weft = np.abs(np.sin(np.pi * threads * u)), np.abs(np.sin(np.pi * threads * v))
    over = (np.floor(threads * u) + np.floor(threads * v)) % 2
    return np.where(over == 0, warp * (0.6 + 0.4 * weft), weft * (0.6 + 0.4 * warp)).astype(np.float32)


def cloth(noise: Noise) -> Array:
    """Undyed cloth with two darker stripes a tile; a material's base colour dyes it."""
    size = 512
    _, v = coordinates(size)
    thread = weave(size, 128)
    stripe = 1 - 0.35 * (np.abs(v - 0.5) < 0.05) - 0.35 * ((v > 0.06) & (v < 0.1))
    return colored((245, 242, 236), (0.85 + 0.15 * thread) * stripe * (1 + 0.02 * noise.field(size, 1.4)))


def terracotta(noise: Noise) -> Array:
    """Fired clay with faint turning rings."""
    factor = 1 + 0.05 * noise.field(power=1.3) + 0.05 * noise.field(power=1.5, stretch=(0.15, 4.0))
    return colored((186, 104, 68), factor)


def wood(noise: Noise) -> Array:
    """Dark planks along v."""
    u, _ = coordinates(SIZE)
    plank = np.broadcast_to(u * 4, (SIZE, SIZE))
    fraction = plank - np.floor(plank)
    tone = noise.random.uniform(0.8, 1.15, 4).astype(np.float32)[np.floor(plank).astype(np.int32)]
    clear = np.clip(np.minimum(fraction, 1 - fraction) / 0.04, 0, 1)
    fibre = noise.field(power=1.2, stretch=(0.3, 6.0))
    return colored((112, 74, 46), tone * (0.45 + 0.55 * clear) * (1 + 0.1 * fibre))
