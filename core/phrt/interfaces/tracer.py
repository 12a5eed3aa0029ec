"""Tracer: answers which triangle a ray meets first, and whether anything is in the way."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from phrt.rays import HitBatch, RayBatch

if TYPE_CHECKING:
    from phrt.world import Changes, World


@dataclass(frozen=True)
class TracerCapabilities:
    """description: what the tracer is and how it works, in one line; shown by `phrt doctor`."""

    description: str


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

    def close(self) -> None:
        """Give memory back. Called once; no query follows."""
