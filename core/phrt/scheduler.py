"""Scheduler: asks the heuristic what is next, has it traced in waves on the thread pool, and tells what it cost."""

from __future__ import annotations

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
        asked = BlamedHeuristic(heuristic)
        asked.begin_frame(work.candidates, context)
        while wave := self._ask(asked, ledger, context.budget):
            self._trace(frame, effects, work, wave, layers, ledger)
            for part in wave:
                asked.report(part.item, ledger.outcome(part))
        asked.end_frame()
        for index, effect in enumerate(effects):
            if self._faults.is_off(effect):
                ledger.passes[work.candidates.effect == index] = 0
        return ledger.decisions()

    def _ask(self, heuristic: BlamedHeuristic, ledger: Ledger, remaining: float) -> list[Part]:
        """The next wave: parts of items in the order the heuristic named them."""
        wave: list[Part] = []
        while (request := heuristic.next(remaining)) is not None:
            part = ledger.accept(request)
            if part is None:
                raise PluginError(
                    f"heuristic {heuristic.name} returned item {request.item}: "
                    f"not one of {len(ledger.passes)}, or twice"
                )
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
    ) -> None:
        """Trace `wave` chunk by chunk, dearest effects first; costs are shared out to items by their pixels."""
        estimates = [
            max(float(work.candidates.ray_estimate[work.candidates.effect == index].max(initial=1.0)), 1.0)
            for index in range(len(effects))
        ]
        by_effect: dict[int, list[Part]] = {}
        for part in wave:
            by_effect.setdefault(int(work.candidates.effect[part.item]), []).append(part)
        tasks: list[Task] = []
        for index in sorted(by_effect, key=lambda e: -estimates[e]):
            if not self._faults.is_off(effects[index]):
                size = max(int(CHUNK_RAYS / estimates[index]), 256)
                for run in pixel_runs(work, by_effect[index], frame.view.width):
                    tasks += [Task(index, run[piece]) for piece in chunks(len(run), size)]

        def work_on(task: Task) -> tuple[int, int, float]:
            started = time.perf_counter()
            traced = self._trace_task(frame, effects[task.effect], task.pixels, layers)
            return task.effect, traced, (time.perf_counter() - started) * 1e3

        totals = np.zeros((len(effects), 2))
        for index, traced, spent in frame.workers.map(work_on, tasks):
            totals[index] += traced, spent
        for index, parts in by_effect.items():
            ledger.share_out(parts, int(totals[index, 0]), float(totals[index, 1]))
            name = effects[index].name
            layers.rays[name] = layers.rays.get(name, 0) + int(totals[index, 0])

    def _trace_task(self, frame: Frame, effect: RayEffect, pixels: np.ndarray, layers: LayerSet) -> int:
        result = self._faults.trace(effect, frame, pixels)
        if result is None:
            return 0
        traced = np.ones(len(pixels), np.uint8) if result.traced is None else result.traced
        name = effect.writes.name
        scatter(pixels, result.values, traced, np.uint8(MASK_TRACED), layers.arrays[name], layers.masks[name])
        return result.rays
