"""What every item of a frame is truly worth, and what tracing it truly takes.

A frame is rendered with nothing traced, the floor, and with everything traced, the reference. Every picture in between is
composed from the layers of these two by the renderer's own kernels: an item, an object with an effect, takes that effect's layer
from the reference at the pixels of the object. No layer depends on what else is traced, and no pixel belongs to two objects. So
the error of a picture against the reference is a sum over objects, and each object's share depends only on which of its effects
are traced. That share is measured for every set of effects (2^E compositions), which is exact: what two effects bring at a pixel
together is not the sum of what each brings alone.

Errors are differences of 8-bit sRGB codes over 255, mean of red, green and blue, summed over pixels. They are whole multiples of
1 / 765, so sums and differences have no rounding that matters.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from phrt.camera import CameraView
from phrt.clock import RayClock, beneath
from phrt.composite import all_rows, compose
from phrt.errors import OptionError
from phrt.frame import FrameResult
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.kernels.arrays import environment_arrays, material_arrays, surface_arrays
from phrt.output.tonemap import to_8bit
from phrt.renderer import Renderer
from phrt.workers import Workers

MOST_EFFECTS = 8
"""So many may apply to a scene: every set of them is composed once a frame."""


@dataclass(frozen=True)
class EffectSets:
    """Every way to trace something of every object: m sets of effects, each of one object and none empty.

    object_id (m,) int32; effects (m,) int32, bit e stands for `effect_names[e]`; benefit (m,) float64, by how much the picture's
    error falls when just these of the object are traced, sum over pixels of the mean over red, green and blue, 0 to 1 each;
    rays (m,) int64, ms (m,) float64: what tracing them takes.
    """

    effect_names: tuple[str, ...]
    object_id: np.ndarray
    effects: np.ndarray
    benefit: np.ndarray
    rays: np.ndarray
    ms: np.ndarray

    def __len__(self) -> int:
        return len(self.object_id)

    def row(self, object_id: int, effects: int) -> int:
        """The row of a set. Raises KeyError where the object has no such set."""
        found = np.flatnonzero((self.object_id == object_id) & (self.effects == effects))
        if not len(found):
            raise KeyError((object_id, effects))
        return int(found[0])


@dataclass(frozen=True)
class ItemTruth:
    """The n items of a frame, as the renderer's candidates have them, and their sets.

    object_id, effect, pixels (n,) int32; benefit (n,) float64: of the item alone, as in `EffectSets`; rays (n,) int64;
    ms (n,) float64; relevance (n,) float32: R, nothing having been selected before. picture_pixels: of the whole picture.
    error_floor: of the picture with nothing traced, sum over pixels as benefits are.
    """

    frame: int
    time: float
    effect_names: tuple[str, ...]
    object_id: np.ndarray
    effect: np.ndarray
    pixels: np.ndarray
    benefit: np.ndarray
    rays: np.ndarray
    ms: np.ndarray
    relevance: np.ndarray
    sets: EffectSets
    error_floor: float
    picture_pixels: int

    def __len__(self) -> int:
        return len(self.object_id)

    def sets_of(self, chosen: np.ndarray) -> np.ndarray:
        """(objects,) rows of `sets`: what the items `chosen` (n,) bool are together, object by object."""
        together = np.zeros(int(self.object_id.max(initial=0)) + 1, np.int64)
        np.bitwise_or.at(together, self.object_id[chosen], np.left_shift(1, self.effect[chosen].astype(np.int64)))
        return np.flatnonzero(together[self.sets.object_id] == self.sets.effects)

    def items_of(self, rows: np.ndarray) -> np.ndarray:
        """(n,) bool: the items that the sets `rows` are made of."""
        together = np.zeros(int(self.object_id.max(initial=0)) + 1, np.int64)
        together[self.sets.object_id[rows]] = self.sets.effects[rows]
        return (together[self.object_id] >> self.effect) & 1 == 1

    def error_of(self, chosen: np.ndarray) -> float:
        """Mean absolute error of the displayed picture, 0 to 1, in which the items `chosen` (n,) bool are traced."""
        error = self.error_floor - float(self.sets.benefit[self.sets_of(chosen)].sum())
        return max(error, 0.0) / self.picture_pixels


class AllOrNothing(Heuristic):
    """Traces every item, or none, as `everything` says."""

    def __init__(self) -> None:
        self.everything = False
        self._left = np.zeros(0, np.int32)

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self._left = np.arange(len(candidates) if self.everything else 0, dtype=np.int32)

    def next(self, remaining: float) -> int | None:
        return None

    def take(self, remaining: float, enough: float) -> np.ndarray | None:
        taken, self._left = self._left, self._left[:0]
        return taken


class Judged:
    """A frame with nothing traced (`floor`) and with everything traced (`reference`), and all pictures in between, as long as their
    renderer is open and renders nothing else.

    together_ms: what tracing all items in one wave takes, by the renderer's clock.
    """

    def __init__(
        self, floor: FrameResult, reference: FrameResult, together_ms: float, workers: Workers, tone_map: str
    ) -> None:
        self.floor, self.reference = floor, reference
        self._together_ms, self._workers, self._tone_map = together_ms, workers, tone_map
        self.effect_names = reference.decisions.candidates.effect_names
        self._layer_of = [reference.effect_layers[name] for name in self.effect_names]
        _check_layers(self.effect_names, self._layer_of)
        self._surfaces = surface_arrays(reference.gbuffer)
        self._display = to_8bit(reference.image, tone_map, workers)

    def picture(self, chosen: np.ndarray) -> np.ndarray:
        """(H, W, 3) float32, linear, exposure applied: items `chosen` (n,) bool traced, the others as their fallbacks."""
        items = self.reference.decisions.candidates
        layers, masks = dict(self.floor.layers), dict(self.floor.masks)
        for index, name in enumerate(self._layer_of):
            objects = np.zeros(self.reference.world.object_count + 1, bool)
            objects[items.object_id[chosen & (items.effect == index)]] = True
            where = objects[self.reference.gbuffer.object_id]
            layers[name] = np.where(where[..., None], self.reference.layers[name], layers[name])
            masks[name] = np.where(where, self.reference.masks[name], masks[name])
        return self._compose(layers, masks)

    def error(self, image: np.ndarray) -> float:
        """Mean absolute difference of the displayed `image` (H, W, 3) and the displayed reference, 0 to 1."""
        return float(self._codes_off(image).sum()) / (255 * 3 * image.shape[0] * image.shape[1])

    @cached_property
    def truth(self) -> ItemTruth:
        """What every item of the frame is worth and takes."""
        decisions = self.reference.decisions
        items, count = decisions.candidates, len(decisions.candidates)
        alone = float(decisions.milliseconds.sum())
        ms = decisions.milliseconds * (min(self._together_ms / alone, 1.0) if alone > 0 else 1.0)
        sets, floor = self._measure(items, decisions.rays, ms)
        single = {
            (o, e): b for o, e, b in zip(sets.object_id.tolist(), sets.effects.tolist(), sets.benefit, strict=True)
        }
        pairs = zip(items.object_id.tolist(), items.effect.tolist(), strict=True)
        return ItemTruth(
            frame=self.reference.index,
            time=self.reference.time,
            effect_names=self.effect_names,
            object_id=items.object_id,
            effect=items.effect,
            pixels=items.pixel_count,
            benefit=np.fromiter((single[o, 1 << e] for o, e in pairs), np.float64, count),
            rays=decisions.rays,
            ms=ms,
            relevance=items.relevance,
            sets=sets,
            error_floor=floor,
            picture_pixels=self.reference.view.width * self.reference.view.height,
        )

    def _measure(self, items: Candidates, rays: np.ndarray, ms: np.ndarray) -> tuple[EffectSets, float]:
        """Every set of effects that an object has items for, and the error of the floor."""
        objects, effects = self.reference.world.object_count + 1, len(self.effect_names)
        own_rays, own_ms = np.zeros((objects, effects), np.int64), np.zeros((objects, effects))
        own_rays[items.object_id, items.effect], own_ms[items.object_id, items.effect] = rays, ms
        has = np.zeros(objects, np.int64)
        np.bitwise_or.at(has, items.object_id, np.left_shift(1, items.effect.astype(np.int64)))
        floor = self._errors_by_object(())
        rows: list[tuple[np.ndarray, ...]] = []
        for chosen in _subsets(effects):
            bits = sum(1 << effect for effect in chosen)
            mine = np.flatnonzero(has & bits == bits)
            if len(mine):
                benefit = (floor - self._errors_by_object(chosen))[mine]
                which = list(chosen)
                rows.append(
                    (mine, np.full(len(mine), bits), benefit, own_rays[mine][:, which].sum(1), own_ms[mine][:, which].sum(1))
                )  # fmt: skip
        types = (np.int32, np.int32, np.float64, np.int64, np.float64)
        columns = [
            np.concatenate([row[k] for row in rows]).astype(kind) if rows else np.zeros(0, kind) for k, kind in enumerate(types)
        ]  # fmt: skip
        return EffectSets(self.effect_names, *columns), float(floor.sum())

    def _errors_by_object(self, traced: Iterable[int]) -> np.ndarray:
        """(N + 1,) float64: each object's part of the picture's error, the effects `traced` being traced everywhere."""
        layers, masks = dict(self.floor.layers), dict(self.floor.masks)
        for effect in traced:
            name = self._layer_of[effect]
            layers[name], masks[name] = self.reference.layers[name], self.reference.masks[name]
        off = self._codes_off(self._compose(layers, masks))
        object_id, count = self.reference.gbuffer.object_id.reshape(-1), self.reference.world.object_count + 1
        return np.bincount(object_id, weights=off, minlength=count) / (255 * 3)

    def _codes_off(self, image: np.ndarray) -> np.ndarray:
        """(P,) int64, by how many codes red, green and blue of `image` are off together."""
        display = to_8bit(image, self._tone_map, self._workers)
        return np.abs(display.astype(np.int16) - self._display).sum(axis=-1, dtype=np.int64).reshape(-1)

    def _compose(self, layers: dict[str, np.ndarray], masks: dict[str, np.ndarray]) -> np.ndarray:
        frame = self.reference
        height, width = frame.image.shape[:2]
        image = np.empty((height * width, 3), np.float32)
        compose(
            self._surfaces, material_arrays(frame.world).materials, environment_arrays(frame.world),
            frame.world.environment.visible, frame.view, all_rows(len(image)),
            frame.direct.reshape(len(image), -1, 3),
            {name: array.reshape(len(image), -1) for name, array in layers.items()},
            {name: mask.reshape(-1) for name, mask in masks.items()}, frame.exposure, image, self._workers,
        )  # fmt: skip
        return image.reshape(height, width, 3)


def judge(
    renderer: Renderer, time: float, index: int, camera: int | str | CameraView = 0, *, tone_map: str = "neutral"
) -> Judged:
    """Frame `index` at `time` seconds, with nothing and with everything traced, without history.

    The renderer forgets what it learnt (`Renderer.restart`): restart it before it renders anything else. Items are objects with
    one effect each, whatever it grouped them by before. Raises OptionError for a renderer with aa above 1, and where two effects
    write one layer.
    """
    if renderer.aa > 1:
        raise OptionError(f"aa is {renderer.aa}; what items are worth can be told for one sample per pixel only")
    heuristic = AllOrNothing()
    renderer.restart(heuristic=heuristic, budget="none", clock=renderer.clock, history=False)

    def rendered(*, everything: bool, each: bool = False) -> FrameResult:
        heuristic.everything, renderer.measure_each = everything, each
        return renderer.render(time, frame_index=index, camera=camera)

    try:
        # Nothing first: then nothing was selected before, and R is the frame's own.
        floor = rendered(everything=False)
        reference = rendered(everything=True, each=True)
        together = reference if counts_rays(renderer) else rendered(everything=True)
    finally:
        renderer.measure_each = False
    return Judged(floor, reference, together.decisions.ray_ms, renderer.workers, tone_map)


def counts_rays(renderer: Renderer) -> bool:
    """Does its clock count rays, so that it does not matter what is traced together?"""
    return isinstance(beneath(renderer.clock), RayClock)


def _check_layers(effects: tuple[str, ...], layer_of: list[str]) -> None:
    if len(effects) > MOST_EFFECTS:
        raise OptionError(f"{len(effects)} effects; what items are worth can be told for up to {MOST_EFFECTS} effects")
    for first, second in combinations(range(len(effects)), 2):
        if layer_of[first] == layer_of[second]:
            raise OptionError(
                f"effects '{effects[first]}' and '{effects[second]}' both write the layer '{layer_of[first]}'; what each is worth "
                "cannot be told"
            )


def _subsets(count: int) -> list[tuple[int, ...]]:
    """Every set of the numbers below `count` that is not empty, small ones first."""
    return [chosen for size in range(1, count + 1) for chosen in combinations(range(count), size)]
