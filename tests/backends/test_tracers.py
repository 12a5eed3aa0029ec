"""Every tracer gives the same, right answers: one body of tests over all backends that are available here."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import needs
import numpy as np
import pytest

from phrt.conventions import NO_PRIMITIVE
from phrt.errors import PhrtError
from phrt.interfaces.tracer import Tracer
from phrt.rays import HitBatch, RayBatch
from phrt_backends.availability import embree_reason, open3d_reason
from phrt_backends.options import EmbreeOptions, NumpyOptions, Open3dOptions

TRACERS = ["embree-packets", "embree-packets-robust", "embree-embreex", "open3d", "numpy"]


@dataclass
class TracerWorld:
    """The arrays of a `World` that tracers read, made from (local positions, triangles) of every object."""

    meshes: list[tuple[np.ndarray, np.ndarray]]
    matrices: list[np.ndarray] = field(default_factory=list)
    casts: list[bool] = field(default_factory=list)
    opaque: list[bool] = field(default_factory=list)
    moving_objects: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        count = len(self.meshes)
        self.vertex_count = np.array([0, *(len(v) for v, _ in self.meshes)], np.int32)
        self.triangle_count = np.array([0, *(len(t) for _, t in self.meshes)], np.int32)
        self.first_vertex = np.cumsum(self.vertex_count, dtype=np.int32) - self.vertex_count
        self.first_triangle = np.cumsum(self.triangle_count, dtype=np.int32) - self.triangle_count
        self.local_positions = np.concatenate([np.zeros((0, 3)), *(v for v, _ in self.meshes)]).astype(np.float32)
        shifted = [t + first for (_, t), first in zip(self.meshes, self.first_vertex[1:], strict=True)]
        self.triangles = np.concatenate([np.zeros((0, 3), int), *shifted]).astype(np.int32)
        self.triangle_object = np.repeat(np.arange(count + 1), self.triangle_count).astype(np.int32)
        self.object_matrix = np.stack([np.eye(4), *(self.matrices or [np.eye(4)] * count)])
        self.object_casts_shadow = np.array([False, *(self.casts or [True] * count)])
        self.object_opaque = np.array([True, *(self.opaque or [True] * count)])
        self.positions = np.zeros_like(self.local_positions)
        for object_id in range(1, count + 1):
            self.place(object_id, self.object_matrix[object_id])

    def place(self, object_id: int, matrix: np.ndarray) -> None:
        """Move an object, rewriting its rows in place as `World.advance` does."""
        rows = slice(self.first_vertex[object_id], self.first_vertex[object_id] + self.vertex_count[object_id])
        self.object_matrix[object_id] = matrix
        self.positions[rows] = self.local_positions[rows] @ matrix[:3, :3].T + matrix[:3, 3]


def make_tracer(name: str) -> Tracer:
    """A tracer by its name in TRACERS, or a skip that says what is missing."""
    reason = open3d_reason() if name == "open3d" else embree_reason() if name.startswith("embree") else None
    if reason:
        needs.absent(reason)
    if name == "open3d":
        from phrt_backends.tracers.open3d_scene import Open3dTracer

        return Open3dTracer(Open3dOptions())
    if name == "numpy":
        from phrt_backends.tracers.numpy_bvh import NumpyTracer

        return NumpyTracer(NumpyOptions())
    from phrt_backends.tracers.embree import EmbreeTracer

    binding: Any = name.split("-")[1]
    return EmbreeTracer(EmbreeOptions(binding=binding, robust=name.endswith("robust")))


@pytest.fixture(params=TRACERS)
def tracer(request: pytest.FixtureRequest) -> Iterator[Tracer]:
    made = make_tracer(request.param)
    yield made
    made.close()


def rays_of(origin: Any, direction: Any, t_max: Any = np.inf, coherent: bool = False) -> RayBatch:
    origin, direction = np.atleast_2d(np.asarray(origin, np.float32)), np.atleast_2d(np.asarray(direction, np.float32))
    count = max(len(origin), len(direction))
    return RayBatch(
        np.array(np.broadcast_to(origin, (count, 3))),
        np.array(np.broadcast_to(direction, (count, 3))),
        np.array(np.broadcast_to(np.asarray(t_max, np.float32), count)),
        coherent,
    )


def moved(objects: Any) -> Any:
    return SimpleNamespace(objects=tuple(int(i) for i in objects), lights=False, turned=())


def translation(x: float, y: float, z: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def unit_triangle(z: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    return np.array([[0, 0, z], [1, 0, z], [0, 1, z]], float), np.array([[0, 1, 2]])


def box(half: float = 0.5) -> tuple[np.ndarray, np.ndarray]:
    """An axis-aligned cube around the origin, 12 triangles."""
    corners = np.array([[x, y, z] for x in (-half, half) for y in (-half, half) for z in (-half, half)], float)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])


def sphere(rings: int = 24, segments: int = 48) -> tuple[np.ndarray, np.ndarray]:
    """A unit sphere of triangles; the poles are slivers that never count as hits."""
    theta, phi = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, segments + 1), indexing="ij")
    points = np.stack((np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)), axis=-1).reshape(-1, 3)
    row, column = np.meshgrid(np.arange(rings), np.arange(segments), indexing="ij")
    a = (row * (segments + 1) + column).ravel()
    b, c, d = a + 1, a + segments + 1, a + segments + 2
    return points, np.concatenate((np.stack((a, b, d), 1), np.stack((a, d, c), 1)))


def soup(count: int, seed: int, size: float = 0.3) -> tuple[np.ndarray, np.ndarray]:
    """Random triangles in the cube [-1, 1]."""
    random = np.random.default_rng(seed)
    corners = random.uniform(-1, 1, (count, 1, 3)) + random.normal(0, size, (count, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3)


def random_rays(count: int, seed: int, extent: float = 2.0, t_max: Any = np.inf) -> RayBatch:
    random = np.random.default_rng(seed)
    direction = random.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return rays_of(random.uniform(-extent, extent, (count, 3)), direction, t_max)


def assert_same_hits(actual: HitBatch, expected: HitBatch, different: float = 0.002) -> None:
    """Equal distances and, where the nearest triangle is the same one, equal barycentrics; at most the share
    `different` of the rays, those that graze an edge, may disagree about hitting or about which neighbour is hit."""
    same = actual.primitive == expected.primitive
    assert np.count_nonzero(~same) <= different * len(same)
    hit = same & np.isfinite(expected.distance)
    assert hit.any()
    np.testing.assert_allclose(actual.distance[hit], expected.distance[hit], rtol=2e-5, atol=2e-5)
    error = np.abs(actual.barycentric[hit] - expected.barycentric[hit])
    assert np.quantile(error, 0.99) < 1e-3
    assert np.isinf(actual.distance[actual.primitive == NO_PRIMITIVE]).all()
    assert np.isfinite(actual.distance[actual.primitive != NO_PRIMITIVE]).all()


def test_distances_to_a_sphere_are_those_of_the_formula(tracer: Tracer) -> None:
    tracer.build(TracerWorld([sphere(96, 192)]))
    random = np.random.default_rng(3)
    target = random.normal(size=(500, 3)) * 0.3
    origin = random.normal(size=(500, 3))
    origin *= 4.0 / np.linalg.norm(origin, axis=1, keepdims=True)
    direction = (target - origin) / np.linalg.norm(target - origin, axis=1, keepdims=True)
    b = np.einsum("ij,ij->i", origin, direction)
    discriminant = b * b - (16.0 - 1.0)
    clear = discriminant > 0.05
    hits = tracer.closest_hit(rays_of(origin[clear], direction[clear]))
    np.testing.assert_allclose(hits.distance, -b[clear] - np.sqrt(discriminant[clear]), atol=4e-3)


def test_rays_for_opaque_objects_alone_may_leave_out_the_others_and_never_an_opaque_one(tracer: Tracer) -> None:
    casts, opaque = [False, True, True], [False, True, False]
    world = TracerWorld([unit_triangle(z) for z in (-1.0, -3.0, -5.0)], casts=casts, opaque=opaque)
    tracer.build(world)
    rays = replace(rays_of(np.tile([0.2, 0.2, 0.0], (2, 1)), [0, 0, -1], [2.0, 9.0]), opaque_only=True)
    near, far = tracer.closest_hit(rays).primitive.tolist()
    assert near in (0, NO_PRIMITIVE)
    assert far in (0, 1)
    assert tracer.occluded(rays).tolist() == [False, True]
    if "packets" in tracer.capabilities.description:
        assert (near, far) == (NO_PRIMITIVE, 1)


def test_rays_for_shadow_casters_alone_may_leave_out_the_others_and_never_a_caster(tracer: Tracer) -> None:
    tracer.build(TracerWorld([unit_triangle(z) for z in (-1.0, -3.0, -5.0)], casts=[False, True, True]))
    rays = replace(rays_of(np.tile([0.2, 0.2, 0.0], (2, 1)), [0, 0, -1], [2.0, 9.0]), casters_only=True)
    near, far = tracer.closest_hit(rays).primitive.tolist()
    assert near in (0, NO_PRIMITIVE)
    assert far in (0, 1)
    if "packets" in tracer.capabilities.description:
        assert (near, far) == (NO_PRIMITIVE, 1)


def test_broken_triangles_are_missed_and_hide_nothing(tracer: Tracer) -> None:
    vertices, triangles = unit_triangle()
    broken = vertices.copy()
    broken[1] = np.nan
    broken[:, 2] += 1.0
    tracer.build(TracerWorld([(broken, triangles), (vertices, triangles), (np.zeros((3, 3)), triangles)]))
    hits = tracer.closest_hit(rays_of([0.25, 0.25, 2.0], [0, 0, -1]))
    assert hits.primitive.tolist() == [1]


def test_oracle_agrees_with_brute_force() -> None:
    from phrt_backends.tracers.numpy_bvh import intersect

    vertices, triangles = soup(200, seed=9)
    tracer = make_tracer("numpy")
    tracer.build(TracerWorld([(vertices, triangles)]))
    rays = random_rays(500, seed=10)
    corners = vertices.astype(np.float32).astype(np.float64)[triangles]
    t, _, _ = intersect(rays.origin.astype(float), rays.direction.astype(float), corners)
    hits = tracer.closest_hit(rays)
    np.testing.assert_allclose(hits.distance, t.min(axis=1), rtol=1e-6)
    finite = np.isfinite(hits.distance)
    assert np.array_equal(hits.primitive[finite], t.argmin(axis=1)[finite])


def test_coherent_is_only_a_hint() -> None:
    tracer = make_tracer("embree-packets")
    tracer.build(TracerWorld([sphere(), soup(200, seed=4)]))
    rays = random_rays(1000, seed=8)
    hinted = RayBatch(rays.origin, rays.direction, rays.t_max, coherent=True)
    assert_same_hits(tracer.closest_hit(hinted), tracer.closest_hit(rays))
    assert np.count_nonzero(tracer.occluded(hinted) != tracer.occluded(rays)) <= 1


def grid_world() -> TracerWorld:
    """100 boxes and spheres in a 10 x 10 grid, 3 m apart; every third casts no shadow."""
    meshes = [box() if i % 2 else sphere(6, 12) for i in range(100)]
    matrices = [translation(3.0 * (i % 10), 0.0, 3.0 * (i // 10)) for i in range(100)]
    return TracerWorld(meshes, matrices, casts=[i % 3 != 0 for i in range(100)])


def grid_rays(count: int, seed: int) -> RayBatch:
    """Rays from above and from between the objects of `grid_world`."""
    random = np.random.default_rng(seed)
    target = random.uniform([-2, -1, -2], [29, 2, 29], (count, 3))
    origin = random.uniform([-5, 0, -5], [32, 8, 32], (count, 3))
    return rays_of(origin, (target - origin) / np.linalg.norm(target - origin, axis=1, keepdims=True))


def some_matrix(random: np.random.Generator) -> np.ndarray:
    """A rotation, a non-uniform and mirroring scale, and a place in the grid."""
    rotation, _ = np.linalg.qr(random.normal(size=(3, 3)))
    matrix = translation(*random.uniform([0, 0, 0], [27, 2, 27]))
    matrix[:3, :3] = rotation @ np.diag(random.uniform(0.5, 2.0, 3) * [1, -1, 1])
    return matrix


def test_moving_objects_are_found_where_a_fresh_build_finds_them(tracer: Tracer) -> None:
    world, random = grid_world(), np.random.default_rng(11)
    tracer.build(world)
    steps = [[3, 17, 42, 77, 100], [3, 17, 42, 77, 100], [3, 50], [], [51]]
    for step, objects in enumerate(steps):
        for object_id in objects:
            world.place(object_id, some_matrix(random))
        tracer.update(world, moved(objects))
        fresh = make_tracer("embree-packets")
        fresh.build(world)
        rays = grid_rays(3000, seed=step)
        assert_same_hits(tracer.closest_hit(rays), fresh.closest_hit(rays), different=0.004)
        assert np.count_nonzero(tracer.occluded(rays) != fresh.occluded(rays)) <= 6
        primitive = tracer.closest_hit(rays).primitive
        assert set(objects) <= set(world.triangle_object[primitive[primitive != NO_PRIMITIVE]].tolist())
        fresh.close()


def test_moving_objects_leave_the_others_bvh_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    from phrt_backends.tracers.embree_packets import EmbreePackets
    from phrt_backends.tracers.embree_scene import EmbreeScene

    tracer, world = EmbreePackets(EmbreeOptions()), grid_world()
    tracer.build(world)
    commits: list[EmbreeScene] = []
    commit = EmbreeScene.commit
    monkeypatch.setattr(EmbreeScene, "commit", lambda scene: (commits.append(scene), commit(scene))[1])
    objects = [3, 17, 42, 77, 100]
    tracer.update(world, moved(objects))
    assert len(commits) == 5 + 1 + 1  # each mover's own scene, the static scene without them, the top scene
    commits.clear()
    tracer.update(world, moved(objects))
    assert len(commits) == 1
    tracer.close()


def test_the_first_update_of_what_an_animation_moves_commits_the_top_scene_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from phrt_backends.tracers.embree_packets import EmbreePackets
    from phrt_backends.tracers.embree_scene import EmbreeScene

    tracer, world, objects = EmbreePackets(EmbreeOptions()), grid_world(), (3, 17, 42)
    world.moving_objects = objects
    tracer.build(world)
    fresh, still = make_tracer("embree-packets"), grid_world()
    fresh.build(still)
    rays = grid_rays(3000, seed=5)
    assert_same_hits(tracer.closest_hit(rays), fresh.closest_hit(rays), different=0.004)
    commits: list[EmbreeScene] = []
    commit = EmbreeScene.commit
    monkeypatch.setattr(EmbreeScene, "commit", lambda scene: (commits.append(scene), commit(scene))[1])
    for object_id in objects:
        world.place(object_id, some_matrix(np.random.default_rng(object_id)))
    tracer.update(world, moved(objects))
    assert commits == [tracer._top]
    fresh.build(world)
    assert_same_hits(tracer.closest_hit(rays), fresh.closest_hit(rays), different=0.004)
    tracer.close()


def test_queries_before_build_and_after_close_are_refused(tracer: Tracer) -> None:
    rays = random_rays(4, seed=0)
    with pytest.raises(PhrtError, match="call build first"):
        tracer.closest_hit(rays)
    tracer.build(TracerWorld([unit_triangle()]))
    tracer.closest_hit(rays)
    tracer.close()
    with pytest.raises(PhrtError, match="call build first"):
        tracer.occluded(rays)


def load_meshes(path: Path) -> list[tuple[np.ndarray, np.ndarray]]:
    """Every mesh of a file in world space, read by trimesh."""
    trimesh = needs.package("trimesh")
    scene = trimesh.load_scene(path, process=False)
    meshes = []
    for node in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        meshes.append((np.asarray(mesh.vertices) @ matrix[:3, :3].T + matrix[:3, 3], np.asarray(mesh.faces)))
    return meshes


@pytest.fixture(scope="module", params=["sponza/sponza_textured.glb", "stanford/bun_zipper.ply"])
def real_scene(request: pytest.FixtureRequest, assets: Path) -> tuple[TracerWorld, RayBatch, HitBatch, np.ndarray]:
    """A real mesh, rays from inside its bounds, and the oracle's answers."""
    world = TracerWorld(load_meshes(assets / request.param))
    lower, upper = world.positions.min(axis=0), world.positions.max(axis=0)
    random = np.random.default_rng(2)
    direction = random.normal(size=(1500, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    rays = rays_of(random.uniform(lower, upper, (1500, 3)), direction)
    oracle = make_tracer("numpy")
    oracle.build(world)
    short = RayBatch(rays.origin, rays.direction, np.full(1500, np.linalg.norm(upper - lower) / 6, np.float32))
    return world, rays, oracle.closest_hit(rays), oracle.occluded(short)


@pytest.mark.parametrize("name", [name for name in TRACERS if name != "numpy"])
def test_real_meshes_are_answered_as_by_the_oracle(name: str, real_scene: Any) -> None:
    world, rays, expected, blocked = real_scene
    tracer = make_tracer(name)
    tracer.build(world)
    actual = tracer.closest_hit(rays)
    far_off = ~np.isclose(actual.distance, expected.distance, rtol=1e-4, atol=1e-4 * np.ptp(world.positions))
    assert np.count_nonzero(far_off) <= 3
    assert np.mean(actual.primitive == expected.primitive) > 0.995
    short = np.full(len(rays), np.linalg.norm(np.ptp(world.positions, axis=0)) / 6, np.float32)
    assert np.count_nonzero(tracer.occluded(RayBatch(rays.origin, rays.direction, short)) != blocked) <= 3
    tracer.close()


@pytest.mark.parametrize("name", [name for name in TRACERS if name != "numpy"])
def test_an_animated_file_is_followed_through_time(name: str, assets: Path) -> None:
    import phrt
    from phrt.world import World

    world = World(phrt.load_scene(assets / "gltf" / "BoxAnimated" / "BoxAnimated.glb"))
    tracer, oracle = make_tracer(name), make_tracer("numpy")
    tracer.build(world)
    lower, upper = world.bounds()
    random = np.random.default_rng(4)
    target, origin = random.uniform(lower, upper, (1000, 3)), random.uniform(lower - 1, upper + 1, (1000, 3))
    rays = rays_of(origin, (target - origin) / np.linalg.norm(target - origin, axis=1, keepdims=True))
    seen = []
    for time in (0.5, 1.7, 3.7):
        changes = world.advance(time)
        assert changes.objects
        tracer.update(world, changes)
        oracle.build(world)
        expected = oracle.closest_hit(rays).distance
        far_off = ~np.isclose(tracer.closest_hit(rays).distance, expected, rtol=1e-4, atol=1e-4)
        assert np.count_nonzero(far_off) <= 2
        seen.append(expected)
    assert np.count_nonzero(seen[0] != seen[1]) > 50
    tracer.close()
