"""The tracer gives right answers, the same as Embree's and the numpy oracle's, also while things move."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import needs
import numpy as np
import pytest

import phrt
from phrt.conventions import NO_PRIMITIVE
from phrt.errors import PhrtError
from phrt.interfaces.tracer import Tracer
from phrt.registry import get_registry
from phrt.testing import check_tracer
from phrt.testing.tracers import few_triangles, rays_between, rays_of
from phrt.testing.worlds import at, box, sphere, triangle, world_of
from phrt.world import World
from phrt_mitsuba.availability import has_nvidia_gpu, unavailable_reason

pytestmark = needs.all_need(unavailable_reason())

DEVICES = ["llvm", *(["cuda"] if has_nvidia_gpu() else [])]
SCENES = Path(needs.PROJECT) / "scenes"


@pytest.fixture(params=DEVICES)
def tracer(request: pytest.FixtureRequest) -> Iterator[Tracer]:
    made: Tracer = get_registry().create("tracer", "mitsuba", {"device": request.param})
    yield made
    made.close()


def built(name: str, world: World) -> Tracer:
    tracer: Tracer = get_registry().create("tracer", name)
    tracer.build(world)
    return tracer


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("robust", [False, True])
def test_it_keeps_the_contract(device: str, robust: bool) -> None:
    check_tracer("mitsuba", {"device": device, "robust": robust})


@pytest.mark.parametrize(("scene", "other", "count"), [("atrium", "embree", 20_000), ("carousel", "numpy", 400)])
def test_hits_of_a_real_scene_are_those_of_other_tracers(tracer: Tracer, scene: str, other: str, count: int) -> None:
    """But for triangles that lie in one place, of which any may be named."""
    world = World(phrt.load_scene(SCENES / f"{scene}.yaml"))
    low, high = world.bounds()
    tracer.build(world)
    reference = built(other, world)
    for t_max in (np.inf, 2.0):
        rays = rays_between(low, high, count, 4, t_max)
        found, wanted = tracer.closest_hit(rays), reference.closest_hit(rays)
        assert np.isfinite(wanted.distance).mean() > 0.2, "too few rays hit anything to tell"
        np.testing.assert_allclose(found.distance, wanted.distance, rtol=5e-5, atol=2e-5)
        same = found.primitive == wanted.primitive
        assert same.mean() > 0.95
        both = same & (found.primitive != NO_PRIMITIVE)
        off = np.abs(found.barycentric[both] - wanted.barycentric[both])
        assert np.quantile(off, 0.99) < 1e-3
        assert np.array_equal(tracer.occluded(rays), reference.occluded(rays))
    reference.close()


def test_a_scene_in_motion_is_followed(tracer: Tracer) -> None:
    """60 objects turn and rise; after every step both tracers see them in the same place."""
    world = World(phrt.load_scene(SCENES / "carousel.yaml"))
    tracer.build(world)
    reference = built("embree", world)
    assert len(world.moving_objects) == 60
    still, before = tracer._still, None  # type: ignore[attr-defined]
    for step, time in enumerate((0.5, 1.0, 2.5)):
        changes = world.advance(time)
        for each in (tracer, reference):
            each.update(world, changes)
        rays = rays_between(*world.bounds(), 5000, seed=1)
        found, wanted = tracer.closest_hit(rays), reference.closest_hit(rays)
        assert np.count_nonzero(~np.isclose(found.distance, wanted.distance, rtol=1e-4, atol=1e-4)) <= 10, step
        assert np.count_nonzero(tracer.occluded(rays) != reference.occluded(rays)) <= 10
        assert before is None or not np.array_equal(found.distance, before), "nothing moved"
        before = found.distance.copy()
    assert tracer._still is still  # type: ignore[attr-defined]
    reference.close()


def test_hits_are_exact_however_near(tracer: Tracer) -> None:
    """Mitsuba moves the start of rays that it spawns itself; rays that it is given stay as they are."""
    tracer.build(world_of([(triangle(0.0), at())]))
    near = np.array([1e-7, 1e-5, 1e-3, 1.0, 1000.0], np.float32)
    rays = rays_of(np.stack([np.full(5, 0.25), np.full(5, 0.25), near], axis=1), [0, 0, -1])
    np.testing.assert_allclose(tracer.closest_hit(rays).distance, near, rtol=1e-6)
    assert tracer.occluded(rays).all()


def test_an_object_that_is_moved_by_hand_is_found_again_and_again(tracer: Tracer) -> None:
    world = world_of([(box(), at(x=3.0 * i)) for i in range(4)], casts=[True, False, True, True])
    tracer.build(world)
    down = rays_of([[x, 0.1, 5.0] for x in (0.1, 3.1, 6.1, 9.1, 50.1)], [0, 0, -1])
    assert tracer.closest_hit(down).distance.tolist() == pytest.approx([4.5] * 4 + [np.inf])
    assert tracer.occluded(down).tolist() == [True, False, True, True, False]
    world.set_object_matrix(2, at(x=50.0, z=1.0))
    tracer.update(world, world.advance(0.0))
    assert tracer.closest_hit(down).distance.tolist() == pytest.approx([4.5, np.inf, 4.5, 4.5, 3.5])
    assert not tracer.occluded(down)[4], "it casts no shadow where it went either"
    still = tracer._still  # type: ignore[attr-defined]
    world.set_object_matrix(2, at(x=3.0, z=-1.0))
    tracer.update(world, world.advance(0.0))
    assert tracer.closest_hit(down).distance.tolist() == pytest.approx([4.5, 5.5, 4.5, 4.5, np.inf])
    hit = tracer.closest_hit(down).primitive[:4]
    assert world.triangle_object[hit].tolist() == [1, 2, 3, 4]
    assert tracer._still is still, "what stands still was built again"  # type: ignore[attr-defined]


def test_animated_objects_are_apart_from_the_start(tracer: Tracer) -> None:
    world = world_of([(box(), at()), (sphere(5), at(x=4.0))])
    world.moving_objects = (2,)
    tracer.build(world)
    still = tracer._still  # type: ignore[attr-defined]
    world.set_object_matrix(2, at(x=8.0))
    tracer.update(world, world.advance(0.0))
    hits = tracer.closest_hit(rays_of([[0.1, 0.1, 5], [4.1, 0.1, 5], [8.1, 0.1, 5]], [0, 0, -1]))
    assert np.isfinite(hits.distance).tolist() == [True, False, True]
    assert world.triangle_object[hits.primitive[[0, 2]]].tolist() == [1, 2]
    assert tracer._still is still  # type: ignore[attr-defined]


def test_later_moves_of_the_world_reach_it_only_by_update(tracer: Tracer) -> None:
    """`World.advance` rewrites positions in place: the tracer has its own."""
    world = world_of([(box(), at())])
    tracer.build(world)
    world.set_object_matrix(1, at(x=30.0))
    world.advance(0.0)
    assert np.isfinite(tracer.closest_hit(rays_of([0.1, 0.1, 5.0], [0, 0, -1])).distance).all()


def test_answers_may_be_written_to(tracer: Tracer) -> None:
    """Holes of cut-out surfaces are passed by rewriting hits in place."""
    tracer.build(few_triangles())
    rays = rays_between([-2] * 3, [2] * 3, 50, 1)
    hits = tracer.closest_hit(rays)
    before = hits.distance.copy()
    hits.distance[:], hits.primitive[:], hits.barycentric[:] = -1.0, 7, 9.0
    assert np.array_equal(tracer.closest_hit(rays).distance, before)


def test_another_variant_set_in_between_changes_nothing(tracer: Tracer) -> None:
    import mitsuba

    world = few_triangles()
    tracer.build(world)
    rays = rays_between([-2] * 3, [2] * 3, 200, 3)
    before = tracer.closest_hit(rays).primitive.copy()
    mitsuba.set_variant("scalar_rgb")
    assert np.array_equal(tracer.closest_hit(rays).primitive, before)
    tracer.build(world)
    assert np.array_equal(tracer.closest_hit(rays).primitive, before)


def test_tracers_of_several_threads_do_not_disturb_each_other() -> None:
    """Builds, updates and queries of two worlds at the same time, many times."""
    worlds = [few_triangles(seed) for seed in (1, 50)]
    batches = [rays_between([-2] * 3, [2] * 3, count, seed) for seed, count in enumerate((1, 17, 400, 20_000))]
    tracers = [built("mitsuba", world) for world in worlds]
    expected = [[tracer.closest_hit(rays).primitive.copy() for rays in batches] for tracer in tracers]

    def work(turn: int) -> bool:
        which, kind = turn % 2, turn // 2 % len(batches)
        if turn % 10 == 9:
            other = built("mitsuba", worlds[which])
            found = other.closest_hit(batches[kind]).primitive
            other.close()
        else:
            found = tracers[which].closest_hit(batches[kind]).primitive
        return bool(np.array_equal(found, expected[which][kind]))

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(work, range(120)))


def test_after_close_there_is_no_scene(tracer: Tracer) -> None:
    tracer.build(few_triangles())
    tracer.close()
    with pytest.raises(PhrtError, match="call build first"):
        tracer.closest_hit(rays_of([0, 0, 0], [0, 0, 1]))


def test_it_says_what_runs(tracer: Tracer) -> None:
    import mitsuba

    said = tracer.capabilities.description
    assert said.startswith(f"Mitsuba {mitsuba.__version__}, ")
    assert "_ad_rgb with " in said


def test_the_number_of_threads_is_the_one_asked_for() -> None:
    import drjit

    before = drjit.thread_count()
    try:
        tracer: Tracer = get_registry().create("tracer", "mitsuba", {"device": "llvm", "threads": 1})
        assert tracer.capabilities.description.endswith(", 1 thread")
        tracer.build(few_triangles())
        assert tracer.occluded(rays_between([-2] * 3, [2] * 3, 20_000, 1)).any()
        tracer.close()
    finally:
        drjit.set_thread_count(before)
    assert drjit.thread_count() == before
