"""Row 9: what deciding takes, with up to 100,000 candidates.

Made-up work items go through the real `BudgetScheduler` with every heuristic, under a budget of time that is half of what all of
them would take by a `RayClock`. Their effects trace nothing, at once. Counted is the ray phase less the time that the
thread pool has the waves: asking, planning, booking, telling.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from rich.table import Table
from rows import Row, row
from watch import Watch

from phrt.candidates import Units, WorkItems
from phrt.clock import RayClock
from phrt.costs import CostModels
from phrt.experience import Experience
from phrt.faults import Faults
from phrt.frame import Decisions
from phrt.interfaces.effect import EffectResult, LayerSpec, RayEffect
from phrt.interfaces.heuristic import Candidates, FrameContext
from phrt.layers import LayerSet
from phrt.registry import get_registry
from phrt.scheduler import BudgetScheduler
from phrt.workers import Workers

COUNTS = (1_000, 10_000, 100_000)
LIMIT_MS, LIMIT_COUNT = 5.0, 10_000
EFFECTS = ("shadows", "reflections", "refractions", "ambient_occlusion")
MEAN_PIXELS = 23
"""Of an item: 10,000 of them then fill 640x360."""
WIDTH = 640
NANOSECONDS_PER_RAY = 100.0
SETS = 4
"""Sets of candidates that frames take turns with: same items, other letters."""


class NoEffect(RayEffect):
    """Traces nothing, at no cost: every value is 0, and stands for `rays` a pixel; `pixels` at most."""

    reads = ()

    def __init__(self, name: str, rays: float, pixels: int) -> None:
        self.name = name
        self.writes = LayerSpec(name, 1, 0.0, "nothing")
        self._rays = rays
        self._zeros = np.zeros((pixels, 1), np.float32)

    def applies_to(self, world: Any) -> np.ndarray:
        return np.ones(1, bool)

    def rays_per_pixel(self, world: Any) -> float:
        return self._rays

    def trace(self, frame: Any, pixels: np.ndarray) -> EffectResult:
        return EffectResult(self._zeros[: len(pixels)], round(len(pixels) * self._rays))

    def fallback(self, frame: Any, pixels: np.ndarray) -> np.ndarray | None:
        return None


RAYS = (3.0, 2.0, 4.0, 4.0)
"""A pixel, by effect."""


@dataclass(frozen=True)
class Made:
    """`count` candidates with pixels, made up from `seed`."""

    count: int
    seed: int = 0

    @cached_property
    def work(self) -> WorkItems:
        """The items: every object with every effect, its pixels in one piece."""
        rng = np.random.default_rng(self.seed)
        objects = -(-self.count // len(EFFECTS))
        effect = np.repeat(np.arange(len(EFFECTS), dtype=np.int32), objects)[: self.count]
        object_id = np.tile(np.arange(1, objects + 1, dtype=np.int32), len(EFFECTS))[: self.count]
        size = np.maximum(rng.exponential(MEAN_PIXELS, self.count), 1.0).astype(np.int32)
        first = np.zeros(self.count, np.int64)
        pixels = []
        for index in range(len(EFFECTS)):
            mine = effect == index
            ends = np.cumsum(size[mine])
            first[mine] = ends - size[mine]
            pixels.append(np.arange(ends[-1] if len(ends) else 0, dtype=np.int32))
        rays, held = size * np.array(RAYS)[effect], rng.integers(0, size + 1).astype(np.int32)
        units = Units(
            np.arange(self.count, dtype=np.int32), object_id, effect, first, size, rays,
            rays * NANOSECONDS_PER_RAY * 1e-6, held, held * rng.uniform(1, 20, self.count),
        )  # fmt: skip
        return WorkItems(self._candidates(rng, units), units, pixels, WIDTH)

    @cached_property
    def frames(self) -> list[WorkItems]:
        """The same items with letters drawn anew, SETS times."""
        return [
            replace(self.work, candidates=self._candidates(np.random.default_rng(self.seed + 1 + k), self.work.units))
            for k in range(SETS)
        ]

    def _candidates(self, rng: np.random.Generator, units: Units) -> Candidates:
        """Letters as they come in scenes: V over some orders of magnitude, a third selected before, a tenth never traced."""
        n = len(units)

        def drawn(values: np.ndarray) -> np.ndarray:
            return values.astype(np.float32)

        visibility = drawn(10.0 ** rng.uniform(-6, -2, n))
        importance = drawn(rng.choice([0.8, 1.0, 1.5, 2.0], n))
        was_selected = rng.random(n) < 1 / 3
        persistence = 1e-4
        change = drawn(rng.exponential(0.05, n).clip(0, 1))
        change[rng.random(n) < 0.1] = np.nan
        since = np.where(was_selected, 1, rng.integers(2, 50, n)).astype(np.int32)
        ray_estimate = drawn(np.array(RAYS)[units.effect])
        return Candidates(
            effect_names=EFFECTS,
            object_id=units.object_id,
            effect=units.effect,
            pixel_count=units.count,
            mandatory=np.zeros(n, bool),
            predicted_cost=drawn(units.ms),
            ray_estimate=ray_estimate,
            area=drawn(units.count / units.count.sum()),
            center_closeness=drawn(rng.random(n)),
            distance=drawn(rng.uniform(0.5, 30, n)),
            visibility=visibility,
            cost=visibility * ray_estimate,
            importance_factor=importance,
            was_selected=was_selected,
            relevance=drawn((was_selected * persistence + visibility) * importance),
            persistence=persistence,
            predicted_rays=drawn(units.rays),
            predicted_ms_paper=drawn(units.ms * rng.uniform(0.5, 2, n)),
            predicted_ms_measured=drawn(units.ms),
            history_share=drawn(units.held / units.count),
            history_age=drawn(units.age_sum / np.maximum(units.held, 1)),
            seen_frames=rng.integers(1, 100, n).astype(np.int32),
            frames_since_traced=since,
            measured_change=change,
            measured_strength=change,
            measured_detail=change * np.float32(0.5),
            measured_drift=change * np.float32(0.1),
            measured_ms_per_pixel=drawn(units.ms / units.count),
        )


@dataclass(frozen=True)
class Deciding:
    """One heuristic with `count` candidates. milliseconds: of every frame, waves apart; waves_ms: of these, median;
    waves, traced: of the last frame."""

    heuristic: str
    count: int
    milliseconds: tuple[float, ...]
    waves_ms: float
    waves: int
    traced: int

    @property
    def median(self) -> float:
        return float(np.median(self.milliseconds))


def decide(heuristic: str, made: Made, repeats: int, threads: int = 2) -> Deciding:
    """Frames of one heuristic; as many again come first and are not counted."""
    largest = max(len(pixels) for pixels in made.work.pixels)
    effects: list[RayEffect] = [NoEffect(name, rays, largest) for name, rays in zip(EFFECTS, RAYS, strict=True)]
    chooser = get_registry().create("heuristic", heuristic)
    experience = Experience(int(made.work.units.object_id.max()), list(RAYS))
    clock = RayClock(NANOSECONDS_PER_RAY)
    scheduler = BudgetScheduler(CostModels(EFFECTS), experience, faults=Faults(strict=True), clock=clock)
    workers, watch = Workers(threads), Watch()
    watch.sees_the_pool(workers)
    frame = cast(Any, SimpleNamespace(workers=workers, view=SimpleNamespace(width=WIDTH), world=None))
    layers = LayerSet(
        {name: np.zeros((largest, 1), np.float32) for name in EFFECTS},
        {name: np.zeros(largest, np.uint8) for name in EFFECTS},
    )
    budget = float(made.work.units.ms.sum()) / 2
    spent, waves = [], []
    decisions: Decisions | None = None
    for index in range(2 * repeats):
        context = FrameContext(cast(Any, None), index, index / 30.0, budget, "ms", history=True)
        work = made.frames[index % SETS]
        watch.begin()
        decisions = scheduler.run(frame, effects, work, chooser, context, layers)
        watch.end()
        spent.append(watch.phase.scheduler_ms)
        waves.append(sum(watch.phase.waves_ms))
    workers.close()
    assert decisions is not None
    return Deciding(
        heuristic, made.count, tuple(spent[repeats:]), float(np.median(waves[repeats:])), decisions.waves,
        int(decisions.chosen.sum()),
    )  # fmt: skip


def measure(
    names: Sequence[str],
    counts: Sequence[int],
    repeats: int,
    *,
    threads: int = 2,
    progress: Callable[[str], None] = lambda text: None,
) -> list[Deciding]:
    """Every heuristic of `names` with every number of candidates."""
    found = []
    for count in counts:
        made = Made(count)
        for name in names:
            progress(f"row 9: {name}, {count:,} candidates")
            found.append(decide(name, made, repeats, threads))
    return found


def growth(found: Sequence[Deciding]) -> dict[str, float]:
    """By heuristic: time per n log n with the most candidates / that with LIMIT_COUNT. 1 is n log n, less is better."""
    per: dict[str, dict[int, float]] = {}
    for entry in found:
        per.setdefault(entry.heuristic, {})[entry.count] = entry.median / (entry.count * np.log2(entry.count))
    return {
        name: values[max(values)] / values[LIMIT_COUNT]
        for name, values in per.items()
        if LIMIT_COUNT in values and max(values) > LIMIT_COUNT and values[LIMIT_COUNT] > 0
    }


def selection_rows(found: Sequence[Deciding]) -> list[Row]:
    """Row 9: every heuristic at LIMIT_COUNT, and the growth of the one that grows most."""
    rows = [
        row(9, f"scheduler + {entry.heuristic}, {entry.count:,} candidates", "ms", entry.milliseconds, "<=", LIMIT_MS)
        for entry in found
        if entry.count == LIMIT_COUNT
    ]
    if grown := growth(found):
        worst = max(grown, key=lambda name: grown[name])
        rows.append(row(9, f"  growth to {max(COUNTS):,} / n log n: {worst}, the most", "", [grown[worst]], "<=", 1.5))
    return rows


def table(found: Sequence[Deciding]) -> Table:
    """Medians by heuristic and number of candidates."""
    counts = list(dict.fromkeys(entry.count for entry in found))
    grown = growth(found)
    made = Table(title="Scheduler and heuristic, ms (medians)", title_justify="left")
    made.add_column("heuristic")
    for count in counts:
        made.add_column(f"{count:,} items", justify="right")
    made.add_column("growth / n log n", justify="right")
    made.add_column(f"waves of {counts[-1]:,}, ms", justify="right")
    by_name: Mapping[str, list[Deciding]] = {
        name: [entry for entry in found if entry.heuristic == name]
        for name in dict.fromkeys(entry.heuristic for entry in found)
    }
    for name, entries in by_name.items():
        times = [f"{entry.median:.2f}" for entry in entries]
        grew = f"{grown[name]:.2f}" if name in grown else ""
        made.add_row(
            name, *times, grew, f"{entries[-1].waves} x {entries[-1].waves_ms / max(entries[-1].waves, 1):.1f}"
        )
    return made
