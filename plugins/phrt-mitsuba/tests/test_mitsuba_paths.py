"""Path-traced pictures: answers that can be computed, and what PHRT itself shows of the same scene, the right way up.

In Mitsuba's scalar variant, which needs no LLVM; `test_both_variants_agree` holds the compiled one to it.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import needs
import numpy as np
import pytest
from scene_kit import GLASS, LAMBERT, MIRROR, Stage, at, ball, box, floor, psnr, quad, turned

from phrt.camera import CameraView
from phrt.errors import PhrtWarning
from phrt.model import Material, TextureRef
from phrt.scene import Dome, Scene
from phrt.world import World
from phrt_mitsuba.paths import PathTracer, samples_at_a_time, stratified
from phrt_mitsuba.specks import parts_of, without_specks

needs.package("mitsuba")

WHITE = Material("white", base_color=(1.0, 1.0, 1.0, 1.0), specular=0.0)
DOWN = turned("x", -90)
"""What shines down -Z shines down -Y."""


def traced(
    scene: Scene, size: tuple[int, int] = (16, 16), *, samples: int = 16, max_depth: int = 6, seed: int = 0
) -> np.ndarray:
    """The scene's first camera's picture. A note of what is left out fails the test."""
    world = World(scene)
    with PathTracer("scalar_rgb") as tracer, warnings.catch_warnings():
        warnings.simplefilter("error", PhrtWarning)
        image = tracer.render(world, world.view(*size), samples=samples, max_depth=max_depth, seed=seed)
    assert image.shape == (size[1], size[0], 3)
    assert image.dtype == np.float32
    assert np.isfinite(image).all()
    return image


def all_trace(stage: Stage, size: tuple[int, int], **options: Any) -> np.ndarray:
    return stage.render(size, aa=16, **options).image


def above(stage: Stage, **lens: Any) -> Stage:
    """A camera that looks down on the origin from 4 m, -Z up in the picture."""
    return stage.camera((0, 4, 0.0001), (0, 0, 0), fov_y=0.2, **lens)


# Answers that can be computed


def test_a_white_ball_in_a_white_furnace_disappears() -> None:
    stage = Stage(dome=(1.0, 0.5, 0.25)).add("/ball", ball(1.0), WHITE).camera((0, 0, 3), (0, 0, 0), fov_y=0.9)
    image = traced(stage.scene, samples=36, max_depth=8)
    np.testing.assert_allclose(image.mean(axis=(0, 1)), (1.0, 0.5, 0.25), rtol=0.01)
    assert np.abs(image / np.float32([1.0, 0.5, 0.25]) - 1).max() < 0.25


LIGHTS: dict[str, tuple[str, np.ndarray, dict[str, Any], float]] = {
    # The light, and the lux that arrive at the origin, by docs/conventions.md.
    "point": ("point", at(0, 2, 0), {"intensity": 40.0}, 10.0),
    "point_aside": ("point", at(2, 2, 0), {"intensity": 40.0}, 40 / 8 * np.sqrt(0.5)),
    "range": ("point", at(0, 2, 0), {"intensity": 40.0, "range": 4.0}, 10.0 * (1 - 0.5**4)),
    "out_of_range": ("point", at(0, 2, 0), {"intensity": 40.0, "range": 1.9}, 0.0),
    "sphere": ("sphere", at(0, 2, 0), {"intensity": 40.0, "radius": 0.3}, 10.0),
    "sun": ("directional", turned("x", -60), {"intensity": 8.0}, 8 * np.sin(np.pi / 3)),
    "wide_sun": ("directional", turned("x", -60), {"intensity": 8.0, "angle": 0.05}, 8 * np.sin(np.pi / 3)),
    "spot": ("spot", at(0, 2, 0) @ DOWN, {"intensity": 40.0, "inner_angle": 0.3, "outer_angle": 0.6}, 10.0),
    "beside_a_spot": (
        "spot", at(2, 2, 0) @ DOWN, {"intensity": 40.0, "inner_angle": 0.3, "outer_angle": np.pi / 3},
        40 / 8 * np.sqrt(0.5) * ((np.sqrt(0.5) - 0.5) / (np.cos(0.3) - 0.5)) ** 2,
    ),
    "rect": ("rect", at(0, 2, 0) @ DOWN, {"intensity": 100.0, "size": (0.2, 0.1)}, 100 * 0.02 / 4),
    "rect_from_behind": ("rect", at(0, 2, 0) @ turned("x", 90), {"intensity": 100.0, "size": (0.2, 0.1)}, 0.0),
}  # fmt: skip


@pytest.mark.parametrize("name", LIGHTS)
def test_a_light_brings_the_lux_that_it_should(name: str) -> None:
    kind, matrix, values, lux = LIGHTS[name]
    stage = above(Stage().add("/floor", floor(), LAMBERT), exposure=2.0)
    stage.light(kind, matrix, color=(1.0, 0.5, 0.25), **values)
    stage.scene.settings.exposure = 1.5
    middle = traced(stage.scene, (3, 3), samples=64, max_depth=2)[1, 1]
    expected = 2.0 * 1.5 * 0.5 / np.pi * lux * np.float32([1.0, 0.5, 0.25])
    np.testing.assert_allclose(middle, expected, rtol=0.02, atol=1e-6)


def test_light_between_surfaces_is_there() -> None:
    """A closed white box of albedo a round a light: every bounce adds a share a, in all E / (1 - a)."""
    grey = replace(WHITE, base_color=(0.5, 0.5, 0.5, 1.0), double_sided=True)
    stage = Stage().add("/room", box(2, 2, 2, inwards=True), grey).camera((0, 0, 0), (0, 0, -1), fov_y=1.0)
    stage.light("point", at(0, 0, 0), intensity=1.0)
    direct, everything = (traced(stage.scene, samples=36, max_depth=depth).mean() for depth in (2, 40))
    assert everything / direct == pytest.approx(2.0, rel=0.2)


def test_glass_absorbs_on_the_way_through() -> None:
    tinted = replace(GLASS, attenuation_color=(0.8, 0.4, 0.1), attenuation_distance=0.5)
    stage = Stage(dome=(1.0, 1.0, 1.0)).add("/slab", box(4, 4, 1.0), tinted).camera((0, 0, 3), (0, 0, 0), fov_y=0.05)
    found = traced(stage.scene, (4, 4), samples=256, max_depth=12).mean(axis=(0, 1))
    # Behind a slab, and mirrored by it, is the same white: reflected R + T, all orders of reflection inside.
    once, reflected = np.array([0.8, 0.4, 0.1]) ** 2, 0.04
    passed = (1 - reflected) ** 2 * once / (1 - reflected**2 * once**2)
    mirrored = reflected + (1 - reflected) ** 2 * reflected * once**2 / (1 - reflected**2 * once**2)
    np.testing.assert_allclose(found, passed + mirrored, rtol=0.06)


def test_what_glows_is_seen_and_lights_nothing() -> None:
    glow = Material("glow", base_color=(0, 0, 0, 1), specular=0.0, emissive=(3.0, 2.0, 1.0))
    stage = Stage().add("/floor", floor(), WHITE).add("/panel", quad(1, 1), glow, at(0, 0.5, 0))
    stage.camera((0, 0.5, 3), (0, 0.5, 0), fov_y=0.7)
    image = traced(stage.scene, (15, 15))
    np.testing.assert_allclose(image[7, 7], (3.0, 2.0, 1.0), rtol=1e-4)
    assert not image[14].any(), "the floor is lit by what only glows"


def test_what_glows_is_seen_in_mirrors_and_through_glass() -> None:
    glow = Material("glow", base_color=(0, 0, 0, 1), specular=0.0, emissive=(3.0, 2.0, 1.0))
    stage = Stage().add("/mirror", quad(4, 4), MIRROR).add("/panel", quad(9, 9), glow, at(0, 0, 6) @ turned("y", 180))
    stage.add("/pane", box(4, 4, 0.1), GLASS, at(0, 0, 1)).camera((0, 0, 3), (0, 0, 0), fov_y=0.2)
    image = traced(stage.scene, (6, 6), samples=64, max_depth=12)
    # All that is not reflected towards the panel by the pane comes back from the mirror behind it.
    np.testing.assert_allclose(image.mean(axis=(0, 1)), (3.0, 2.0, 1.0), rtol=0.03)


# Shadows


def under_a_lid(lid: Material, **switches: Any) -> np.ndarray:
    """A lit floor under a lid, seen from the side below it."""
    stage = Stage().add("/floor", floor(), LAMBERT).add("/lid", box(2, 0.01, 2), lid, at(0, 1, 0), **switches)
    stage.light("point", at(0, 2, 0), intensity=10.0).camera((0, 0.4, 2.5), (0, 0, 0), fov_y=0.1)
    return traced(stage.scene, (3, 3), max_depth=2)[1, 1]


def test_what_casts_no_shadow_lets_light_pass_and_is_seen() -> None:
    lit = under_a_lid(LAMBERT, casts_shadow=False)
    np.testing.assert_allclose(lit, 0.5 / np.pi * 10 / 4, rtol=0.02)
    assert not under_a_lid(LAMBERT).any()
    stage = above(Stage().add("/lid", box(1, 0.1, 1), WHITE, casts_shadow=False)).light(
        "point", at(0, 2.05, 0), intensity=4.0
    )
    np.testing.assert_allclose(traced(stage.scene, (3, 3), max_depth=2)[1, 1], 1 / np.pi, rtol=0.02)


@pytest.mark.parametrize(("alpha", "mode", "share"), [(0.25, "BLEND", 0.5625), (0.4, "MASK", 1.0), (0.6, "MASK", 0.0)])
def test_light_passes_what_is_not_covered(alpha: float, mode: Any, share: float) -> None:
    lid = replace(LAMBERT, base_color=(0.5, 0.5, 0.5, alpha), alpha_mode=mode)
    # A box has two sides to pass.
    np.testing.assert_allclose(under_a_lid(lid), share * 0.5 / np.pi * 10 / 4, rtol=0.02, atol=1e-6)


def test_thin_walls_let_light_pass_and_thick_glass_does_not() -> None:
    assert under_a_lid(replace(GLASS, thickness=0.0)).min() > 0.8 * 0.5 / np.pi * 10 / 4
    assert not under_a_lid(GLASS).any()


# The right way up


def colourful(size: int = 32) -> np.ndarray:
    """(size, size, 4) uint8: every corner, and the way from each to the next, is its own."""
    y, x = np.mgrid[0:size, 0:size] / (size - 1)
    bar = (x > 0.6) & (y < 0.3)
    pixels = np.stack([x, y, np.where(bar, 1.0, 0.1), np.ones_like(x)], axis=-1)
    return (pixels * 255).astype(np.uint8)


FLIPS = {
    "upside_down": lambda image: image[::-1],
    "mirrored": lambda image: image[:, ::-1],
    "turned": lambda image: image[::-1, ::-1],
    "transposed": lambda image: image.transpose(1, 0, 2),
}


def same_way_up(found: np.ndarray, wanted: np.ndarray, at_least: float, clear: float = 10.0) -> None:
    """`found` is `wanted`, and nothing that is turned or mirrored comes within `clear` dB of passing for it."""
    reached = psnr(found, wanted)
    assert reached >= at_least, f"{reached:.1f} dB"
    for name, flip in FLIPS.items():
        wrong = psnr(flip(found), wanted)
        assert wrong < at_least - clear, f"{name}: {wrong:.1f} dB"


@pytest.mark.parametrize(
    "sampler",
    [
        {},
        {"scale": (2.0, 1.0), "offset": (0.25, 0.1)},
        {"rotation": 0.5, "scale": (0.7, 0.9)},
        {"wrap_s": "clamp", "wrap_t": "clamp"},
        {"wrap_s": "mirror", "wrap_t": "mirror", "scale": (1.6, 1.4)},
        {"nearest": True},
    ],
    ids=str,
)
def test_a_texture_lies_as_it_does_in_our_pictures(sampler: dict[str, Any]) -> None:
    stage = Stage(dome=(1.0, 1.0, 1.0))
    image = stage.image(colourful())
    stage.add("/sign", quad(2, 2), replace(WHITE, base_color_texture=TextureRef(image, **sampler)))
    stage.camera((0.3, -0.2, 2.6), (0.1, 0.0, 0.0), fov_y=0.9)
    same_way_up(traced(stage.scene, (32, 32), max_depth=2), all_trace(stage, (32, 32)), 29.0)


def test_two_textures_of_a_material_lie_as_they_do_in_our_pictures() -> None:
    stage = Stage(dome=(1.0, 1.0, 1.0))
    color, glow = stage.image(colourful()), stage.image(colourful()[::-1])
    material = replace(
        WHITE, base_color_texture=TextureRef(color, scale=(2.0, 2.0)), emissive=(0.4, 0.4, 0.4),
        emissive_texture=TextureRef(glow, offset=(0.3, 0.2), rotation=0.4),
    )  # fmt: skip
    stage.add("/sign", quad(2, 2), material).camera((0.3, -0.2, 2.6), (0.1, 0.0, 0.0), fov_y=0.9)
    same_way_up(traced(stage.scene, (32, 32), max_depth=2), all_trace(stage, (32, 32)), 27.0, clear=6.0)


@pytest.mark.parametrize("orthographic", [False, True])
def test_things_stand_where_they_stand_in_our_pictures(orthographic: bool) -> None:
    stage = Stage(dome=(0.2, 0.3, 0.5)).add("/floor", floor(4), replace(LAMBERT, base_color=(0.3, 0.3, 0.3, 1.0)))
    for number, color in enumerate([(0.9, 0.1, 0.1), (0.1, 0.8, 0.1), (0.1, 0.1, 0.9)]):
        material = replace(LAMBERT, base_color=(*color, 1.0))
        stage.add(
            f"/box{number}", box(0.4, 0.3 + 0.4 * number, 0.4), material, at(number - 1.2, 0.2, 0.4 * number - 0.6)
        )
    stage.camera((1.2, 1.6, 3.2), (0, 0.3, 0), fov_y=0.8, ortho_height=2.5 if orthographic else None)
    found, wanted = traced(stage.scene, (36, 24), max_depth=2), all_trace(stage, (36, 24))
    # Light of the dome is occluded in one and not in the other: what is compared is where things are.
    same = psnr(found, wanted)
    assert same > 18
    assert psnr(found[:, ::-1], wanted) < same - 3
    assert psnr(found[::-1], wanted) < same - 3
    background = np.abs(wanted - np.float32([0.2, 0.3, 0.5])).max(axis=2) < 1e-4
    assert 0.05 < background.mean() < 0.9
    # Edges are sampled elsewhere.
    assert np.isclose(found[background], wanted[background], rtol=1e-3).mean() > 0.97


@pytest.mark.parametrize("rotation", [0.0, 0.7])
def test_a_dome_is_round_us_as_in_our_pictures(rotation: float) -> None:
    x, y = np.meshgrid(np.linspace(0, 1, 64), np.linspace(0, 1, 32))
    pixels = np.stack([x, y, (np.abs(x - 0.6) < 0.05) & (y < 0.6)], axis=-1).astype(np.float32)
    stage = (
        Stage().add("/speck", quad(0.001, 0.001), LAMBERT, at(0, 0, 50)).camera((0, 0, 0), (0.5, 0.1, -1), fov_y=1.4)
    )
    stage.scene.dome = Dome((0.9, 0.8, 0.7), pixels, rotation)
    same_way_up(traced(stage.scene, (32, 32), samples=16), all_trace(stage, (32, 32)), 30.0)


def test_a_normal_map_bends_as_in_our_pictures() -> None:
    bumps = np.full((2, 2, 4), 255, np.uint8)
    bumps[:, 0, :3], bumps[:, 1, :3] = (200, 128, 210), (128, 200, 210)
    mesh = quad(2, 2)
    mesh.normals = np.tile(np.float32([0, 0, 1]), (4, 1))
    mesh.tangents = np.tile(np.float32([1, 0, 0, 1]), (4, 1))
    stage = Stage()
    bent = replace(WHITE, normal_texture=TextureRef(stage.image(bumps), nearest=True))
    stage.add("/wall", mesh, bent).camera((0, 0, 3), (0, 0, 0), fov_y=0.9)
    stage.light("point", at(1.5, 0.5, 1.5), intensity=9.0)
    found, wanted = traced(stage.scene, (32, 32), max_depth=2), all_trace(stage, (32, 32))
    same_way_up(found, wanted, 33.0, clear=6.0)


# The picture


def test_an_invisible_dome_lights_and_is_not_seen() -> None:
    stage = Stage(dome=(1.0, 1.0, 1.0)).add("/ball", ball(0.5), WHITE).camera((0, 0, 3), (0, 0, 0), fov_y=0.9)
    stage.scene.dome.visible = False
    image = traced(stage.scene)
    assert image[8, 8].min() > 0.7
    assert not image[0, 0].any()


def test_the_same_seed_is_the_same_picture_and_another_one_is_not() -> None:
    stage = Stage(dome=(1.0, 1.0, 1.0)).add("/ball", ball(0.5), WHITE).camera((0, 0, 3), (0, 0, 0), fov_y=0.5)
    one, same, other = (traced(stage.scene, samples=4, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, same)
    assert (one != other).any()


def test_more_samples_have_less_noise() -> None:
    stage = Stage(dome=(1.0, 1.0, 1.0)).add("/ball", ball(1.2), WHITE).camera((0, 0, 3), (0, 0, 0), fov_y=0.3)
    few, many = (traced(stage.scene, samples=samples, max_depth=2).std() for samples in (4, 100))
    assert many < 0.5 * few


def test_the_views_jitter_moves_nothing() -> None:
    stage = Stage(dome=(1.0, 1.0, 1.0)).add("/ball", ball(0.5), WHITE).camera((0, 0, 3), (0, 0, 0), fov_y=0.5)
    world = World(stage.scene)
    view: CameraView = world.view(8, 8)
    with PathTracer("scalar_rgb") as tracer:
        one, other = (
            tracer.render(world, each, samples=4, max_depth=3) for each in (view, view.with_jitter(0.4, -0.3))
        )
    np.testing.assert_array_equal(one, other)


def test_what_moved_is_where_it_is_now_and_what_stands_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    from phrt_mitsuba import paths

    made: list[float] = []
    real = paths.make_scenes
    monkeypatch.setattr(paths, "make_scenes", lambda mitsuba, world: (made.append(world.time), real(mitsuba, world))[1])
    stage = Stage(dome=(1.0, 1.0, 1.0)).add("/ball", ball(0.5), replace(WHITE, base_color=(0, 0, 0, 1.0)))
    world = World(stage.camera((0, 0, 3), (0, 0, 0), fov_y=0.9).scene)
    with PathTracer("scalar_rgb") as tracer:
        first = tracer.render(world, world.view(9, 9), samples=4, max_depth=2)
        world.advance(1.0)
        again = tracer.render(world, world.view(9, 9), samples=4, max_depth=2)
        world.set_object_matrix(1, at(0.8, 0, 0))
        world.advance(2.0)
        moved = tracer.render(world, world.view(9, 9), samples=4, max_depth=2)
    assert made == [0.0, 2.0]
    np.testing.assert_array_equal(first, again)
    assert not first[4, 4].any()
    assert moved[4, 4].min() > 0.9
    assert moved[4, 7].max() < 0.5


def test_what_is_left_out_is_said_once() -> None:
    mesh = quad()
    mesh.colors = np.tile(np.float32([1, 0, 0, 1]), (4, 1))
    world = World(Stage(dome=(1.0, 1.0, 1.0)).add("/sign", mesh, WHITE).camera((0, 0, 3), (0, 0, 0)).scene)
    with PathTracer("scalar_rgb") as tracer:
        with pytest.warns(PhrtWarning, match=r"^path tracing 'test' leaves out: colours of vertices$"):
            tracer.render(world, world.view(4, 4), samples=1, max_depth=2)
        world.set_object_matrix(1, at(1, 0, 0))
        world.advance(1.0)
        tracer.render(world, world.view(4, 4), samples=1, max_depth=2)


def test_a_scene_without_a_light_is_black() -> None:
    assert not traced(Stage().add("/ball", ball(1.0), WHITE).camera((0, 0, 3), (0, 0, 0)).scene, (4, 4)).any()


def test_the_process_keeps_its_variant() -> None:
    import mitsuba

    before = mitsuba.variant()
    traced(Stage(dome=(1.0, 1.0, 1.0)).camera((0, 0, 3), (0, 0, 0)).scene, (2, 2))
    assert mitsuba.variant() == before


@pytest.mark.parametrize(
    ("samples", "pixels", "expected"), [(64, 100, 64), (64, 500_000, 8), (7, 9_000_000, 1), (9, 1_000_000, 3)]
)
def test_samples_are_taken_in_equal_parts(samples: int, pixels: int, expected: int) -> None:
    assert samples_at_a_time(samples, pixels) == expected


@pytest.mark.parametrize(
    ("samples", "expected"), [(1, 1), (2, 2), (7, 8), (16, 16), (32, 35), (35, 35), (64, 64), (97, 99)]
)
def test_samples_fill_a_grid(samples: int, expected: int) -> None:
    assert stratified(samples) == expected
    assert stratified(expected) == expected


def test_a_speck_is_taken_out_and_noise_is_not() -> None:
    random = np.random.default_rng(1)
    parts = (1 + 0.1 * random.normal(size=(8, 20, 20, 3))).astype(np.float32)
    clean = without_specks(parts)
    np.testing.assert_allclose(clean, parts.mean(axis=0), rtol=1e-5)
    parts[3, 5, 5] = 900.0
    specked = without_specks(parts)
    assert specked[5, 5].max() < 1.2
    assert parts.mean(axis=0)[5, 5].min() > 100
    specked[5, 5] = clean[5, 5]
    np.testing.assert_allclose(specked, clean, rtol=1e-5)


@pytest.mark.parametrize(("samples", "parts"), [(1, 1), (63, 1), (64, 4), (128, 8), (256, 16), (10_000, 16)])
def test_parts_are_large_enough_to_be_stratified(samples: int, parts: int) -> None:
    assert parts_of(samples) == parts


# A whole scene


def a_room(kind: Material) -> Stage:
    """Dark walls, so that light between them does not count, strong lights, and a ball of `kind`."""

    def tint(*color: float) -> Material:
        return Material(base_color=(*(0.01 * channel for channel in color), 1.0), specular=0.0)

    stage = Stage().add("/floor", box(4, 0.1, 4), tint(0.8, 0.8, 0.8), at(0, -1.05, 0))
    stage.add("/back", box(4, 3, 0.1), tint(0.5, 0.6, 0.9), at(0, 0, -1.55)).add(
        "/front", box(4, 3, 0.1), tint(0.9, 0.6, 0.2), at(0, 0, 4.05)
    )
    stage.add("/left", box(0.1, 3, 6), tint(0.9, 0.2, 0.2), at(-1.55, 0, 1)).add(
        "/right", box(0.1, 3, 6), tint(0.2, 0.9, 0.2), at(1.55, 0, 1)
    )
    stage.add("/bar", box(0.2, 1.6, 0.05), tint(0.9, 0.9, 0.1), at(0.5, -0.2, -1.3)).add(
        "/ball", ball(0.6), kind, at(-0.3, -0.35, 0.3)
    )
    stage.light("point", at(-0.9, 1.2, 1.5), intensity=900.0).light(
        "point", at(1.1, 0.8, 0.4), intensity=300.0, color=(1, 0.8, 0.6)
    )
    return stage.camera((0, 0.15, 3.4), (0, -0.1, 0), fov_y=0.8)


@pytest.mark.parametrize(("kind", "samples"), [(MIRROR, 16), (GLASS, 36)], ids=["mirror", "glass"])
def test_a_room_is_what_all_trace_shows_of_it(kind: Material, samples: int) -> None:
    stage = a_room(kind)
    found = traced(stage.scene, (40, 40), samples=samples, max_depth=12)
    options = {"effects": {"reflections": {"max_depth": 8}, "refractions": {"max_depth": 10}}}
    reached = psnr(found, all_trace(stage, (40, 40), **options))
    assert reached > 30, f"{reached:.1f} dB"
    # A light that is a quarter brighter does not pass, nor does a ball of the other kind.
    stage.scene.lights[0].light.intensity *= 1.25
    assert psnr(found, all_trace(stage, (40, 40), **options)) < 30
    other = a_room(GLASS if kind is MIRROR else MIRROR)
    assert psnr(found, all_trace(other, (40, 40), **options)) < 30


def test_both_variants_agree() -> None:
    """The compiled variant, where there is an LLVM, with everything that is of our own in it."""
    from phrt_mitsuba.availability import choose_variant, unavailable_reason

    if reason := unavailable_reason():
        needs.absent(reason)
    stage = Stage(dome=(0.1, 0.2, 0.3)).add("/floor", floor(), replace(LAMBERT, specular=1.0, roughness=0.4))
    stage.add("/ball", ball(0.5), MIRROR, at(-0.6, 0.5, 0)).add(
        "/lid", box(0.5, 0.1, 0.5), LAMBERT, at(0.7, 0.9, 0), casts_shadow=False
    )
    stage.add(
        "/glass",
        box(0.4, 0.8, 0.4),
        replace(GLASS, attenuation_color=(0.9, 0.3, 0.2), attenuation_distance=0.3),
        at(0.5, 0.4, 0.6),
    )
    stage.light("sphere", at(0.7, 2, 0), intensity=6.0, radius=0.2, range=5.0).light(
        "directional", turned("x", -50), intensity=0.5, angle=0.02
    )
    stage.light("rect", at(-1, 2, 1) @ DOWN, intensity=9.0, size=(0.3, 0.3)).light(
        "spot", at(0, 3, 0) @ DOWN, intensity=9.0
    )
    world = World(stage.camera((0, 1.2, 3.2), (0, 0.4, 0), fov_y=0.8).scene)
    pictures = []
    for variant in ("scalar_rgb", choose_variant()):
        with PathTracer(variant) as tracer:
            pictures.append(tracer.render(world, world.view(32, 24), samples=64, max_depth=6))
    assert psnr(*pictures) > 27
    assert np.abs(pictures[0].mean(axis=(0, 1)) / pictures[1].mean(axis=(0, 1)) - 1).max() < 0.03
