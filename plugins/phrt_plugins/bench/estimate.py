"""How long a benchmark will take: some frames of every setup are rendered and judged, and what that took is multiplied out.

It is an estimate from above: budgets of time are taken as used up, and a contestant without a budget as tracing everything.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from phrt.budget import parse_budget
from phrt.cli.console import DelayedProgress
from phrt.errors import PhrtWarning
from phrt.frame import FrameResult
from phrt.interfaces.metric import Metric
from phrt.output.tonemap import to_8bit
from phrt.renderer import Renderer
from phrt_plugins.bench.config import HALF
from phrt_plugins.bench.paths import path_tracing
from phrt_plugins.bench.pictures import ReferencePicture, shots
from phrt_plugins.bench.plan import Cell, Plan, Setup, Task
from phrt_plugins.bench.references import References
from phrt_plugins.bench.scenes import new_clock, open_renderer
from phrt_plugins.metrics.measure import make_metrics, measure_shots

ORACLE_FRAMES = 10
"""All-trace frames that the oracle takes a frame, nearly."""
WRITING_S = 0.02
"""Bringing a block to the disk, nearly."""
FEW_PATHS = 4
"""Paths a pixel that an estimate takes the time of, the second time; the first time scenes are built and kernels compiled."""


@dataclass(frozen=True)
class Cost:
    """Seconds that a setup takes: to load, for a frame with nothing and with everything traced, to judge a frame.

    rays: secondary rays of a frame with everything traced; paths: seconds to path trace a frame, where its reference is
    """

    load: float
    floor: float
    full: float
    judge: float
    rays: int
    paths: float = 0.0

    def frame(self, cell: Cell, setup: Setup) -> float:
        """Of a frame of `cell`."""
        if cell.heuristic == "raster_only":
            return self.floor
        if cell.budget == HALF:
            return self.floor + (self.full - self.floor) / 2
        budget = parse_budget(cell.budget)
        if budget.kind == "none":
            return self.full
        if budget.kind != "rays" and setup.clock is None:
            return min(self.full, budget.amount / 1e3 + (self.floor if budget.kind == "ray_ms" else 0.0))
        rays = budget.amount if setup.clock is None or budget.kind == "rays" else budget.amount * 1e6 / setup.clock
        return self.floor + (self.full - self.floor) * min(rays / max(self.rays, 1), 1.0)


class Estimate:
    """Costs of the setups of `plan`, measured as they are asked for; nothing is written."""

    def __init__(self, plan: Plan, cache: Path, metrics: Sequence[str] | None) -> None:
        self._plan, self._references = plan, References(cache)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PhrtWarning)
            self._metrics = make_metrics(metrics)
        self._costs: dict[str, Cost | None] = {}

    def cost(self, setup: Setup) -> Cost | None:
        """Of `setup`; None where it cannot be rendered, which its run will tell."""
        if setup.id not in self._costs:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", PhrtWarning)
                try:
                    self._costs[setup.id] = measured_cost(setup, self._metrics)
                except Exception:
                    self._costs[setup.id] = None
        return self._costs[setup.id]

    def measure(self, tasks: Sequence[Task]) -> None:
        """Find the costs that `tasks` need, and say so where that takes long."""
        setups = {task.setup.id: task.setup for task in tasks}
        with DelayedProgress(len(setups), "estimating") as progress:
            for setup in setups.values():
                progress.step(f"estimating: {setup.scene} {setup.size[0]}x{setup.size[1]}")
                self.cost(setup)
                progress.advance()

    def seconds(self, task: Task) -> float:
        """Of `task`, its setup loaded."""
        cost = self.cost(task.setup)
        if cost is None:
            return 0.0
        setup, block = task.setup, task.block
        judged = len(block.judged(setup.judge_every))
        if task.stage == "cells":
            frames = len(block.frames) + setup.warm_up
            return sum(frames * cost.frame(cell, setup) + judged * cost.judge + WRITING_S for cell in task.cells)
        if task.stage == "oracle":
            return judged * ORACLE_FRAMES * cost.full
        if self._references.folder(setup, block).is_dir():
            return judged * cost.judge
        pictured = len(block.pictured(setup.judge_every))
        return pictured * (cost.full + cost.paths) + judged * (cost.floor + cost.judge)

    def total(self, tasks: Sequence[Task], jobs: int = 1) -> float:
        """Seconds of all `tasks`, loading included, `jobs` at a time."""
        loads = {task.setup.id: self.cost(task.setup) for task in tasks}
        return (sum(map(self.seconds, tasks)) + sum(cost.load for cost in loads.values() if cost)) / max(jobs, 1)


def measured_cost(setup: Setup, metrics: Sequence[Metric]) -> Cost:
    """Render the middle of the path with nothing and with everything traced, twice each, and judge one against the other."""
    began = time.perf_counter()
    with open_renderer(setup) as renderer:
        load = time.perf_counter() - began
        full, all_traced = _second(renderer, setup, "all_trace")
        floor, nothing = _second(renderer, setup, "raster_only")
        number = setup.path.numbers[setup.path.count // 2]
        reference = ReferencePicture(
            all_traced.image.copy(), to_8bit(all_traced.image, setup.tone_map), nothing.image,
            to_8bit(nothing.image, setup.tone_map), np.zeros((*all_traced.image.shape[:2], 2), np.float32),
        )  # fmt: skip
        images = {number: nothing.image, number - 1: nothing.image}
        judged = shots(images, {number: reference, number - 1: reference}, [number], setup.tone_map)
        began = time.perf_counter()
        measure_shots(metrics, judged)
        judge = time.perf_counter() - began
        rays = sum(count for kind, count in all_traced.rays.items() if kind != "primary")
        return Cost(load, floor, full, judge, rays, seconds_of_paths(renderer, setup, all_traced))


def seconds_of_paths(renderer: Renderer, setup: Setup, frame: FrameResult) -> float:
    """Seconds to path trace `frame`, by how long a few paths a pixel take; 0 where the reference is not path traced."""
    reference = setup.reference
    with path_tracing(reference, FEW_PATHS) as picture:
        if reference is None or picture is None:
            return 0.0
        picture(renderer.world, frame.view)
        began = time.perf_counter()
        picture(renderer.world, frame.view)
        return (time.perf_counter() - began) * reference.samples / FEW_PATHS


def _second(renderer: Renderer, setup: Setup, heuristic: str) -> tuple[float, FrameResult]:
    """Seconds of a frame, and the frame, once everything is warm."""
    renderer.restart(heuristic=heuristic, history=False, clock=new_clock(setup))
    number = setup.path.numbers[setup.path.count // 2]
    renderer.render(setup.path.time(number), frame_index=number, camera=setup.camera)
    began = time.perf_counter()
    frame = renderer.render(setup.path.time(number), frame_index=number, camera=setup.camera)
    return time.perf_counter() - began, frame


def spoken(seconds: float) -> str:
    """ "0.4 s", "40 s", "12 min", "3.5 h"."""
    if seconds < 10:
        return f"{seconds:.1f} s"
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
