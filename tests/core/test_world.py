"""The world at a time: what moved, lights, materials and masks."""

from __future__ import annotations

import numpy as np
import pytest
from scene_kit import GLASS, LAMBERT, MIRROR, Stage, at, box, quad, turned

from phrt.lights import DIRECTIONAL, RECT, SPHERE, SPOT
from phrt.materials import absorption
from phrt.model import Light, Material, TextureRef, Track
from phrt.scene import Scene
from phrt.world import World


def moving() -> Scene:
    """A box that rises a metre a second, a box that stands still, and a lamp that follows the first from t = 1 on."""
    made = Stage().add("/lift", box(), MIRROR).add("/still", box(), GLASS, at(5, 0, 0), casts_shadow=False)
    made.light("point", at(0, 2, 0), intensity=2.0, color=(1.0, 0.5, 0.25)).camera((0, 0, 5), (0, 0, 0))
    rise = np.array([[0.0, 0, 0], [0, 10, 0]])
    made.scene.tracks = [
        Track(0, "translation", np.array([0.0, 10.0]), rise),
        Track(2, "translation", np.array([1.0, 11.0]), rise),
    ]
    return made.scene


def test_advance_says_what_moved_and_moves_only_that() -> None:
    world = World(moving())
    still = world.positions[world.triangles[world.triangle_object == 2]].copy()
    assert not world.advance(0.0)
    changes = world.advance(0.5)
    assert (changes.objects, changes.lights) == ((1,), False)
    assert bool(changes)
    np.testing.assert_allclose(world.object_bounds()[0][1], [-0.5, 0.0, -0.5], atol=1e-6)
    np.testing.assert_array_equal(world.positions[world.triangles[world.triangle_object == 2]], still)
    changes = world.advance(2.0)
    assert (changes.objects, changes.lights) == ((1,), True)
    np.testing.assert_allclose(world.lights["position"], [[0, 1, 0]], atol=1e-6)
    assert not world.advance(2.0)


def test_going_back_in_time_gives_the_same_world() -> None:
    world, fresh = World(moving()), World(moving(), time=3.0)
    for time in (1.0, 7.0, 3.0):
        world.advance(time)
    np.testing.assert_array_equal(world.positions, fresh.positions)
    np.testing.assert_array_equal(world.normals, fresh.normals)
    assert world.lights.tobytes() == fresh.lights.tobytes()


def test_an_object_put_somewhere_stays_there_until_given_back() -> None:
    world = World(moving())
    world.set_object_matrix(1, at(0, 0, 9))
    assert world.advance(0.0).objects == (1,)
    assert world.advance(5.0).objects == ()
    np.testing.assert_allclose(world.object_matrix[1], at(0, 0, 9))
    world.set_object_matrix(1, None)
    assert world.advance(5.0).objects == (1,)
    np.testing.assert_allclose(world.object_matrix[1], at(0, 5, 0))


def test_masks_say_who_casts_shadows_and_who_lets_light_through() -> None:
    world = World(moving())
    assert world.object_count == 2
    assert world.object_casts_shadow.tolist() == [False, True, False]
    assert world.object_opaque[1:].tolist() == [True, False]
    assert world.object_has(world.materials["metallic"] == 1).tolist() == [False, True, False]
    assert not world.has_cutouts


@pytest.mark.parametrize(("mode", "cut"), [("OPAQUE", False), ("MASK", True), ("BLEND", True)])
def test_only_materials_in_use_make_cutouts(mode: str, cut: bool) -> None:
    made = Stage().add("/a", quad(), Material(alpha_mode=mode))  # type: ignore[arg-type]
    assert World(made.scene).has_cutouts is cut
    made = Stage().add("/a", quad(), LAMBERT)
    made.scene.materials.append(Material(alpha_mode="MASK"))
    assert not World(made.scene).has_cutouts


def test_bounds_and_an_empty_world() -> None:
    world = World(moving())
    low, high = world.bounds()
    np.testing.assert_allclose(low, [-0.5, -0.5, -0.5], atol=1e-6)
    np.testing.assert_allclose(high, [5.5, 0.5, 0.5], atol=1e-6)
    empty = World(Scene("empty"))
    np.testing.assert_array_equal(empty.bounds(), [[-0.5] * 3, [0.5] * 3])
    assert empty.object_count == 0
    assert not empty.advance(1.0)


def lit(kind: str, matrix: np.ndarray, **values: object) -> np.void:
    return World(Stage().light(kind, matrix, **values).scene).lights[0]


def test_lights_shine_down_their_minus_z_and_scale_with_their_node() -> None:
    turn = at(1, 2, 3) @ turned("x", -90)
    sun = lit("directional", turn, intensity=3.0, angle=0.02, color=(1.0, 0.5, 0.0))
    assert sun["kind"] == DIRECTIONAL
    np.testing.assert_allclose(sun["direction"], [0, -1, 0], atol=1e-6)
    np.testing.assert_allclose(sun["color"], [3, 1.5, 0])
    assert sun["tan_half_angle"] == pytest.approx(np.tan(0.01))
    spot = lit("spot", turn, inner_angle=0.2, outer_angle=0.4, range=8.0)
    assert spot["kind"] == SPOT
    np.testing.assert_allclose([spot["cos_inner"], spot["cos_outer"]], np.cos([0.2, 0.4]), rtol=1e-6)
    assert spot["inverse_range"] == pytest.approx(1 / 8)
    np.testing.assert_allclose(spot["position"], [1, 2, 3])
    sphere = lit("sphere", turn @ np.diag([2.0, 2, 2, 1]), radius=0.5)
    assert (sphere["kind"], sphere["radius"]) == (SPHERE, pytest.approx(1.0))
    rect = lit("rect", turn @ np.diag([3.0, 1, 1, 1]), size=(2.0, 1.0))
    assert rect["kind"] == RECT
    np.testing.assert_allclose([rect["half_u"], rect["half_v"]], [[3, 0, 0], [0, 0, -0.5]], atol=1e-6)
    assert lit("point", turn)["inverse_range"] == 0
    assert lit("point", turn, casts_shadow=False)["casts_shadow"] == 0
    assert Light("point").range == np.inf


def test_the_default_material_is_row_zero_and_used_for_minus_one() -> None:
    made = Stage().add("/a", quad(), LAMBERT)
    made.scene.meshes[0].triangle_material[:] = [-1, 0]
    world = World(made.scene)
    assert world.triangle_material.tolist() == [0, 1]
    assert world.materials["specular"].tolist() == [1, 0]
    assert world.materials["roughness"][0] == 1


def test_absorption_reaches_the_attenuation_colour_at_its_distance() -> None:
    color, distance = (0.5, 0.9, 0.1), 0.3
    coefficients = np.array(absorption(Material(attenuation_color=color, attenuation_distance=distance)))
    np.testing.assert_allclose(np.exp(-coefficients * distance), color)
    assert absorption(Material(attenuation_color=color)) == (0, 0, 0)
    assert np.isfinite(absorption(Material(attenuation_color=(0, 0, 0), attenuation_distance=0.1))).all()


def test_textures_are_shared_where_they_are_the_same() -> None:
    made = Stage()
    image = made.image(np.zeros((4, 4, 4)))
    ref = TextureRef(image)
    for index, wrap in enumerate(("repeat", "repeat", "clamp")):
        made.add(f"/{index}", quad(), Material(base_color_texture=TextureRef(image, wrap_s=wrap), normal_texture=ref))  # type: ignore[arg-type]
    world = World(made.scene)
    rows = world.materials["base_color_texture"][1:]
    assert rows[0] == rows[1] != rows[2]
    assert len(set(world.materials["normal_texture"][1:])) == 1
    # One pyramid for colour, one for data: 16 + 4 + 1 texels each.
    assert len(world.textures.texels) == 2 * 21
