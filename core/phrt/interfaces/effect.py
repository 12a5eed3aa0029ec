"""RayEffect: one kind of light that rays can bring - shadows, reflections, refractions, ... Declared, then executed."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from phrt.frame import Frame
    from phrt.world import World


Adds = Literal["", "irradiance", "radiance"]
"""What a layer adds to the picture, see `LayerSpec`."""


@dataclass(frozen=True)
class LayerSpec:
    """A layer an effect writes. `components` 0 means one component per light of the scene.

    adds: what the composition makes of a layer that it does not know by name: nothing (""), or it adds the layer, which has 3
    components. "irradiance" arrives at the surface, in lux, and its body sends its diffuse share of it on; "radiance" leaves the
    surface towards the eye, in nits, as it is. The clear value of layers that add light should be 0.
    """

    name: str
    components: int
    clear: float
    meaning: str
    adds: Adds = ""

    def __post_init__(self) -> None:
        if self.adds and self.components != 3:
            raise ValueError(f"layer '{self.name}' adds {self.adds}, so it has 3 components, not {self.components}")

    def width(self, world: World) -> int:
        """Components in `world`."""
        return self.components or len(world.lights)


@dataclass(frozen=True)
class EffectResult:
    """values: (n, components) float32, in the order of the pixels asked for; rays: how many were really traced.

    traced: (n,) uint8, 0 where the effect does not apply after all (a texture made the surface rough, say) and the layer's
    clear value stays; None when every pixel holds a value.
    shared_rays: how many of `rays` serve every pixel of the frame, whichever call came first (a photon map's, say). They are booked
    on all that the wave traced of the effect, by pixels, so that no decision hangs on which call came first.
    """

    values: np.ndarray
    rays: int
    traced: np.ndarray | None = None
    shared_rays: int = 0


@dataclass(frozen=True)
class HistoryRule:
    """How long a value that was traced at a point may stand in for that point in later frames. Points of objects that moved
    lose theirs anyway. Whatever else can change the value must be named here, or ghosts stay.

    movers   : which moving objects can change it: those on the way from the point to a light, those within `radius` of it, or any.
               Only objects that cast shadows count for the first two
    lights   : does it depend on where and how bright lights are?
    parallax : radians by which the eye may have gone round the point since; inf where the value does not depend on the eye.
               A glossy surface is granted the width of its lobe more
    max_age  : frames it may stand in; ages stop counting at 255, which is for ever
    radius   : metres
    """

    movers: Literal["to_lights", "near", "any"]
    lights: bool
    parallax: float = math.inf
    max_age: int = 255
    radius: float = 0.0


class RayEffect(ABC):
    """Contract: constructed from its pydantic options; everything but `trace` and `fallback` is cheap and repeatable.
    `trace` is called from several threads with disjoint pixels, and must give the same values for a pixel whatever
    the other pixels of the call are (randomness is seeded by pixel, sample and frame)."""

    name: str
    reads: tuple[str, ...]
    """G-buffer channels it needs."""
    writes: LayerSpec
    history: HistoryRule | None = None
    """What its values of earlier frames are good for where nothing is traced; None when they are not kept."""

    @property
    def switch(self) -> str:
        """The name that objects switch it by (`effects: {shadows: always}`)."""
        return self.name

    @abstractmethod
    def applies_to(self, world: World) -> np.ndarray:
        """(materials,) bool: does tracing this effect change anything on surfaces of that material?"""

    @abstractmethod
    def rays_per_pixel(self, world: World) -> float:
        """Expected rays for one pixel of a surface it applies to: Q of the paper before it is measured."""

    @abstractmethod
    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        """Values of this effect's layer at `pixels` ((n,) int32, flat indices, tile order) by ray tracing."""

    def applies_at(self, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        """(n,) bool: where among `pixels`, on materials it applies to, `trace` would give a value; None for everywhere.

        The other pixels keep the layer's clear value, traced or not: no gap filling and no fallback reaches them.
        """
        return None

    def prepare_fallback(self, frame: Frame) -> None:
        """Called before `fallback` in the first frame where something is not traced, and again when the scene was changed since."""
        return

    def begin_run(self) -> None:
        """Another run begins (`Renderer.restart`). An effect whose fallbacks depend on the frames before, as probes that are
        captured bit by bit do, forgets them here; those of a scene that stood still may be kept."""
        return

    @abstractmethod
    def fallback(self, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        """(n, components) float32: what `pixels` get when they are not traced; None when that is the layer's clear value."""
