"""The kit finds what an effect does wrong. Each broken one is a sound one with one thing changed."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from phrt.frame import Frame
from phrt.interfaces.effect import EffectResult, LayerSpec, RayEffect
from phrt.rays import RayBatch
from phrt.registry import Options
from phrt.testing import check_effect
from phrt.world import World


class Sound(RayEffect):
    """Is the sky above open? One ray straight up; 0.5 where nothing is traced."""

    name = "sound"
    reads: tuple[str, ...] = ("position_world", "normal_geometric_world")
    writes = LayerSpec("sky", 1, 1.0, "is the sky above open?")

    def __init__(self, options: Options) -> None:
        self.options = options

    def applies_to(self, world: World) -> np.ndarray:
        return np.asarray(world.materials["metallic"] < 1)

    def rays_per_pixel(self, world: World) -> float:
        return 1.0

    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        points, count = frame.surfaces, len(pixels)
        origin = points.position[pixels] + np.float32(1e-3) * points.geometric_normal[pixels]
        up = np.tile(np.array([0, 1, 0], np.float32), (count, 1))
        blocked = frame.tracer.occluded(RayBatch(origin, up, np.full(count, np.inf, np.float32)))
        return EffectResult((~blocked).astype(np.float32).reshape(count, 1), count)

    def fallback(self, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        return np.full((len(pixels), 1), 0.5, np.float32)


class UnknownChannel(Sound):
    reads = ("position_world", "albedo")


class ClearsToNan(Sound):
    writes = LayerSpec("sky", 1, float("nan"), "")


class FlatValues(Sound):
    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        found = super().trace(frame, pixels)
        return replace(found, values=found.values[:, 0])


class NotFinite(Sound):
    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        found = super().trace(frame, pixels)
        return replace(found, values=np.log(found.values + np.float32(0.5)) / np.maximum(found.values, 0))


class BoolTraced(Sound):
    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        return replace(super().trace(frame, pixels), traced=np.ones(len(pixels), bool))


class CountsTwice(Sound):
    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        return replace(super().trace(frame, pixels), rays=2 * len(pixels))


class RandomByCall(Sound):
    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        found = super().trace(frame, pixels)
        return replace(found, values=found.values + np.random.default_rng().random(found.values.shape, np.float32))


class RandomByRow(Sound):
    """Seeded, but by the place in the call and not by the pixel."""

    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        found = super().trace(frame, pixels)
        noise = np.random.default_rng(frame.seed).random(found.values.shape, np.float32)
        return replace(found, values=found.values + noise)


class RelativeToTheMean(Sound):
    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        found = super().trace(frame, pixels)
        return replace(found, values=found.values - found.values.mean())


class SharesItsScratch(Sound):
    def __init__(self, options: Options) -> None:
        super().__init__(options)
        self.pixels = np.zeros(0, np.int32)
        self.pause = threading.Event()

    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        self.pixels = pixels
        self.pause.wait(0.005)
        return super().trace(frame, self.pixels)


class SortsItsPixels(Sound):
    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        pixels.sort()
        return super().trace(frame, pixels)


class ChangesTheFrame(Sound):
    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        found = super().trace(frame, pixels)
        frame.surfaces.roughness[pixels] = 0.0
        return found


class MaterialsOfObjects(Sound):
    def applies_to(self, world: World) -> np.ndarray:
        return np.ones(world.object_count + 5, bool)


class CostsNothing(Sound):
    def rays_per_pixel(self, world: World) -> float:
        return 0.0


class AppliesNowhere(Sound):
    def applies_to(self, world: World) -> np.ndarray:
        return np.zeros(len(world.materials), bool)


class FallbackOfThreeComponents(Sound):
    def fallback(self, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        return np.zeros((len(pixels), 3), np.float32)


class FallbackByRow(Sound):
    def fallback(self, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        return np.linspace(0, 1, len(pixels), dtype=np.float32).reshape(-1, 1)


class NeedsALight(Sound):
    def trace(self, frame: Frame, pixels: np.ndarray) -> EffectResult:
        assert len(frame.world.lights) > 0, "no light"
        return super().trace(frame, pixels)


BROKEN: list[tuple[Any, str]] = [
    (UnknownChannel, "`reads` names channels of the G-buffer; it has no albedo"),
    (ClearsToNan, "a layer's clear value is finite, not nan"),
    (FlatValues, r"trace returns values float32\((\d+), 1\), not float32\(\d+,\)"),
    (NotFinite, "values of trace are finite"),
    (BoolTraced, r"`traced` is None or uint8"),
    (CountsTwice, r"`rays` is how many were traced: \d+, not \d+"),
    (RandomByCall, "the same frame gives the same values: .* differ, as at pixel"),
    (RandomByRow, "a pixel's value does not depend on the other pixels"),
    (RelativeToTheMean, "a pixel's value does not depend on the other pixels"),
    (SharesItsScratch, "several threads may trace at once|an effect's frame raised"),
    (SortsItsPixels, "the pixels are not changed"),
    (ChangesTheFrame, "the frame's arrays are not changed"),
    (MaterialsOfObjects, r"applies_to returns bool\(5,\), not bool\(14,\)"),
    (CostsNothing, "rays_per_pixel is finite, and above 0 where it applies"),
    (AppliesNowhere, "it applies to some of: stone, mirror, glass"),
    (FallbackOfThreeComponents, "fallback returns values float32"),
    (FallbackByRow, "a pixel's fallback does not depend on the other pixels"),
    (NeedsALight, r"an effect's frame raised AssertionError: no light.*\[a room without lights\]"),
]


def test_the_sound_one_passes() -> None:
    check_effect(Sound)


@pytest.mark.filterwarnings("ignore:divide by zero:RuntimeWarning", "ignore:invalid value:RuntimeWarning")
@pytest.mark.parametrize(("broken", "says"), BROKEN, ids=lambda value: getattr(value, "__name__", ""))
def test_a_broken_effect_is_found(broken: type[RayEffect], says: str) -> None:
    with pytest.raises(AssertionError, match=f"effect {broken.__name__} breaks its contract: .*({says})"):
        check_effect(broken)
