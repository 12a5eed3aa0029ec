"""A contest: all heuristics on the same camera path under the same budget, and all-trace without one beside them.

Every entrant is a renderer of its own with a state of its own. They take turns in blocks of consecutive frames, so that a
slow minute of the machine hits them all. Before the path that counts each walks its first second backwards, up to the
start: caches, kernels and what heuristics learn are then in place, and the view never jumps.
"""

from __future__ import annotations

import re
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from quality import Quality, compare_all
from watch import Watch, watch

from phrt import Renderer, Scene
from phrt.budget import Budget
from phrt.errors import PhrtWarning
from phrt.frame import Decisions, FrameResult
from phrt.output.tonemap import to_8bit
from phrt.registry import get_registry
from phrt_plugins.metrics.costs import relative_errors, traced_share
from phrt_plugins.metrics.flips import flips_between

Progress = Callable[[str], None]
WARM_UP = 30
"""Frames before those that count."""
BLOCK = 50
"""Frames that an entrant renders in one go: the first one of a block finds the caches cold."""
REFERENCE = "all-trace, no budget"
CLOSING_QUANTILE = 0.95
"""Of the time that `to_8bit` takes: what a renderer is told to keep for it."""


@dataclass(frozen=True)
class Rules:
    """What all entrants of a contest share. budget: None for half of the rays that all-trace's ray phase takes on average.

    effects: options by effect. history: do values of earlier frames stand in for what is not traced?
    """

    name: str
    variant: str
    budget: Budget | None
    effects: Mapping[str, Mapping[str, object]]
    history: bool


@dataclass(frozen=True)
class Path:
    """The frames that count, one after the other: `frames` of them, `1 / fps` s apart. Pictures of every `every`-th are kept."""

    frames: int
    fps: float
    every: int = 5

    def warm_up(self) -> list[tuple[int, float]]:
        """(frame index, time): backwards to the start."""
        return [(i, (WARM_UP - i) / self.fps) for i in range(WARM_UP)]

    def blocks(self) -> Iterator[list[tuple[int, float]]]:
        """(frame index, time) of the frames that count, in blocks."""
        for first in range(0, self.frames, BLOCK):
            last = min(first + BLOCK, self.frames)
            yield [(WARM_UP + i, i / self.fps) for i in range(first, last)]

    def keeps(self, index: int) -> bool:
        """Is the picture of frame `index` looked at?"""
        return (index - WARM_UP) % self.every == 0


@dataclass
class Samples:
    """Of one entrant, frame by frame: columns by name, stages by name, and relative errors of items by cost model."""

    columns: dict[str, list[float]] = field(default_factory=dict)
    stages: dict[str, list[float]] = field(default_factory=dict)
    item_errors: dict[str, list[np.ndarray]] = field(default_factory=dict)

    def add(self, values: Mapping[str, float], stages: Mapping[str, float], errors: Mapping[str, np.ndarray]) -> None:
        """One frame more."""
        for name, value in values.items():
            self.columns.setdefault(name, []).append(value)
        for stage, spent in stages.items():
            self.stages.setdefault(stage, []).append(spent)
        for model, found in errors.items():
            self.item_errors.setdefault(model, []).append(found)

    def __getitem__(self, name: str) -> np.ndarray:
        return np.array(self.columns[name])


class Entrant:
    """One heuristic under the rules. `name` is what tables call it."""

    def __init__(self, name: str, renderer: Renderer) -> None:
        self.name = name
        self.renderer = renderer
        self.samples = Samples()
        self.pictures: dict[int, np.ndarray] = {}
        self.quality: list[Quality] = []
        self._watch: Watch = watch(renderer)
        self._earlier: Decisions | None = None

    def render(self, index: int, at: float, path: Path, counts: bool) -> None:
        """One frame; its samples are kept when it `counts`."""
        start = time.perf_counter()
        result = self.renderer.render(at, frame_index=index)
        rendered = time.perf_counter()
        picture = to_8bit(result.image, pool=self.renderer.workers)
        end = time.perf_counter()
        earlier, self._earlier = self._earlier, result.decisions
        if not counts:
            return
        times = {"frame_ms": (end - start) * 1e3, "closing_ms": (end - rendered) * 1e3}
        values = times | self._ray_phase(result) | flips(earlier, result.decisions)
        totals, items = prediction_errors(result.decisions)
        self.samples.add(values | totals, result.stages, items)
        if path.keeps(index):
            self.pictures[index] = picture

    def _ray_phase(self, result: FrameResult) -> dict[str, float]:
        decisions, phase = result.decisions, self._watch.phase
        rays = float(sum(count for kind, count in result.rays.items() if kind != "primary"))
        over = rays - decisions.budget if decisions.budget_unit == "rays" else decisions.overrun_ms
        return {
            "rays": rays,
            "ray_budget": decisions.budget,
            "overrun": max(over, 0.0),
            "candidates": float(len(decisions.candidates)),
            "chosen": float(decisions.chosen.sum()),
            "heuristic_ms": phase.heuristic_ms,
            "scheduler_ms": phase.scheduler_ms,
            "longest_wave_ms": max(phase.waves_ms, default=0.0),
            "headroom_ms": result.headroom_ms,
        }


def flips(earlier: Decisions | None, now: Decisions) -> dict[str, float]:
    """How many items that both frames see were traced in one and not in the other, and their share of such items' pixels."""
    if earlier is None:
        return {"flips": 0.0, "flipped_area": 0.0}
    before, work = earlier.candidates, now.candidates
    count, share = flips_between(before.keys(), earlier.chosen, work.keys(), now.chosen, work.pixel_count)
    return {"flips": count, "flipped_area": share}


def prediction_errors(decisions: Decisions) -> tuple[dict[str, float], dict[str, np.ndarray]]:
    """|predicted - actual| / actual of rays and of both models' ms: of the frame's sum, and of every item by itself.

    Predictions are for whole items; of a partly traced one the share of its pixels counts. NaN where nothing was traced.
    """
    work = decisions.candidates
    share = traced_share(decisions.traced_pixels, work.pixel_count, decisions.rays)
    traced = share > 0
    pairs = {
        "rays": (work.predicted_rays, decisions.rays),
        "paper": (work.predicted_ms_paper, decisions.milliseconds),
        "measured": (work.predicted_ms_measured, decisions.milliseconds),
    }
    totals, items = {}, {}
    for name, (predicted, actual) in pairs.items():
        expected, took = (predicted * share)[traced], actual[traced]
        totals[f"error_{name}"] = float(relative_errors(expected.sum(), took.sum()))
        items[name] = relative_errors(expected, took)[took > 0]
    return totals, items


@dataclass
class Contest:
    """What was found. entrants: the reference first. warnings: what renderers had to say; of those that differ in a number
    only the first."""

    rules: Rules
    budget: Budget
    path: Path
    entrants: list[Entrant]
    warnings: list[str] = field(default_factory=list)

    @property
    def reference(self) -> Entrant:
        return self.entrants[0]

    @property
    def rivals(self) -> list[Entrant]:
        return self.entrants[1:]


def heuristics_here() -> list[str]:
    """Every heuristic that can be made here, plugins' own among them."""
    registry = get_registry()
    return [n for n in registry.names("heuristic") if registry.get("heuristic", n).unavailable_reason() is None]


@contextmanager
def _renderer(
    scene: Scene, rules: Rules, heuristic: str, size: tuple[int, int], threads: int, **more: Any
) -> Iterator[Renderer]:
    with Renderer(
        scene, size=size, threads=threads, gbuffer="raycast", tracer="embree", heuristic=heuristic,
        effects=rules.effects, history=rules.history, remember_costs=False, strict=True, **more,
    ) as renderer:  # fmt: skip
        yield renderer


def _mean_rays(renderer: Renderer, path: Path) -> float:
    """Of the ray phase, along the path."""
    counts = []
    for i in range(0, path.frames, 10):
        rays = renderer.render(i / path.fps).rays
        counts.append(sum(count for kind, count in rays.items() if kind != "primary"))
    return float(np.mean(counts))


def _closing_ms(renderer: Renderer) -> float:
    """What `to_8bit` takes on the renderer's threads, nearly always."""
    image = renderer.render(0.0).image
    times = []
    for _ in range(40):
        start = time.perf_counter()
        to_8bit(image, pool=renderer.workers)
        times.append((time.perf_counter() - start) * 1e3)
    return float(np.quantile(times, CLOSING_QUANTILE))


def hold(
    scene: Scene,
    rules: Rules,
    names: Sequence[str],
    path: Path,
    *,
    size: tuple[int, int] = (640, 360),
    threads: int = 2,
    progress: Progress = lambda text: None,
) -> Contest:
    """Walk all of heuristics `names` and the reference along `path`, and compare their pictures."""
    with ExitStack() as stack, warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", PhrtWarning)
        progress(f"{rules.name}: all-trace without a budget")
        free = stack.enter_context(_renderer(scene, rules, "all_trace", size, threads))
        budget = rules.budget or Budget(round(_mean_rays(free, path) / 2), "rays")
        reserve = _closing_ms(free)
        entrants = [Entrant(REFERENCE, free)]
        for name in names:
            made = _renderer(scene, rules, name, size, threads, budget=budget, reserve_ms=reserve)
            entrants.append(Entrant(name, stack.enter_context(made)))
        for entrant in entrants:
            progress(f"{rules.name}: {entrant.name} warms up")
            for index, at in path.warm_up():
                entrant.render(index, at, path, counts=False)
        for block in path.blocks():
            for entrant in entrants:
                progress(f"{rules.name}: frame {block[0][0] - WARM_UP} of {path.frames}, {entrant.name}")
                for index, at in block:
                    entrant.render(index, at, path, counts=True)
    said = [str(entry.message) for entry in told if issubclass(entry.category, PhrtWarning)]
    kinds = {re.sub(r"\d+", "#", text): text for text in reversed(said)}
    contest = Contest(rules, budget, path, entrants, list(reversed(kinds.values())))
    _look(contest, threads, progress)
    return contest


def _look(contest: Contest, processes: int, progress: Progress) -> None:
    """Compare what was kept with the reference's, and let the pictures go."""
    progress(f"{contest.rules.name}: comparing pictures")
    wanted = contest.reference.pictures
    pairs = [(wanted[index], entrant.pictures[index]) for entrant in contest.rivals for index in wanted]
    found = compare_all(pairs, processes)
    for number, entrant in enumerate(contest.rivals):
        entrant.quality = found[number * len(wanted) : (number + 1) * len(wanted)]
    for entrant in contest.entrants:
        entrant.pictures.clear()
