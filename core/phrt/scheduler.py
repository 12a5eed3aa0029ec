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
from phrt.interfaces.heuristic import FrameContext, Heuristic
from phrt.kernels.layers import scatter
from phrt.layers import LayerSet
from phrt.ledger import NO_PARTS, Ledger, Parts
from phrt.runs import UnitParts, unit_parts
from phrt.workers import chunks

CHUNK_RAYS = 24576
"""Rays, by prediction, that a thread takes at a time: what stays in its share of the cache;"""
SMALLEST_CHUNK_RAYS = 4096
"""fewer in small waves, so that all threads have work and end together."""

WAVE_SHARE = 0.35
"""A wave takes at most this share of what is left of a budget, by prediction, so that the next one can be corrected;"""
SMALLEST_WAVE = {"rays": 2.0 * CHUNK_RAYS, "ms": 1.5}
"""but it may take this much, in the budget's unit, so that the last waves are not many small ones."""
LEAST_LEFT = {"rays": 1.0, "ms": 0.2}
"""With less than this left, no wave is started."""


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

    No wave is started that is predicted to pass the budget, and the clock is read after each. With a budget of rays, or by a
    RayClock, decisions depend neither on time nor on threads.

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
        spent = 0.0
        unit = context.budget_unit
        ledger = Ledger(work)
        asking = Asking(heuristic, self._faults, ledger, context)
        asking.begin(work.candidates)
        waves, pending, now = 0, NO_PARTS, started
        while True:
            left = max(context.budget - spent, 0.0)
            wave, pending = self._next_wave(asking, ledger, pending, left, unit)
            if not len(wave):
                break
            traced = self._trace(frame, effects, work, ledger, wave, layers)
            ledger.book(wave)
            asking.report(wave)
            waves += 1
            now = self._clock.now_ms()
            spent = spent + traced if unit == "rays" else now - started
        asking.end()
        for index, effect in enumerate(effects):
            if self._faults.is_off(effect):
                ledger.discard(index)
        ledger.teach(self._experience)
        return ledger.decisions(context.budget, unit, max(context.budget - spent, 0.0), now - started, waves)

    def _next_wave(self, asking: Asking, ledger: Ledger, pending: Parts, left: float, unit: str) -> tuple[Parts, Parts]:
        """What is traced now, and what was named and has to wait. left: of the budget."""
        if unit == "none":
            return asking.take(math.inf, math.inf), NO_PARTS
        if left < LEAST_LEFT[unit]:
            return NO_PARTS, pending
        largest = min(max(left * WAVE_SHARE, SMALLEST_WAVE[unit]), left)
        named = [pending]
        planned = float(ledger.predicted(pending).sum())
        asking.begin_wave()
        while planned < largest and asking.has_more:
            named.append(asking.take(left - planned, largest - planned))
            planned += float(ledger.predicted(named[-1]).sum())
        return _cut(Parts.joined(named), ledger, largest)

    def _trace(
        self,
        frame: Frame,
        effects: list[RayEffect],
        work: WorkItems,
        ledger: Ledger,
        wave: Parts,
        layers: LayerSet,
    ) -> float:
        """Trace `wave` chunk by chunk, dearest effects first, and book what it took. Returns the rays."""
        started = self._clock.now_ms()
        parts = unit_parts(work, wave)
        groups = [
            group
            for group in self._groups(parts, 0.0 if self.each_alone else CHUNK_RAYS)
            if not self._faults.is_off(effects[group.effect])
        ]
        size = min(max(float(parts.rays.sum()) / (4 * frame.workers.threads), SMALLEST_CHUNK_RAYS), CHUNK_RAYS)
        tasks: list[_Task] = []
        for number, group in enumerate(groups):
            pixels = parts.pixels(work, group.rows)
            for piece in chunks(len(pixels), max(int(size / group.rays_per_pixel), 64)):
                tasks.append(_Task(number, group.effect, pixels[piece]))

        def work_on(task: _Task) -> tuple[int, float]:
            began = time.perf_counter()
            traced = self._trace_task(frame, effects[task.effect], task.pixels, layers)
            return traced, (time.perf_counter() - began) * 1e3

        rays, thread_ms = np.zeros(len(groups), np.int64), np.zeros(len(groups))
        for task, (traced, spent) in zip(tasks, frame.workers.map(work_on, tasks), strict=True):
            rays[task.group] += traced
            thread_ms[task.group] += spent
        milliseconds = self._clock.wave(started, thread_ms, rays)
        booked = [
            parts.book(ledger, work, group.rows, group.effect, int(count), float(spent))
            for group, count, spent in zip(groups, rays, milliseconds, strict=True)
        ]
        if not self.each_alone:
            self._costs.learn(booked)
        for group, count in zip(groups, rays, strict=True):
            name = effects[group.effect].name
            layers.rays[name] = layers.rays.get(name, 0) + int(count)
        return float(rays.sum())

    @staticmethod
    def _groups(parts: UnitParts, large_rays: float) -> list[_Group]:
        """What is accounted for together: a large part alone, the small ones of an effect as one. Dearest pixels first."""
        large = parts.rays >= large_rays
        rows = [np.array([row]) for row in np.flatnonzero(large)]
        rows += [
            found
            for effect in np.unique(parts.effect)
            if len(found := np.flatnonzero(~large & (parts.effect == effect)))
        ]
        groups = [
            _Group(int(parts.effect[own[0]]), own, float(parts.rays[own].sum() / max(parts.count[own].sum(), 1)))
            for own in rows
        ]
        return sorted(groups, key=lambda group: -group.rays_per_pixel)

    def _trace_task(self, frame: Frame, effect: RayEffect, pixels: np.ndarray, layers: LayerSet) -> int:
        result = self._faults.trace(effect, frame, pixels)
        if result is None:
            return 0
        traced = np.ones(len(pixels), np.uint8) if result.traced is None else result.traced
        name = effect.writes.name
        scatter(pixels, result.values, traced, np.uint8(MASK_TRACED), layers.arrays[name], layers.masks[name])
        return result.rays


@dataclass(frozen=True)
class _Group:
    """Unit parts `rows` of one effect."""

    effect: int
    rows: np.ndarray
    rays_per_pixel: float


@dataclass(frozen=True)
class _Task:
    """A run of pixels of one group, for one thread."""

    group: int
    effect: int
    pixels: np.ndarray


def _cut(parts: Parts, ledger: Ledger, largest: float) -> tuple[Parts, Parts]:
    """The first parts that are predicted to take `largest` together, the last of them perhaps not whole, and the rest."""
    costs = ledger.predicted(parts)
    ends = np.cumsum(costs)
    whole = int(np.searchsorted(ends, largest, side="right"))
    if whole == len(parts):
        return parts, NO_PARTS
    before = float(ends[whole - 1]) if whole else 0.0
    size = int(parts.stop[whole] - parts.start[whole])
    fits = int(size * (largest - before) / costs[whole])
    middle = np.array([parts.start[whole] + fits])
    first, rest = parts.rows(slice(0, whole)), parts.rows(slice(whole, None))
    if fits:
        first = Parts.joined([first, Parts(rest.item[:1], rest.start[:1], middle)])
        rest = Parts(rest.item, np.concatenate([middle, rest.start[1:]]), rest.stop)
    return first, rest
