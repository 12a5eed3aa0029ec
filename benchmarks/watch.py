"""Stop-watches inside the ray phase: what the heuristic takes, what the waves take, and what is left for the scheduler.

They stand outside of the renderer: around the heuristic's calls, and around the thread pool while a ray phase runs.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from phrt import Renderer
from phrt.interfaces.heuristic import Candidates, FrameContext
from phrt.workers import Workers


@dataclass
class RayPhase:
    """Wall-clock ms of one ray phase. waves: what the thread pool was given at a time, one after the other."""

    heuristic_ms: float = 0.0
    whole_ms: float = 0.0
    waves_ms: list[float] = field(default_factory=list)

    @property
    def scheduler_ms(self) -> float:
        """Neither the heuristic's nor the waves'."""
        return max(self.whole_ms - self.heuristic_ms - sum(self.waves_ms), 0.0)


class Watch:
    """Keeps the ray phase that runs, or ran last."""

    def __init__(self) -> None:
        self.phase = RayPhase()
        self.running = False
        self._thread = threading.get_ident()
        self._start = 0.0

    def begin(self) -> None:
        """A ray phase starts."""
        self.phase, self.running, self._start = RayPhase(), True, time.perf_counter()

    def end(self) -> None:
        """It has ended."""
        self.phase.whole_ms = (time.perf_counter() - self._start) * 1e3
        self.running = False

    def sees_the_pool(self, workers: Workers) -> None:
        """From now on every `map` of `workers` in a ray phase, called by this thread, is a wave."""
        original = workers.map

        def timed(function: Callable[[Any], Any], items: Iterable[Any]) -> list[Any]:
            if not self.running or threading.get_ident() != self._thread:
                return original(function, items)
            start = time.perf_counter()
            try:
                return original(function, items)
            finally:
                self.phase.waves_ms.append((time.perf_counter() - start) * 1e3)

        workers.map = timed  # type: ignore[method-assign]


def watch(renderer: Renderer) -> Watch:
    """A watch over the ray phases of `renderer`, from its next frame on. Its heuristic stays the object it is."""
    made, heuristic = Watch(), renderer.heuristic

    def timed(call: Callable[..., Any]) -> Callable[..., Any]:
        def within(*arguments: Any) -> Any:
            start = time.perf_counter()
            try:
                return call(*arguments)
            finally:
                made.phase.heuristic_ms += (time.perf_counter() - start) * 1e3

        return within

    calls = {name: timed(getattr(heuristic, name)) for name in ("begin_frame", "next", "take", "report", "end_frame")}

    def begin_frame(candidates: Candidates, context: FrameContext) -> None:
        made.begin()
        calls["begin_frame"](candidates, context)

    def end_frame() -> None:
        calls["end_frame"]()
        made.end()

    for name, call in (calls | {"begin_frame": begin_frame, "end_frame": end_frame}).items():
        setattr(heuristic, name, call)
    made.sees_the_pool(renderer.workers)
    return made
