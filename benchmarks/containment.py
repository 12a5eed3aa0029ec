"""What it costs to check plugins' answers: processor milliseconds of all threads in a frame of the reference scene, by check.

    python benchmarks/containment.py            # 640x360, everything traced; PHRT_ASSETS names the scenes
    python benchmarks/containment.py --others   # as if nothing were ours: values are looked at, too

Stop-watches of processor time are put around the checks of `phrt.faults`; what they take themselves is taken off.
"""

from __future__ import annotations

import argparse
import statistics
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

from fallbacks import PLAIN

import phrt
from phrt.faults import faults as faults_module
from phrt.faults import gbuffer as gbuffer_module
from phrt.faults import tracer as tracer_module

SCENE = Path(__file__).resolve().parents[1] / "scenes" / "sponza_armadillo.yaml"
CHECKS: tuple[tuple[str, Any, str], ...] = (
    ("hits and occlusion", tracer_module.GuardedTracer, "_checked"),
    ("hits and occlusion", tracer_module, "fits"),
    ("G-buffer", gbuffer_module.GuardedProducer, "_check_picture"),
    ("effects' values", faults_module, "check_result"),
    ("fallbacks' values", faults_module, "check_values"),
    ("fallbacks' values", faults_module, "check_applies"),
)
"""What is said of a check, and where it is."""


class Watches:
    """Seconds and calls by check, of all threads."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = defaultdict(float)
        self.calls: dict[str, int] = defaultdict(int)
        self._lock = threading.Lock()
        self._inside = threading.local()

    def around(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def watched(*given: Any, **named: Any) -> Any:
            if getattr(self._inside, "yes", False):
                # A check within a check is counted once.
                return function(*given, **named)
            self._inside.yes = True
            before, began = time.thread_time(), time.thread_time()
            try:
                return function(*given, **named)
            finally:
                # Looking at the watch takes its time, too, the more so after code that emptied the caches.
                spent = time.thread_time() - began - (began - before)
                self._inside.yes = False
                with self._lock:
                    self.seconds[name] += spent
                    self.calls[name] += 1

        return watched

    def take(self) -> dict[str, tuple[float, int]]:
        """Milliseconds and calls so far, and begin anew."""
        found = {name: (seconds * 1e3, self.calls[name]) for name, seconds in self.seconds.items()}
        self.seconds.clear()
        self.calls.clear()
        return found


def measure(frames: int, heuristic: str, budget: str, others: bool) -> None:
    watches = Watches()
    if others:
        for module in (faults_module, gbuffer_module, tracer_module):
            module.is_ours = lambda made: False  # type: ignore[attr-defined]
    for name, owner, attribute in CHECKS:
        setattr(owner, attribute, watches.around(name, getattr(owner, attribute)))
    scene = phrt.load_scene(SCENE)
    taken: dict[str, list[tuple[float, int]]] = defaultdict(list)
    whole: list[float] = []
    with phrt.Renderer(
        scene,
        size=(640, 360),
        heuristic=heuristic,
        budget=budget,
        effects=PLAIN,
        gbuffer="raycast",
        remember_costs=False,
    ) as renderer:
        for number in range(3 + frames):
            spent_before = time.process_time()
            renderer.render(number / 30)
            spent = (time.process_time() - spent_before) * 1e3
            found = watches.take()
            if number >= 3:
                whole.append(spent)
                for name, each in found.items():
                    taken[name].append(each)
        threads = renderer.workers.threads
    print(
        f"{heuristic} {budget}: {statistics.median(whole):.1f} processor ms a frame, {threads} threads, median of {frames}"
    )
    total = 0.0
    for name, each in taken.items():
        spent = statistics.median(ms for ms, _ in each)
        total += spent
        print(f"  {name:<20} {spent:6.3f} ms in {statistics.median(calls for _, calls in each):.0f} calls")
    share = total / statistics.median(whole)
    print(
        f"  {'all of them':<20} {total:6.3f} ms of processor time, {total / threads:.3f} ms of a frame, {share:.2%} of it"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--frames", type=int, default=15)
    parser.add_argument("--heuristic", default="all_trace")
    parser.add_argument("--budget", default="none")
    parser.add_argument("--others", action="store_true")
    arguments = parser.parse_args()
    measure(arguments.frames, arguments.heuristic, arguments.budget, arguments.others)


if __name__ == "__main__":
    main()
