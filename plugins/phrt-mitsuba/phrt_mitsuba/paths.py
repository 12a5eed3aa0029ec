"""Path-traced pictures of a world, by Mitsuba's `path` and `volpath`.

    with PathTracer() as tracer:
        image = tracer.render(world, view, samples=64, max_depth=6, seed=0)

Every pixel is the mean over its area (a box filter of one pixel), by stratified samples (Kensler 2013, "Correlated
Multi-Jittered Sampling"). Paths end by Russian roulette after `max_depth` or LONG edges, whichever is less. Bright specks, which
a few paths of very many make, are taken out (`phrt_mitsuba.specks`).
"""

from __future__ import annotations

import math
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from phrt.camera import CameraView
from phrt.errors import PhrtWarning
from phrt_mitsuba.availability import choose_variant
from phrt_mitsuba.scene import PathScenes, make_scenes
from phrt_mitsuba.specks import MOST_PARTS, parts_of, without_specks

if TYPE_CHECKING:
    from phrt.world import World

LONG = 8
MOST_PATHS = 4_000_000
"""That a kernel has at a time: each takes some ten bytes of memory."""
FARTHEST = 1e5
"""Metres: Mitsuba's cameras must end somewhere."""

_lock = threading.RLock()
"""The variant belongs to the process."""


class PathTracer:
    """Keeps the scenes of a world for as long as nothing in it moves.

    variant: of Mitsuba; by default the one that works here. "scalar_rgb" needs no LLVM, and takes far longer. Raises PluginError
    where none works.
    """

    def __init__(self, variant: str | None = None) -> None:
        self.variant = variant or choose_variant()
        self._world: World | None = None
        self._moment: tuple[bytes, bytes] | None = None
        self._scenes: PathScenes | None = None

    def render(self, world: World, view: CameraView, *, samples: int, max_depth: int, seed: int = 0) -> np.ndarray:
        """As `phrt.interfaces.tracer.Tracer.render_paths`."""
        with _using(self.variant) as mitsuba:
            scenes = self._made(mitsuba, world)
            asked = Asked(view, samples, max_depth, seed, scenes.passing)
            image = picture(mitsuba, scenes.lit, asked, hide_emitters=not world.environment.visible)
            if scenes.glowing is not None:
                image += picture(mitsuba, scenes.glowing, asked, hide_emitters=False)
        return np.ascontiguousarray(image * np.float32(view.exposure * world.scene.settings.exposure))

    def close(self) -> None:
        """Give memory back."""
        self._world = self._moment = self._scenes = None

    def __enter__(self) -> PathTracer:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _made(self, mitsuba: Any, world: World) -> PathScenes:
        """The scenes of `world` as it is now."""
        moment = (world.object_matrix.tobytes(), world.lights.tobytes())
        known = self._scenes.notes if self._scenes is not None and self._world is world else ()
        if self._scenes is None or self._world is not world or self._moment != moment:
            self._scenes, self._world, self._moment = make_scenes(mitsuba, world), world, moment
            if new := [note for note in self._scenes.notes if note not in known]:
                left_out = f"path tracing '{world.scene.name}' leaves out: {'; '.join(new)}"
                warnings.warn(PhrtWarning(left_out), stacklevel=4)
        return self._scenes


@dataclass(frozen=True)
class Asked:
    """What pictures of a scene have in common. passing: are there surfaces that light passes on a straight way?"""

    view: CameraView
    samples: int
    max_depth: int
    seed: int
    passing: bool


def picture(mitsuba: Any, scene: Any, asked: Asked, *, hide_emitters: bool) -> np.ndarray:
    """(H, W, 3) float32 of a Mitsuba scene, exposure not applied. hide_emitters: is the dome not to be seen?"""
    parts = parts_of(asked.samples)
    each = stratified(-(-asked.samples // parts))
    camera = sensor(mitsuba, asked.view, each)
    paths = integrator(mitsuba, asked, each, hide_emitters=hide_emitters)
    seeds = range(asked.seed * MOST_PARTS, asked.seed * MOST_PARTS + parts)
    pictures = [paths.render(scene, camera, seed=seed, spp=each) for seed in seeds]
    return without_specks(np.stack([np.array(part, np.float32) for part in pictures]))


def sensor(mitsuba: Any, view: CameraView, samples: int) -> Any:
    """The camera of `view`, whatever its jitter."""
    # Mitsuba's cameras look along +Z, and +X is on their left.
    matrix = view.world_from_view @ np.diag([-1.0, 1.0, -1.0, 1.0])
    said: dict[str, Any] = {
        "near_clip": max(float(view.near), 1e-4),
        "far_clip": float(min(view.far, FARTHEST)),
        "film": {
            "type": "hdrfilm", "width": view.width, "height": view.height, "rfilter": {"type": "box"},
            "pixel_format": "rgb", "component_format": "float32",
        },
        "sampler": {"type": "multijitter", "sample_count": samples},
    }  # fmt: skip
    if view.orthographic:
        # An orthographic camera of Mitsuba's sees -1 to 1 across, and what the picture's shape makes of it upwards.
        said["type"] = "orthographic"
        matrix = matrix @ np.diag([view.tan_half[0], view.tan_half[0], 1.0, 1.0])
    else:
        said |= {"type": "perspective", "fov": math.degrees(2 * math.atan(view.tan_half[1])), "fov_axis": "y"}
    return mitsuba.load_dict({**said, "to_world": mitsuba.ScalarTransform4f(matrix.astype(np.float32))})


def integrator(mitsuba: Any, asked: Asked, samples: int, *, hide_emitters: bool) -> Any:
    """Mitsuba's path tracer. To look through surfaces on the way to a light takes longer, and is done where it must be."""
    said = {
        "type": "volpath" if asked.passing else "path",
        "max_depth": asked.max_depth,
        "rr_depth": min(asked.max_depth, LONG),
        "hide_emitters": hide_emitters,
    }
    if not mitsuba.variant().startswith("scalar"):
        said["samples_per_pass"] = samples_at_a_time(samples, asked.view.width * asked.view.height)
    return mitsuba.load_dict(said)


def stratified(samples: int) -> int:
    """`samples` or a few more: as many as fill a grid, which is what Mitsuba's sampler takes."""
    rows = math.isqrt(samples)
    return rows * -(-samples // rows)


def samples_at_a_time(samples: int, pixels: int) -> int:
    """The largest divisor of `samples` with MOST_PATHS paths at most, or 1."""
    fits = [part for part in range(1, samples + 1) if samples % part == 0 and part * pixels <= MOST_PATHS]
    return max(fits, default=1)


@contextmanager
def _using(variant: str) -> Iterator[Any]:
    """The package `mitsuba` with `variant` set, inside; one thread at a time."""
    import mitsuba

    with _lock:
        before = mitsuba.variant()
        mitsuba.set_variant(variant)
        level = mitsuba.log_level()
        mitsuba.set_log_level(mitsuba.LogLevel.Error)
        try:
            yield mitsuba
        finally:
            mitsuba.set_log_level(level)
            if before is not None:
                mitsuba.set_variant(before)
