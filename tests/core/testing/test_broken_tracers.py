"""The kit finds what a tracer does wrong. Each broken one is the numpy tracer with one thing changed."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from phrt.conventions import NO_PRIMITIVE
from phrt.interfaces.tracer import Tracer, TracerCapabilities
from phrt.rays import HitBatch, RayBatch
from phrt.registry import Options, get_registry
from phrt.testing import check_tracer
from phrt.world import Changes, World


class Wrapped(Tracer):
    """Passes everything on to the numpy tracer."""

    capabilities = TracerCapabilities("the oracle, wrapped")

    def __init__(self, options: Options) -> None:
        self.inner: Tracer = get_registry().create("tracer", "numpy")

    def build(self, world: World) -> None:
        self.inner.build(world)

    def update(self, world: World, changes: Changes) -> None:
        self.inner.update(world, changes)

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        return self.inner.closest_hit(rays)

    def occluded(self, rays: RayBatch) -> np.ndarray:
        return self.inner.occluded(rays)


class NoCapabilities(Wrapped):
    capabilities = "fast"  # type: ignore[assignment]


class Doubles(Wrapped):
    def closest_hit(self, rays: RayBatch) -> HitBatch:
        hits = super().closest_hit(rays)
        return replace(hits, distance=hits.distance.astype(np.float64))


class IgnoresLimits(Wrapped):
    def closest_hit(self, rays: RayBatch) -> HitBatch:
        return super().closest_hit(replace(rays, t_max=np.full_like(rays.t_max, np.inf)))


class LimitOfTheFirstRay(Wrapped):
    def occluded(self, rays: RayBatch) -> np.ndarray:
        same = np.full_like(rays.t_max, rays.t_max[0] if len(rays) else np.inf)
        return super().occluded(replace(rays, t_max=same))


class SwapsBarycentrics(Wrapped):
    def closest_hit(self, rays: RayBatch) -> HitBatch:
        hits = super().closest_hit(rays)
        return replace(hits, barycentric=np.ascontiguousarray(hits.barycentric[:, ::-1]))


class MissesAtZero(Wrapped):
    def closest_hit(self, rays: RayBatch) -> HitBatch:
        hits = super().closest_hit(rays)
        missed = hits.primitive == NO_PRIMITIVE
        return replace(hits, distance=np.where(missed, np.float32(0), hits.distance))


class EverythingCasts(Wrapped):
    def occluded(self, rays: RayBatch) -> np.ndarray:
        return self.inner.closest_hit(rays).primitive != NO_PRIMITIVE


class NothingMoves(Wrapped):
    def update(self, world: World, changes: Changes) -> None:
        return


class MovesTheFirstOnly(Wrapped):
    def update(self, world: World, changes: Changes) -> None:
        kept = world.positions.copy()
        for object_id in changes.objects[1:]:
            rows = slice(world.first_vertex[object_id], world.first_vertex[object_id] + world.vertex_count[object_id])
            world.positions[rows] = kept[rows] + 7.0
        self.inner.build(world)
        world.positions[:] = kept


class SharesItsScratch(Wrapped):
    """Answers of one call are overwritten by the next one of another thread."""

    def __init__(self, options: Options) -> None:
        super().__init__(options)
        self.rays: RayBatch | None = None
        self.barrier = threading.Event()

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        self.rays = rays
        self.barrier.wait(0.003)
        return super().closest_hit(self.rays)


class WritesIntoRays(Wrapped):
    def occluded(self, rays: RayBatch) -> np.ndarray:
        rays.t_max[rays.t_max > 100.0] = 100.0
        return super().occluded(rays)


class WritesIntoTheWorld(Wrapped):
    def build(self, world: World) -> None:
        super().build(world)
        world.positions += np.float32(1e-4)


class NoRaysAtAll(Wrapped):
    def closest_hit(self, rays: RayBatch) -> HitBatch:
        assert len(rays) > 0, "there are rays"
        return super().closest_hit(rays)


class TrustsNumbers(Wrapped):
    def occluded(self, rays: RayBatch) -> np.ndarray:
        return super().occluded(RayBatch(*(np.nan_to_num(a) for a in (rays.origin, rays.direction, rays.t_max))))


class BuiltOnce(Wrapped):
    def __init__(self, options: Options) -> None:
        super().__init__(options)
        self.built = False

    def build(self, world: World) -> None:
        if not self.built:
            super().build(world)
        self.built = True


class LeavesOutStone(Wrapped):
    def build(self, world: World) -> None:
        super().build(world)
        self.opaque = world.object_opaque[world.triangle_object]

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        hits = super().closest_hit(rays)
        if not rays.opaque_only:
            return hits
        stone = (hits.primitive != NO_PRIMITIVE) & self.opaque[np.minimum(hits.primitive, len(self.opaque) - 1)]
        primitive = np.where(stone, NO_PRIMITIVE, hits.primitive).astype(np.uint32)
        return HitBatch(np.where(stone, np.float32(np.inf), hits.distance), primitive, hits.barycentric)


class LeavesOutCasters(Wrapped):
    def closest_hit(self, rays: RayBatch) -> HitBatch:
        hits = super().closest_hit(rays)
        if not rays.casters_only:
            return hits
        nothing = np.full(len(rays), np.inf, np.float32)
        return HitBatch(nothing, np.full(len(rays), NO_PRIMITIVE, np.uint32), hits.barycentric)


class NearlyRight(Wrapped):
    """A thousandth off, as after a transform in too low a precision."""

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        hits = super().closest_hit(rays)
        return replace(hits, distance=hits.distance * np.float32(0.999))


BROKEN: list[tuple[Any, str]] = [
    (NoCapabilities, "`capabilities` is a TracerCapabilities"),
    (Doubles, r"distance is float32\(3,\), not float64\(3,\)"),
    (IgnoresLimits, "hits at or beyond t_max do not count"),
    (LimitOfTheFirstRay, "every ray has its own t_max"),
    (SwapsBarycentrics, r"barycentrics weigh the second and the third vertex: \(0.25, 0.5\)"),
    (MissesAtZero, r"a miss is at t = \+inf"),
    (EverythingCasts, "an object that casts no shadow does not block"),
    (NothingMoves, r"after update number 0 moved objects \[3, 17, 25\]"),
    (MovesTheFirstOnly, "the oracle's .*after update number 0"),
    (SharesItsScratch, "queries of four threads give what one thread gets"),
    (WritesIntoRays, "read-only"),
    (WritesIntoTheWorld, "the world's arrays are not changed|is hit|oracle's"),
    (NoRaysAtAll, "any number of rays raised AssertionError: there are rays"),
    (TrustsNumbers, "rays with NaN, infinity or no direction miss"),
    (BuiltOnce, "built for another world"),
    (LeavesOutStone, "opaque_only may leave out what is not opaque, and never what is"),
    (LeavesOutCasters, "casters_only may leave out what casts no shadow, and never what does"),
    (NearlyRight, r"expected t \[2.0, 2.0, inf\], got \[1.998"),
]


@pytest.mark.parametrize(("broken", "says"), BROKEN, ids=lambda value: getattr(value, "__name__", ""))
def test_a_broken_tracer_is_found(broken: type[Tracer], says: str) -> None:
    with pytest.raises(AssertionError, match=f"tracer {broken.__name__} breaks its contract: .*({says})"):
        check_tracer(broken)
