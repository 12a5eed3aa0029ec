"""Small worlds whose caustics can be computed, and what the effect makes of them."""

from __future__ import annotations

from collections import Counter
from contextlib import ExitStack
from typing import Any

import numpy as np
from phrt_caustics.effect import Caustics
from phrt_caustics.emission import Batch, batches
from phrt_caustics.kernels.photons import Landed
from phrt_caustics.options import CausticsOptions
from phrt_caustics.photons import joined, trace_photons

from phrt.camera import CameraView, look_at
from phrt.frame import Frame
from phrt.interfaces.effect import EffectResult
from phrt.model import Light, Material
from phrt.testing.frames import frame_of
from phrt.testing.worlds import at, quad, sphere, world_of
from phrt.world import World

GROUND = Material("ground", base_color=(0.5, 0.5, 0.5, 1.0), specular=0.0)
MIRROR = Material("mirror", metallic=1.0, roughness=0.0)
GLASS = Material("glass", transmission=1.0, thickness=1.0, roughness=0.0, ior=1.5)
MATERIALS = [GROUND, MIRROR, GLASS]
"""Meshes name them by number: 0, 1, 2."""
RADIUS = 0.5
WIDE = 1.0
"""Half the width and height of what `above` sees, metres."""


def flat(y: float = 0.0) -> np.ndarray:
    """(4, 4): a quad, which faces +Z, laid down at height y, facing up."""
    matrix = at(y=y)
    matrix[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    return matrix


def down(x: float = 0.0, y: float = 4.0, z: float = 0.0) -> np.ndarray:
    """(4, 4): a light, which shines along -Z, turned to shine straight down."""
    matrix = at(x, y, z)
    matrix[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    return matrix


def above(size: int = 64) -> CameraView:
    """Straight down on the ground at y = 0 from under whatever hangs there: x to the right, z downwards, no perspective."""
    eye = look_at((0.0, 0.01, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0))
    return CameraView(size, size, eye, (WIDE, WIDE), orthographic=True, near=0.001)


def places(size: int = 64) -> tuple[np.ndarray, np.ndarray]:
    """x and z (size * size,) of the ground points that the pixels of `above` show."""
    along = (np.arange(size) + 0.5) / size * 2 * WIDE - WIDE
    x, z = np.meshgrid(along, along)
    return x.reshape(-1), z.reshape(-1)


def glass_ball(height: float = 2 * RADIUS, *, shift: float = 0.0, light: Light | None = None, **changes: Any) -> World:
    """A ball of glass over the ground, and a light straight above it that shines down. Height: of its centre."""
    lamp = light or Light("directional", intensity=3.0)
    placed = [(quad(0, half=4.0), flat()), (sphere(48, RADIUS, 2), at(shift, height))]
    return world_of(placed, MATERIALS, lights=[(lamp, down())], **changes)


def every_pixel(frame: Frame) -> np.ndarray:
    return np.arange(len(frame.surfaces.object_id), dtype=np.int32)


def layer(world: World, view: CameraView, **options: Any) -> tuple[np.ndarray, EffectResult]:
    """(H, W, 3) irradiance at all pixels of `view`, and the result it is from."""
    with frame_of(world, view) as frame:
        found = Caustics(CausticsOptions(**options)).trace(frame, every_pixel(frame))
    return found.values.reshape(view.height, view.width, 3), found


class Shot:
    """Photons of a world, traced: where they landed, and the batches they were sent in."""

    def __init__(self, world: World, photons: int, *, depth: int = 8, cutoff: float = 0.3) -> None:
        with ExitStack() as stack:
            frame = stack.enter_context(frame_of(world, above(8)))
            self.batches: list[Batch] = batches(world, photons, cutoff)
            parts = [trace_photons(frame, batch, depth, cutoff) for batch in self.batches]
            self.traced = frame.tracer.rays  # type: ignore[attr-defined]
        self.landed: Landed = joined([part for part, _ in parts])
        self.rays = sum(rays for _, rays in parts)

    def main_path(self) -> np.ndarray:
        """(k,) those that met the same things as most."""
        (trail, _), *_ = Counter(self.landed.trail.tolist()).most_common(1)
        return np.flatnonzero(self.landed.trail == trail)


def through_a_ball(h: np.ndarray, ior: float, distance: float) -> np.ndarray:
    """How far from the axis rays land that met a ball of RADIUS parallel to it at h (n,) from it: on a plane across the axis
    `distance` behind the centre; negative on the other side. Snell's law, twice."""
    i = np.arcsin(h / RADIUS)
    r = np.arcsin(h / RADIUS / ior)
    leaves, turned = 2 * r - i, 2 * (i - r)
    return RADIUS * np.sin(leaves) - (distance - RADIUS * np.cos(leaves)) * np.tan(turned)
