"""Pictures with answers that can be computed, through every tracer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scene_kit import (
    GLASS,
    LAMBERT,
    MIRROR,
    TRACERS,
    Stage,
    at,
    ball,
    box,
    floor,
    mesh_of,
    need_tracer,
    pixel_centres,
    quad,
    render,
    turned,
)

from phrt.camera import look_at
from phrt.model import Material, TextureRef

DOWN = turned("x", -90)
"""What turns a light's -Z to the floor."""
DIFFUSE = 0.5 / np.pi
"""Radiance per unit of irradiance of LAMBERT."""
CLEAR = {"refractions": {"max_depth": 12}, "reflections": {"max_depth": 8}}


@pytest.fixture(params=TRACERS)
def tracer(request: pytest.FixtureRequest) -> str:
    return need_tracer(request.param)


def unlit(*color: float) -> Material:
    """Shows its colour, whatever the light; from both sides."""
    return Material(base_color=(*color, 1.0), unlit=True, double_sided=True)  # type: ignore[arg-type]


def from_above(made: Stage, height: float, eye: float = 5.0) -> Stage:
    """An orthographic camera over the floor: x to the right, z down the picture, `height` metres both ways."""
    return made.camera((0, eye, 0), (0, 0, 0), ortho_height=height)


def floor_points(count: int, height: float) -> tuple[np.ndarray, np.ndarray]:
    """x, z (count, count) of the floor points `from_above` sees."""
    return tuple(np.meshgrid(*(pixel_centres(count, -height / 2, height / 2),) * 2))  # type: ignore[return-value]


def orthographic_rays(made: Stage, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Origins (count, count, 3) and the direction (3,) of the first camera's pixels."""
    camera = made.scene.cameras[0]
    matrix, height = made.scene.nodes[camera.node].matrix, camera.lens.ortho_height
    assert height is not None
    across = pixel_centres(count, -height / 2, height / 2)
    origin = matrix[:3, 3] + across[None, :, None] * matrix[:3, 0] - across[:, None, None] * matrix[:3, 1]
    return origin, -matrix[:3, 2]


def fresnel(cosine: np.ndarray, ior: float) -> np.ndarray:
    """Unpolarised reflectance of a dielectric, from Snell's and Fresnel's equations."""
    sine = np.sqrt(1 - cosine**2)
    behind = np.sqrt(1 - (sine / ior) ** 2)
    s = (cosine - ior * behind) / (cosine + ior * behind)
    p = (behind - ior * cosine) / (behind + ior * cosine)
    return (s**2 + p**2) / 2


# --- lights ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("height", [0.5, 1.0, 3.0])
def test_point_light_falls_off_with_the_square_of_distance_and_the_cosine(tracer: str, height: float) -> None:
    made = from_above(Stage().add("/floor", floor()), 4.0)
    made.light("point", at(0.2, height, -0.3), intensity=7.0, color=(1.0, 0.5, 0.25))
    image = made.render((24, 24), tracer=tracer).image
    x, z = floor_points(24, 4.0)
    square = (x - 0.2) ** 2 + (z + 0.3) ** 2 + height**2
    expected = DIFFUSE * 7.0 * height / square**1.5
    np.testing.assert_allclose(image, expected[..., None] * [1.0, 0.5, 0.25], rtol=1e-3)


@pytest.mark.parametrize("degrees", [0.0, 30.0, 75.0])
def test_directional_light_gives_lux_times_cosine(tracer: str, degrees: float) -> None:
    made = from_above(Stage().add("/floor", floor()), 4.0)
    made.light("directional", turned("z", degrees) @ DOWN, intensity=3.0)
    image = made.render((8, 8), tracer=tracer).image
    np.testing.assert_allclose(image, DIFFUSE * 3.0 * np.cos(np.radians(degrees)), rtol=1e-4)


def test_spot_light_is_full_inside_its_inner_cone_and_dark_outside_its_outer_one(tracer: str) -> None:
    inner, outer = 0.3, 0.5
    made = from_above(Stage().add("/floor", floor()), 4.0)
    made.light("spot", at(0, 2, 0) @ DOWN, intensity=5.0, inner_angle=inner, outer_angle=outer)
    image = made.render((48, 48), tracer=tracer).image[..., 0]
    x, z = floor_points(48, 4.0)
    square = x**2 + z**2 + 4.0
    cosine = 2.0 / np.sqrt(square)
    full = DIFFUSE * 5.0 * cosine / square
    angle = np.arccos(cosine)
    assert np.all(image[angle > outer] == 0)
    np.testing.assert_allclose(image[angle < inner], full[angle < inner], rtol=1e-3)
    between = (angle > inner + 0.02) & (angle < outer - 0.02)
    assert between.any()
    # KHR_lights_punctual: the square of the linear ramp in the cosine.
    ramp = (cosine - np.cos(outer)) / (np.cos(inner) - np.cos(outer))
    np.testing.assert_allclose(image[between], (full * ramp**2)[between], rtol=1e-2)


def test_rect_light_far_away_gives_nits_times_solid_angle(tracer: str) -> None:
    made = from_above(Stage().add("/floor", floor()), 0.5)
    made.light("rect", at(0, 20, 0) @ DOWN, intensity=1000.0, size=(2.0, 0.5))
    image = made.render((4, 4), tracer=tracer).image
    np.testing.assert_allclose(image, DIFFUSE * 1000.0 * 1.0 / 400.0, rtol=1e-2)


def test_a_light_below_the_surface_brings_nothing(tracer: str) -> None:
    made = from_above(Stage().add("/floor", floor()), 4.0).light("point", at(0, -1, 0), intensity=100.0)
    assert not made.render((8, 8), tracer=tracer).image.any()


# --- shadows --------------------------------------------------------------------------------------------------------


def boxed(**switches: Any) -> Stage:
    """A unit box from y = 1 to 2 over a floor, seen from above."""
    made = Stage().add("/floor", floor(20)).add("/box", box(), LAMBERT, at(0, 1.5, 0), **switches)
    return from_above(made, 4.0)


def test_shadow_of_a_box_under_a_point_light_ends_where_similar_triangles_say(tracer: str) -> None:
    frame = boxed().light("point", at(0.3, 4, -0.2), intensity=50.0).render((64, 64), tracer=tracer)
    x, z = floor_points(64, 4.0)
    # The top face, half way between light and floor, decides: its edges move twice as far from the light's foot.
    inside = (x > 0.3 - 0.8 * 2) & (x < 0.3 + 0.2 * 2) & (z > -0.2 - 0.3 * 2) & (z < -0.2 + 0.7 * 2)
    on_floor = frame.gbuffer.object_id == 1
    dark = frame.image[..., 0] == 0
    assert (inside & on_floor).sum() > 500
    np.testing.assert_array_equal(dark[on_floor], inside[on_floor])


def test_shadow_of_a_box_under_the_sun_is_moved_by_its_height(tracer: str) -> None:
    made = boxed().light("directional", look_at((0, 0, 0), (1, -2, 0)), intensity=3.0)
    frame = made.render((64, 64), tracer=tracer)
    x, z = floor_points(64, 4.0)
    inside = (x > 0.0) & (x < 1.5) & (np.abs(z) < 0.5)
    on_floor = frame.gbuffer.object_id == 1
    assert (inside & on_floor).sum() > 200
    np.testing.assert_array_equal((frame.image[..., 0] == 0)[on_floor], inside[on_floor])


def test_a_light_in_front_of_the_wall_behind_it_is_not_blocked_by_that_wall(tracer: str) -> None:
    """A shadow ray ends at the light."""
    made = Stage().add("/floor", floor()).add("/roof", floor(), LAMBERT, at(0, 2.2, 0) @ turned("x", 180))
    made.light("point", at(0, 2, 0), intensity=5.0).camera((0, 1.5, 0), (0, 0, 0), ortho_height=2.0)
    assert np.all(made.render((8, 8), tracer=tracer).image > 0)


@pytest.mark.parametrize("switch", ["casts_shadow", "light", "never", "disabled"])
def test_shadows_can_be_switched_off_at_caster_light_receiver_and_altogether(tracer: str, switch: str) -> None:
    made = boxed(casts_shadow=switch != "casts_shadow")
    made.light("point", at(0.3, 4, -0.2), intensity=50.0, casts_shadow=switch != "light")
    if switch == "never":
        made.scene.objects[0].effects = {"shadows": "never"}
    effects = {"shadows": {"enabled": False}} if switch == "disabled" else {}
    frame = made.render((32, 32), tracer=tracer, effects=effects)
    assert np.all(frame.image[frame.gbuffer.object_id == 1] > 0)


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        ("sphere", {"intensity": 50.0, "radius": 0.3}),
        ("rect", {"intensity": 50.0, "size": (0.6, 0.6)}),
        ("directional", {"intensity": 3.0, "angle": 2 * np.arctan(0.1)}),
    ],
)
def test_penumbra_is_as_wide_and_soft_as_the_light_seen_past_the_edge(
    tracer: str, kind: str, values: dict[str, Any]
) -> None:
    # A screen at y = 1 covers x < 0; the light is 3 m above it, or a sun of the same size: the half width is 0.1 m.
    screen = mesh_of([[-9, 1, 9], [0, 1, 9], [0, 1, -9], [-9, 1, -9]], [[0, 1, 2], [0, 2, 3]])
    made = Stage().add("/floor", floor(20)).add("/screen", screen)
    made.light(kind, at(0, 4, 0) @ DOWN, **values).camera((0, 0.9, 0), (0, 0, 0), ortho_height=0.5)
    share = made.render((32, 32), tracer=tracer, effects={"shadows": {"samples": 64}}).layers["visibility"][..., 0]
    s = np.clip(pixel_centres(32, -0.25, 0.25) / 0.1, -1, 1)
    disc = 1 - (np.arccos(s) - s * np.sqrt(1 - s**2)) / np.pi
    expected = (1 + s) / 2 if kind == "rect" else disc
    assert np.abs(share.mean(axis=0) - expected).max() < 0.02
    assert np.all(share[:, s == -1] == 0)
    assert np.all(share[:, s == 1] == 1)


def test_hard_shadows_of_an_extended_light_come_from_its_centre(tracer: str) -> None:
    frame = boxed().light("sphere", at(0.3, 4, -0.2), intensity=50.0, radius=0.5).render((32, 32), tracer=tracer)
    point = boxed().light("point", at(0.3, 4, -0.2), intensity=50.0).render((32, 32), tracer=tracer)
    np.testing.assert_array_equal(frame.image, point.image)


# --- holes and blending ---------------------------------------------------------------------------------------------


def half_covered(made: Stage, **values: Any) -> Material:
    """Left half opaque, right half empty."""
    image = made.image([[[255, 255, 255, 255], [255, 255, 255, 0]]])
    texture = TextureRef(image, nearest=True, mipmaps=False)
    return replace(LAMBERT, base_color_texture=texture, double_sided=True, **values)


def test_light_and_eye_pass_the_hole_of_an_alpha_mask(tracer: str) -> None:
    made = Stage().add("/floor", floor())
    made.add("/leaf", quad(2, 2), half_covered(made, alpha_mode="MASK"), at(0, 1, 0) @ DOWN)
    made.light("directional", DOWN, intensity=np.pi)
    x = pixel_centres(32, -2.0, 2.0)
    below = made.camera((0, 0.9, 0), (0, 0, 0), ortho_height=4.0).render((32, 32), tracer=tracer)
    shaded = (np.abs(x) < 1)[:, None] & ((x > -1) & (x < 0))[None, :]
    np.testing.assert_array_equal(below.image[..., 0] == 0, shaded)

    made.scene.cameras.clear()
    above = from_above(made, 4.0).render((32, 32), tracer=tracer)
    np.testing.assert_array_equal(above.gbuffer.object_id == 2, shaded)


def test_a_mirror_sees_through_the_hole_of_an_alpha_mask(tracer: str) -> None:
    made = Stage().add("/mirror", floor(), MIRROR).add("/sky", floor(20), unlit(0.2, 0.4, 0.6), at(0, 6, 0))
    made.add("/leaf", quad(2, 2), replace(half_covered(made, alpha_mode="MASK"), unlit=True), at(0, 1, 0) @ DOWN)
    image = made.camera((0, 0.9, 0), (0, 0, 0), ortho_height=1.0).render((16, 16), tracer=tracer).image
    np.testing.assert_allclose(image[:, :8], 0.5, rtol=1e-5)
    np.testing.assert_allclose(image[:, 8:], np.broadcast_to([0.2, 0.4, 0.6], (16, 8, 3)), rtol=1e-5)


@pytest.mark.parametrize("alpha", [0.25, 0.6])
def test_a_blended_surface_covers_by_its_alpha_and_casts_a_shadow_from_half_on(tracer: str, alpha: float) -> None:
    film = Material(base_color=(1, 0, 0, alpha), unlit=True, alpha_mode="BLEND", double_sided=True)
    made = from_above(Stage().add("/floor", floor()).add("/film", quad(2, 2), film, at(0, 1, 0) @ DOWN), 1.0)
    made.light("directional", DOWN, intensity=np.pi)
    image = made.render((8, 8), tracer=tracer).image
    floor_light = 0.0 if alpha >= 0.5 else 0.5
    expected = alpha * np.array([1, 0, 0]) + (1 - alpha) * floor_light
    np.testing.assert_allclose(image, np.broadcast_to(expected, image.shape), rtol=1e-3)


def test_blended_surfaces_behind_each_other_mix_in_order(tracer: str) -> None:
    made = from_above(Stage().add("/floor", floor(), unlit(0, 0, 1)), 1.0)
    for index, color in enumerate([(0, 1, 0), (1, 0, 0)]):
        film = Material(base_color=(*color, 0.5), unlit=True, alpha_mode="BLEND", double_sided=True)
        made.add(f"/film{index}", quad(2, 2), film, at(0, 1 + index, 0) @ DOWN)
    image = made.render((4, 4), tracer=tracer).image
    np.testing.assert_allclose(image, np.broadcast_to([0.5, 0.25, 0.25], image.shape), rtol=1e-4)


# --- mirrors and glass ----------------------------------------------------------------------------------------------


def colored_wall(made: Stage) -> Stage:
    """Four unlit square metres at z = -2, x -1..1, y 0..2: red green above, blue white below."""
    for name, x, y, color in (
        ("a", -1, 1, (1, 0, 0)),
        ("b", 0, 1, (0, 1, 0)),
        ("c", -1, 0, (0, 0, 1)),
        ("d", 0, 0, (1, 1, 1)),
    ):
        made.add(f"/{name}", quad(1, 1), unlit(*color), at(x + 0.5, y + 0.5, -2))
    return made


def wall_color(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """What `colored_wall` shows at x, y."""
    on_wall = (np.abs(x) < 1) & (y > 0) & (y < 2)
    red = ((x < 0) & (y > 1)) | ((x > 0) & (y < 1))
    green = (x > 0).astype(bool)
    blue = y < 1
    return np.stack([red, green, blue], axis=-1) * on_wall[..., None]


def test_a_mirror_shows_each_point_where_the_law_of_reflection_puts_it(tracer: str) -> None:
    made = colored_wall(Stage().add("/mirror", floor(4.5), MIRROR)).camera((0, 3, 3), (0, 0, 0), ortho_height=2.4)
    frame = made.render((40, 40), tracer=tracer)
    origin, direction = orthographic_rays(made, 40)
    point = origin - direction * (origin[..., 1] / direction[1])[..., None]
    reflected = direction * [1, -1, 1]
    hit = point + reflected * ((-2 - point[..., 2]) / reflected[2])[..., None]
    assert np.all(frame.gbuffer.object_id == 1)
    np.testing.assert_allclose(frame.gbuffer.position_world, point, atol=1e-4)
    np.testing.assert_allclose(frame.image, wall_color(hit[..., 0], hit[..., 1]), atol=1e-5)


def test_two_parallel_mirrors_show_what_lies_several_bounces_away(tracer: str) -> None:
    """A ray going up between mirrors at x = -1 and 1 by 45 degrees meets them in turn, then the ceiling."""
    made = Stage().add("/left", quad(8, 8), MIRROR, at(-1, 0, 0) @ turned("y", 90))
    made.add("/right", quad(8, 8), MIRROR, at(1, 0, 0) @ turned("y", -90))
    made.add("/ceiling", floor(2), unlit(0.3, 0.6, 0.9), at(0, 3.5, 0))
    made.camera((0, -1, 0), (1, 0, 0), ortho_height=0.1)
    # It meets x = 1 at y = 0, x = -1 at y = 2, and y = 3.5 on its way back: one bounce after the first reflection.
    for depth, seen in ((0, False), (1, True), (3, True)):
        image = made.render((4, 4), tracer=tracer, effects={"reflections": {"max_depth": depth}}).image
        np.testing.assert_allclose(image, np.broadcast_to([0.3, 0.6, 0.9], image.shape) * seen, rtol=1e-4)


@pytest.mark.parametrize("degrees", [15.0, 40.0, 60.0])
@pytest.mark.parametrize("ior", [1.33, 1.8])
def test_a_slab_displaces_what_lies_behind_by_snells_law(tracer: str, degrees: float, ior: float) -> None:
    thickness, angle = 0.5, np.radians(degrees)
    made = Stage().add("/left", quad(20, 20), unlit(1, 0, 0), at(-10, 0, 0) @ DOWN)
    made.add("/right", quad(20, 20), unlit(0, 1, 0), at(10, 0, 0) @ DOWN)
    made.add("/slab", box(20, thickness, 20), replace(GLASS, ior=ior), at(0, 1.25, 0))
    made.camera((-8 * np.tan(angle), 8, 0), (0, 0, 0), ortho_height=1.6)
    image = made.render((40, 40), tracer=tracer, effects=CLEAR).image
    origin, direction = orthographic_rays(made, 40)
    straight = (origin - direction * (origin[..., 1] / direction[1])[..., None])[..., 0]
    inside = np.arcsin(np.sin(angle) / ior)
    x = straight - thickness * (np.tan(angle) - np.tan(inside))
    clear = np.abs(x) > 2e-3
    assert (clear & (x < 0)).any()
    assert (clear & (x > 0) & (straight > 0)).any()
    np.testing.assert_array_equal((image[..., 0] > image[..., 1])[clear], (x < 0)[clear])
    # Two interfaces and the light that bounces between them: (1 - F) / (1 + F).
    f = fresnel(np.cos(angle), ior)
    np.testing.assert_allclose(image[..., :2].sum(axis=-1)[clear], (1 - f) / (1 + f), rtol=5e-3)


def test_a_thin_wall_does_not_bend_light(tracer: str) -> None:
    made = Stage().add("/left", quad(20, 20), unlit(1, 0, 0), at(-10, 0, 0) @ DOWN)
    made.add("/right", quad(20, 20), unlit(0, 1, 0), at(10, 0, 0) @ DOWN)
    made.add("/pane", floor(20), replace(GLASS, thickness=0.0), at(0, 1, 0))
    made.camera((-8, 8, 0), (0, 0, 0), ortho_height=1.6)
    image = made.render((40, 40), tracer=tracer).image
    origin, direction = orthographic_rays(made, 40)
    x = (origin - direction * (origin[..., 1] / direction[1])[..., None])[..., 0]
    np.testing.assert_array_equal(image[..., 0] > image[..., 1], x < 0)


@pytest.mark.parametrize("ior", [1.1, 1.5, 2.4])
def test_glass_reflects_by_fresnels_equations(tracer: str, ior: float) -> None:
    made = (
        Stage(dome=(1.0, 1.0, 1.0))
        .add("/pane", floor(200), replace(GLASS, ior=ior))
        .camera((0, 1, 0), (0, 0, 0), fov_y=2.8)
    )
    # What comes through is left out, so that the dome's reflection alone is seen.
    frame = made.render((65, 65), tracer=tracer, effects={"refractions": {"enabled": False}})
    on_pane = frame.gbuffer.object_id == 1
    point = frame.gbuffer.position_world[on_pane]
    cosine = 1 / np.linalg.norm(point - [0, 1, 0], axis=1)
    assert cosine.max() > 0.999
    assert cosine.min() < 0.15
    np.testing.assert_allclose(frame.image[on_pane][:, 0], fresnel(cosine, ior), atol=1e-3)


def test_a_polished_dielectric_reflects_four_percent_at_normal_incidence(tracer: str) -> None:
    lacquer = Material(base_color=(0, 0, 0, 1), roughness=0.0)
    made = from_above(Stage(dome=(1.0, 1.0, 1.0)).add("/floor", floor(), lacquer), 1.0)
    np.testing.assert_allclose(made.render((4, 4), tracer=tracer).image, 0.04, rtol=1e-4)


@pytest.mark.parametrize(("ior", "total"), [(1.5, True), (1.45, True), (1.3, False)])
def test_a_prism_turns_light_by_total_internal_reflection(tracer: str, ior: float, total: bool) -> None:
    # In through the front, 45 degrees on the back (critical angle 41.8 for 1.5, 50.3 for 1.3), out at the top.
    corner = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5]])
    vertices = [[x, y, z] for x in (-1, 1) for y, z in corner]
    faces = [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [2, 0, 3], [2, 3, 5], [0, 2, 1], [3, 4, 5]]
    prism = mesh_of(vertices, np.array(faces)[:, ::-1])
    made = Stage().add("/prism", prism, replace(GLASS, ior=ior))
    made.add("/ceiling", floor(20), unlit(1, 0, 0), at(0, 5, 0)).add(
        "/behind", quad(40, 40), unlit(0, 1, 0), at(0, 0, -5)
    )
    made.add("/ground", floor(40), unlit(0, 1, 0), at(0, -5, 0)).camera((0, 0, 3), (0, 0, 0), ortho_height=0.5)
    image = made.render((8, 8), tracer=tracer, effects=CLEAR).image
    f = fresnel(np.array(1.0), ior)
    if total:
        np.testing.assert_allclose(image[..., 0], (1 - f) ** 2, rtol=5e-3)
        assert image[..., 1].max() < 0.01
    else:
        assert image[..., 1].min() > 0.5


def test_absorption_follows_beer_and_lambert(tracer: str) -> None:
    made = Stage().add("/wall", quad(20, 20), unlit(1, 1, 1), at(0, 0, -2))
    color = np.array([0.5, 0.25, 0.8])
    tinted = replace(GLASS, attenuation_color=tuple(color), attenuation_distance=0.1)
    made.add("/slab", box(20, 20, 0.3), tinted).camera((0, 0, 3), (0, 0, 0), ortho_height=1.0)
    image = made.render((4, 4), tracer=tracer, effects=CLEAR).image
    np.testing.assert_allclose(image, np.broadcast_to(0.96**2 * color**3, image.shape), rtol=5e-3)


def test_base_color_tints_glass_at_each_interface(tracer: str) -> None:
    made = Stage().add("/wall", quad(20, 20), unlit(1, 1, 1), at(0, 0, -2))
    tinted = replace(GLASS, base_color=(0.9, 0.5, 0.25, 1.0))
    made.add("/slab", box(20, 20, 0.3), tinted).camera((0, 0, 3), (0, 0, 0), ortho_height=1.0)
    image = made.render((4, 4), tracer=tracer, effects=CLEAR).image
    np.testing.assert_allclose(
        image, np.broadcast_to(np.square([0.96 * c for c in (0.9, 0.5, 0.25)]), image.shape), rtol=5e-3
    )


# --- the dome -------------------------------------------------------------------------------------------------------

WHITES = {
    "diffuse": Material(specular=0.0),
    "rough_metal": Material(metallic=1.0, roughness=0.7),
    "glossy_metal": Material(metallic=1.0, roughness=0.2),
    "mirror": MIRROR,
    "glass": GLASS,
    "thin_glass": replace(GLASS, thickness=0.0),
    "plastic": Material(roughness=0.4),
    "lacquer": Material(roughness=0.0),
    "half_metal": Material(metallic=0.5, roughness=0.5),
    "half_mirror": Material(metallic=0.5, roughness=0.0),
    "blended": Material(base_color=(1, 1, 1, 0.5), alpha_mode="BLEND"),
}


@pytest.mark.parametrize("name", WHITES)
def test_a_white_ball_under_a_white_dome_disappears(tracer: str, name: str) -> None:
    """The furnace: nothing absorbs, so every path brings the dome's radiance."""
    made = Stage(dome=(0.7, 0.7, 0.7)).add("/ball", ball(0.5, 3), WHITES[name]).camera((0, 0, 2), (0, 0, 0), fov_y=0.6)
    frame = made.render((24, 24), tracer=tracer, effects=CLEAR)
    assert 0.3 < (frame.gbuffer.object_id == 1).mean() < 0.9
    np.testing.assert_allclose(frame.image, 0.7, rtol=0.01)


def test_white_things_of_every_kind_together_disappear_too(tracer: str) -> None:
    made = Stage(dome=(0.7, 0.7, 0.7)).add("/floor", floor(40), WHITES["diffuse"], at(0, -0.5, 0))
    for index, name in enumerate(("mirror", "glass", "diffuse", "rough_metal")):
        made.add(f"/{name}", ball(0.5, 2), WHITES[name], at(1.1 * index - 1.65, 0, 0))
    made.camera((0, 1, 4), (0, 0, 0), fov_y=0.8)
    np.testing.assert_allclose(made.render((32, 24), tracer=tracer, effects=CLEAR).image, 0.7, rtol=0.01)


@pytest.mark.parametrize(("radius", "seen"), [(1000.0, True), (0.05, False)])
def test_ambient_occlusion_of_a_floor_beside_a_wall(tracer: str, radius: float, seen: bool) -> None:
    wall = mesh_of([[0, 0, 400], [0, 0, -400], [0, 1, -400], [0, 1, 400]], [[0, 1, 2], [0, 2, 3]])
    made = Stage(dome=(1.0, 1.0, 1.0)).add("/floor", floor(900), Material(specular=0.0)).add("/wall", wall)
    made.camera((1.1, 0.9, 0), (1.1, 0, 0), ortho_height=2.0)
    options = {"ambient_occlusion": {"samples": 256, "radius": radius}}
    share = made.render((12, 12), tracer=tracer, effects=options).layers["ambient_occlusion"][..., 0]
    x = pixel_centres(12, 0.1, 2.1)
    # The view factor of an endless wall of height 1 from a floor point at x.
    expected = 1 - 0.5 * (1 - x / np.sqrt(x**2 + 1)) if seen else np.ones(12)
    assert np.abs(share.mean(axis=0) - expected).max() < 0.01
    assert np.abs(share - expected).max() < 0.03


def test_ambient_occlusion_darkens_the_dome_and_not_the_lights(tracer: str) -> None:
    made = from_above(Stage(dome=(1.0, 1.0, 1.0)).add("/floor", floor()), 1.0, eye=0.4)
    made.add("/roof", floor(1000), LAMBERT, at(0, 0.5, 0))
    made.light("point", at(0, 0.3, 0), intensity=1.0)
    frame = made.render((4, 4), tracer=tracer, effects={"ambient_occlusion": {"samples": 16, "radius": 5000.0}})
    assert not frame.layers["ambient_occlusion"].any()
    np.testing.assert_allclose(frame.image[..., 0], frame.direct[..., 0, 0], rtol=1e-5)
    assert frame.image.min() > 0


# --- textures and switches ------------------------------------------------------------------------------------------


def test_the_first_texel_is_at_the_top_left_and_a_mirror_turns_the_picture(tracer: str) -> None:
    made = Stage()
    colors = np.array([[[255, 0, 0, 255], [0, 255, 0, 255]], [[0, 0, 255, 255], [255, 255, 255, 255]]])
    texture = TextureRef(made.image(colors), nearest=True, mipmaps=False)
    picture = Material(unlit=True, base_color_texture=texture, double_sided=True)
    made.add("/picture", quad(2, 2), picture).camera((0, 0, 3), (0, 0, 0), ortho_height=2.0)
    image = made.render((2, 2), tracer=tracer).image
    np.testing.assert_allclose(image, colors[..., :3] / 255, atol=1e-6)

    # An eye that has its back to the picture sees it in a mirror, left and right changed.
    made.scene.cameras.clear()
    made.add("/mirror", quad(8, 8), MIRROR, at(0, 0, 2) @ turned("y", 180)).camera(
        (0, 0, 1), (0, 0, 2), ortho_height=2.0
    )
    np.testing.assert_allclose(made.render((2, 2), tracer=tracer).image, colors[:, ::-1, :3] / 255, atol=1e-6)


@pytest.mark.parametrize("lens", [{"ortho_height": 2.0}, {"fov_y": 0.4}])
def test_a_texture_in_a_mirror_is_as_sharp_as_seen_straight_from_as_far(tracer: str, lens: dict[str, float]) -> None:
    def made(target: tuple[float, float, float]) -> Stage:
        stage = Stage()
        pixels = np.random.default_rng(1).integers(0, 256, (32, 32, 4))
        pixels[:, :, 3] = 255
        texture = TextureRef(stage.image((pixels + pixels[:, ::-1]) / 2))
        stage.add(
            "/picture", quad(8, 8), Material(unlit=True, base_color_texture=texture, double_sided=True), at(0, 0, 8)
        )
        stage.add("/mirror", quad(8, 8), MIRROR, at(0, 0, -2)).camera((0, 0, 2), target, **lens)
        return stage

    # The picture is 10 m from the mirror, which is 4 m ahead; or 14 m from an eye that looks the other way.
    mirrored = made((0, 0, 0)).render((24, 24), tracer=tracer).image
    straight = made((0, 0, 5))
    straight.scene.nodes[straight.scene.cameras[0].node].matrix[2, 3] = 8 - 14
    straight.scene.objects[1].effects = {}
    straight.scene.nodes[straight.scene.objects[1].node].matrix[2, 3] = -20
    np.testing.assert_allclose(mirrored, straight.render((24, 24), tracer=tracer).image, atol=0.02)


def test_a_scene_with_holes_keeps_casts_shadow_and_ends_rays_at_the_light(tracer: str) -> None:
    made = boxed(casts_shadow=False)
    made.add("/leaf", quad(1, 1), half_covered(made, alpha_mode="MASK"), at(1.5, 1, 0) @ DOWN)
    made.add("/roof", floor(30), LAMBERT, at(0, 4.5, 0)).light("point", at(0, 4, 0), intensity=50.0)
    made.scene.cameras[0].lens.near = 0.6
    frame = made.render((48, 48), tracer=tracer)
    x, z = floor_points(48, 4.0)
    on_floor = frame.gbuffer.object_id == 1
    # The leaf's opaque half, x 1..1.5 at a height of 1, spreads by 4 / 3.
    shaded = (x > 1.0 * 4 / 3) & (x < 1.5 * 4 / 3) & (np.abs(z) < 0.5 * 4 / 3)
    assert (shaded & on_floor).sum() > 20
    np.testing.assert_array_equal((frame.image[..., 0] == 0)[on_floor], shaded[on_floor])


def test_always_makes_an_item_mandatory_and_never_leaves_it_out(tracer: str) -> None:
    made = boxed().light("point", at(0.3, 4, -0.2), intensity=50.0)
    made.scene.objects[0].effects = {"shadows": "always"}
    made.scene.objects[1].effects = {"shadows": "never"}
    candidates = made.render((16, 16), tracer=tracer).decisions.candidates
    shadows = candidates.effect == candidates.effect_names.index("shadows")
    assert candidates.object_id[shadows].tolist() == [1]
    assert candidates.mandatory[shadows].tolist() == [True]


def test_a_mirror_that_is_never_traced_shows_the_dome_instead(tracer: str) -> None:
    made = colored_wall(Stage(dome=(0.25, 0.5, 0.75)).add("/mirror", floor(4.5), MIRROR))
    made.camera((0, 3, 3), (0, 0, 0), ortho_height=0.5)
    assert made.render((8, 8), tracer=tracer).image.max() > 0.9
    made.scene.objects[0].effects = {"reflections": "never"}
    image = made.render((8, 8), tracer=tracer).image
    np.testing.assert_allclose(image, np.broadcast_to([0.25, 0.5, 0.75], image.shape), rtol=1e-5)


def test_exposure_of_camera_and_scene_multiply_the_picture(tracer: str) -> None:
    made = Stage().add("/wall", quad(4, 4), unlit(0.25, 0.5, 1.0)).camera((0, 0, 2), (0, 0, 0), exposure=3.0)
    made.scene.settings.exposure = 0.5
    image = render(made.scene, (4, 4), tracer=tracer).image
    np.testing.assert_allclose(image, np.broadcast_to([0.375, 0.75, 1.5], image.shape), rtol=1e-5)
