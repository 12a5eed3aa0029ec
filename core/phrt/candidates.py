"""Candidates: what could be traced in a frame - every visible object with every effect that applies to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from phrt.costs import CostModelName, CostModels
from phrt.experience import Experience
from phrt.faults.declared import checked_applies, checked_rays
from phrt.frame import MASK_HISTORY, Frame
from phrt.interfaces.effect import RayEffect
from phrt.interfaces.heuristic import PASSES, BudgetUnit, Candidates
from phrt.kernels.history import history_of_units
from phrt.kernels.layers import count_by_object, pass_numbers, place_by_object, select_pixels
from phrt.kernels.primary import tile_order
from phrt.kernels.waves import pass_kinds
from phrt.relevance import ObjectSight, item_cost, item_relevance
from phrt.world import World

GroupBy = Literal["object", "object_effect", "object_effect_light"]
"""What a work item is: an object with all effects, with one, or with one and, where it is made light by light, one light."""
GROUPINGS: tuple[GroupBy, ...] = ("object", "object_effect", "object_effect_light")


@dataclass(frozen=True)
class EffectScope:
    """Where an effect may act in a scene. applies (materials,), allowed and mandatory (N + 1,) bool; rays_per_pixel: Q."""

    applies: np.ndarray
    allowed: np.ndarray
    mandatory: np.ndarray
    rays_per_pixel: float

    @classmethod
    def of(cls, effect: RayEffect, world: World) -> EffectScope:
        """Raises PluginFailure naming an effect that cannot say, or says what cannot be."""
        switches = ["never", *(entry.effects.get(effect.switch, "auto") for entry in world.scene.objects)]
        applies = checked_applies(effect, world)
        return cls(
            applies=applies,
            allowed=np.array([switch != "never" for switch in switches]) & world.object_has(applies),
            mandatory=np.array([switch == "always" for switch in switches]),
            rays_per_pixel=checked_rays(effect, world),
        )

    @cached_property
    def place(self) -> bytes:
        """Equal for scopes whose pixels are the same."""
        return self.applies.tobytes() + self.allowed.tobytes()


@dataclass(frozen=True)
class Units:
    """An object with one effect each: what is traced and measured. m units, effect by effect, those of one in order of `first`.

    item (m,) int32: the work item it belongs to; object_id, effect (m,) int32; first (m,) int64, count (m,) int32: its
    pixels are pixels[effect][first:first + count], in tile order. rays, ms (m,) float64: predicted. held (m,) int32: at how many of
    its pixels a value of an earlier frame stands in; age_sum (m,) float64: the sum of those values' ages in frames.
    """

    item: np.ndarray
    object_id: np.ndarray
    effect: np.ndarray
    first: np.ndarray
    count: np.ndarray
    rays: np.ndarray
    ms: np.ndarray
    held: np.ndarray
    age_sum: np.ndarray

    def __len__(self) -> int:
        return len(self.item)


@dataclass(frozen=True)
class WorkItems:
    """The candidates, the units they are made of (one each, unless items are whole objects), and the units' pixels:
    (p,) int32 flat indices for every effect of a picture that is `width` wide.

    masks: of every effect's layer, (P,) uint8, as they are before the ray phase; none where no value of an earlier frame is in any.
    """

    candidates: Candidates
    units: Units
    pixels: list[np.ndarray]
    width: int
    masks: list[np.ndarray] = field(default_factory=list)

    @cached_property
    def passes(self) -> Passes:
        """The order in which parts of units are traced."""
        return Passes(self)


class Passes:
    """The passes of units, found unit by unit when they are first asked for, and then kept: what is traced of a unit later
    changes the masks that its order depends on.

    kinds: (p,) uint8 for every effect, in which pass every pixel is, and sizes (m, 8) int32, see `pass_kinds`; ends (m, PASSES)
    int64: how many pixels a unit's first passes have together: with values of an earlier frame the first pass is all that have
    none, and the others are a third each of those that do. All hold only for units that `find` was called with.
    """

    def __init__(self, work: WorkItems) -> None:
        self._work = work
        self._found = np.zeros(len(work.units), bool)
        self.kinds = [np.empty(len(pixels), np.uint8) for pixels in work.pixels]
        self.sizes = np.zeros((len(work.units), 8), np.int32)
        self.ends = np.zeros((len(work.units), PASSES), np.int64)

    def find(self, units: np.ndarray) -> None:
        """Find the passes of `units` (k,)."""
        new = units[~self._found[units]]
        if not len(new):
            return
        new = np.unique(new)
        self._found[new] = True
        work, of_effect = self._work, self._work.units.effect[new]
        held = work.units.held[new] if work.masks else np.zeros(len(new), np.int32)
        sizes = np.empty((len(new), 8), np.int32)
        for effect in np.flatnonzero(np.bincount(of_effect)).tolist():
            mine = slice(*np.searchsorted(of_effect, [effect, effect + 1]))
            rows, pixels = new[mine], work.pixels[effect]
            # Rows rounded up, so that few tables serve all frames.
            numbers = _pass_numbers(work.width, (int(pixels.max(initial=0)) // work.width | 255) + 1)
            pass_kinds(
                pixels, work.units.first[rows], work.units.count[rows], held[mine], numbers,
                work.masks[effect] if work.masks else _NO_MASK, MASK_HISTORY, self.kinds[effect], sizes[mine],
            )  # fmt: skip
        self.sizes[new] = sizes
        ends = np.cumsum(sizes[:, :PASSES], axis=1)
        others = (held[:, None] * np.arange(PASSES) + 2) // (PASSES - 1)
        self.ends[new] = np.where(held[:, None] > 0, ends[:, -1:] + others, ends)


_NO_MASK = np.zeros(0, np.uint8)


@lru_cache(maxsize=8)
def _pass_numbers(width: int, height: int) -> np.ndarray:
    numbers = np.empty(width * height, np.uint8)
    pass_numbers(width, numbers)
    return numbers


def find_work(
    frame: Frame,
    effects: list[RayEffect],
    scopes: list[EffectScope],
    sight: ObjectSight,
    experience: Experience,
    costs: CostModels,
    *,
    persistence: float,
    budget_unit: BudgetUnit = "none",
    cost_model: CostModelName = "measured",
    group_by: GroupBy = "object_effect",
    masks: Mapping[str, np.ndarray] | None = None,
    ages: Mapping[str, np.ndarray] | None = None,
) -> WorkItems:
    """Every (object, effect) with visible pixels, and the letters that heuristics choose by.

    masks, ages: (P,) by layer name, where values of earlier frames stand in and how old they are (see `History.reproject`).
    """
    surfaces = frame.surfaces
    begins, sorted_pixels = _by_object(frame)
    visible_pixels = np.diff(begins)

    def select(scope: EffectScope) -> tuple[np.ndarray, np.ndarray]:
        start, pixels = np.zeros_like(begins), np.empty_like(sorted_pixels)
        if not scope.allowed.any():
            return start, pixels[:0]
        selected = select_pixels(
            begins, sorted_pixels, surfaces.material_id, scope.applies, scope.allowed, start, pixels
        )
        return start, pixels[:selected]

    places = {scope.place: scope for scope in scopes}
    found = dict(zip(places, frame.workers.map(select, places.values()), strict=True))
    pixels = [found[scope.place][1] for scope in scopes]
    starts = np.array([found[scope.place][0] for scope in scopes], np.int64)
    units = _units(starts.reshape(len(scopes), len(begins)), group_by, experience, costs)
    for index, effect in enumerate(effects):
        name = effect.writes.name
        if masks is not None and ages is not None and name in ages:
            _note_history(units, index, pixels[index], masks[name], ages[name])
    candidates = _with_letters(
        effects, scopes, units, sight, frame, visible_pixels, experience, costs, persistence, budget_unit, cost_model,
        group_by,
    )  # fmt: skip
    held = masks is not None and bool(units.held.any())
    kept = [masks[effect.writes.name] for effect in effects] if masks is not None and held else []
    return WorkItems(candidates, units, pixels, frame.view.width, kept)


def _by_object(frame: Frame) -> tuple[np.ndarray, np.ndarray]:
    """All pixels (P,) int32 by object, in tile order within one, and where (N + 2,) int64 every object begins among them."""
    order, object_id = tile_order(frame.gbuffer.width, frame.gbuffer.height), frame.surfaces.object_id
    begins = np.zeros(frame.world.object_count + 2, np.int64)
    count_by_object(order, object_id, begins[1:])
    np.cumsum(begins, out=begins)
    pixels = np.empty(len(order), np.int32)
    place_by_object(order, object_id, begins[:-1].copy(), pixels)
    return begins, pixels


def _units(starts: np.ndarray, group_by: GroupBy, experience: Experience, costs: CostModels) -> Units:
    """Objects with pixels, effect by effect; starts (effects, N + 2): where objects begin in the sorted pixels."""
    counts = np.diff(starts, axis=1)
    effect, object_id = (index.astype(np.int32) for index in np.nonzero(counts))
    item = np.arange(len(effect), dtype=np.int32)
    if group_by == "object":
        item = np.unique(object_id, return_inverse=True)[1].astype(np.int32)
    count = counts[effect, object_id].astype(np.int32)
    rays = experience.predict_rays(object_id, effect, count).astype(np.float64)
    return Units(item, object_id, effect, starts[effect, object_id], count, rays, costs.measured_ms(effect, rays),
                 np.zeros(len(effect), np.int32), np.zeros(len(effect)))  # fmt: skip


def _note_history(units: Units, effect: int, pixels: np.ndarray, mask: np.ndarray, age: np.ndarray) -> None:
    """Fill `held` and `age_sum` of the units of one effect."""
    mine = np.flatnonzero(units.effect == effect)
    held, age_sum = np.empty(len(mine), np.int32), np.empty(len(mine))
    history_of_units(pixels, units.first[mine], units.count[mine], mask, age, MASK_HISTORY, held, age_sum)
    units.held[mine], units.age_sum[mine] = held, age_sum


def _with_letters(
    effects: list[RayEffect],
    scopes: list[EffectScope],
    units: Units,
    sight: ObjectSight,
    frame: Frame,
    visible_pixels: np.ndarray,
    experience: Experience,
    costs: CostModels,
    persistence: float,
    budget_unit: BudgetUnit,
    cost_model: CostModelName,
    group_by: GroupBy,
) -> Candidates:
    """The candidates: equations (1) to (3) of Andrade et al. 2014 for every item."""
    count = int(units.item.max(initial=-1)) + 1

    def total(values: np.ndarray) -> np.ndarray:
        """(n,) float64, sums over the units of each item."""
        return np.bincount(units.item, weights=values, minlength=count)

    object_id, effect = np.zeros(count, np.int32), np.zeros(count, np.int32)
    object_id[units.item] = units.object_id
    if group_by != "object":
        effect[units.item] = units.effect
    objects = sight.letters(frame.world, frame.view, visible_pixels)
    visible, importance = objects.visibility[object_id], objects.importance_factor[object_id]
    ray_estimate = total(experience.ray_estimate[units.object_id, units.effect]).astype(np.float32)
    mandatory = np.array([scope.mandatory for scope in scopes], bool).reshape(len(scopes), len(objects.area))
    was_selected = total(experience.was_selected[units.object_id, units.effect]) > 0
    cost = item_cost(visible, ray_estimate)
    rays, measured_ms = total(units.rays), total(units.ms)
    paper_ms = costs.paper_ms(cost, measured_ms)
    if budget_unit == "ms":
        predicted = paper_ms if cost_model == "paper" else measured_ms
    else:
        predicted = np.ceil(np.maximum(costs.paper_rays(cost, rays), 1.0)) if cost_model == "paper" else rays
    pixel_count, held = total(units.count), total(units.held)
    known = experience.exploration.of_items(units.item, units.object_id, units.effect, units.count)
    return Candidates(
        effect_names=("all",) if group_by == "object" else tuple(entry.name for entry in effects),
        object_id=object_id,
        effect=effect,
        pixel_count=pixel_count.astype(np.int32),
        mandatory=total(mandatory[units.effect, units.object_id]) > 0,
        predicted_cost=predicted.astype(np.float32),
        ray_estimate=ray_estimate,
        area=objects.area[object_id],
        center_closeness=objects.center_closeness[object_id],
        distance=objects.distance[object_id],
        visibility=visible,
        cost=cost,
        importance_factor=importance,
        was_selected=was_selected,
        relevance=item_relevance(was_selected, persistence, visible, importance),
        persistence=persistence,
        predicted_rays=rays.astype(np.float32),
        predicted_ms_paper=paper_ms.astype(np.float32),
        predicted_ms_measured=measured_ms.astype(np.float32),
        history_share=(held / np.maximum(pixel_count, 1)).astype(np.float32),
        history_age=(total(units.age_sum) / np.maximum(held, 1)).astype(np.float32),
        **vars(known),
    )
