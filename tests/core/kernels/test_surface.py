"""The surface kernel against a plain numpy twin, on a random soup of triangles with every attribute."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kernel_kit import dot, unit
from scene_kit import Stage, at, mesh_of, turned

from phrt.conventions import NO_PRIMITIVE
from phrt.kernels.arrays import SurfaceArrays, empty_surfaces, geometry_arrays, material_arrays
from phrt.kernels.surface import surface
from phrt.model import Material, TextureRef
from phrt.world import World

COUNT = 500
EYE, FORWARD = np.float32([0.5, 1.0, 6.0]), np.float32([0.0, 0.0, -1.0])
MATERIALS = (
    Material(base_color=(0.2, 0.4, 0.6, 1.0), metallic=0.3, roughness=0.7),
    Material(base_color=(0.9, 0.5, 0.1, 0.4), alpha_mode="BLEND", double_sided=True, emissive=(1.0, 2.0, 3.0)),
    Material(transmission=0.8, thickness=1.0, roughness=0.05, double_sided=True),
    Material(base_color=(0.3, 0.2, 0.1, 1.0), unlit=True, emissive=(5.0, 5.0, 5.0)),
    Material(base_color=(1.0, 1.0, 1.0, 0.3), alpha_mode="MASK", alpha_cutoff=0.25, double_sided=True),
)


def soup(*, colors: bool = True) -> World:
    rng = np.random.default_rng(1)
    made = Stage()
    for index, material in enumerate(MATERIALS):
        positions = rng.normal(size=(60, 3))
        mesh = mesh_of(positions, np.arange(60), uv0=rng.uniform(0, 1, (60, 2)).astype(np.float32))
        mesh.normals = unit(positions).astype(np.float32)
        mesh.colors = rng.uniform(0, 1, (60, 4)).astype(np.float32) if colors else None
        made.add(f"/{index}", mesh, material, at(index * 0.3, 0, 0) @ turned("y", 40 * index))
    return World(made.scene)


def hits(world: World) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(2)
    primitive = rng.integers(0, len(world.triangles), COUNT).astype(np.uint32)
    primitive[rng.random(COUNT) < 0.1] = NO_PRIMITIVE
    weights = rng.dirichlet([1, 1, 1], COUNT)[:, 1:].astype(np.float32)
    return unit(rng.normal(size=(COUNT, 3))).astype(np.float32), primitive, weights


def run(world: World, eye_ray: bool) -> tuple[SurfaceArrays, np.ndarray, int, np.ndarray]:
    direction, primitive, weights = hits(world)
    target = np.random.default_rng(3).permutation(COUNT).astype(np.int32)
    out, passed = empty_surfaces(COUNT), np.full(COUNT, 9, np.uint8)
    going_on = surface(
        direction, np.ones(COUNT, np.float32), primitive, weights, geometry_arrays(world), material_arrays(world), EYE,
        FORWARD, np.float32([0, 0.001]), np.zeros(world.object_count + 1, np.uint8), eye_ray,
        np.random.default_rng(4).permutation(COUNT).astype(np.int32), target, out, passed,
    )  # fmt: skip
    return out, passed, going_on, target


@pytest.mark.parametrize("eye_ray", [True, False])
@pytest.mark.parametrize("colors", [True, False])
def test_hits_become_the_surface_points_their_twin_computes(eye_ray: bool, colors: bool) -> None:
    world = soup(colors=colors)
    out, passed, going_on, target = run(world, eye_ray)
    direction, primitive, weights = (a.astype(float) if a.dtype == np.float32 else a for a in hits(world))
    hit = primitive != NO_PRIMITIVE
    p = np.where(hit, primitive, 0)
    corners, w = world.triangles[p], np.c_[1 - weights.sum(axis=1), weights]

    def mixed(attribute: np.ndarray) -> np.ndarray:
        return np.einsum("nc,nck->nk", w, attribute[corners].astype(float))

    a, b, c = np.moveaxis(world.positions[corners].astype(float), 1, 0)
    geometric = unit(np.cross(b - a, c - a))
    behind = dot(geometric, direction) > 0
    turn = np.where(behind, -1.0, 1.0)[:, None]
    m = world.materials[world.triangle_material[p]]
    color = np.stack([m["base_r"], m["base_g"], m["base_b"], m["alpha"]], axis=1).astype(float)
    if colors:
        color = color * mixed(world.colors)
    hole = (m["alpha_mode"] == 1) & (color[:, 3] < m["alpha_cutoff"])
    gone = hit & ((behind & (m["double_sided"] == 0)) | hole) & eye_ray

    np.testing.assert_array_equal(passed, gone)
    assert going_on == gone.sum()
    assert not eye_ray or going_on > 50
    kept = hit & ~gone
    rows = target[kept]
    position = mixed(world.positions)
    expected = {
        "position": position,
        "geometric_normal": geometric * turn,
        "normal": unit(mixed(world.normals)) * turn,
        "uv": mixed(world.uv0),
        "depth": (position - EYE) @ FORWARD,
        "object_id": world.triangle_object[p],
        "primitive_id": primitive,
        "material_id": world.triangle_material[p],
        "base_color": color[:, :3],
        "alpha": np.where(m["alpha_mode"] == 2, color[:, 3], 1.0),
        "metallic": m["metallic"],
        "roughness": m["roughness"],
        "transmission": m["transmission"],
        "emissive": np.where(
            (m["unlit"] != 0)[:, None],
            color[:, :3],
            np.stack([m["emissive_r"], m["emissive_g"], m["emissive_b"]], axis=1),
        ),
    }
    for name, values in expected.items():
        np.testing.assert_allclose(getattr(out, name)[rows], values[kept], atol=3e-4, err_msg=name)


def test_misses_get_the_clear_values_of_the_channel_table() -> None:
    from phrt.channels import CHANNELS
    from phrt.kernels.arrays import CHANNEL_OF

    world = soup()
    out, _, _, target = run(world, True)
    rows = target[hits(world)[1] == NO_PRIMITIVE]
    assert len(rows) > 20
    for name in SurfaceArrays._fields:
        clear = CHANNELS[CHANNEL_OF.get(name, name)].clear
        assert np.all(getattr(out, name)[rows] == clear), name


def test_a_normal_map_bends_the_normal_in_the_tangent_frame() -> None:
    made = Stage()
    # A constant map that leans by (0.6, 0, 0.8): 0.6 along the tangent, which is +Y here.
    texel = np.round((np.array([0.6, 0.0, 0.8]) + 1) / 2 * 255)
    image = made.image([[[*texel, 255]]])
    triangle = mesh_of([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], uv0=np.zeros((3, 2), np.float32))
    triangle.normals = np.tile(np.float32([0, 0, 1]), (3, 1))
    triangle.tangents = np.tile(np.float32([0, 1, 0, 1]), (3, 1))
    world = World(made.add("/t", triangle, Material(normal_texture=TextureRef(image))).scene)

    def normal(scale: float, towards: float, hand: float = 1.0) -> np.ndarray:
        world.materials["normal_scale"] = scale
        world.tangents[:, 3] = hand
        out = empty_surfaces(1)
        surface(
            np.float32([[0, 0, towards]]), np.ones(1, np.float32), np.zeros(1, np.uint32), np.float32([[0.2, 0.2]]),
            geometry_arrays(world), material_arrays(world), EYE, FORWARD, np.zeros(2, np.float32),
            np.zeros(world.object_count + 1, np.uint8), False, np.zeros(1, np.int32), np.zeros(1, np.int32), out,
            np.empty(1, np.uint8),
        )  # fmt: skip
        return out.normal[0]

    np.testing.assert_allclose(normal(1.0, -1), [0, 0.6, 0.8], atol=0.01)
    np.testing.assert_allclose(normal(0.0, -1), [0, 0, 1], atol=0.01)
    np.testing.assert_allclose(normal(2.0, -1), unit(np.array([0, 1.2, 0.8])), atol=0.01)
    np.testing.assert_allclose(normal(1.0, 1), [0, -0.6, -0.8], atol=0.01)
    # The bitangent is cross(normal, tangent) times the tangent's w; a lean along it changes sign with w.
    made.scene.images[0].pixels[:] = [*np.round((np.array([0.0, 0.6, 0.8]) + 1) / 2 * 255), 255]
    world = World(replace(made.scene))
    np.testing.assert_allclose(normal(1.0, -1, 1.0), [-0.6, 0, 0.8], atol=0.01)
    np.testing.assert_allclose(normal(1.0, -1, -1.0), [0.6, 0, 0.8], atol=0.01)


def test_hidden_objects_are_passed_by_every_ray() -> None:
    world = soup(colors=False)
    direction, primitive, weights = hits(world)
    hidden = np.ones(world.object_count + 1, np.uint8)
    out, passed = empty_surfaces(COUNT), np.empty(COUNT, np.uint8)
    going_on = surface(
        direction, np.ones(COUNT, np.float32), primitive, weights, geometry_arrays(world), material_arrays(world), EYE,
        FORWARD, np.float32([0, 0.001]), hidden, False, np.arange(COUNT, dtype=np.int32),
        np.arange(COUNT, dtype=np.int32), out, passed,
    )  # fmt: skip
    assert going_on == np.count_nonzero(primitive != NO_PRIMITIVE) > 0
    np.testing.assert_array_equal(passed != 0, primitive != NO_PRIMITIVE)
