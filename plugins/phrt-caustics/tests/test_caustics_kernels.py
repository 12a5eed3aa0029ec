"""The kernels against what they stand for: the map of directions, the projection map, the lattice, the hash grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from caustics_kit import MATERIALS, RADIUS, flat
from phrt_caustics.casters import caster_triangles
from phrt_caustics.emission import FIBONACCI, Aims, aimed, batches, spread, started, tiling
from phrt_caustics.kernels.emission import CELLS, SIDE, cell_at, interleaved, parted, sphere_to_square, square_to_sphere
from phrt_caustics.kernels.photons import Landed
from phrt_caustics.kernels.splat import SAME_SIDE, THICKNESS, collect, crowd
from phrt_caustics.splat import splats_of

from phrt.model import Light
from phrt.testing.worlds import at, quad, sphere, world_of
from phrt.world import World


def lit_by(light: Light, place: np.ndarray) -> World:
    """A ball of glass, a mirror on the wall, and one light."""
    wall = at(x=-1.5, y=1.0)
    wall[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    placed = [(quad(0, half=4.0), flat()), (sphere(24, RADIUS, 2), at(y=1.0)), (quad(1, half=0.6), wall)]
    return world_of(placed, MATERIALS, lights=[(light, place)])


def corners_of(world: World) -> np.ndarray:
    return world.positions[world.triangles[caster_triangles(world, 0.3)]].astype(np.float64)


def landed(count: int, seed: int) -> tuple[Landed, np.ndarray]:
    """Photons on the ground and on a wall, and radii of very different sizes."""
    random = np.random.default_rng(seed)
    position = random.uniform(-1, 1, (count, 3)).astype(np.float32)
    normal = np.zeros((count, 3), np.float32)
    upright = random.random(count) < 0.3
    position[~upright, 1], normal[~upright, 1] = 0.0, 1.0
    position[upright, 0], normal[upright, 0] = -1.0, 1.0
    flux = random.uniform(0, 1, (count, 3)).astype(np.float32)
    number = np.arange(count, dtype=np.int32)
    radius = (0.003 * 100 ** random.random(count)).astype(np.float32)
    return Landed(position, normal, flux, number.astype(np.uint32), number, number), radius


def test_directions_and_squares_are_each_other_s_inverse_and_areas_stay_equal() -> None:
    random = np.random.default_rng(1)
    places = random.random((20000, 2))
    directions = np.array([square_to_sphere(a, b) for a, b in places])
    assert np.linalg.norm(directions, axis=1) == pytest.approx(np.ones(20000))
    back = np.array([sphere_to_square(*direction) for direction in directions])
    assert np.abs(back - places).max() < 1e-6
    # Evenly over the square is evenly over the sphere: every coordinate is spread evenly (Archimedes).
    for axis in range(3):
        counts = np.histogram(directions[:, axis], bins=10, range=(-1, 1))[0]
        assert np.abs(counts - 2000).max() < 200


def test_places_on_the_curve_come_back() -> None:
    for column, row in ((0, 0), (3, 5), (SIDE - 1, SIDE - 1), (100, 7)):
        assert parted(interleaved(column, row, 8), 8) == (column, row)
    assert sorted(interleaved(c, r, 2) for c in range(4) for r in range(4)) == list(range(16))


@pytest.mark.parametrize("kind", ["point", "directional"])
def test_every_direction_that_meets_a_caster_is_marked_and_few_others(kind: str) -> None:
    place = at(1.0, 3.0, 0.5)
    place[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    world = lit_by(Light(kind), place)  # type: ignore[arg-type]
    corners = corners_of(world)
    beam = aimed(world, 0, corners)
    # Random points of the casters, seen from the light.
    random = np.random.default_rng(2)
    weights = random.dirichlet((1, 1, 1), len(corners))
    points = np.einsum("tk,tkc->tc", weights, corners)
    towards = points - beam.origin
    if kind == "directional":
        squares = towards @ beam.axes[:2].T / beam.side
    else:
        squares = np.array([sphere_to_square(*(v / np.linalg.norm(v))) for v in towards])
    cells = [cell_at(a, b) for a, b in squares]
    assert np.isfinite(beam.reach[cells]).all()
    marked = np.isfinite(beam.reach).sum()
    if kind == "point":
        # The ball's cap and the mirror's solid angle, and a cell around them.
        distance = np.linalg.norm(np.array([1.0, 2.0, 0.5]))
        cap = (1 - np.sqrt(1 - (RADIUS / distance) ** 2)) / 2 * CELLS
        assert cap < marked < 3 * cap + 400
        assert beam.reach[cells].min() > distance - RADIUS - 0.01


def test_photons_are_as_many_as_asked_for_and_evenly_spread() -> None:
    world = lit_by(Light("point"), at(1.0, 3.0, 0.5))
    bare = aimed(world, 0, corners_of(world))
    cells = int(np.isfinite(bare.reach).sum())
    for wanted in (300, 3000, 40000):
        beam = spread(bare, wanted)
        assert 0.8 < beam.count / wanted < 1.25
        assert beam.share * beam.count == pytest.approx(cells / CELLS, rel=0.1 if wanted < 1000 else 0.02)
        assert np.isfinite(beam.reach[[cell_at(a, b) for a, b in beam.place]]).all()
        _, direction, power = started(world, beam, 0, beam.count)
        assert np.linalg.norm(direction, axis=1) == pytest.approx(np.ones(beam.count), rel=1e-5)
        assert power == pytest.approx(np.full(beam.count, 4 * np.pi * beam.share), rel=1e-4)
    # No two are nearer than half of what they would be apart on a square grid.
    apart = np.sqrt(beam.share)
    some = beam.place[:2000]
    distance = np.linalg.norm(some[:, None] - some[None], axis=2) + np.eye(len(some))
    assert distance.min() > 0.5 * apart


def test_a_lattice_has_nearly_the_density_that_is_asked_for() -> None:
    for density in (0.01, 0.3, 1.0, 7.0, 150.0):
        bits, number = tiling(density)
        assert 0.85 < FIBONACCI[number] / 4.0**bits / density < 1.2


def test_photons_of_extended_lights_carry_the_same_power_to_the_same_place() -> None:
    place = at(1.0, 3.0, 0.5)
    place[:3, :3] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]]
    for kind, changes in (("sphere", {"radius": 0.2}), ("directional", {"angle": 0.1})):
        totals = []
        for light in (Light(kind), replace(Light(kind), **changes)):  # type: ignore[arg-type]
            world = lit_by(light, place)
            beam = spread(aimed(world, 0, corners_of(world)), 3000)
            origin, direction, power = started(world, beam, 0, beam.count)
            totals.append(float(power.sum()))
        assert totals[1] == pytest.approx(totals[0], rel=0.03)
        assert np.ptp(origin, axis=0).max() > 0.1 or np.ptp(direction, axis=0).max() > 0.05


def test_directions_are_found_anew_when_lights_or_casters_moved() -> None:
    world, aims = lit_by(Light("directional"), at()), Aims(0.3)
    first = aims.batches(world, 500)
    assert aims.batches(world, 500)[0].beam.reach is first[0].beam.reach
    world.set_object_matrix(1, at(y=-9.0))  # the ground, which throws nothing
    world.advance(0.0)
    again = aims.batches(world, 500)[0].beam
    assert again.reach is first[0].beam.reach
    assert again.back > first[0].beam.back  # further off than anything
    world.set_object_matrix(2, at(y=1.5))
    world.advance(0.0)
    moved = aims.batches(world, 500)
    assert moved[0].beam.reach is not first[0].beam.reach
    fresh = batches(world, 500, 0.3)
    assert np.array_equal(moved[0].beam.place, fresh[0].beam.place)
    assert np.array_equal(moved[0].beam.reach, fresh[0].beam.reach)


def test_a_pixel_finds_every_splat_over_it_once() -> None:
    photons, radius = landed(3000, seed=5)
    splats = splats_of(photons, radius)
    assert splats is not None
    random = np.random.default_rng(6)
    points = random.uniform(-1, 1, (400, 3)).astype(np.float32)
    points[:200, 1], points[200:, 0] = 0.0, -1.0 + 0.002
    normals = np.zeros((400, 3), np.float32)
    normals[:200, 1], normals[200:, 0] = 1.0, 1.0
    normals[:20, 1] = -1.0  # the dark side
    out = np.empty((400, 3), np.float32)
    collect(np.arange(400, dtype=np.int32), points, normals, *splats, out)
    away = points[:, None].astype(np.float64) - photons.position[None]
    off = (away * photons.normal[None]).sum(axis=2) / radius
    across = (away**2).sum(axis=2) / radius**2 - off**2
    over = (across < 1) & (np.abs(off) < THICKNESS) & (normals @ photons.normal.T >= SAME_SIDE)
    weight = np.where(over, (1 - across) * 2 / np.pi / radius.astype(np.float64) ** 2, 0)
    np.testing.assert_allclose(out, weight @ photons.flux, rtol=2e-3, atol=1e-3 * out.max())
    assert (out[20:] > 0).any(axis=1).mean() > 0.5
    assert not out[:20].any()


def test_how_crowded_it_is_is_found_from_few() -> None:
    photons, _ = landed(4000, seed=7)
    splats = splats_of(photons, np.full(4000, 0.3, np.float32))
    assert splats is not None
    density = np.empty(4000, np.float32)
    crowd(*splats, density)
    ground = (photons.normal[:, 1] == 1) & (np.abs(photons.position[:, [0, 2]]).max(axis=1) < 0.7)
    on_ground = np.count_nonzero(photons.normal[:, 1] == 1)
    assert density[ground].mean() == pytest.approx(on_ground / 4, rel=0.05)
    assert density[ground].std() < 0.3 * density[ground].mean()


def test_nothing_landed_is_no_splats() -> None:
    photons, radius = landed(0, seed=1)
    assert splats_of(photons, radius) is None
