"""check_effect: the rules of `phrt.interfaces.effect.RayEffect`, at the pixels of small frames."""

from __future__ import annotations

import math
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from pydantic import BaseModel

from phrt.camera import CameraView, look_at
from phrt.channels import CHANNELS
from phrt.frame import Frame
from phrt.interfaces.effect import EffectResult, HistoryRule, LayerSpec, RayEffect
from phrt.model import Light, Material
from phrt.testing.contract import BROKEN_BY_THE_PLUGIN, Contract, Given, Maker
from phrt.testing.frames import CountingTracer, frame_of
from phrt.testing.worlds import at, box, front_view, quad, sphere, world_of
from phrt.world import World

__tracebackhide__ = BROKEN_BY_THE_PLUGIN

CLOSE = 1e-6
"""Relative and absolute: how far values of the same pixel may be apart."""


def check_effect(effect: Given, options: Mapping[str, object] | BaseModel | None = None) -> None:
    """Put an effect through its contract, in a room with stone, mirrors and glass and in one without lights. Raises
    AssertionError naming the rule and the case.

    effect: the name of a registered one, a descriptor, or a class that takes `options`
    """
    make = Maker("effect", effect, options)
    contract = make.contract
    made = make()
    contract.holds(isinstance(made, RayEffect), "it is a phrt.interfaces.effect.RayEffect")
    _check_declaration(contract, made)
    anywhere = False
    for case, world in (("a lit room", room(True)), ("a room without lights", room(False))):
        with frame_of(world, view(), seed=5) as frame:
            # Each world is a run of its own: what an effect keeps of a scene is not kept from one to the next.
            anywhere |= contract.call("an effect's frame", partial(_applies_anywhere, make, frame, case), case)
    contract.holds(anywhere, "it applies to some of: stone, mirror, glass, a textured or a glossy surface")


def _applies_anywhere(make: Maker, frame: Frame, case: str) -> bool:
    """Every rule in one frame. Does the effect apply to anything in it?"""
    return _Check(make.contract, make(), frame, case).all()


def room(lit: bool) -> World:
    """Balls and boxes of stone, mirror, glass and rough metal on a floor before a wall, under a dome."""
    materials = [
        Material("stone", base_color=(0.6, 0.5, 0.4, 1.0), roughness=0.8),
        Material("mirror", metallic=1.0, roughness=0.0),
        Material("glass", transmission=1.0, thickness=1.0, roughness=0.0),
        Material("glossy", metallic=1.0, roughness=0.12),
    ]
    floor = at(y=-0.7)
    floor[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    placed = [(quad(0, half=3.0), floor), (quad(0, half=3.0), at(z=-2.0))]
    placed += [(sphere(16, 0.35, number % 4), at(x=-0.9 + 0.6 * number, y=-0.35)) for number in range(4)]
    placed += [(box(0.25, number), at(x=-0.6 + 0.8 * number, y=0.4, z=-0.8)) for number in range(3)]
    lamps = [(Light("point", intensity=30.0), at(2, 3, 2)), (Light("sphere", intensity=20.0, radius=0.3), at(-2, 2, 1))]
    return world_of(placed, materials, lights=lamps if lit else [], dome=(0.4, 0.5, 0.7))


def view() -> CameraView:
    return front_view(
        width=48, height=32, tan_half=(0.75, 0.5), world_from_view=look_at((0.3, 0.6, 2.6), (0.0, -0.1, 0.0))
    )


def _check_declaration(contract: Contract, effect: RayEffect) -> None:
    """What it says of itself before anything is traced."""
    name = getattr(effect, "name", None)
    contract.holds(isinstance(name, str) and name, f"`name` is a text, not {name!r}")
    reads = getattr(effect, "reads", None)
    contract.holds(isinstance(reads, tuple), f"`reads` is a tuple of channels, not {reads!r}")
    unknown = sorted(set(reads or ()) - set(CHANNELS))
    contract.holds(not unknown, f"`reads` names channels of the G-buffer; it has no {', '.join(unknown)}")
    writes = getattr(effect, "writes", None)
    contract.holds(isinstance(writes, LayerSpec), f"`writes` is a LayerSpec, not {writes!r}")
    assert isinstance(writes, LayerSpec)
    contract.holds(writes.components >= 0, f"a layer has 0 components (one a light) or more, not {writes.components}")
    contract.holds(math.isfinite(writes.clear), f"a layer's clear value is finite, not {writes.clear}")
    history = effect.history
    contract.holds(history is None or isinstance(history, HistoryRule), f"`history` is a HistoryRule, not {history!r}")


@dataclass
class _Check:
    """One effect in one frame."""

    contract: Contract
    effect: RayEffect
    frame: Frame
    case: str

    def all(self) -> bool:
        """Every rule; returns whether the effect applies to anything here."""
        applies = self._applies()
        material = self.frame.surfaces.material_id
        pixels = np.flatnonzero((self.frame.surfaces.object_id > 0) & applies[material]).astype(np.int32)
        self._applies_at(pixels)
        if not len(pixels):
            return False
        # In an order of its own, as a scheduler's tiles are.
        pixels = np.random.default_rng(3).permutation(pixels)
        before = [array.copy() for array in (*self.frame.surfaces, self.frame.direct)]
        result = self._trace(pixels)
        self._same("the same frame gives the same values", pixels, result, self._trace(pixels))
        self._whatever_the_others_are(pixels, result)
        self._fallback(pixels)
        after = (*self.frame.surfaces, self.frame.direct)
        same = all(np.array_equal(a, b, equal_nan=True) for a, b in zip(before, after, strict=True))
        self._holds(same, "the frame's arrays are not changed")
        return True

    def _applies(self) -> np.ndarray:
        world = self.frame.world
        applies = self.effect.applies_to(world)
        shape = (len(world.materials),)
        fits = isinstance(applies, np.ndarray) and applies.dtype == np.bool_ and applies.shape == shape
        self._holds(fits, f"applies_to returns bool{shape}, not {_kind(applies)}")
        self._holds(np.array_equal(applies, self.effect.applies_to(world)), "applies_to can be asked again")
        rays = self.effect.rays_per_pixel(world)
        right = math.isfinite(rays) and rays >= 0 and (rays > 0 or not applies.any())
        self._holds(right, f"rays_per_pixel is finite, and above 0 where it applies to anything; not {rays!r}")
        return applies

    def _applies_at(self, pixels: np.ndarray) -> None:
        found = self.effect.applies_at(self.frame, pixels)
        fits = found is None or (
            isinstance(found, np.ndarray) and found.dtype == np.bool_ and found.shape == pixels.shape
        )
        self._holds(fits, f"applies_at returns None or bool{pixels.shape}, not {_kind(found)}")

    def _trace(self, pixels: np.ndarray) -> EffectResult:
        """Values of `pixels`, their shapes, their rays."""
        given, counter = pixels.copy(), self.frame.tracer
        assert isinstance(counter, CountingTracer)
        counter.rays = 0
        result = self.effect.trace(self.frame, pixels)
        asked = counter.rays
        self._holds(isinstance(result, EffectResult), f"trace returns an EffectResult, not {_kind(result)}")
        self._values("trace", result.values, len(pixels))
        traced, shape = result.traced, (len(pixels),)
        fits = traced is None or (isinstance(traced, np.ndarray) and traced.dtype == np.uint8 and traced.shape == shape)
        self._holds(fits, f"`traced` is None or uint8{shape}, not {_kind(traced)}")
        self._holds(result.rays == asked, f"`rays` is how many were traced: {asked}, not {result.rays!r}")
        shared = result.shared_rays
        self._holds(0 <= shared <= asked, f"`shared_rays` is 0 to all of them, {asked}; not {shared!r}")
        self._holds(np.array_equal(pixels, given), "the pixels are not changed")
        return result

    def _values(self, method: str, values: object, count: int) -> None:
        shape = (count, self.effect.writes.width(self.frame.world))
        fits = isinstance(values, np.ndarray) and values.dtype == np.float32 and values.shape == shape
        self._holds(fits, f"{method} returns values float32{shape}, not {_kind(values)}")
        self._holds(np.isfinite(np.asarray(values)).all(), f"values of {method} are finite")

    def _whatever_the_others_are(self, pixels: np.ndarray, result: EffectResult) -> None:
        """A pixel's value is the same in any company, from any thread."""
        rule = "a pixel's value does not depend on the other pixels of the call"
        half = len(pixels) // 2
        order = np.random.default_rng(4).permutation(len(pixels))
        for rows in (np.arange(half), np.arange(half, len(pixels)), order, np.arange(1)):
            self._same(rule, pixels[rows], _rows(result, rows), self._trace(np.ascontiguousarray(pixels[rows])))
        pieces = np.array_split(np.arange(len(pixels)), 8)
        with ThreadPoolExecutor(4) as pool:
            found = list(
                pool.map(lambda rows: self.effect.trace(self.frame, np.ascontiguousarray(pixels[rows])), pieces)
            )
        for rows, part in zip(pieces, found, strict=True):
            self._same("several threads may trace at once", pixels[rows], _rows(result, rows), part)

    def _same(self, rule: str, pixels: np.ndarray, one: EffectResult, other: EffectResult) -> None:
        traced = [np.ones(len(pixels), bool) if r.traced is None else r.traced != 0 for r in (one, other)]
        self._holds(np.array_equal(traced[0], traced[1]), f"{rule}: `traced` differs")
        close = np.isclose(one.values, other.values, rtol=CLOSE, atol=CLOSE).all(axis=1) | ~traced[0]
        where = "" if close.all() else f", as at pixel {int(pixels[~close][0])}"
        self._holds(close.all(), f"{rule}: {np.count_nonzero(~close)} of {len(pixels)} differ{where}")

    def _fallback(self, pixels: np.ndarray) -> None:
        """What pixels get that are not traced; it may be prepared again."""
        for turn in ("", "prepared again"):
            self.effect.prepare_fallback(self.frame)
            values = self.effect.fallback(self.frame, pixels)
            if values is None:
                continue
            self._values("fallback", values, len(pixels))
            some = self.effect.fallback(self.frame, np.ascontiguousarray(pixels[::3]))
            same = some is not None and np.allclose(some, values[::3], rtol=CLOSE, atol=CLOSE)
            self._holds(same, f"a pixel's fallback does not depend on the other pixels of the call {turn}".strip())

    def _holds(self, condition: object, rule: str) -> None:
        self.contract.holds(condition, rule, self.case)


def _rows(result: EffectResult, rows: np.ndarray) -> EffectResult:
    return EffectResult(result.values[rows], result.rays, None if result.traced is None else result.traced[rows])


def _kind(value: object) -> str:
    return f"{value.dtype}{value.shape}" if isinstance(value, np.ndarray) else f"{value!r:.80}"
