"""Light by light: an effect with a component per light as one effect for each of them, so that lights can be chosen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from phrt.frame import Frame
from phrt.interfaces.effect import EffectResult, LayerSpec, RayEffect
from phrt.world import World


class OneLight(RayEffect):
    """Component `light` of an effect's layer, as an effect of its own: "shadows@/Lights/West".

    It relies on the effect to trace nothing for other lights than `frame.only_light`; one that does not pays for all.
    """

    def __init__(self, effect: RayEffect, light: int, path: str, lights: int) -> None:
        self.name = f"{effect.name}@{path}"
        self.reads = effect.reads
        self.writes = LayerSpec(
            f"{effect.writes.name}@{path}", 1, effect.writes.clear, f"{effect.writes.meaning}: {path}"
        )
        self.layer, self.light = effect.writes.name, light
        self.history = effect.history
        self.whole, self._lights, self._first = effect, lights, light == 0

    @property
    def switch(self) -> str:
        return self.whole.switch

    def applies_to(self, world: World) -> np.ndarray:
        return self.whole.applies_to(world)

    def rays_per_pixel(self, world: World) -> float:
        return self.whole.rays_per_pixel(world) / self._lights

    def applies_at(self, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        return self.whole.applies_at(frame, pixels)

    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        result = self.whole.trace(replace(frame, only_light=self.light), pixels)
        return replace(result, values=self._component(result.values))

    def prepare_fallback(self, frame: Frame) -> None:
        if self._first:
            self.whole.prepare_fallback(frame)

    def begin_run(self) -> None:
        if self._first:
            self.whole.begin_run()

    def fallback(self, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        values = self.whole.fallback(replace(frame, only_light=self.light), pixels)
        return None if values is None else self._component(values)

    def _component(self, values: np.ndarray) -> np.ndarray:
        return np.ascontiguousarray(values[:, self.light : self.light + 1])


def by_light(effects: Sequence[RayEffect], world: World) -> list[RayEffect]:
    """`effects`, those with a component per light as one for every light of `world`."""
    lights = [entry.path for entry in world.scene.lights]
    made: list[RayEffect] = []
    for effect in effects:
        if effect.writes.components:
            made.append(effect)
        else:
            made += [OneLight(effect, number, path, len(lights)) for number, path in enumerate(lights)]
    return made
