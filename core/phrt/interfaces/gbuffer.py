"""G-buffer producer: finds which surface is behind every pixel."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from phrt.channels import CHANNELS, GBuffer

if TYPE_CHECKING:
    from phrt.camera import CameraView
    from phrt.world import Changes, World


class GBufferProducer(ABC):
    """Contract: `build` once, `update` between frames, `render` any number of times for any camera and size."""

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

    def close(self) -> None:
        """Give memory and contexts back. Called once; nothing follows."""
