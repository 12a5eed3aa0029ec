"""Clocks: what a frame budget is held by. The scheduler and the frame loop read no other.

A clock is read at the same points of every frame, and says what the work of a wave counts as. That makes time something
that can be injected: real time, a price per ray (the same decisions on every machine), or the readings of an earlier run.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod

import numpy as np

from phrt.errors import OptionError


class Clock(ABC):
    """Contract: called from the thread that renders only."""

    @abstractmethod
    def now_ms(self) -> float:
        """Milliseconds since any fixed moment; never falls."""

    @abstractmethod
    def wave(self, started_ms: float, thread_ms: np.ndarray, rays: np.ndarray) -> np.ndarray:
        """(g,) float64: what the groups of a wave that began at `started_ms` and is done now count as, in milliseconds of
        this clock; they sum to the wave's time.

        thread_ms (g,) float64: thread time that each group took; rays (g,) int64: what it traced.
        """


class WallClock(Clock):
    """Real time. A wave's time is shared out by the thread time of its groups, so that waiting for the last thread counts."""

    def now_ms(self) -> float:
        return time.perf_counter() * 1e3

    def wave(self, started_ms: float, thread_ms: np.ndarray, rays: np.ndarray) -> np.ndarray:
        total = float(thread_ms.sum())
        return thread_ms * ((self.now_ms() - started_ms) / total if total > 0 else 0.0)


class RayClock(Clock):
    """A ray takes `nanoseconds_per_ray`, and nothing else takes time: decisions are the same bit for bit on every machine.

    A frame budget is then one for the ray phase.
    """

    def __init__(self, nanoseconds_per_ray: float = 100.0) -> None:
        if not 0 < nanoseconds_per_ray < 1e9:
            raise OptionError(f"nanoseconds_per_ray is {nanoseconds_per_ray}; it must be above 0 and below 1e9")
        self._ms_per_ray = nanoseconds_per_ray * 1e-6
        self._rays = 0

    def now_ms(self) -> float:
        return self._rays * self._ms_per_ray

    def wave(self, started_ms: float, thread_ms: np.ndarray, rays: np.ndarray) -> np.ndarray:
        self._rays += int(rays.sum())
        return rays * self._ms_per_ray


class RecordingClock(Clock):
    """Passes another clock on and keeps what it said in `readings`; `take` hands them over and begins anew."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.readings: list[float] = []

    def now_ms(self) -> float:
        self.readings.append(self.clock.now_ms())
        return self.readings[-1]

    def wave(self, started_ms: float, thread_ms: np.ndarray, rays: np.ndarray) -> np.ndarray:
        milliseconds = self.clock.wave(started_ms, thread_ms, rays)
        self.readings.extend(milliseconds.tolist())
        return milliseconds

    def take(self) -> list[float]:
        """The readings since the last call."""
        taken, self.readings = self.readings, []
        return taken


class ReplayClock(Clock):
    """Says again what a RecordingClock kept: a run takes the same decisions at the same moments on another machine.

    Raises OptionError when more is read than was kept: then it is not the same run.
    """

    def __init__(self, readings: list[float]) -> None:
        self._readings = list(readings)
        self._next = 0

    def now_ms(self) -> float:
        return self._read(1)[0]

    def wave(self, started_ms: float, thread_ms: np.ndarray, rays: np.ndarray) -> np.ndarray:
        return np.array(self._read(len(rays)), np.float64)

    def _read(self, count: int) -> list[float]:
        first, self._next = self._next, self._next + count
        if self._next > len(self._readings):
            raise OptionError(
                f"the clock was read {self._next} times, {len(self._readings)} readings were recorded: not the same run"
            )
        return self._readings[first : self._next]


def beneath(clock: Clock) -> Clock:
    """The clock that is read in the end: what a RecordingClock passes on, else `clock` itself."""
    return beneath(clock.clock) if isinstance(clock, RecordingClock) else clock
