"""Scheduler: asks the heuristic what is next, has it traced in waves on the thread pool, and tells what it cost."""

from __future__ import annotations

import math
import time
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from phrt.asking import Asking
from phrt.candidates import WorkItems
from phrt.clock import Clock, WallClock
from phrt.costs import CostModels
from phrt.experience import Experience
from phrt.faults import Faults
from phrt.frame import MASK_TRACED, Decisions, Frame
from phrt.interfaces.effect import RayEffect
from phrt.interfaces.heuristic import BudgetUnit, FrameContext, Heuristic
from phrt.kernels.booking import beginnings
from phrt.kernels.layers import scatter
from phrt.layers import LayerSet
from phrt.ledger import NO_PARTS, Ledger, Parts
from phrt.runs import UnitParts, unit_parts
from phrt.workers import chunks

CHUNK_RAYS = 24576
"""Rays, by prediction, that a thread takes at a time: what stays in its share of the cache;"""
CHUNKS_A_THREAD = 4
"""fewer where the wave is small, so that all threads have work and end together,"""
SMALLEST_CHUNK_MS, SMALLEST_CHUNK_PIXELS = 0.75, 64
"""but not less than this, by prediction: every chunk takes a time of its own, whatever is in it."""

WAVE_SHARE = {"rays": 0.9, "ms": 0.65}
"""A wave takes at most this share of what is left of a budget, by prediction, so that the next one can be corrected; rays are
predicted better than time;"""
SMALLEST_WAVE = {"rays": 2.0 * CHUNK_RAYS, "ms": 4.0}
"""but it may take this much, in the budget's unit, and all that is left when that is less than LAST_WAVE times as much: every wave
has a price of its own."""
LAST_WAVE = 1.5
LEAST_LEFT = {"rays": 1.0, "ms": 0.2}
"""With less than this left, no wave is started."""
MOST_FOR_BEGINNING = 0.7
"""Of what is left, and of a wave: however dear a wave or the first ray of an effect are thought to be, the rest is for rays, or
nothing would ever teach better."""


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
    """Waves of work items, as many as the budget of the context (rays or milliseconds) holds.

    Without a budget one wave takes everything the heuristic wants. With one, what an item is predicted to take is off the
    budget when the item is named, and what it really took instead when it is traced. An item that is predicted to take more
    than is left is not started. One that is larger than a wave is traced over several, pixels of its interleaved passes one
    after the other, and where the budget ends before it does, it stays a coarser effect.

    No wave is started that is predicted to pass the budget, and the clock is read after each. A wave has a price of its own, and
    so has each effect in it, whatever it traces (`CostModels`): under a budget of time both are planned for. With a budget of
    rays, or by a RayClock, decisions depend neither on time nor on threads.

    Effects and heuristics that fail are contained (`Faults`).
    """

    def __init__(
        self, costs: CostModels, experience: Experience, faults: Faults | None = None, clock: Clock | None = None
    ) -> None:
        self._costs, self._experience = costs, experience
        self._faults = faults or Faults()
        self._clock = clock or WallClock()
        self.each_alone = False
        """Is every part traced and counted by itself? For analysis: small ones take longer so, and their times teach nothing."""

    def run(
        self,
        frame: Frame,
        effects: list[RayEffect],
        work: WorkItems,
        heuristic: Heuristic,
        context: FrameContext,
        layers: LayerSet,
    ) -> Decisions:
        started = self._clock.now_ms()
        unit = context.budget_unit
        ledger = Ledger(work)
        asking = Asking(heuristic, self._faults, ledger, context)
        asking.begin(work.candidates)
        waves, pending, now = 0, NO_PARTS, self._clock.now_ms()
        spent = now - started if unit == "ms" else 0.0
        while True:
            plan = self._plan(max(context.budget - spent, 0.0), unit)
            wave, pending = self._next_wave(asking, ledger, pending, plan)
            if not len(wave):
                break
            traced, batches_ms = self._trace(frame, effects, work, ledger, wave, layers)
            ledger.book(wave)
            asking.report(wave)
            waves += 1
            before, now = now, self._clock.now_ms()
            spent = spent + traced if unit == "rays" else now - started
            self._costs.learn_wave(now - before - batches_ms)
        asking.end()
        if not self.each_alone:
            self._costs.end_frame()
        for index, effect in enumerate(effects):
            if self._faults.is_off(effect):
                ledger.discard(index)
        ledger.teach(self._experience)
        return ledger.decisions(context.budget, unit, max(context.budget - spent, 0.0), now - started, waves)

    def _plan(self, left: float, unit: BudgetUnit) -> _Plan:
        """What the next wave may take of what is `left` of the budget."""
        if unit == "none":
            return _Plan(math.inf, math.inf, np.zeros(len(self._costs)))
        least, smallest = LEAST_LEFT[unit], SMALLEST_WAVE[unit]
        if unit == "ms":
            left -= min(self._costs.wave_ms, MOST_FOR_BEGINNING * left)
        if left < least:
            return _Plan(0.0, 0.0, np.zeros(len(self._costs)))
        largest = left if left < LAST_WAVE * smallest else max(left * WAVE_SHARE[unit], smallest)
        begin = np.minimum(self._costs.batch_ms() * (unit == "ms"), MOST_FOR_BEGINNING * largest)
        return _Plan(left, largest, begin)

    @staticmethod
    def _next_wave(asking: Asking, ledger: Ledger, pending: Parts, plan: _Plan) -> tuple[Parts, Parts]:
        """What is traced now, and what was named and has to wait."""
        if not plan.left:
            return NO_PARTS, pending
        if plan.left == math.inf:
            return asking.take(math.inf, math.inf), NO_PARTS
        named, begin = [pending], plan.begin.copy()
        planned = _planned(pending, ledger, begin)
        asking.begin_wave()
        while planned < plan.largest and asking.has_more:
            named.append(asking.take(plan.left - planned, plan.largest - planned))
            planned += _planned(named[-1], ledger, begin)
        return plan.cut(Parts.joined(named), ledger)

    def _trace(
        self,
        frame: Frame,
        effects: list[RayEffect],
        work: WorkItems,
        ledger: Ledger,
        wave: Parts,
        layers: LayerSet,
    ) -> tuple[float, float]:
        """Trace `wave` chunk by chunk, dearest effects first, and book what it took: the rays, and the clock's milliseconds."""
        started = self._clock.now_ms()
        parts = unit_parts(work, wave, 0.0 if self.each_alone else CHUNK_RAYS)
        tasks = self._tasks(parts, effects, parts.pixels(work), frame.workers.threads)

        def work_on(task: _Task) -> tuple[int, int, float]:
            began = time.perf_counter()
            traced, shared = self._trace_task(frame, effects[task.effect], task.pixels, layers)
            return traced, shared, (time.perf_counter() - began) * 1e3

        rays, thread_ms = np.zeros(len(parts.group_effect), np.int64), np.zeros(len(parts.group_effect))
        for_all = np.zeros(len(effects), np.int64)
        for task, (traced, shared, spent) in zip(tasks, frame.workers.map(work_on, tasks), strict=True):
            rays[task.group] += traced - shared
            for_all[task.effect] += shared
            thread_ms[task.group] += spent
            name = effects[task.effect].name
            layers.rays[name] = layers.rays.get(name, 0) + traced
        for effect in np.flatnonzero(for_all).tolist():
            parts.spread(rays, effect, int(for_all[effect]))
        milliseconds = self._clock.wave(started, thread_ms, rays)
        booked = parts.book(ledger, work, rays, milliseconds)
        if not self.each_alone:
            self._costs.learn(booked)
        return float(rays.sum()), float(milliseconds.sum())

    def _tasks(self, parts: UnitParts, effects: list[RayEffect], pixels: list[np.ndarray], threads: int) -> list[_Task]:
        """The groups in chunks, those with the dearest pixels first."""
        chunk_ms = max(float(parts.group_ms.sum()) / (CHUNKS_A_THREAD * threads), SMALLEST_CHUNK_MS)
        pieces = np.maximum(parts.group_rays / CHUNK_RAYS, parts.group_ms / chunk_ms)
        if len(pieces) < threads:
            # Two threads at half a chunk each are done sooner than one at a whole one.
            pieces = np.maximum(pieces, np.minimum(threads, 2 * parts.group_ms / SMALLEST_CHUNK_MS))
        tasks = []
        for group in np.argsort(-parts.group_rays / parts.group_pixels, kind="stable").tolist():
            effect, own = int(parts.group_effect[group]), pixels[group]
            if not self._faults.is_off(effects[effect]):
                size = max(-(-len(own) // max(int(pieces[group]), 1)), SMALLEST_CHUNK_PIXELS)
                tasks += [_Task(group, effect, own[piece]) for piece in chunks(len(own), size)]
        return tasks

    def _trace_task(self, frame: Frame, effect: RayEffect, pixels: np.ndarray, layers: LayerSet) -> tuple[int, int]:
        """Rays that were traced, and how many of them serve every pixel."""
        result = self._faults.trace(effect, frame, pixels)
        if result is None:
            return 0, 0
        traced = np.ones(len(pixels), np.uint8) if result.traced is None else result.traced
        name = effect.writes.name
        scatter(pixels, result.values, traced, np.uint8(MASK_TRACED), layers.arrays[name], layers.masks[name])
        return result.rays, result.shared_rays


@dataclass(frozen=True)
class _Plan:
    """Of a wave: what is `left` of the budget, and the `largest` share of it that the wave may take, in the budget's unit; what
    each effect takes before its first ray, begin (effects,)."""

    left: float
    largest: float
    begin: np.ndarray

    def cut(self, parts: Parts, ledger: Ledger) -> tuple[Parts, Parts]:
        """The first parts that are predicted to take `largest` together, the last of them perhaps not whole, and the rest."""
        begins = _begins(parts, ledger, self.begin.copy())
        costs = ledger.predicted(parts) + begins
        ends = np.cumsum(costs)
        whole = int(np.searchsorted(ends, self.largest, side="right"))
        if whole == len(parts):
            return parts, NO_PARTS
        room = self.largest - (float(ends[whole - 1]) if whole else 0.0) - float(begins[whole])
        size = int(parts.stop[whole] - parts.start[whole])
        fits = max(int(size * room / (costs[whole] - begins[whole])), 0)
        middle = np.array([parts.start[whole] + fits])
        first, rest = parts.rows(slice(0, whole)), parts.rows(slice(whole, None))
        if fits:
            first = Parts.joined([first, Parts(rest.item[:1], rest.start[:1], middle)])
            rest = Parts(rest.item, np.concatenate([middle, rest.start[1:]]), rest.stop)
        return first, rest


def _planned(parts: Parts, ledger: Ledger, begin: np.ndarray) -> float:
    """What `parts` are predicted to take in a wave whose effects still have `begin` (effects,) before them, less from now on."""
    return float(ledger.predicted(parts).sum() + _begins(parts, ledger, begin).sum())


def _begins(parts: Parts, ledger: Ledger, begin: np.ndarray) -> np.ndarray:
    """(k,) float64: the first one of `parts` of each effect bears its beginning, which is taken out of `begin` (effects,)."""
    begins = np.zeros(len(parts))
    if begin.any():
        beginnings(parts.item, ledger.effect, begin, begins)
    return begins


@dataclass(frozen=True)
class _Task:
    """A run of pixels of one group, for one thread."""

    group: int
    effect: int
    pixels: np.ndarray
