"""Scheduler: asks the heuristic what is next, has it traced in waves on the thread pool, and tells what it cost."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from phrt.candidates import WorkItems
from phrt.errors import PluginError
from phrt.faults import BlamedHeuristic, Faults
from phrt.frame import MASK_TRACED, Decisions, Frame
from phrt.interfaces.effect import RayEffect
from phrt.interfaces.heuristic import FrameContext, Heuristic
from phrt.kernels.layers import scatter
from phrt.layers import LayerSet
from phrt.ledger import Ledger, Part, pixel_runs
from phrt.workers import chunks

CHUNK_RAYS = 24576
"""Rays, by estimate, that a thread takes at a time: what stays in its share of the cache."""


WAVE_SHARE = 0.25
"""A wave takes at most this share of what is left of a budget, by prediction, so that the next one can be corrected;"""

SMALLEST_WAVE_RAYS = 2.0 * CHUNK_RAYS
"""but it may take this much, so that the last waves are not many small ones."""


@dataclass(frozen=True)
class Group:
    """Parts of items of one effect that are traced and accounted for together."""

    effect: int
    parts: list[Part]


@dataclass(frozen=True)
class Task:
    """A run of pixels of one group: one or several items that lie next to each other."""

    group: int
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
    """Waves of work items, as many as the budget of the context (rays) holds.

    Without a budget one wave takes everything the heuristic wants, batched by effect. With one, what an item is predicted
    to take is off the budget when the item is handed out, and what it really took instead when its wave is done. An item
    that is predicted to take more than is left is not started. Decisions do not depend on time or threads.

    An effect that fails traces nothing from then on, and the frame goes on (`Faults`). A heuristic that fails ends it with
    a PluginError: without one, nobody knows what is wanted.
    """

    def __init__(self, faults: Faults | None = None) -> None:
        self._faults = faults or Faults()

    def run(
        self,
        frame: Frame,
        effects: list[RayEffect],
        work: WorkItems,
        heuristic: Heuristic,
        context: FrameContext,
        layers: LayerSet,
    ) -> Decisions:
        ledger = Ledger(work)
        remaining = context.budget
        asked = BlamedHeuristic(heuristic)
        asked.begin_frame(work.candidates, context)
        while wave := self._ask(asked, ledger, remaining):
            self._trace(frame, effects, work, wave, layers, ledger, math.isfinite(context.budget))
            remaining = max(context.budget - float(ledger.rays.sum()), 0.0)
            for part in wave:
                asked.report(part.item, ledger.outcome(part))
        asked.end_frame()
        for index, effect in enumerate(effects):
            if self._faults.is_off(effect):
                ledger.discard(work.candidates.effect == index)
        return ledger.decisions(context.budget)

    def _ask(self, heuristic: BlamedHeuristic, ledger: Ledger, remaining: float) -> list[Part]:
        """The next wave: parts of items in the order the heuristic named them."""
        wave: list[Part] = []
        refused: set[int] = set()
        largest = max(remaining * WAVE_SHARE, SMALLEST_WAVE_RAYS)
        planned = 0.0
        while planned < largest and (request := heuristic.next(remaining - planned)) is not None:
            part = ledger.accept(request)
            if part is None or part.item in refused:
                raise PluginError(
                    f"heuristic {heuristic.name} returned item {request.item}: "
                    f"not one of {len(ledger.passes)}, or twice"
                )
            if planned + ledger.predicted(part) > remaining:
                ledger.withdraw(part)
                refused.add(part.item)
                continue
            planned += ledger.predicted(part)
            wave.append(part)
        return wave

    def _trace(
        self,
        frame: Frame,
        effects: list[RayEffect],
        work: WorkItems,
        wave: list[Part],
        layers: LayerSet,
        ledger: Ledger,
        measure: bool,
    ) -> None:
        """Trace `wave` chunk by chunk, dearest effects first. With `measure` every item is traced and measured by itself;
        without, items of an effect are merged, and costs are shared out to them by their pixels."""
        estimates = [
            max(float(work.candidates.ray_estimate[work.candidates.effect == index].max(initial=1.0)), 1.0)
            for index in range(len(effects))
        ]
        groups = self._groups(work, wave, measure)
        tasks: list[Task] = []
        for number in sorted(range(len(groups)), key=lambda g: -estimates[groups[g].effect]):
            index = groups[number].effect
            if not self._faults.is_off(effects[index]):
                size = max(int(CHUNK_RAYS / estimates[index]), 256)
                for run in pixel_runs(work, groups[number].parts, frame.view.width):
                    tasks += [Task(number, index, run[piece]) for piece in chunks(len(run), size)]

        def work_on(task: Task) -> tuple[int, float]:
            started = time.perf_counter()
            traced = self._trace_task(frame, effects[task.effect], task.pixels, layers)
            return traced, (time.perf_counter() - started) * 1e3

        rays, pixels = np.zeros(len(groups), np.int64), np.zeros(len(groups), np.int64)
        milliseconds = np.zeros(len(groups))
        for task, (traced, spent) in zip(tasks, frame.workers.map(work_on, tasks), strict=True):
            rays[task.group] += traced
            pixels[task.group] += len(task.pixels)
            milliseconds[task.group] += spent
        for number, group in enumerate(groups):
            ledger.share_out(group.parts, int(pixels[number]), int(rays[number]), float(milliseconds[number]))
            name = effects[group.effect].name
            layers.rays[name] = layers.rays.get(name, 0) + int(rays[number])

    @staticmethod
    def _groups(work: WorkItems, wave: list[Part], measure: bool) -> list[Group]:
        """What is accounted for together: one part, or all parts of an effect."""
        if measure:
            return [Group(int(work.candidates.effect[part.item]), [part]) for part in wave]
        by_effect: dict[int, list[Part]] = {}
        for part in wave:
            by_effect.setdefault(int(work.candidates.effect[part.item]), []).append(part)
        return [Group(index, parts) for index, parts in by_effect.items()]

    def _trace_task(self, frame: Frame, effect: RayEffect, pixels: np.ndarray, layers: LayerSet) -> int:
        result = self._faults.trace(effect, frame, pixels)
        if result is None:
            return 0
        traced = np.ones(len(pixels), np.uint8) if result.traced is None else result.traced
        name = effect.writes.name
        scatter(pixels, result.values, traced, np.uint8(MASK_TRACED), layers.arrays[name], layers.masks[name])
        return result.rays
