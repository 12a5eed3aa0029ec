"""Faults to inject: for every method and attribute of every kind of plugin what may go wrong in it, and what is to come of it.

A row of `FAULTS` is a sound plugin of which one member fails while `armed` is set. docs/faults.md has the same table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import typer
from scene_kit import GLASS, LAMBERT, MIRROR, Stage, at, ball, box, floor, quad

import phrt
from phrt.conventions import NO_PRIMITIVE
from phrt.faults.making import INTERFACES
from phrt.interfaces.effect import EffectResult, HistoryRule, LayerSpec, RayEffect
from phrt.interfaces.gbuffer import GBufferProducer
from phrt.interfaces.heuristic import Heuristic, Request
from phrt.interfaces.loader import Loader
from phrt.interfaces.metric import Column, Metric
from phrt.interfaces.tracer import Tracer, TracerCapabilities
from phrt.model import Image, Material, Model, Node, TextureRef, Track
from phrt.rays import HitBatch, RayBatch
from phrt.registry import get_registry
from phrt.registry.auto import choose_tracer
from phrt.registry.descriptors import Plugin
from phrt.registry.manager import KINDS
from phrt.scene import Scene
from phrt.workers import Workers
from phrt_backends.gbuffers.raycast import RaycastProducer
from phrt_backends.gbuffers.raycast_options import RaycastOptions

OWNER, VERSION = "phrt-broken", "0.3"
PACKAGE = f"{OWNER} {VERSION}"
NAME = "faulty"
SIZE = (48, 27)
armed: list[bool] = [False]
"""Whether faulty members fail now."""


# Sound plugins


class SoundEffect(RayEffect):
    """A layer of its own: 2 where traced, 7 where not."""

    name = NAME
    reads = ("depth",)
    writes = LayerSpec("faulty_layer", 1, 0.0, "for tests")
    history: HistoryRule | None = None

    def __init__(self, options: Any) -> None:
        return

    def applies_to(self, world: Any) -> np.ndarray:
        return np.ones(len(world.materials), bool)

    def rays_per_pixel(self, world: Any) -> float:
        return 1.0

    def trace(self, frame: Any, pixels: np.ndarray) -> EffectResult:
        count = len(pixels)
        up = np.tile(np.array([0, 1, 0], np.float32), (count, 1))
        rays = RayBatch(np.ascontiguousarray(frame.surfaces.position[pixels]), up, np.full(count, np.inf, np.float32))
        frame.tracer.closest_hit(rays)
        frame.tracer.occluded(rays)
        return EffectResult(np.full((count, 1), 2, np.float32), 2 * count)

    def fallback(self, frame: Any, pixels: np.ndarray) -> np.ndarray | None:
        return np.full((len(pixels), 1), 7, np.float32)


class SoundTracer(Tracer):
    """Another name for the one that is there."""

    capabilities = TracerCapabilities("sound", path_tracer="white")

    def __init__(self, options: Any) -> None:
        self.inner: Tracer = get_registry().create("tracer", choose_tracer().name)

    def build(self, world: Any) -> None:
        self.inner.build(world)

    def update(self, world: Any, changes: Any) -> None:
        self.inner.update(world, changes)

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        return self.inner.closest_hit(rays)

    def occluded(self, rays: RayBatch) -> np.ndarray:
        return self.inner.occluded(rays)

    def render_paths(self, world: Any, view: Any, *, samples: int, max_depth: int, seed: int = 0) -> np.ndarray:
        return np.ones((view.height, view.width, 3), np.float32)

    def close(self) -> None:
        self.inner.close()


class SoundProducer(GBufferProducer):
    """Eye rays through a tracer of its own."""

    def __init__(self, options: Any) -> None:
        self.tracer: Tracer = get_registry().create("tracer", choose_tracer().name)
        self.inner = RaycastProducer(RaycastOptions(), tracer=self.tracer, workers=Workers(1))

    def build(self, world: Any) -> None:
        self.tracer.build(world)
        self.inner.build(world)

    def update(self, world: Any, changes: Any) -> None:
        self.tracer.update(world, changes)

    def render(self, view: Any, **arguments: Any) -> Any:
        return self.inner.render(view, **arguments)

    def points(self, view: Any, pixels: np.ndarray, *, hidden: np.ndarray | None = None) -> Any:
        return self.inner.points(view, pixels, hidden=hidden)

    def close(self) -> None:
        self.tracer.close()


class SoundHeuristic(Heuristic):
    """Everything, in order."""

    def __init__(self, options: Any) -> None:
        self._left: list[int] = []

    def begin_frame(self, candidates: Any, context: Any) -> None:
        self._left = list(range(len(candidates)))

    def next(self, remaining: float) -> int | Request | None:
        return self._left.pop(0) if self._left else None


class SoundLoader(Loader):
    """A square, whatever the file says."""

    def __init__(self, options: Any) -> None:
        return

    def load(self, path: Path, context: Any) -> Model:
        pixels = np.full((2, 2, 4), 255, np.uint8)
        material = Material("white", base_color_texture=TextureRef(0))
        track = Track(1, "translation", np.array([0.0, 1.0]), np.zeros((2, 3)))
        nodes = [Node("root"), Node("square", 0, meshes=[0])]
        return Model(nodes, [quad()], [material], [Image("white", pixels)], tracks=[track])


class SoundMetric(Metric):
    """One number of every picture, one of every run."""

    columns = (  # type: ignore[assignment]
        Column("faulty_shot", "for tests", "", "lower"),
        Column("faulty_run", "for tests", "", "lower", scope="run"),
    )

    def __init__(self, options: Any) -> None:
        return

    def of_shot(self, shot: Any) -> dict[str, float]:
        return {"faulty_shot": 1.0}

    def of_run(self, frames: Any) -> dict[str, float]:
        return {"faulty_run": 1.0}


def sound_command(options: Any) -> Any:
    application = typer.Typer(rich_markup_mode=None)

    @application.command()
    def run() -> None:
        if armed[0]:
            raise RuntimeError("the cable came off")
        typer.echo("it runs")

    return application


SOUND: dict[str, Any] = {
    "effect": SoundEffect,
    "tracer": SoundTracer,
    "gbuffer": SoundProducer,
    "heuristic": SoundHeuristic,
    "loader": SoundLoader,
    "metric": SoundMetric,
    "command": sound_command,
}

ATTRIBUTES = {
    "name", "reads", "writes", "history", "switch", "capabilities", "few_are_cheap", "wants_change", "traces_everything", "columns",
    "scores",
}  # fmt: skip
"""Members that are looked at, not called."""


# Faults

Fault = Callable[[Callable[[], Any]], Any]
"""What happens in place of the sound call, which is given."""


def raises(sound: Callable[[], Any]) -> Any:
    raise RuntimeError("the cable came off")


def leaves(sound: Callable[[], Any]) -> Any:
    raise SystemExit(3)


def gives(value: Any) -> Fault:
    return lambda sound: value


def changed(change: Callable[[Any], Any]) -> Fault:
    """The sound answer, made wrong."""
    return lambda sound: change(sound())


def result(**changes: Callable[[EffectResult], Any]) -> Fault:
    """Of `trace`: the sound result with other fields."""
    return changed(lambda r: replace(r, **{name: make(r) for name, make in changes.items()}))


def hits(**changes: Callable[[HitBatch], Any]) -> Fault:
    """Of `closest_hit`: the sound hits with other arrays."""
    return changed(lambda h: replace(h, **{name: make(h) for name, make in changes.items()}))


def channel(name: str, make: Callable[[np.ndarray], np.ndarray | None]) -> Fault:
    """Of `render`: the sound G-buffer with another channel; without it where there is none."""

    def change(gbuffer: Any) -> Any:
        if name in gbuffer.arrays:
            made = make(gbuffer.arrays[name].copy())
            if made is None:
                del gbuffer.arrays[name]
            else:
                gbuffer.arrays[name] = made
        return gbuffer

    return changed(change)


def filled(array: np.ndarray, value: Any) -> np.ndarray:
    return np.full_like(array, value)


def mesh(**changes: Any) -> Fault:
    """Of `load`: the sound model with other arrays of its mesh."""
    return changed(lambda model: replace(model, meshes=[replace(model.meshes[0], **changes)]))


def forever(sound: Callable[[], Any]) -> Any:
    while True:
        sum(range(100))


# The table

OFF = "it is switched off, and its pixels take the fallback"
CLEAR = "it is switched off, and its pixels take the layer's clear value 0"
ASKED_NO_MORE = "it is switched off, and what it did not choose takes the fallbacks"
NO_RAYS = "no more rays are traced in this run, and all pixels take the fallbacks"
BUILT_ANEW = "it is built anew"
LEFT_OPEN = "what it held may not have been given back"
NO_PICTURE = ""


@dataclass(frozen=True)
class Row:
    """One fault.

    member : of the plugin, that fails; what: how, in words; fault: what it does
    says   : regular expression of the cause, as it is told
    at     : "start", when it is made; "frame", in frame 100; "restart", when a run begins anew; "close"; "load", "measure",
             "command", "paths": when it is used
    done   : what is done about it; empty where there is nothing to go on with
    options: of the renderer
    """

    kind: str
    member: str
    what: str
    fault: Fault
    says: str
    at: str = "start"
    done: str = NO_PICTURE
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def id(self) -> str:
        return f"{self.kind}.{self.member} {self.what}"


LOST = r"RuntimeError: the cable came off"
CUT = {"heuristic": "raster_only"}
ALPHA = {"heuristic": "raster_only", "effects": {"refractions": {"fallback": "alpha"}}}
COUNTED = {"budget": "100000rays"}


def rows() -> Iterator[Row]:
    yield from effect_rows()
    yield from heuristic_rows()
    yield from tracer_rows()
    yield from gbuffer_rows()
    yield from loader_rows()
    yield from metric_rows()
    yield Row("command", "command", "raises", raises, LOST, "command")


def effect_rows() -> Iterator[Row]:
    def start(member: str, what: str, fault: Fault, says: str) -> Row:
        return Row("effect", member, what, fault, says)

    yield start("name", "raises", raises, "RuntimeError")
    yield start("name", "is another name", gives("other"), "calls itself 'other'")
    yield start("reads", "raises", raises, LOST)
    yield start("reads", "names no channel", gives(("dept",)), r"given 'dept'; wanted channels.*Did you mean 'depth'")
    yield start("writes", "raises", raises, LOST)
    yield start("writes", "is no layer", gives("faulty_layer"), "wanted a LayerSpec")
    yield start("writes", "has -1 components", gives(LayerSpec("own", -1, 0.0, "")), "given -1; wanted components")
    yield start("writes", "clears to NaN", gives(LayerSpec("own", 1, np.nan, "")), "given nan; wanted a finite clear")
    yield start("writes", "takes a known layer for another", gives(LayerSpec("reflection", 1, 0.0, "")), "3 components")
    yield start("history", "raises", raises, LOST)
    yield start("history", "is no rule", gives("always"), "wanted a HistoryRule or None")
    rule = HistoryRule("any", lights=True)
    for name, value in {"movers": "few", "parallax": np.nan, "max_age": -1, "radius": np.inf}.items():
        nonsense = gives(replace(rule, **{name: value}))
        yield start("history", f"has {name} {value}", nonsense, f"given .*{value}.*; wanted {name}")
    yield start("switch", "raises", raises, LOST)
    yield start("switch", "is no text", gives(3), "given 3; wanted the name")
    yield start("applies_to", "raises", raises, f"cannot say where it applies: {LOST}")
    yield start("applies_to", "wrong shape", gives(np.ones(1, bool)), r"returned bool\(1,\), expected bool")
    yield start("applies_to", "wrong dtype", changed(lambda a: a.astype(np.uint8)), "returned uint8")
    yield start("rays_per_pixel", "raises", raises, f"cannot say how many rays it takes: {LOST}")
    for value in (np.nan, -1.0, np.inf):
        yield start("rays_per_pixel", f"gives {value}", gives(value), rf"returned {value:g}, expected a finite number")
    for what, fault, says in (
        ("raises", raises, rf"failed in trace\(\): {LOST}"),
        ("leaves the program", leaves, r"failed in trace\(\): SystemExit: 3"),
        ("gives nothing", gives(None), r"returned NoneType from trace\(\), expected an EffectResult"),
        ("wrong shape", result(values=lambda r: r.values[1:]), r"returned float32\(\d+, 1\) from trace\(\), expected float32"),
        ("wrong dtype", result(values=lambda r: r.values.astype(np.float64)), r"returned float64\("),
        ("NaN", result(values=lambda r: filled(r.values, np.nan)), r"returned \[nan\] at \d+ of \d+ pixels"),
        ("infinity", result(values=lambda r: filled(r.values, np.inf)), r"returned \[inf\] at"),
        ("wrong mask", result(traced=lambda r: np.ones(1, np.uint8)), r"returned traced as uint8\(1,\)"),
        ("negative cost", result(rays=lambda r: -5), r"returned -5 rays"),
        ("no number of rays", result(rays=lambda r: np.nan), r"returned nan rays"),
        ("more shared rays than rays", result(shared_rays=lambda r: r.rays + 1), r"of them shared"),
    ):  # fmt: skip
        yield Row("effect", "trace", what, fault, says, "frame", OFF)
    for what, fault, says in (
        ("raises", raises, rf"failed in fallback\(\): {LOST}"),
        ("wrong shape", changed(lambda v: v[:, 0]), r"returned float32\(\d+,\) from fallback\(\)"),
        ("wrong dtype", changed(lambda v: v.astype(np.int32)), r"returned int32"),
        ("NaN", changed(lambda v: filled(v, np.nan)), r"returned \[nan\] at"),
    ):
        yield Row("effect", "fallback", what, fault, says, "frame", CLEAR, CUT)
    everywhere = r"expected bool\(\d+,\)"
    yield Row("effect", "applies_at", "raises", raises, rf"failed in applies_at\(\): {LOST}", "frame", CLEAR, CUT)
    yield Row("effect", "applies_at", "wrong shape", gives(np.ones(1, bool)), everywhere, "frame", CLEAR, CUT)
    yield Row("effect", "applies_at", "wrong dtype", gives("all"), everywhere, "frame", CLEAR, CUT)
    yield Row("effect", "prepare_fallback", "raises", raises, r"failed in prepare_fallback\(\)", "frame", CLEAR, CUT)
    yield Row("effect", "begin_run", "raises", raises, r"failed in begin_run\(\)", "restart", CLEAR, CUT)


def heuristic_rows() -> Iterator[Row]:
    for member, what, fault, says in (
        ("begin_frame", "raises", raises, rf"failed in begin_frame\(\): {LOST}"),
        ("begin_frame", "leaves the program", leaves, r"failed in begin_frame\(\): SystemExit: 3"),
        ("next", "raises", raises, rf"failed in next\(\): {LOST}"),
        ("next", "hangs", forever, r"did not return from next\(\) within 0.1 seconds"),
        ("next", "gives no number", gives("first"), r"returned 'first' from next\(\): expected an item's number"),
        ("next", "gives NaN", gives(np.nan), r"returned nan from next\(\)"),
        ("next", "names an item that is not there", gives(10**6), "returned item 1000000: not one of"),
        ("next", "names an item for ever", gives(0), "returned item 0: not one of .*, or twice"),
        ("take", "raises", raises, rf"failed in take\(\): {LOST}"),
        (
            "take",
            "wrong shape",
            gives(np.zeros((2, 3), np.int32)),
            r"returned an array of shape \(2, 3\) from take\(\)",
        ),
        ("take", "wrong dtype", gives(np.zeros(2, np.float32)), r"returned array\(.*from take\(\)"),
        ("report", "raises", raises, rf"failed in report\(\): {LOST}"),
        ("end_frame", "raises", raises, rf"failed in end_frame\(\): {LOST}"),
        ("wants_change", "raises", raises, rf"failed in wants_change: {LOST}"),
        ("scores", "raises", raises, rf"failed in scores: {LOST}"),
    ):
        yield Row("heuristic", member, what, fault, says, "frame", ASKED_NO_MORE, COUNTED)
    history = {"history": True, "budget": "none"}
    says = f"failed in traces_everything: {LOST}"
    yield Row("heuristic", "traces_everything", "raises", raises, says, "frame", ASKED_NO_MORE, history)


def tracer_rows() -> Iterator[Row]:
    yield Row("tracer", "capabilities", "raises", raises, "RuntimeError")
    yield Row(
        "tracer", "capabilities", "are none", gives("fast"), "its `capabilities` are no TracerCapabilities but .fast"
    )
    yield Row("tracer", "build", "raises", raises, rf"failed in build\(\): {LOST}")
    yield Row("tracer", "update", "raises", raises, rf"failed in update\(\): {LOST}", "frame", BUILT_ANEW)
    yield Row("tracer", "close", "raises", raises, rf"failed in close\(\): {LOST}", "close", LEFT_OPEN)
    far = np.uint32(10**6)
    for what, fault, says in (
        ("raises", raises, rf"failed in closest_hit\(\): {LOST}"),
        ("leaves the program", leaves, r"failed in closest_hit\(\): SystemExit: 3"),
        ("gives nothing", gives(None), r"returned NoneType from closest_hit\(\), expected a HitBatch"),
        ("wrong shape", hits(distance=lambda h: h.distance[1:]), r"returned distance float32\(\d+,\)"),
        ("wrong dtype", hits(primitive=lambda h: h.primitive.astype(np.int64)), r"returned primitive int64\("),
        ("no barycentrics", hits(barycentric=lambda h: None), r"returned barycentric NoneType"),
        ("NaN", hits(distance=lambda h: filled(h.distance, np.nan)), r"returned \d+ of \d+ hits that cannot be"),
        ("triangles that are not there", hits(primitive=lambda h: filled(h.primitive, far)), "hits that cannot be"),
        ("hits at a negative distance", hits(
            distance=lambda h: filled(h.distance, -1), primitive=lambda h: filled(h.primitive, 0)), "that cannot be"),
        ("NaN as barycentrics", hits(
            distance=lambda h: filled(h.distance, 1), primitive=lambda h: filled(h.primitive, 0),
            barycentric=lambda h: filled(h.barycentric, np.nan)), "hits that cannot be"),
        ("misses that are near", hits(
            distance=lambda h: filled(h.distance, 1), primitive=lambda h: filled(h.primitive, NO_PRIMITIVE)), "cannot be"),
    ):  # fmt: skip
        yield Row("tracer", "closest_hit", what, fault, says, "frame", NO_RAYS)
    for what, fault, says in (
        ("raises", raises, rf"failed in occluded\(\): {LOST}"),
        ("gives nothing", gives(None), r"returned NoneType from occluded\(\), expected bool"),
        ("wrong shape", gives(np.ones(1, bool)), r"returned bool\(1,\) from occluded\(\)"),
        ("wrong dtype", changed(lambda b: b.astype(np.float32)), r"returned float32\("),
    ):
        yield Row("tracer", "occluded", what, fault, says, "frame", NO_RAYS)
    for what, fault, says in (
        ("raises", raises, rf"failed in render_paths\(\): {LOST}"),
        ("wrong shape", gives(np.ones((2, 2), np.float32)), r"returned float32\(2, 2\) from render_paths\(\)"),
        ("wrong dtype", changed(lambda p: p.astype(np.float16)), "returned float16"),
        ("NaN", changed(lambda p: filled(p, np.nan)), "with NaN or infinity in it"),
    ):
        yield Row("tracer", "render_paths", what, fault, says, "paths")


def gbuffer_rows() -> Iterator[Row]:
    yield Row("gbuffer", "few_are_cheap", "raises", raises, LOST)
    yield Row("gbuffer", "build", "raises", raises, rf"failed in build\(\): {LOST}")
    yield Row("gbuffer", "update", "raises", raises, rf"failed in update\(\): {LOST}", "frame", BUILT_ANEW)
    yield Row("gbuffer", "close", "raises", raises, rf"failed in close\(\): {LOST}", "close", LEFT_OPEN)
    for what, fault, says in (
        ("raises", raises, rf"failed in render\(\): {LOST}"),
        ("leaves the program", leaves, r"failed in render\(\): SystemExit: 3"),
        ("gives nothing", gives(None), r"returned NoneType from render\(\), expected a GBuffer"),
        ("a channel is missing", channel("depth", lambda a: None), "returned no channel 'depth'"),
        ("wrong shape", channel("depth", lambda a: a[1:]), r"returned channel 'depth' as float32\("),
        ("wrong size", changed(lambda g: replace(g, width=g.width + 1)), "returned a picture of 49x27 pixels"),
        ("wrong dtype", channel("object_id", lambda a: a.astype(np.int64)), "returned channel 'object_id' as int64"),
        ("NaN", channel("normal_world", lambda a: filled(a, np.nan)), "returned channel 'normal_world' with NaN"),
        ("NaN as depth", channel("depth", lambda a: filled(a, np.nan)), "returned channel 'depth' with NaN"),
        ("objects that are not there", channel("object_id", lambda a: filled(a, 99)), "returned object_id 99"),
        ("materials that are not there", channel("material_id", lambda a: filled(a, 99)), "returned material_id 99"),
        (
            "triangles that are not there",
            channel("primitive_id", lambda a: filled(a, 10**6)),
            "returned primitive_id 1000000",
        ),
    ):
        yield Row("gbuffer", "render", what, fault, says, "frame", NO_PICTURE)
    without = "effect 'refractions' is switched off, and its pixels take the layer's clear value 0"
    for what, fault, says in (
        ("raises", raises, rf"failed in points\(\): {LOST}"),
        ("gives nothing", gives(None), r"returned NoneType from points\(\)"),
        ("wrong shape", changed(lambda s: s._replace(depth=s.depth[1:])), r"returned depth as float32\("),
        ("wrong dtype", changed(lambda s: s._replace(uv=s.uv.astype(np.float64))), r"returned uv as float64"),
        ("materials that are not there", changed(
            lambda s: s._replace(material_id=filled(s.material_id, 99))), "returned material_id 99"),
    ):  # fmt: skip
        yield Row("gbuffer", "points", what, fault, says, "frame", without, ALPHA)


def loader_rows() -> Iterator[Row]:
    sound = quad()
    nowhere = np.array([[0, 1, 9], [0, 2, 3]], np.int32)
    for what, fault, says in (
        ("raises", raises, rf"failed in load\(\): {LOST}"),
        ("leaves the program", leaves, r"failed in load\(\): SystemExit: 3"),
        ("gives nothing", gives(None), r"returned NoneType from load\(\), expected a phrt.model.Model"),
        ("a mesh that is none", changed(lambda m: replace(m, meshes=["square"])), r"returned meshes\[0\] as str"),
        ("wrong shape", mesh(positions=sound.positions[:, :2]), r"positions as float32\(4, 2\)"),
        ("wrong dtype", mesh(positions=sound.positions.astype(np.float64)), r"positions as float64\(4, 3\)"),
        ("NaN", mesh(positions=filled(sound.positions, np.nan)), "positions with NaN or infinity in it"),
        ("too few normals", mesh(normals=np.zeros((1, 3), np.float32)), r"normals as float32\(1, 3\)"),
        ("vertices that are not there", mesh(triangles=nowhere), r"triangles with 9 in it.*expected 0 to 3"),
        ("materials that are not there", mesh(triangle_material=np.full(2, 5, np.int32)), "triangle_material with 5"),
        ("an image that is none", changed(lambda m: replace(m, images=[Image("x", np.zeros((2, 2), np.uint8))])), "pixels as"),
        ("images that are not there", changed(
            lambda m: replace(m, materials=[Material("x", base_color_texture=TextureRef(7))])), "image 7"),
        ("NaN in a material", changed(lambda m: replace(m, materials=[Material("x", roughness=np.nan)])), "roughness nan"),
        ("a parent that comes later", changed(lambda m: replace(m, nodes=[Node("x", 4)])), "parent 4"),
        ("meshes that are not there", changed(lambda m: replace(m, nodes=[Node("x", meshes=[3])], tracks=[])), "mesh 3"),
        ("a matrix that is none", changed(
            lambda m: replace(m, nodes=[Node("x", matrix=np.eye(3))], tracks=[])), r"matrix of shape \(3, 3\)"),
        ("times that go back", changed(
            lambda m: replace(m, tracks=[replace(m.tracks[0], times=np.array([1.0, 0.0]))])), "times that go back"),
        ("values that are too few", changed(
            lambda m: replace(m, tracks=[replace(m.tracks[0], values=np.zeros((1, 3)))])), r"values of shape \(1, 3\)"),
    ):  # fmt: skip
        yield Row("loader", "load", what, fault, says, "load")


def metric_rows() -> Iterator[Row]:
    yield Row("metric", "name", "cannot be set", raises, "cannot be named: the cable came off")
    yield Row("metric", "columns", "raises", raises, rf"failed in columns: {LOST}")
    yield Row("metric", "columns", "are none", gives(("flip",)), "its column 'flip' is no")
    yield Row(
        "metric", "columns", "duplicate a name", gives((Column("flip", "", "", "lower"),)), "column 'flip' is there"
    )
    for member in ("of_shot", "of_run"):
        for what, fault, says in (
            ("raises", raises, LOST),
            ("leaves the program", leaves, "SystemExit: 3"),
            ("gives nothing", gives(None), "it returned NoneType, no mapping"),
            ("another column", gives({"other": 1.0}), "it returned the column 'other'"),
            ("no number", changed(lambda m: dict.fromkeys(m, "1")), "is '1', no number"),
            ("infinity", changed(lambda m: dict.fromkeys(m, np.inf)), "is infinite"),
        ):
            yield Row("metric", member, what, fault, says, "measure", "is left out")


FAULTS = list(rows())


# Using it


def members(kind: str) -> set[str]:
    """Methods and attributes of an interface that a plugin of that kind has or may override."""
    interface = INTERFACES[kind]
    named = {*vars(interface), *getattr(interface, "__annotations__", {})}
    return {name for name in named if not name.startswith("_")}


def faulty(row: Row) -> Any:
    """A plugin's class (a command's function) that is sound, but for one member while `armed`."""
    base = SOUND[row.kind]
    if row.kind == "command":
        return base
    member = row.member

    def attribute(self: Any) -> Any:
        def sound() -> Any:
            value = getattr(super(made, self), member)
            return value

        return row.fault(sound) if armed[0] else sound()

    def method(self: Any, *given: Any, **named: Any) -> Any:
        def sound() -> Any:
            return getattr(super(made, self), member)(*given, **named)

        return row.fault(sound) if armed[0] else sound()

    def rename(self: Any, value: Any) -> None:
        if armed[0]:
            row.fault(lambda: None)

    failing = property(attribute, rename) if member in ATTRIBUTES else method
    made: Any = type(base)("Faulty", (base,), {member: failing})
    return made


current: dict[str, Any] = {}
"""What the factories make now, by name."""


class Factories:
    """`fault_kit:factories.NAME` is whatever `current` says."""

    def __getattr__(self, name: str) -> Any:
        if name not in current:
            raise AttributeError(name)
        return current[name]


factories = Factories()


def descriptor(kind: str, name: str = NAME, **more: Any) -> Plugin:
    """That of a plugin whose factory is in `current`."""
    if kind == "loader":
        more.setdefault("suffixes", (".faulty",))
    return KINDS[kind](name, "for tests", f"{__name__}:factories.{name}", **more)


@contextmanager
def registered(row: Row, name: str = NAME, **more: Any) -> Iterator[None]:
    """The faulty plugin is there, as if a package had brought it, and is sound until `armed` is set."""
    current[name] = faulty(row)
    registry = get_registry()
    registry.register(descriptor(row.kind, name, **more), owner=OWNER, version=VERSION)
    try:
        yield
    finally:
        armed[0] = False
        registry._forget(OWNER)
        del current[name]


@contextmanager
def own_producer() -> Iterator[str]:
    """A producer that does not need the tracer under test; its name."""
    registry, name = get_registry(), "sound_producer"
    current[name] = SoundProducer
    registry.register(descriptor("gbuffer", name), owner="own_producer")
    try:
        yield name
    finally:
        registry._forget("own_producer")
        del current[name]


def thing() -> Scene:
    """A floor, a mirror, glass and a box under a lamp."""
    made = Stage(dome=(0.3, 0.4, 0.6)).add("/floor", floor(), LAMBERT, at(0, -0.5, 0))
    made.add("/ball", ball(0.4, 2), MIRROR, at(-0.9, 0, 0)).add("/glass", ball(0.4, 2), GLASS, at(0, 0, 0.2))
    made.add("/box", box(0.6, 0.6, 0.6), LAMBERT, at(0.9, 0, 0)).light("point", at(1, 3, 2), intensity=40.0)
    return made.camera((0, 0.8, 3), (0, 0, 0), fov_y=0.8).scene


SCENE = thing()


def renderer(row: Row | None = None, **options: Any) -> phrt.Renderer:
    """One that uses the faulty plugin of `row`, which is registered."""
    chosen: dict[str, Any] = {
        "size": SIZE, "threads": 2, "gbuffer": "raycast", "heuristic": "all_trace", "history": False, "remember_costs": False,
        "effects": {},
    }  # fmt: skip
    if row is not None:
        chosen |= row.options
        own = {"effect": "effects", "heuristic": "heuristic", "tracer": "tracer", "gbuffer": "gbuffer"}[row.kind]
        chosen[own] = chosen["effects"] | {NAME: {}} if own == "effects" else NAME
    return phrt.Renderer(SCENE, **(chosen | options))


def step(made: phrt.Renderer, number: int) -> Any:
    """Frame `number`, in which the box is somewhere else than before."""
    made.move("/box", at(0.9, 0, 0.01 * number))
    return made.render(0.0, frame_index=number)


def descriptor_fields() -> set[str]:
    """The fields of all descriptors."""
    return {each.name for kind in KINDS.values() for each in fields(kind)}


# The table of docs/faults.md


def happens(row: Row) -> str:
    """What comes of a fault, in words."""
    if row.member == "points":
        return "effects that need it are switched off, and their pixels take the layer's clear value"
    if row.kind == "tracer" and row.done == NO_RAYS:
        return f"{NO_RAYS}; an error where the G-buffer is made of its rays and they fail"
    return {
        "start": "an error when it is asked for",
        "frame": row.done.replace("clear value 0", "clear value")
        or "an error: there is no picture; finished frames stay",
        "restart": row.done.replace("clear value 0", "clear value"),
        "close": row.done,
        "load": "an error that names the file",
        "measure": "its columns are left out",
        "command": "an error; the other commands are there",
        "paths": "an error",
    }[row.at]


def table() -> str:
    """All faults in Markdown: a line a member and what comes of it."""
    lines = ["| plugin | what fails | how | what happens |", "| --- | --- | --- | --- |"]
    found: dict[tuple[str, str, str], list[str]] = {}
    for row in FAULTS:
        found.setdefault((row.kind, row.member, happens(row)), []).append(row.what)
    for (kind, member, text), ways in found.items():
        call = member if member in ATTRIBUTES or kind == "command" else f"{member}()"
        lines.append(f"| {kind} | `{call}` | {'; '.join(ways)} | {text} |")
    return "\n".join(lines) + "\n"
