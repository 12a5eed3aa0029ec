"""What every item of a frame is truly worth, and what tracing it truly takes.

A frame is rendered with nothing traced, the floor, with everything traced, the reference, and with a part of everything traced.
Every other picture is composed from the layers of these by the renderer's own kernels: an item, an object with an effect, takes
that effect's layer from one of them at the pixels of the object. No layer depends on what else is traced, and no pixel belongs to
two objects. So the error of a picture against the reference is a sum over objects, and each object's share depends only on which
of its effects are traced, and how densely. That share is measured for every set of effects, which is exact: what two effects
bring at a pixel together is not the sum of what each brings alone.

Errors are differences of 8-bit sRGB codes over 255, mean of red, green and blue, summed over pixels. They are whole multiples of
1 / 765, so sums and differences have no rounding that matters.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import numpy as np

from phrt.camera import CameraView
from phrt.clock import RayClock, beneath
from phrt.composite import compose
from phrt.errors import OptionError
from phrt.frame import FrameResult
from phrt.interfaces.heuristic import PASSES, Candidates, FrameContext, Heuristic
from phrt.kernels.arrays import empty_surfaces, environment_arrays, material_arrays, surface_arrays
from phrt.kernels.change import gather_surfaces
from phrt.output.tonemap import to_8bit
from phrt.renderer import Renderer
from phrt.workers import Workers

MOST_EFFECTS = 6
"""So many may apply to a scene: every set of them is composed once a frame."""
PARTS = (1, PASSES)
"""How many passes of an item may be traced. Two and three as well would make the best choice better by less than 0.3 % of what
there is to gain, and take twice the time to look at."""


@dataclass(frozen=True)
class EffectSets:
    """Every way to trace something of every object: m sets of effects, each of one object and none empty.

    object_id (m,) int32; passes (m, E) uint8, how many passes of each of `effect_names` are traced, 0 for none of it, PASSES for
    all; benefit (m,) float64, by how much the picture's error falls when just this is traced, sum over pixels of the mean over
    red, green and blue, 0 to 1 each; rays (m,) int64, ms (m,) float64: what tracing it takes.
    """

    effect_names: tuple[str, ...]
    object_id: np.ndarray
    passes: np.ndarray
    benefit: np.ndarray
    rays: np.ndarray
    ms: np.ndarray

    def __len__(self) -> int:
        return len(self.object_id)

    def rows(self, chosen: np.ndarray) -> EffectSets:
        """Some of the sets."""
        columns = (self.object_id, self.passes, self.benefit, self.rays, self.ms)
        return EffectSets(self.effect_names, *(column[chosen] for column in columns))

    @cached_property
    def whole(self) -> EffectSets:
        """Those in which what is traced is traced as a whole."""
        return self.rows(np.logical_and.reduce(np.isin(self.passes, (0, PASSES)), axis=1))


@dataclass(frozen=True)
class ItemTruth:
    """The n items of a frame, as the renderer's candidates have them, and the sets they make up.

    object_id, effect, pixels (n,) int32; benefit (n,) float64: of the item alone, as in `EffectSets`; rays (n,) int64;
    ms (n,) float64; relevance (n,) float32: R, nothing having been selected before. picture_pixels: of the whole picture.
    error_floor: of the picture with nothing traced, sum over pixels as benefits are.

    A choice of items is (n,) bool, or (n,) integers: how many passes of each are traced.
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
    parts: EffectSets
    error_floor: float
    picture_pixels: int

    def __len__(self) -> int:
        return len(self.object_id)

    @property
    def sets(self) -> EffectSets:
        """Sets of items as a whole."""
        return self.parts.whole

    def sets_of(self, chosen: np.ndarray) -> np.ndarray:
        """(objects,) rows of `parts`: what a choice is, object by object."""
        together = np.zeros((self._objects, len(self.effect_names)), np.uint8)
        together[self.object_id, self.effect] = as_passes(chosen)
        return np.flatnonzero((together[self.parts.object_id] == self.parts.passes).all(axis=1))

    def choice_of(self, sets: EffectSets) -> np.ndarray:
        """(n,) uint8, passes of every item in `sets`, at most one of an object."""
        together = np.zeros((self._objects, len(self.effect_names)), np.uint8)
        together[sets.object_id] = sets.passes
        return together[self.object_id, self.effect]

    def error_of(self, chosen: np.ndarray) -> float:
        """Mean absolute error of the displayed picture, 0 to 1, that a choice makes."""
        error = self.error_floor - float(self.parts.benefit[self.sets_of(chosen)].sum())
        return max(error, 0.0) / self.picture_pixels

    @property
    def _objects(self) -> int:
        return int(self.object_id.max(initial=0)) + 1


def as_passes(chosen: np.ndarray) -> np.ndarray:
    """(n,) uint8: a choice of items as passes."""
    return (chosen * PASSES if chosen.dtype == bool else chosen).astype(np.uint8)


class Everything(Heuristic):
    """Traces `passes` passes of every item."""

    def __init__(self) -> None:
        self.passes = 0
        self._left = np.zeros((0, 2), np.int32)

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        count = len(candidates) if self.passes else 0
        self._left = np.stack([np.arange(count), np.full(count, self.passes)], axis=1).astype(np.int32)

    def next(self, remaining: float) -> int | None:
        return None

    def take(self, remaining: float, enough: float) -> np.ndarray | None:
        taken, self._left = self._left, self._left[:0]
        return taken


class Judged:
    """A frame with nothing traced (`floor`), with everything traced (`reference`), and all pictures in between, as long as their
    renderer is open and renders nothing else.

    frames: by how many passes of everything are traced in them; 0 and PASSES must be there
    together_ms: what tracing all items in one wave takes, by the renderer's clock
    """

    def __init__(
        self, frames: Mapping[int, FrameResult], together_ms: float, workers: Workers, tone_map: str = "neutral"
    ) -> None:
        self.frames = dict(frames)
        self.floor, self.reference = frames[0], frames[PASSES]
        self._together_ms, self._workers, self._tone_map = together_ms, workers, tone_map
        self.effect_names = self.reference.decisions.candidates.effect_names
        self._layer_of = [self.reference.effect_layers[name] for name in self.effect_names]
        _check_layers(self.effect_names, self._layer_of)
        self._object_id = self.reference.gbuffer.flat("object_id")
        self._display = self._displayed(self.reference.image.reshape(-1, 3))
        self._layers = {number: _flat(frame.layers) for number, frame in self.frames.items()}
        self._masks = {number: _flat(frame.masks) for number, frame in self.frames.items()}

    def picture(self, chosen: np.ndarray) -> np.ndarray:
        """(H, W, 3) float32, linear, exposure applied: a choice of items traced, the others as their fallbacks."""
        items, passes = self.reference.decisions.candidates, as_passes(chosen)
        layers, masks = dict(self._layers[0]), dict(self._masks[0])
        for index, name in enumerate(self._layer_of):
            of_object = np.zeros(self.reference.world.object_count + 1, np.uint8)
            mine = items.effect == index
            of_object[items.object_id[mine]] = passes[mine]
            at_pixel = of_object[self._object_id]
            for number in np.unique(passes[mine & (passes > 0)]).tolist():
                where = at_pixel == number
                layers[name] = np.where(where[:, None], self._layers[number][name], layers[name])
                masks[name] = np.where(where, self._masks[number][name], masks[name])
        everywhere = np.arange(len(self._object_id), dtype=np.int32)
        return _Place(self, everywhere).composed(layers, masks).reshape(self.reference.image.shape)

    def error(self, image: np.ndarray) -> float:
        """Mean absolute difference of the displayed `image` (H, W, 3) and the displayed reference, 0 to 1."""
        off = np.abs(self._displayed(image.reshape(-1, 3)).astype(np.int16) - self._display)
        return float(off.sum(dtype=np.int64)) / (255 * off.size)

    @cached_property
    def truth(self) -> ItemTruth:
        """What every item of the frame is worth and takes."""
        decisions = self.reference.decisions
        items = decisions.candidates
        alone = float(decisions.milliseconds.sum())
        scale = min(self._together_ms / alone, 1.0) if alone > 0 else 1.0
        parts = self._measure(items, scale)
        single = parts.whole.rows((parts.whole.passes > 0).sum(axis=1) == 1)
        alone_benefit = np.zeros((self.reference.world.object_count + 1, len(self.effect_names)))
        alone_benefit[single.object_id, single.passes.argmax(axis=1)] = single.benefit
        return ItemTruth(
            frame=self.reference.index,
            time=self.reference.time,
            effect_names=self.effect_names,
            object_id=items.object_id,
            effect=items.effect,
            pixels=items.pixel_count,
            benefit=alone_benefit[items.object_id, items.effect],
            rays=decisions.rays,
            ms=decisions.milliseconds * scale,
            relevance=items.relevance,
            parts=parts,
            error_floor=self.error(self.floor.image) * len(self._object_id),
            picture_pixels=len(self._object_id),
        )

    def _measure(self, items: Candidates, scale: float) -> EffectSets:
        """Every set of effects that an object has items for, at every density."""
        objects, effects = self.reference.world.object_count + 1, len(self.effect_names)
        has = np.zeros((objects, effects), bool)
        has[items.object_id, items.effect] = True
        rays_of, ms_of = np.zeros((2, PASSES + 1, objects, effects))
        for number, frame in self.frames.items():
            rays_of[number, items.object_id, items.effect] = frame.decisions.rays
            ms_of[number, items.object_id, items.effect] = frame.decisions.milliseconds * scale
        rows: list[tuple[np.ndarray, ...]] = [(np.zeros(0), np.zeros((0, effects)), *[np.zeros(0)] * 3)]
        for chosen in _subsets(effects):
            there: np.ndarray = np.logical_and.reduce(has[:, chosen], axis=1)
            mine = np.flatnonzero(there)
            if not len(mine):
                continue
            place = _Place(self, np.flatnonzero(there[self._object_id]).astype(np.int32))
            nothing = place.errors(dict.fromkeys(chosen, 0))
            for passes in product(sorted(set(self.frames) - {0}), repeat=len(chosen)):
                row = np.zeros(effects, np.uint8)
                row[chosen] = passes
                benefit = nothing - place.errors(dict(zip(chosen, passes, strict=True)))
                taken = [table[passes, :, chosen][:, mine].sum(axis=0) for table in (rays_of, ms_of)]
                rows.append((mine, np.tile(row, (len(mine), 1)), benefit[mine], *taken))
        types = (np.int32, np.uint8, np.float64, np.int64, np.float64)
        columns = [np.concatenate([row[k] for row in rows]).astype(kind) for k, kind in enumerate(types)]
        return EffectSets(self.effect_names, *columns)

    def _displayed(self, image: np.ndarray) -> np.ndarray:
        """(k, 3) uint8 of linear colours (k, 3)."""
        return to_8bit(image[None], self._tone_map)[0]


class _Place:
    """Some pixels, rows (k,) int32, of the frames of `judged`: what the composition reads there, gathered once for many sets."""

    def __init__(self, judged: Judged, rows: np.ndarray) -> None:
        self._judged, self._rows = judged, rows
        frame = judged.reference
        direct = _flat({"direct": frame.direct})["direct"]
        self._surfaces = empty_surfaces(len(rows))
        self._direct = np.empty((len(rows), *direct.shape[1:]), np.float32)
        gather_surfaces(rows, surface_arrays(frame.gbuffer), direct, self._surfaces, self._direct)
        self._object_id, self._display = judged._object_id[rows], judged._display[rows]
        self._gathered: dict[tuple[int, str], tuple[np.ndarray, np.ndarray]] = {}

    def errors(self, passes: Mapping[int, int]) -> np.ndarray:
        """(N + 1,) float64: by object, the error of its pixels here, so many passes of these effects being traced."""
        judged = self._judged
        of_layer = {judged._layer_of[effect]: number for effect, number in passes.items()}
        layers, masks = {}, {}
        for name in judged._layers[0]:
            layers[name], masks[name] = self._at(of_layer.get(name, 0), name)
        off = np.abs(judged._displayed(self.composed(layers, masks)).astype(np.int16) - self._display)
        count = judged.reference.world.object_count + 1
        return np.bincount(self._object_id, weights=off.sum(axis=1), minlength=count) / (255 * 3)

    def _at(self, number: int, name: str) -> tuple[np.ndarray, np.ndarray]:
        if (number, name) not in self._gathered:
            judged, rows = self._judged, self._rows
            self._gathered[number, name] = judged._layers[number][name][rows], judged._masks[number][name][rows]
        return self._gathered[number, name]

    def composed(self, layers: dict[str, np.ndarray], masks: dict[str, np.ndarray]) -> np.ndarray:
        """(k, 3) float32, linear: the sum of layers (k, C)."""
        frame, image = self._judged.reference, np.empty((len(self._rows), 3), np.float32)
        compose(
            self._surfaces, material_arrays(frame.world).materials, environment_arrays(frame.world),
            frame.world.environment.visible, frame.view, self._rows, self._direct, layers, masks, frame.exposure, image,
            self._judged._workers, frame.added_layers,
        )  # fmt: skip
        return image


def judge(
    renderer: Renderer,
    time: float,
    index: int,
    camera: int | str | CameraView = 0,
    *,
    tone_map: str = "neutral",
    passes: Sequence[int] = PARTS,
) -> Judged:
    """Frame `index` at `time` seconds, with nothing traced and with `passes` passes of everything, without history.

    The renderer forgets what it learnt (`Renderer.restart`): restart it before it renders anything else. Items are objects with
    one effect each, whatever it grouped them by before. Raises OptionError for a renderer with aa above 1, and where two effects
    write one layer.
    """
    if renderer.aa > 1:
        raise OptionError(f"aa is {renderer.aa}; what items are worth can be told for one sample per pixel only")
    heuristic = Everything()
    renderer.restart(heuristic=heuristic, budget="none", clock=renderer.clock, history=False, strict=True)

    def rendered(passes: int, *, each: bool = True) -> FrameResult:
        heuristic.passes, renderer.measure_each = passes, each
        return renderer.render(time, frame_index=index, camera=camera)

    try:
        # Nothing first: then nothing was selected before, and R of everything is the frame's own.
        frames = {number: rendered(number) for number in (0, PASSES, *(p for p in passes if p != PASSES))}
        together = frames[PASSES] if counts_rays(renderer) else rendered(PASSES, each=False)
    finally:
        renderer.measure_each = False
    return Judged(frames, together.decisions.ray_ms, renderer.workers, tone_map)


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


def _subsets(count: int) -> list[list[int]]:
    """Every set of the numbers below `count` that is not empty, small ones first."""
    return [list(chosen) for size in range(1, count + 1) for chosen in combinations(range(count), size)]


def _flat(arrays: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Layers (H, W, C) and masks (H, W) with their pixels in one row."""
    return {name: array.reshape(array.shape[0] * array.shape[1], *array.shape[2:]) for name, array in arrays.items()}
