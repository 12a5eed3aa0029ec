"""The `mitsuba` tracer: Mitsuba 3's ray tracing, numpy arrays in and out.

On the processor (device `llvm`) Dr.Jit, Mitsuba's compiler, makes one kernel of a query: it reads the rays as they lie in
numpy, calls Embree in packets as wide as the processor's vectors, and writes the answer; its own threads share a batch. On
an NVIDIA GPU (device `cuda`) OptiX traces, and rays and hits are copied there and back.

Threads: Dr.Jit locks its own state, but documents no more than that (github.com/mitsuba-renderer/drjit, pull request 290),
and threads that hold its lock and the GIL have met before (issue 524). So a lock of the process lets one query in at a time;
it has all of Dr.Jit's threads, and the GIL is free while rays are traced. Measured with chunks of 8192 rays from two threads,
this is faster than queries side by side, whose threads wait for each other. A call costs 0.03 to 0.06 ms before its first
ray: batches of a few thousand rays are large enough.

Rays that Mitsuba spawns itself start a little off surfaces; a `Ray3f` is taken as it is, and hits are exact.

Options: `phrt_mitsuba.options.MitsubaOptions`. Source: Jakob et al. 2022, "Dr.Jit: A Just-In-Time Compiler for
Differentiable Rendering", and https://mitsuba-renderer.org.
Example: phrt render SCENE -o OUT --tracer mitsuba
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np

from phrt.conventions import NO_PRIMITIVE
from phrt.errors import PhrtError
from phrt.interfaces.tracer import Tracer, TracerCapabilities
from phrt.rays import HitBatch, RayBatch
from phrt_mitsuba.availability import choose_variant, load_mitsuba
from phrt_mitsuba.geometry import Layer, make_layer
from phrt_mitsuba.options import MitsubaOptions
from phrt_mitsuba.paths import PathTracer

if TYPE_CHECKING:
    from phrt.camera import CameraView
    from phrt.world import Changes, World

JIT = threading.RLock()
"""Held by whatever has Dr.Jit compute something in this process."""

# Embree counts a hit at exactly the ray's end, the Tracer contract does not: the end is one step below t_max.
_JUST_BELOW = 1.0 - 2.0**-23


class MitsubaTracer(Tracer):
    """Raises PluginError where no variant of Mitsuba runs on this machine."""

    def __init__(self, options: MitsubaOptions) -> None:
        self.options = options
        variant = choose_variant(options.device)
        package = load_mitsuba(options.device)
        import drjit

        self._dr: Any = drjit
        self._mi: Any = getattr(package, variant)
        if options.threads:
            drjit.set_thread_count(options.threads)
        self.capabilities = TracerCapabilities(
            description(package.__version__, variant, drjit), path_tracer=f"Mitsuba {package.__version__}, {variant}"
        )
        self._paths = PathTracer(variant)
        self._built = False
        self._movers: set[int] = set()
        self._still: Layer | None = None
        self._moving: Layer | None = None

    def build(self, world: World) -> None:
        self._movers = set(world.moving_objects)
        self._build_still(world)
        self._build_moving(world)
        self._built = True

    def update(self, world: World, changes: Changes) -> None:
        moved = {object_id for object_id in changes.objects if world.triangle_count[object_id]}
        if not moved:
            return
        if moved - self._movers:
            self._movers |= moved
            self._build_still(world)
        self._build_moving(world)

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        layers = self._layers()
        count = len(rays)
        if not (count and layers):
            return HitBatch(
                np.full(count, np.inf, np.float32), np.full(count, NO_PRIMITIVE), np.zeros((count, 2), np.float32)
            )
        with JIT:
            distance, primitive, barycentric = self._nearest(layers, rays)
            self._dr.eval(distance, primitive, barycentric)  # one kernel for the three
            return HitBatch(plain(distance), plain(primitive), plain(barycentric).reshape(count, 2))

    def occluded(self, rays: RayBatch) -> np.ndarray:
        casters = [layer.casters for layer in self._layers() if layer.casters is not None]
        if not (len(rays) and casters):
            return np.zeros(len(rays), bool)
        with JIT:
            ray, usable = self._ray(rays)
            blocked = self._mi.Bool(False)
            coherent = self._mi.Bool(rays.coherent)
            for scene in casters:
                # Rays that are switched off may come back as blocked.
                blocked |= usable & scene.ray_test(ray, coherent, usable & ~blocked)
            return plain(blocked)

    def render_paths(
        self, world: World, view: CameraView, *, samples: int, max_depth: int, seed: int = 0
    ) -> np.ndarray:
        with JIT:
            return self._paths.render(world, view, samples=samples, max_depth=max_depth, seed=seed)

    def close(self) -> None:
        self._still = self._moving = None
        self._paths.close()
        self._built = False

    def _layers(self) -> list[Layer]:
        if not self._built:
            raise PhrtError("the tracer has no scene: call build first, and nothing after close")
        return [layer for layer in (self._still, self._moving) if layer is not None]

    def _build_still(self, world: World) -> None:
        still = np.setdiff1d(np.arange(1, len(world.triangle_count)), list(self._movers))
        with JIT:
            self._still = make_layer(self._mi, world, still, self.options.robust)

    def _build_moving(self, world: World) -> None:
        with JIT:
            self._moving = make_layer(self._mi, world, np.array(sorted(self._movers), int), self.options.robust)

    def _ray(self, rays: RayBatch) -> tuple[Any, Any]:
        """The batch as a `Ray3f`, and which of it can hit: finite origin, a finite direction, a t_max above 0."""
        mi, dr = self._mi, self._dr
        origin = dr.unravel(mi.Point3f, mi.Float(flat(rays.origin)))
        direction = dr.unravel(mi.Vector3f, mi.Float(flat(rays.direction)))
        t_max = mi.Float(flat(rays.t_max))
        length = dr.squared_norm(direction)
        usable = dr.isfinite(dr.sum(origin)) & dr.isfinite(length) & (length > 0.0) & (t_max > 0.0)
        ray = mi.Ray3f(origin, direction)
        ray.maxt = dr.minimum(t_max * _JUST_BELOW, dr.largest(mi.Float))  # OptiX knows no infinite ray
        return ray, usable

    def _nearest(self, layers: list[Layer], rays: RayBatch) -> tuple[Any, Any, Any]:
        """Recorded, not yet traced: distance (n,), primitive (n,) and barycentrics (2 n,)."""
        mi, dr = self._mi, self._dr
        ray, usable = self._ray(rays)
        distance, primitive, weights = mi.Float(dr.inf), mi.UInt32(int(NO_PRIMITIVE)), mi.Point2f(0.0)
        for layer in layers:
            hit = layer.scene.ray_intersect_preliminary(ray, mi.Bool(rays.coherent), usable)
            found = hit.is_valid()
            row = (
                hit.prim_index
                if layer.world_rows is None
                else dr.gather(mi.UInt32, layer.world_rows, hit.prim_index, found)
            )
            distance = dr.select(found, hit.t, distance)
            primitive = dr.select(found, row, primitive)
            weights = dr.select(found, hit.prim_uv, weights)
            ray.maxt = dr.select(found, hit.t, ray.maxt)
        return distance, primitive, dr.ravel(weights)


def description(version: str, variant: str, drjit: Any) -> str:
    """What runs, for `phrt doctor`: "Mitsuba 3.9.1, llvm_ad_rgb with LLVM 19.1.7, 2 threads"."""
    if not variant.startswith("llvm"):
        return f"Mitsuba {version}, {variant} with OptiX"
    llvm = ".".join(str(part) for part in drjit.detail.llvm_version())
    threads = drjit.thread_count()
    return f"Mitsuba {version}, {variant} with LLVM {llvm}, {threads} thread{'s' if threads > 1 else ''}"


def flat(array: np.ndarray) -> np.ndarray:
    """(n * width,) float32, C-contiguous: what Dr.Jit reads in place; no copy where the batch keeps its contract."""
    return np.ascontiguousarray(array, np.float32).reshape(-1)


def plain(array: Any) -> np.ndarray:
    """A Dr.Jit array, computed, as numpy; on the processor it is the same memory."""
    result: np.ndarray = array.numpy()
    return result
