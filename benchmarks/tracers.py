"""Bare tracer rates: M rays/s of the `embree` tracer, of embreex's own `run` and of Open3D, on the same rays.

    PHRT_ASSETS=/path/to/scenes .venv/bin/python benchmarks/tracers.py
    PYTHONPATH=plugins/phrt-mitsuba ... benchmarks/tracers.py --plugin phrt_mitsuba.plugin --tracer mitsuba

Three kinds of rays, 640x360 each: primary (4x4 tiles), shadow (from the primary hits to a point light), random (closest
hits). Two sizes: Sponza and Armadillo, and the same with Sponza's triangles split in sixteen. Contenders take turns
within every repeat, so that a noisy moment hits them all; figures are medians over the repeats, the ratio is the
median of the ratios within a repeat. The bar: the `embree` tracer is at least 1.8 times as fast as `run` on two threads,
primary and shadow rays.

Tracers of other packages take part by name (--tracer). They get every batch in one call and bring their own threads, so
they are only measured where all threads are used; their ratios, too, are taken within a repeat. On a busy machine look at
the rates in brackets: rays a second of processor time, whose sum over two free cores is what two threads come to at best.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from rich.console import Console
from rich.table import Table

from phrt.rays import RayBatch
from phrt.registry import get_registry
from phrt.registry.local import register_source
from phrt.workers import usable_cores
from phrt_backends.availability import embree_reason, open3d_reason
from phrt_backends.options import EmbreeOptions, Open3dOptions
from phrt_backends.tracers.embree import EmbreeTracer

WIDTH, HEIGHT = 640, 360
CHUNK = 8192
"""Rays of one call on a thread of the pool."""

BAR = 1.8
"""Row 13 of `docs/benchmarks.md`: embree tracer / embreex `run`, two threads, primary and shadow rays."""

EYE, LOOK_AT, LIGHT = (-9.0, 3.0, 0.5), (0.0, 2.0, 0.0), (1.0, 9.0, 0.5)
KINDS = ("primary", "shadow", "random")


@dataclass(frozen=True)
class Geometry:
    """What tracers read of a `World`: objects that own contiguous vertices and triangles; row 0 is the background."""

    name: str
    positions: np.ndarray
    triangles: np.ndarray
    triangle_object: np.ndarray
    first_vertex: np.ndarray
    vertex_count: np.ndarray
    first_triangle: np.ndarray
    triangle_count: np.ndarray
    object_casts_shadow: np.ndarray
    object_opaque: np.ndarray
    moving_objects: tuple[int, ...] = ()

    @classmethod
    def from_meshes(cls, name: str, meshes: list[trimesh.Trimesh]) -> Geometry:
        """One object a mesh, in world space."""
        vertices = np.array([0, *(len(mesh.vertices) for mesh in meshes)], np.int32)
        triangles = np.array([0, *(len(mesh.faces) for mesh in meshes)], np.int32)
        first_vertex = np.cumsum(vertices, dtype=np.int32) - vertices
        shifted = [mesh.faces + first for mesh, first in zip(meshes, first_vertex[1:], strict=True)]
        return cls(
            name=name,
            positions=np.concatenate([mesh.vertices for mesh in meshes]).astype(np.float32),
            triangles=np.concatenate(shifted).astype(np.int32),
            triangle_object=np.repeat(np.arange(len(triangles)), triangles).astype(np.int32),
            first_vertex=first_vertex,
            vertex_count=vertices,
            first_triangle=np.cumsum(triangles, dtype=np.int32) - triangles,
            triangle_count=triangles,
            object_casts_shadow=np.arange(len(triangles)) > 0,
            object_opaque=np.ones(len(triangles), bool),
        )


@dataclass(frozen=True)
class RateRow:
    """Rates of one kind of rays. mega_rays: M rays/s by contender; ratio and its bar: embree tracer / embreex `run`;
    ratios: of every repeat; guests: median ratios of other packages' tracers, by "guest / contender".
    busy_rays: M rays a second of processor time, all threads together, which other programs hardly change."""

    scene: str
    triangles: int
    kind: str
    threads: int
    mega_rays: dict[str, float]
    ratio: float
    bar: float | None
    ratios: tuple[float, ...]
    guests: dict[str, float] = field(default_factory=dict)
    busy_rays: dict[str, float] = field(default_factory=dict)


def reference_geometries(assets: Path) -> Iterator[Geometry]:
    """Sponza and Armadillo, as they are and with Sponza split in sixteen; made one after the other."""
    scene = trimesh.load_scene(assets / "sponza" / "sponza_textured.glb", process=False)
    sponza = []
    for node in scene.graph.nodes_geometry:
        matrix, mesh = scene.graph[node]
        placed = scene.geometry[mesh].copy()
        sponza.append(trimesh.Trimesh(placed.vertices, placed.faces, process=False).apply_transform(matrix))
    armadillo = trimesh.load_mesh(assets / "armadillo" / "armadillo_100k.obj", process=False)
    armadillo.apply_translation([-armadillo.centroid[0], -armadillo.bounds[0, 1], -armadillo.centroid[2]])
    armadillo.apply_scale(3.0 / armadillo.extents[1]).apply_translation([0, -0.9, 0])
    yield Geometry.from_meshes("Sponza + Armadillo", [*sponza, armadillo])
    split = [mesh.subdivide().subdivide() for mesh in sponza]
    yield Geometry.from_meshes("the same, Sponza split in 16", [*split, armadillo])


def camera_rays() -> RayBatch:
    """Primary rays, 60 degrees wide, pixels in 4x4 tiles."""
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    tiles = [a.reshape(HEIGHT // 4, 4, WIDTH // 4, 4).transpose(0, 2, 1, 3).ravel() for a in (rows, columns)]
    forward = normalized(np.subtract(LOOK_AT, EYE))
    right = normalized(np.cross(forward, [0.0, 1.0, 0.0]))
    up = np.cross(right, forward)
    pixel = 2.0 * np.tan(np.radians(30.0)) / WIDTH
    x, y = (tiles[1] + 0.5 - WIDTH / 2) * pixel, (HEIGHT / 2 - tiles[0] - 0.5) * pixel
    direction = normalized(forward + x[:, None] * right + y[:, None] * up).astype(np.float32)
    origin = np.tile(np.array(EYE, np.float32), (len(direction), 1))
    return RayBatch(origin, direction, np.full(len(direction), np.inf, np.float32), coherent=True)


def shadow_rays(primary: RayBatch, distance: np.ndarray) -> RayBatch:
    """From a little before every primary hit to the light; distance (n,) of the hits, misses left out."""
    hit = np.isfinite(distance)
    origin = primary.origin[hit] + primary.direction[hit] * (distance[hit, None] * 0.999)
    to_light = np.array(LIGHT, np.float32) - origin
    length = np.linalg.norm(to_light, axis=1, keepdims=True)
    direction, t_max = (to_light / length).astype(np.float32), length[:, 0].astype(np.float32)
    return RayBatch(origin.astype(np.float32), direction, t_max, coherent=True)


def random_rays(geometry: Geometry) -> RayBatch:
    """Origins anywhere in the bounds, directions anywhere."""
    random, count = np.random.default_rng(0), WIDTH * HEIGHT
    origin = random.uniform(geometry.positions.min(axis=0), geometry.positions.max(axis=0), (count, 3))
    direction = normalized(random.normal(size=(count, 3)))
    return RayBatch(origin.astype(np.float32), direction.astype(np.float32), np.full(count, np.inf, np.float32))


def normalized(vectors: np.ndarray) -> np.ndarray:
    """`vectors` (..., 3) at unit length."""
    unit: np.ndarray = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


class BareEmbreex:
    """embreex's `run` and nothing around it but the copy of t_max that it would overwrite."""

    def __init__(self, geometry: Geometry) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene = EmbreeScene()
        TriangleMesh(self._scene, geometry.positions, geometry.triangles)

    def closest_hit(self, rays: RayBatch) -> Any:
        return self._scene.run(rays.origin, rays.direction, rays.t_max.copy(), output=True)

    def occluded(self, rays: RayBatch) -> Any:
        return self._scene.run(rays.origin, rays.direction, rays.t_max.copy(), query="OCCLUDED")


def chunks(rays: RayBatch) -> list[RayBatch]:
    """The batch in pieces of CHUNK rays."""
    parts = (slice(first, first + CHUNK) for first in range(0, len(rays), CHUNK))
    return [RayBatch(rays.origin[s], rays.direction[s], rays.t_max[s], rays.coherent) for s in parts]


@contextmanager
def contenders(
    geometry: Geometry, threads: int, guests: Sequence[str] = ()
) -> Iterator[dict[str, Callable[[str, RayBatch], Any]]]:
    """Functions (query, rays) by contender's name. Open3D and guests run their own threads, the others get a pool's."""
    tracers: dict[str, Any] = {"embree": EmbreeTracer(EmbreeOptions()), "embreex run": BareEmbreex(geometry)}
    tracers["embree"].build(geometry)
    whole = list(guests)
    for name in guests:
        tracers[name] = get_registry().create("tracer", name)
        tracers[name].build(geometry)
    if open3d_reason() is None:
        from phrt_backends.tracers.open3d_scene import Open3dTracer

        tracers["open3d"] = Open3dTracer(Open3dOptions(threads=threads))
        tracers["open3d"].build(geometry)
        whole.append("open3d")
    with ThreadPoolExecutor(threads) as pool:

        def pooled(name: str) -> Callable[[str, RayBatch], Any]:
            return lambda query, rays: list(pool.map(getattr(tracers[name], query), chunks(rays)))

        def at_once(name: str) -> Callable[[str, RayBatch], Any]:
            return lambda query, rays: getattr(tracers[name], query)(rays)

        yield {name: at_once(name) if name in whole else pooled(name) for name in tracers}
    for name in ("embree", *guests):
        tracers[name].close()


def measure(geometry: Geometry, threads: int, repeats: int = 15, guests: Sequence[str] = ()) -> list[RateRow]:
    """Rates of every kind of rays on `threads` threads. guests: registered tracers, measured with all cores only."""
    rows = []
    guests = guests if threads == usable_cores() else ()
    with contenders(geometry, threads, guests) as run:
        primary = camera_rays()
        distance = np.concatenate([hits.distance for hits in run["embree"]("closest_hit", primary)])
        batches = {
            "primary": ("closest_hit", primary),
            "shadow": ("occluded", shadow_rays(primary, distance)),
            "random": ("closest_hit", random_rays(geometry)),
        }
        for kind, (query, rays) in batches.items():
            seconds, busy = interleaved(run, query, rays, repeats)
            rates, busy_rates = (
                {name: len(rays) / float(np.median(times)) / 1e6 for name, times in each.items()}
                for each in (seconds, busy)
            )
            ratios = tuple(np.divide(seconds["embreex run"], seconds["embree"]).tolist())
            ratio = float(np.median(ratios))
            bar = BAR if threads == 2 and kind != "random" else None
            against = {
                f"{guest} / {name}": float(np.median(np.divide(seconds[name], seconds[guest])))
                for guest in guests
                for name in seconds
                if name not in guests
            }
            row = (
                geometry.name,
                len(geometry.triangles),
                kind,
                threads,
                rates,
                ratio,
                bar,
                ratios,
                against,
                busy_rates,
            )
            rows.append(RateRow(*row))
    return rows


def interleaved(
    run: dict[str, Callable[[str, RayBatch], Any]], query: str, rays: RayBatch, repeats: int
) -> tuple[dict[str, list[float]], dict[str, list[float]]]:
    """Seconds of every repeat by contender, and those of processor time; the first round is not counted."""
    seconds: dict[str, list[float]] = {name: [] for name in run}
    busy: dict[str, list[float]] = {name: [] for name in run}
    for repeat in range(repeats + 1):
        for name, ask in run.items():
            start, busy_start = time.perf_counter(), time.process_time()
            ask(query, rays)
            if repeat:
                seconds[name].append(time.perf_counter() - start)
                busy[name].append(time.process_time() - busy_start)
    return seconds, busy


def measure_all(assets: Path, repeats: int = 15, guests: Sequence[str] = ()) -> list[RateRow]:
    """Rows for both geometries on one and on two threads."""
    rows: list[RateRow] = []
    for geometry in reference_geometries(assets):
        for threads in (1, 2):
            rows += measure(geometry, threads, repeats, guests)
    return rows


def table(rows: list[RateRow]) -> Table:
    """The rows, for `rich`."""
    names = list(dict.fromkeys(name for row in rows for name in row.mega_rays))
    guests = list(dict.fromkeys(name for row in rows for name in row.guests))
    made = Table(title="Bare tracers, M rays/s (medians; in brackets a second of processor time)", title_justify="left")
    for heading in ("scene", "triangles", "rays", "threads", *names, "embree / run", "bar", *guests):
        made.add_column(heading, justify="left" if heading in ("scene", "rays") else "right")
    for row in rows:
        rates = [rate_text(row, name) for name in names]
        against = [f"{row.guests[name]:.2f}" if name in row.guests else "" for name in guests]
        bar = "" if row.bar is None else f">= {row.bar} {'met' if row.ratio >= row.bar else 'MISSED'}"
        start = (row.scene, f"{row.triangles:,}", row.kind, str(row.threads))
        made.add_row(*start, *rates, f"{row.ratio:.2f}", bar, *against)
    return made


def rate_text(row: RateRow, name: str) -> str:
    """ "24.6 (12.9)", or nothing for who did not take part."""
    if name not in row.mega_rays:
        return ""
    return f"{row.mega_rays[name]:.1f}" + (f" ({row.busy_rays[name]:.1f})" if name in row.busy_rays else "")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=15, help="timed rounds of every kind of rays (default 15)")
    parser.add_argument(
        "--assets", type=Path, default=os.environ.get("PHRT_ASSETS"), help="the real scenes (default PHRT_ASSETS)"
    )
    parser.add_argument("--plugin", action="append", default=[], help="a module or file with further tracers")
    parser.add_argument("--tracer", action="append", default=[], help="a registered tracer that takes part")
    arguments = parser.parse_args()
    if arguments.assets is None:
        parser.error("name the folder of real scenes: --assets or PHRT_ASSETS")
    if reason := embree_reason():
        parser.error(reason)
    for source in arguments.plugin:
        register_source(source)
    console = Console()
    with console.status("measuring"):
        rows = measure_all(Path(arguments.assets), arguments.repeats, arguments.tracer)
    console.print(table(rows))


if __name__ == "__main__":
    main()
