"""Scheduler: asks the heuristic what is next, has it traced in waves on the thread pool, and tells what it cost."""

from __future__ import annotations

import time
import warnings
from abc import ABC, abstractmethod
from dataclasses import dataclass, field

import numpy as np

from phrt.candidates import WorkItems
from phrt.errors import PhrtWarning
from phrt.frame import MASK_FALLBACK, MASK_TRACED, Decisions, Frame
from phrt.interfaces.effect import EffectResult, RayEffect
from phrt.interfaces.heuristic import FrameContext, Heuristic, Outcome
from phrt.kernels.layers import scatter
from phrt.workers import chunks

CHUNK_RAYS = 24576
"""Rays, by estimate, that a thread takes at a time: what stays in its share of the cache."""


@dataclass
class LayerSet:
    """The layers of one frame under construction: arrays (P, C) and masks (P,) uint8 by layer name."""

    arrays: dict[str, np.ndarray]
    masks: dict[str, np.ndarray]
    rays: dict[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Task:
    """A run of pixels of one effect: one or several items that lie next to each other."""

    effect: int
    pixels: np.ndarray


class Scheduler(ABC):
    """Contract: fills layers by tracing items until the heuristic has no more or the budget is spent."""

    @abstractmethod
    def run(
        self,
        frame: Frame,
        effects: list[RayEffect],
        work: WorkItems,
        heuristic: Heuristic,
        context: FrameContext,
        layers: LayerSet,
    ) -> Decisions:
        """One frame's ray phase."""


class BudgetScheduler(Scheduler):
    """Waves of work items. Without a budget one wave takes everything the heuristic wants, batched by effect.

    An effect that raises is switched off for the rest of the run with one warning that names it; its pixels take the
    fallback, and the frame goes on. With `strict` it raises.
    """

    def __init__(self, *, strict: bool = False) -> None:
        self._strict = strict
        self._broken: set[str] = set()

    def run(
        self,
        frame: Frame,
        effects: list[RayEffect],
        work: WorkItems,
        heuristic: Heuristic,
        context: FrameContext,
        layers: LayerSet,
    ) -> Decisions:
        candidates = work.candidates
        count = len(candidates)
        chosen = np.zeros(count, bool)
        rays, milliseconds = np.zeros(count, np.int64), np.zeros(count, np.float64)
        heuristic.begin_frame(candidates, context)
        while True:
            wave = self._ask(heuristic, chosen, context.budget)
            if not wave:
                break
            self._trace(frame, effects, work, np.array(wave), layers, rays, milliseconds)
            for item in wave:
                heuristic.report(
                    item, Outcome(int(candidates.pixel_count[item]), int(rays[item]), float(milliseconds[item]), True)
                )
        heuristic.end_frame()
        for index, effect in enumerate(effects):
            if effect.name in self._broken:
                chosen[candidates.effect == index] = False
        traced = np.where(chosen, candidates.pixel_count, 0)
        return Decisions(candidates, chosen, traced, rays, milliseconds)

    def _ask(self, heuristic: Heuristic, chosen: np.ndarray, remaining: float) -> list[int]:
        """The next wave: items in the order the heuristic named them."""
        wave: list[int] = []
        while len(wave) < len(chosen):
            item = heuristic.next(remaining)
            if item is None:
                break
            if not 0 <= item < len(chosen) or chosen[item]:
                raise ValueError(
                    f"heuristic {type(heuristic).__name__} returned item {item}: not one of {len(chosen)}, or twice"
                )
            chosen[item] = True
            wave.append(item)
        return wave

    def _trace(
        self,
        frame: Frame,
        effects: list[RayEffect],
        work: WorkItems,
        wave: np.ndarray,
        layers: LayerSet,
        rays: np.ndarray,
        milliseconds: np.ndarray,
    ) -> None:
        """Trace `wave` chunk by chunk, dearest effects first; costs are shared out to items by their pixels."""
        candidates = work.candidates
        tasks: list[Task] = []
        for index in sorted(
            range(len(effects)), key=lambda e: -float(candidates.ray_estimate[candidates.effect == e].max(initial=0))
        ):
            if effects[index].name in self._broken:
                continue
            estimate = max(float(candidates.ray_estimate[candidates.effect == index].max(initial=1.0)), 1.0)
            for run in merged(work, wave[candidates.effect[wave] == index]):
                size = max(int(CHUNK_RAYS / estimate), 256)
                tasks += [Task(index, run[part]) for part in chunks(len(run), size)]

        def work_on(task: Task) -> tuple[int, int, float]:
            started = time.perf_counter()
            traced = self._trace_task(frame, effects[task.effect], task.pixels, layers)
            return task.effect, traced, (time.perf_counter() - started) * 1e3

        totals = np.zeros((len(effects), 2))
        for effect, traced, spent in frame.workers.map(work_on, tasks):
            totals[effect] += traced, spent
        for index, traced_effect in enumerate(effects):
            items = wave[candidates.effect[wave] == index]
            if len(items) == 0:
                continue
            share = candidates.pixel_count[items] / candidates.pixel_count[items].sum()
            rays[items] = np.round(totals[index, 0] * share)
            milliseconds[items] = totals[index, 1] * share
            name = traced_effect.name
            layers.rays[name] = layers.rays.get(name, 0) + int(totals[index, 0])

    def _trace_task(self, frame: Frame, effect: RayEffect, pixels: np.ndarray, layers: LayerSet) -> int:
        if effect.name in self._broken:
            return 0
        try:
            result = effect.trace(frame, pixels)
            self._check(effect, frame, result, len(pixels))
        except Exception as error:
            if self._strict:
                raise
            if effect.name not in self._broken:
                self._broken.add(effect.name)
                warnings.warn(
                    f"effect '{effect.name}' failed and is switched off, its pixels take the fallback: "
                    f"{type(error).__name__}: {error}",
                    PhrtWarning,
                    stacklevel=2,
                )
            return 0
        traced = np.ones(len(pixels), np.uint8) if result.traced is None else result.traced
        name = effect.writes.name
        scatter(pixels, result.values, traced, np.uint8(MASK_TRACED), layers.arrays[name], layers.masks[name])
        return result.rays

    @staticmethod
    def _check(effect: RayEffect, frame: Frame, result: EffectResult, count: int) -> None:
        expected = (count, effect.writes.width(frame.world))
        if result.values.shape != expected or result.values.dtype != np.float32:
            raise ValueError(f"returned {result.values.dtype}{result.values.shape}, its layer needs float32{expected}")


def merged(work: WorkItems, items: np.ndarray) -> list[np.ndarray]:
    """The pixels of `items` (of one effect) as few runs: items that lie next to each other in the sorted pixels become one."""
    if len(items) == 0:
        return []
    pixels = work.pixels[int(work.candidates.effect[items[0]])]
    items = items[np.argsort(work.first[items])]
    first = work.first[items]
    end = first + work.candidates.pixel_count[items]
    breaks = np.flatnonzero(first[1:] != end[:-1]) + 1
    starts = first[np.concatenate([[0], breaks])]
    ends = end[np.concatenate([breaks - 1, [len(items) - 1]])]
    return [pixels[a:b] for a, b in zip(starts, ends, strict=True)]


def apply_fallbacks(
    frame: Frame, effects: list[RayEffect], work: WorkItems, chosen: np.ndarray, layers: LayerSet
) -> None:
    """What was not traced takes its effect's fallback."""
    for index, effect in enumerate(effects):
        left = np.flatnonzero((work.candidates.effect == index) & ~chosen)
        name = effect.writes.name
        runs = merged(work, left)
        if not runs:
            continue
        pixels = np.ascontiguousarray(np.concatenate(runs))
        values = effect.fallback(frame, pixels)
        if values is not None:
            ones = np.ones(len(pixels), np.uint8)
            scatter(pixels, values, ones, np.uint8(MASK_FALLBACK), layers.arrays[name], layers.masks[name])
