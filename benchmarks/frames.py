"""Rows 1 to 5: where the milliseconds of a frame go, on the reference scene.

Everything that is compared is timed in turns: for every repeat and every place on the camera path one all-trace frame,
its rays again through the bare tracer, one raster-only frame, and its surfaces again. A noisy moment then hits both
sides of a ratio. `docs/benchmarks.md` defines each figure.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from fallbacks import PLAIN
from rows import Row, row

from phrt import Renderer, Scene
from phrt.frame import FrameResult
from phrt.interfaces.tracer import Tracer
from phrt.kernels.surface import surface
from phrt.output.tonemap import to_8bit
from phrt.rays import HitBatch, RayBatch
from phrt.workers import Workers
from phrt_backends.gbuffers import raycast

Progress = Callable[[str], None]
SURFACE = "surface"
"""The kernels' names in the raycast producer's module, where a recording takes their place."""

Call = tuple[Callable[..., Any], tuple[Any, ...]]
"""A kernel and its arguments."""


@dataclass(frozen=True)
class Query:
    """One call of a tracer: which query, and a copy of its rays."""

    name: str
    rays: RayBatch

    def ask(self, tracer: Tracer) -> None:
        """Put it to `tracer`; the answer is dropped."""
        getattr(tracer, self.name)(self.rays)


class RecordingTracer(Tracer):
    """Passes queries on and keeps a copy of each. Only what a frame's ray phase asks for is implemented."""

    def __init__(self, tracer: Tracer) -> None:
        self.capabilities = tracer.capabilities
        self.queries: list[Query] = []
        self._tracer = tracer

    def build(self, world: object) -> None:
        raise NotImplementedError("a recording starts on a tracer that is built")

    def update(self, world: object, changes: object) -> None:
        self._tracer.update(world, changes)  # type: ignore[arg-type]

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        self._keep("closest_hit", rays)
        return self._tracer.closest_hit(rays)

    def occluded(self, rays: RayBatch) -> np.ndarray:
        self._keep("occluded", rays)
        return self._tracer.occluded(rays)

    def _keep(self, name: str, rays: RayBatch) -> None:
        copy = RayBatch(rays.origin.copy(), rays.direction.copy(), rays.t_max.copy(), rays.coherent)
        self.queries.append(Query(name, copy))


def record_queries(renderer: Renderer, at: float) -> list[Query]:
    """What the stage "rays" of the frame at `at` seconds asks of the tracer; primary rays are not among it."""
    run = renderer.run
    tracer, recorder = run.tracer, RecordingTracer(run.tracer)
    run.tracer = recorder
    try:
        renderer.render(at)
    finally:
        run.tracer = tracer
    return recorder.queries


def record_surfaces(renderer: Renderer, at: float) -> list[Call]:
    """The calls of the kernel `surface` by the producer in the frame at `at` seconds: its G-buffer's, where the heuristic is
    all_trace; fallbacks may take another view."""
    calls: list[Call] = []

    def keep(*arguments: Any) -> int:
        inputs = tuple(array.copy() for array in arguments[:4])
        calls.append((surface, inputs + arguments[4:]))
        return int(surface(*arguments))

    setattr(raycast, SURFACE, keep)
    try:
        renderer.render(at)
    finally:
        setattr(raycast, SURFACE, surface)
    return calls


def milliseconds(function: Callable[..., object], *arguments: object) -> float:
    """Wall-clock time of one call."""
    start = time.perf_counter()
    function(*arguments)
    return (time.perf_counter() - start) * 1e3


def trace_again(queries: Sequence[Query], tracer: Tracer, workers: Workers) -> None:
    """The bare tracer: recorded batches, one after the other, to whichever thread is free."""
    workers.map(lambda query: query.ask(tracer), queries)


def surfaces_again(calls: Sequence[Call], workers: Workers) -> None:
    """The recorded kernels again. No two of them write the same row, so their order does not matter."""

    def again(call: Call) -> None:
        kernel, arguments = call
        kernel(*arguments)

    workers.map(again, calls)


@dataclass
class Frames:
    """Samples of one kind of frame, in ms: whole (with 8 bit), to_8bit alone, and every stage.

    processor: processor time of the whole, divided by the threads: what other programs cannot lengthen by waiting.
    """

    whole: list[float] = field(default_factory=list)
    processor: list[float] = field(default_factory=list)
    tone: list[float] = field(default_factory=list)
    stages: dict[str, list[float]] = field(default_factory=dict)
    rays: list[dict[str, int]] = field(default_factory=list)

    def take(self, renderer: Renderer, at: float) -> None:
        """Render one more, and keep its times."""
        start, spent_before = time.perf_counter(), time.process_time()
        result: FrameResult = renderer.render(at)
        rendered = time.perf_counter()
        to_8bit(result.image, pool=renderer.workers)
        end, spent_after = time.perf_counter(), time.process_time()
        self.processor.append((spent_after - spent_before) * 1e3 / renderer.workers.threads)
        self.whole.append((end - start) * 1e3)
        self.tone.append((end - rendered) * 1e3)
        self.rays.append(result.rays)
        for stage, spent in result.stages.items():
            self.stages.setdefault(stage, []).append(spent)

    def medians(self) -> dict[str, float]:
        """Median by stage, "tone map, 8 bit" and "whole frame" at the end."""
        parts = {stage: float(np.median(values)) for stage, values in self.stages.items()}
        return parts | {"tone map, 8 bit": float(np.median(self.tone)), "whole frame": float(np.median(self.whole))}

    def ray_counts(self) -> dict[str, float]:
        """Median number of rays a frame by kind."""
        return {kind: float(np.median([counts[kind] for counts in self.rays])) for kind in self.rays[0]}


@dataclass
class FrameTimes:
    """Everything that rows 1 to 5 are made of. frames: by (G-buffer, heuristic). bare, surfaces: ms, sample by sample
    beside frames["raycast", "all_trace"] and ["raycast", "raster_only"]. queries, query_rays: of one frame, medians."""

    frames: dict[tuple[str, str], Frames]
    bare: list[float] = field(default_factory=list)
    surfaces: list[float] = field(default_factory=list)
    queries: float = 0.0
    query_rays: float = 0.0

    def rows(self) -> list[Row]:
        """Rows 1 to 5 of `docs/benchmarks.md`."""
        traced, plain = self.frames["raycast", "all_trace"], self.frames["raycast", "raster_only"]
        ratio = np.divide(self.bare, traced.stages["rays"])
        closing = np.add(traced.stages["composite"], traced.tone)
        surface = np.add(self.surfaces, plain.stages["direct"])
        return [
            row(1, "all-trace: bare tracer / ray phase", "", ratio, ">=", 0.75),
            row(2, "composite + tone map + 8 bit", "ms", closing, "<=", 4.0),
            row(3, "surface + direct light, 3 GGX lights", "ms", surface, "<=", 12.0),
            row(4, "raster-only frame", "ms", plain.whole, "<=", 28.0),
            row(4, "  its processor time / threads", "ms", plain.processor, "<=", None),
            row(5, "all-trace frame, hard shadows", "ms", traced.whole, "<=", 75.0),
            row(5, "  its processor time / threads", "ms", traced.processor, "<=", None),
        ]


@contextmanager
def renderers(
    scene: Scene, size: tuple[int, int], threads: int, gbuffers: Sequence[str]
) -> Iterator[dict[tuple[str, str], Renderer]]:
    """Renderers by (G-buffer, heuristic): all_trace and raster_only for every one of `gbuffers`."""
    made: dict[tuple[str, str], Renderer] = {}
    try:
        for gbuffer in gbuffers:
            for heuristic in ("all_trace", "raster_only"):
                made[gbuffer, heuristic] = Renderer(
                    scene,
                    size=size,
                    threads=threads,
                    gbuffer=gbuffer,
                    tracer="embree",
                    heuristic=heuristic,
                    effects=PLAIN,
                )
        yield made
    finally:
        for renderer in made.values():
            renderer.close()


def measure(
    scene: Scene,
    times: Sequence[float],
    repeats: int,
    *,
    size: tuple[int, int] = (640, 360),
    threads: int = 2,
    gbuffers: Sequence[str] = ("raycast",),
    progress: Progress = lambda text: None,
) -> FrameTimes:
    """`repeats` rounds over `times` (seconds), after a recording round that also compiles and warms up.

    gbuffers: "raycast" and any others, whose frames are rendered in the same rounds.
    """
    with renderers(scene, size, threads, gbuffers) as made:
        result = FrameTimes({key: Frames() for key in made})
        traced, plain = made["raycast", "all_trace"], made["raycast", "raster_only"]
        progress("compiling kernels, recording rays")
        for renderer in made.values():
            renderer.render(times[0])
        queries = {at: record_queries(traced, at) for at in times}
        surfaces = {at: record_surfaces(traced, at) for at in times}
        result.queries = float(np.median([len(found) for found in queries.values()]))
        result.query_rays = float(np.median([sum(len(q.rays) for q in found) for found in queries.values()]))
        trace_again(queries[times[0]], traced.tracer, traced.workers)
        for repeat in range(repeats):
            progress(f"frames: round {repeat + 1} of {repeats}")
            for at in times:
                for key, renderer in made.items():
                    result.frames[key].take(renderer, at)
                    if renderer is traced:
                        result.bare.append(milliseconds(trace_again, queries[at], renderer.tracer, renderer.workers))
                    if renderer is plain:
                        result.surfaces.append(milliseconds(surfaces_again, surfaces[at], renderer.workers))
    return result
