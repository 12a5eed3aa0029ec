"""G-buffer producer: finds which surface is behind every pixel."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from phrt.channels import CHANNELS, GBuffer
from phrt.kernels.arrays import SurfaceArrays, surface_arrays

if TYPE_CHECKING:
    from phrt.camera import CameraView
    from phrt.world import Changes, World

POINT_CHANNELS = tuple(name for name in CHANNELS if name != "motion")
"""What `SurfaceArrays` hold. Without motion: a view of the side must not become the frame that motion counts from."""


class GBufferProducer(ABC):
    """Contract: `build` once, `update` between frames, `render` any number of times for any camera and size."""

    few_are_cheap: bool = False
    """Do few pixels of a view take less than all of them? A rasterizer draws every triangle for one pixel, too."""

    @abstractmethod
    def build(self, world: World) -> None:
        """Take over geometry, materials and textures."""

    @abstractmethod
    def update(self, world: World, changes: Changes) -> None:
        """Take over the new places of `changes.objects`."""

    @abstractmethod
    def render(
        self,
        view: CameraView,
        *,
        channels: Iterable[str] = tuple(CHANNELS),
        hidden: np.ndarray | None = None,
        pixels: np.ndarray | None = None,
    ) -> GBuffer:
        """The G-buffer of `view` (its size and sub-pixel jitter included), at least the `channels` asked for.

        pixels: (n,) int32 flat indices, the only ones that will be looked at; the others may hold anything.

        hidden: (N + 1,) bool, objects that are not there: glass for what is behind it, an object for its own probe.
        Alpha-masked texels below their cut-off are not there. Single-sided materials are culled from behind.
        """

    def points(self, view: CameraView, pixels: np.ndarray, *, hidden: np.ndarray | None = None) -> SurfaceArrays:
        """The surfaces behind `pixels` (n,) int32 of `view`, n rows in their order: `render` for few pixels.

        Here by way of a whole G-buffer; a producer that can do with less overrides it. Motion is not counted from it.
        """
        gbuffer = self.render(view, channels=POINT_CHANNELS, hidden=hidden, pixels=pixels)
        return SurfaceArrays(*(array[pixels] for array in surface_arrays(gbuffer)))

    def close(self) -> None:
        """Give memory and contexts back. Called once; nothing follows."""
