"""Tracer: answers which triangle a ray meets first, and whether anything is in the way; some can path trace, too."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from phrt.rays import HitBatch, RayBatch

if TYPE_CHECKING:
    from phrt.camera import CameraView
    from phrt.world import Changes, World


@dataclass(frozen=True)
class TracerCapabilities:
    """description: what the tracer is and how it works, in one line; shown by `phrt doctor`.

    path_tracer: what makes its path-traced pictures (`Tracer.render_paths`), with all that they depend on, such as its version:
    pictures of another one are other pictures. Empty where it makes none.
    """

    description: str
    path_tracer: str = ""


class Tracer(ABC):
    """Contract: `build` once, `update` between frames; the two queries are thread-safe, release the GIL and never
    change the arrays they are given. Triangles are two-sided. Results are `World.triangles` indices."""

    capabilities: TracerCapabilities

    @abstractmethod
    def build(self, world: World) -> None:
        """Build the acceleration structure over `world.positions` and `world.triangles` (world space)."""

    @abstractmethod
    def update(self, world: World, changes: Changes) -> None:
        """Bring the structure to the moved objects of `changes.objects`; `world.positions` holds their new places."""

    @abstractmethod
    def closest_hit(self, rays: RayBatch) -> HitBatch:
        """Nearest hit with 0 <= t < t_max of every ray, among all objects."""

    @abstractmethod
    def occluded(self, rays: RayBatch) -> np.ndarray:
        """(n,) bool: does anything that casts a shadow (`world.object_casts_shadow`) lie at 0 <= t < t_max?"""

    def render_paths(
        self, world: World, view: CameraView, *, samples: int, max_depth: int, seed: int = 0
    ) -> np.ndarray:
        """(H, W, 3) float32, linear Rec.709, times the view's and the scene's exposure: `world` as it is now, path traced.

        samples: paths a pixel, spread over its area, whatever the view's jitter; max_depth: the most edges of a path from the
        eye to a light, 2 for direct light alone; seed: of the noise, which is the same where everything else is.

        Needs no `build`. Warns (PhrtWarning) of what the scene has and the picture has not. Only of tracers whose capabilities
        name a `path_tracer`; any other raises NotImplementedError.
        """
        raise NotImplementedError(f"{type(self).__name__} cannot path trace")

    def close(self) -> None:
        """Give memory back. Called once; no query follows."""
