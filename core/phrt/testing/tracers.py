"""check_tracer: the rules of `phrt.interfaces.tracer.Tracer`, by rays whose answers are known and by the numpy tracer's."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from pydantic import BaseModel

from phrt.conventions import NO_PRIMITIVE
from phrt.interfaces.tracer import Tracer, TracerCapabilities
from phrt.model import Material
from phrt.rays import HitBatch, RayBatch
from phrt.registry.manager import get_registry
from phrt.testing.contract import BROKEN_BY_THE_PLUGIN, Contract, Given, Maker
from phrt.testing.worlds import at, box, mesh_of, quad, soup, sphere, triangle, world_of
from phrt.world import World

__tracebackhide__ = BROKEN_BY_THE_PLUGIN

ORACLE = "numpy"
DIFFERENT = 0.002
"""Share of rays that may graze an edge and hit, in single precision, what the oracle's miss."""
NEAR = 2e-5
"""Relative and in metres: how far distances may be from the oracle's."""


def check_tracer(tracer: Given, options: Mapping[str, object] | BaseModel | None = None) -> None:
    """Put a tracer through its contract. Raises BrokenContract naming the rule and the case.

    tracer: the name of a registered one, a descriptor, or a class that takes `options`
    """
    make = Maker("tracer", tracer, options)
    contract = make.contract
    made = make()
    contract.holds(isinstance(made, Tracer), "it is a phrt.interfaces.tracer.Tracer")
    described = getattr(made, "capabilities", None)
    contract.holds(isinstance(described, TracerCapabilities), "`capabilities` is a TracerCapabilities")
    contract.call("close of one that was never built", made.close)
    for check in CHECKS:
        contract.call(check.__name__.strip("_").replace("_", " "), partial(_checked, check, make, contract))


# What checks use


def _checked(check: Callable[[_Bench], None], make: Maker, contract: Contract) -> None:
    """On a bench of its own."""
    check(_Bench(make, contract))


def rays_of(origin: Any, direction: Any, t_max: Any = np.inf) -> RayBatch:
    """Rays of lists or arrays; a single origin, direction or limit is that of all."""
    origin, direction = np.atleast_2d(np.asarray(origin, np.float32)), np.atleast_2d(np.asarray(direction, np.float32))
    count = max(len(origin), len(direction))
    return RayBatch(
        np.array(np.broadcast_to(origin, (count, 3))),
        np.array(np.broadcast_to(direction, (count, 3))),
        np.array(np.broadcast_to(np.asarray(t_max, np.float32), count)),
    )


def rays_between(low: Any, high: Any, count: int, seed: int, t_max: float = np.inf) -> RayBatch:
    """Rays from random points of a box to random points of it."""
    random = np.random.default_rng(seed)
    origin, target = random.uniform(low, high, (2, count, 3))
    return rays_of(origin, (target - origin) / np.linalg.norm(target - origin, axis=1, keepdims=True), t_max)


def few_triangles(seed: int = 1, casts: Sequence[bool] | None = None) -> World:
    """Three objects of random triangles."""
    return world_of([(soup(count, seed + i), at()) for i, count in enumerate((150, 100, 1))], casts=casts)


class _Bench:
    """Makes tracers on worlds, closes them, and compares answers."""

    def __init__(self, make: Callable[[], Tracer], contract: Contract) -> None:
        self._make, self.holds = make, contract.holds

    @contextmanager
    def on(self, world: World) -> Iterator[Tracer]:
        tracer = self._make()
        tracer.build(world)
        try:
            yield tracer
        finally:
            tracer.close()

    def answers(self, tracer: Tracer, rays: RayBatch, case: object = "") -> tuple[HitBatch, np.ndarray]:
        """Both queries, their arrays of the right shapes and dtypes, misses marked as such."""
        hits, blocked = tracer.closest_hit(rays), tracer.occluded(rays)
        count = len(rays)
        for name, array, shape, dtype in (
            ("distance", hits.distance, (count,), np.float32), ("primitive", hits.primitive, (count,), np.uint32),
            ("barycentric", hits.barycentric, (count, 2), np.float32), ("occluded", blocked, (count,), np.bool_),
        ):  # fmt: skip
            fits = isinstance(array, np.ndarray) and array.shape == shape and array.dtype == dtype
            got = f"{array.dtype}{array.shape}" if isinstance(array, np.ndarray) else repr(array)
            self.holds(fits, f"{name} is {np.dtype(dtype)}{shape}, not {got:.80}", case)
        missed = hits.primitive == NO_PRIMITIVE
        self.holds(np.isposinf(hits.distance[missed]).all(), "a miss is at t = +inf", case)
        self.holds(np.isfinite(hits.distance[~missed]).all(), "a hit is at a finite distance", case)
        self.holds((hits.distance[~missed] < rays.t_max[~missed]).all(), "hits at or beyond t_max do not count", case)
        return hits, blocked

    def hits(self, tracer: Tracer, rays: RayBatch, distance: Any, primitive: Any, rule: str, case: object = "") -> None:
        """Both queries of `rays` find triangles `primitive` at `distance`; occluded is true where there is one."""
        hits, blocked = self.answers(tracer, rays, case)
        expected = np.asarray(distance, np.float32)
        found = f"{rule}: expected t {expected.tolist()}, got {hits.distance.tolist()}"
        self.holds(np.allclose(hits.distance, expected, rtol=NEAR, atol=NEAR), found, case)
        wanted = [NO_PRIMITIVE if p is None else p for p in primitive]
        self.holds(
            hits.primitive.tolist() == wanted, f"{rule}: triangles {wanted}, got {hits.primitive.tolist()}", case
        )
        self.holds(blocked.tolist() == np.isfinite(expected).tolist(), f"{rule}: occluded is {blocked.tolist()}", case)

    def as_the_oracle(self, tracer: Tracer, world: World, rays: RayBatch, case: object = "") -> None:
        """Both queries give what the numpy tracer gives, but for rays that graze an edge."""
        oracle: Tracer = get_registry().create("tracer", ORACLE)
        oracle.build(world)
        (hits, blocked), wanted, open_ = (
            self.answers(tracer, rays, case),
            oracle.closest_hit(rays),
            oracle.occluded(rays),
        )
        oracle.close()
        same = hits.primitive == wanted.primitive
        other = f"{np.count_nonzero(~same)} of {len(rays)} rays hit another triangle than the oracle's"
        self.holds(np.count_nonzero(~same) <= DIFFERENT * len(rays) + 2, other, case)
        both = same & np.isfinite(wanted.distance)
        close = np.isclose(hits.distance[both], wanted.distance[both], rtol=NEAR, atol=NEAR)
        self.holds(close.all(), f"{np.count_nonzero(~close)} distances are not the oracle's", case)
        off = np.abs(hits.barycentric[both] - wanted.barycentric[both])
        self.holds(np.quantile(off, 0.99) < 1e-3 if off.size else True, "barycentrics are the oracle's", case)
        wrong = np.count_nonzero(blocked != open_)
        self.holds(wrong <= DIFFERENT * len(rays) + 2, f"{wrong} of {len(rays)} occlusions are not the oracle's", case)


# The rules


def _distance_triangle_and_barycentrics_of_a_hit(bench: _Bench) -> None:
    with bench.on(world_of([(triangle(-5.0), at()), (triangle(0.0), at())])) as tracer:
        rays = rays_of([[0.25, 0.5, 2], [0.25, 0.5, -7], [2, 2, 2]], [[0, 0, -1], [0, 0, 1], [0, 0, -1]])
        bench.hits(tracer, rays, [2, 2, np.inf], [1, 0, None], "the nearest triangle is hit, from both sides")
        weights = tracer.closest_hit(rays).barycentric[:2]
        right = np.allclose(weights, [[0.25, 0.5]] * 2, atol=1e-5)
        bench.holds(right, f"barycentrics weigh the second and the third vertex: (0.25, 0.5), not {weights.tolist()}")


def _rays_from_inside_hit_the_wall_ahead(bench: _Bench) -> None:
    with bench.on(world_of([(box(), at(x=3))])) as tracer:
        towards = np.concatenate([np.eye(3), -np.eye(3)])
        start = np.array([3.0, 0.1, 0.05])
        expected = np.concatenate([0.5 - (start - [3, 0, 0]), 0.5 + (start - [3, 0, 0])])
        found = tracer.closest_hit(rays_of(start, towards)).distance
        right = np.allclose(found, expected, rtol=NEAR)
        bench.holds(right, f"walls of a box are hit from inside at {expected.tolist()}, not {found.tolist()}")


def _limits_of_rays(bench: _Bench) -> None:
    with bench.on(world_of([(triangle(), at())])) as tracer:
        for t_max in (np.inf, 1e30, 2.001, 2.0, 1.999, 0.0, -1.0):
            hit = t_max > 2.0
            rays = rays_of([0.25, 0.25, 2.0], [0, 0, -1], t_max)
            rule = "only hits nearer than t_max count"
            bench.hits(tracer, rays, [2.0 if hit else np.inf], [0 if hit else None], rule, f"t_max {t_max}, hit at 2")
        limits = np.array([1.0, 3.0] * 10, np.float32)
        rays = rays_of(np.tile([0.25, 0.25, 2.0], (20, 1)), [0, 0, -1], limits)
        bench.hits(tracer, rays, [np.inf, 2.0] * 10, [None, 0] * 10, "every ray has its own t_max")
        behind = rays_of([0.25, 0.25, 1e-3], [0, 0, 1])
        bench.hits(tracer, behind, [np.inf], [None], "what is behind the origin is missed")


def _rays_that_are_not_numbers(bench: _Bench) -> None:
    with bench.on(world_of([(triangle(), at())])) as tracer:
        rays = rays_of(np.tile([0.25, 0.25, 2.0], (20, 1)), [0, 0, -1])
        rays.origin[3, 0], rays.direction[7], rays.origin[9, 2] = np.nan, np.nan, np.inf
        rays.direction[11], rays.t_max[13] = 0.0, np.nan
        hit = np.ones(20, bool)
        hit[[3, 7, 9, 11, 13]] = False
        found, blocked = tracer.closest_hit(rays).primitive == 0, tracer.occluded(rays)
        rule = "rays with NaN, infinity or no direction miss, and the others do not"
        bench.holds(np.array_equal(found, hit) and np.array_equal(blocked, hit), rule)


def _any_number_of_rays(bench: _Bench) -> None:
    with bench.on(world_of([(triangle(), at())])) as tracer:
        for count in (0, 1, 15, 16, 17, 33):
            origin, down = np.tile([0.25, 0.25, 2.0], (count, 1)), np.tile([0.0, 0.0, -1.0], (count, 1))
            rays = RayBatch(origin.astype(np.float32), down.astype(np.float32), np.full(count, np.inf, np.float32))
            bench.hits(tracer, rays, [2.0] * count, [0] * count, "any number of rays is answered", f"{count} rays")


def _objects_that_cast_no_shadow(bench: _Bench) -> None:
    with bench.on(world_of([(triangle(-1.0), at()), (triangle(-3.0), at())], casts=[False, True])) as tracer:
        rays = rays_of(np.tile([0.2, 0.2, 0.0], (2, 1)), [0, 0, -1], [2.0, 4.0])
        hits, blocked = bench.answers(tracer, rays)
        bench.holds(hits.primitive.tolist() == [0, 0], "an object that casts no shadow is hit")
        bench.holds(
            blocked.tolist() == [False, True], "an object that casts no shadow does not block, one behind it does"
        )
        hits, _ = bench.answers(tracer, replace(rays, casters_only=True), "casters_only")
        near, far = hits.primitive.tolist()
        rule = "casters_only may leave out what casts no shadow, and never what does"
        bench.holds(near in (0, NO_PRIMITIVE) and far in (0, 1), rule, f"hits {near} and {far}")


def _hints(bench: _Bench) -> None:
    glass, stone = Material(transmission=1.0), Material()
    world = world_of([(triangle(-1.0, 0), at()), (triangle(-3.0, 1), at()), (triangle(-5.0, 0), at())], [glass, stone])
    with bench.on(world) as tracer:
        rays = rays_of([[0.2, 0.2, 0], [0.2, 0.2, 0], [0.2, 0.2, -2]], [0, 0, -1], [2.0, 9.0, 9.0])
        hits, blocked = bench.answers(tracer, replace(rays, opaque_only=True), "opaque_only")
        near, far, stone = hits.primitive.tolist()
        rule = "opaque_only may leave out what is not opaque, and never what is"
        bench.holds(near in (0, NO_PRIMITIVE) and far in (0, 1) and stone == 1, rule, f"hits {near}, {far} and {stone}")
        bench.holds(blocked.all(), "opaque_only does not concern occlusion")
    world = few_triangles()
    with bench.on(world) as tracer:
        rays = replace(rays_between([-2] * 3, [2] * 3, 500, 8), coherent=True)
        bench.as_the_oracle(tracer, world, rays, "coherent is only a hint")


def _scenes_with_little_in_them(bench: _Bench) -> None:
    rays = rays_between([-1] * 3, [1] * 3, 20, 1)
    with bench.on(world_of([])) as tracer:
        bench.hits(tracer, rays, [np.inf] * 20, [None] * 20, "an empty scene is missed")
    nothing = mesh_of(np.zeros((0, 3)), np.zeros((0, 3)))
    world = world_of([(nothing, at()), (triangle(-1.0), at()), (nothing, at()), (triangle(-3.0), at())])
    with bench.on(world) as tracer:
        down = rays_of([[0.2, 0.2, 0.0], [0.2, 0.2, -2.0]], [0, 0, -1])
        bench.hits(tracer, down, [1, 1], [0, 1], "objects without triangles shift no numbers")


def _answers_of_the_oracle(bench: _Bench) -> None:
    world = few_triangles(casts=[True, False, True])
    with bench.on(world) as tracer:
        for t_max in (np.inf, 1.0, 0.3):
            rays = rays_between([-2] * 3, [2] * 3, 1500, 5, t_max)
            bench.as_the_oracle(tracer, world, rays, f"random triangles, t_max {t_max}")


def _inputs_stay_as_they_are(bench: _Bench) -> None:
    world = few_triangles()
    kept = [array.copy() for array in (world.positions, world.triangles)]
    with bench.on(world) as tracer:
        rays = rays_between([-2] * 3, [2] * 3, 100, 2, 1.5)
        given = (rays.origin, rays.direction, rays.t_max)
        copies = [array.copy() for array in given]
        for array in given:
            array.flags.writeable = False
        bench.answers(tracer, rays, "read-only rays")
        same = all(np.array_equal(a, b) for a, b in zip(given, copies, strict=True))
        bench.holds(same, "queries do not change the rays")
    same = all(np.array_equal(a, b) for a, b in zip((world.positions, world.triangles), kept, strict=True))
    bench.holds(same, "the world's arrays are not changed")


def _threads_get_the_answers_of_one_thread(bench: _Bench) -> None:
    with bench.on(few_triangles()) as tracer:
        batches = [rays_between([-2] * 3, [2] * 3, 200, seed) for seed in range(12)]
        expected = [(tracer.closest_hit(rays), tracer.occluded(rays)) for rays in batches]
        with ThreadPoolExecutor(4) as pool:
            hits, blocked = list(pool.map(tracer.closest_hit, batches)), list(pool.map(tracer.occluded, batches))
        for (alone, open_), found, closed in zip(expected, hits, blocked, strict=True):
            same = np.array_equal(found.distance, alone.distance) and np.array_equal(found.primitive, alone.primitive)
            bench.holds(same and np.array_equal(closed, open_), "queries of four threads give what one thread gets")


def _moved_objects_are_found_where_they_went(bench: _Bench) -> None:
    meshes = [box() if i % 2 else sphere(5) for i in range(25)]
    world = world_of(
        [(mesh, at(x=3.0 * (i % 5), z=3.0 * (i // 5))) for i, mesh in enumerate(meshes)],
        casts=[i % 3 != 0 for i in range(25)],
    )
    random = np.random.default_rng(11)
    with bench.on(world) as tracer:
        for step, objects in enumerate(([3, 17, 25], [3, 17, 25], [3, 12], [], [13])):
            for object_id in objects:
                world.set_object_matrix(object_id, _somewhere(random))
            tracer.update(world, world.advance(0.0))
            rays = rays_between([-2, -1, -2], [14, 2, 14], 800, step)
            bench.as_the_oracle(tracer, world, rays, f"after update number {step} moved objects {objects}")


def _everything_may_move_or_be_flattened(bench: _Bench) -> None:
    world = world_of([(box(), at()), (quad(), at(z=-9))])
    with bench.on(world) as tracer:
        down = rays_of([0.2, 0.3, 5.0], [0, 0, -1])
        for matrix, expected, case in (
            (at(z=2), 2.5, "moved"), (np.diag([1.0, 1.0, 0.0, 1.0]), 5.0, "flattened"),
            (np.diag([0.0, 0.0, 0.0, 1.0]), 14.0, "shrunk to a point"), (at(z=1), 3.5, "back again"),
        ):  # fmt: skip
            world.set_object_matrix(1, matrix)
            tracer.update(world, world.advance(0.0))
            found = float(tracer.closest_hit(down).distance[0])
            bench.holds(abs(found - expected) < 1e-3, f"a box is hit at {expected}, not {found:g}", case)
        world.set_object_matrix(1, at(x=20))
        world.set_object_matrix(2, at(x=40))
        tracer.update(world, world.advance(0.0))
        bench.holds(not tracer.occluded(down).any(), "nothing stays behind when everything moves")


def _a_tracer_can_be_built_again(bench: _Bench) -> None:
    with bench.on(world_of([(triangle(), at())])) as tracer:
        world = few_triangles(seed=7)
        tracer.build(world)
        bench.as_the_oracle(tracer, world, rays_between([-2] * 3, [2] * 3, 300, 3), "built for another world")


def _somewhere(random: np.random.Generator) -> np.ndarray:
    """A rotation, a non-uniform and mirroring scale, and a place among the others."""
    rotation, _ = np.linalg.qr(random.normal(size=(3, 3)))
    matrix = at(*random.uniform([0, 0, 0], [12, 2, 12]))
    matrix[:3, :3] = rotation @ np.diag(random.uniform(0.5, 2.0, 3) * [1, -1, 1])
    return matrix


CHECKS: tuple[Callable[[_Bench], None], ...] = (
    _distance_triangle_and_barycentrics_of_a_hit,
    _rays_from_inside_hit_the_wall_ahead,
    _limits_of_rays,
    _rays_that_are_not_numbers,
    _any_number_of_rays,
    _objects_that_cast_no_shadow,
    _hints,
    _scenes_with_little_in_them,
    _answers_of_the_oracle,
    _inputs_stay_as_they_are,
    _threads_get_the_answers_of_one_thread,
    _moved_objects_are_found_where_they_went,
    _everything_may_move_or_be_flattened,
    _a_tracer_can_be_built_again,
)
