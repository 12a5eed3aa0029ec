"""Caustics that can be computed: mirrored lights, ball lenses, panes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from caustics_kit import (
    GLASS,
    GROUND,
    MATERIALS,
    MIRROR,
    RADIUS,
    WIDE,
    Shot,
    above,
    down,
    flat,
    glass_ball,
    layer,
    places,
    through_a_ball,
)
from phrt_caustics.casters import object_radii
from phrt_caustics.emission import started
from phrt_caustics.options import CausticsOptions
from phrt_caustics.splat import radii

from phrt.model import Light, Material
from phrt.testing.worlds import at, box, quad, sphere, world_of
from phrt.world import World


def beside_a_mirror(light: Light, mirror: Material = MIRROR) -> World:
    """A wall that mirrors at x = -1, a light at x = 1 at its height, and the ground between: the mirrored light is at x = -3."""
    wall = at(x=-1.0, y=1.0)
    wall[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    placed = [(quad(0, half=4.0), flat()), (quad(1, half=1.0), wall)]
    return world_of(placed, [GROUND, mirror], lights=[(light, at(1.0, 1.0))])


def mirrored(x: np.ndarray, z: np.ndarray, intensity: float) -> np.ndarray:
    """Lux on the ground of a light at (-3, 1, 0): inverse square and cosine."""
    return intensity / ((x + 3) ** 2 + 1 + z**2) ** 1.5


@pytest.mark.parametrize("share", [1.0, 0.4])
def test_a_mirrored_light_lights_the_ground_as_the_inverse_square_says(share: float) -> None:
    mirror = replace(MIRROR, base_color=(share, 1.0, 1.0, 1.0))
    world = beside_a_mirror(Light("point", intensity=20.0), mirror)
    found, _ = layer(world, above(), photons_per_pixel=30.0)
    x, z = places()
    expected = mirrored(x, z, 20.0).reshape(64, 64)
    for row in (16, 32, 48):
        for column in (16, 32, 48):
            patch = (slice(row - 3, row + 4), slice(column - 3, column + 4))
            assert found[patch][..., 1].mean() == pytest.approx(expected[patch].mean(), rel=0.05), (row, column)
            red = found[patch][..., 0].mean() / found[patch][..., 1].mean()
            # Schlick takes a tinted mirror towards white at grazing angles.
            assert share * 0.999 < red < share * (1.001 if share == 1.0 else 1.2)
    inner = (slice(8, 56), slice(8, 56))
    assert np.std(found[inner][..., 1] / expected[inner]) < 0.1
    assert found[inner][..., 1].mean() == pytest.approx(expected[inner].mean(), rel=0.01)


def test_the_range_of_a_light_counts_the_whole_way() -> None:
    world = beside_a_mirror(Light("point", intensity=20.0, range=4.0))
    found, _ = layer(world, above(), photons_per_pixel=30.0)
    x, z = places()
    square = (x + 3) ** 2 + 1 + z**2
    expected = (mirrored(x, z, 20.0) * np.maximum(1 - (square / 16) ** 2, 0)).reshape(64, 64)
    for column in (20, 32, 45):
        patch = (slice(28, 36), slice(column - 3, column + 4))
        assert found[patch].mean() == pytest.approx(expected[patch].mean(), rel=0.04), column


@pytest.mark.parametrize("kind", ["sphere", "rect", "spot"])
def test_lights_of_every_kind_are_mirrored(kind: str) -> None:
    light = {
        "sphere": Light("sphere", intensity=20.0, radius=0.1),
        "rect": Light("rect", intensity=20.0 / 0.01, size=(0.1, 0.1)),
        "spot": Light("spot", intensity=20.0, inner_angle=1.2, outer_angle=1.3),
    }[kind]
    world = beside_a_mirror(light)
    towards = at(1.0, 1.0)
    towards[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]  # -Z becomes -X: it shines at the mirror
    world = world_of(
        [(quad(0, half=4.0), flat()), (world.scene.meshes[1], world.scene.nodes[1].matrix)],
        [GROUND, MIRROR],
        lights=[(light, towards)],
    )
    found, _ = layer(world, above(), photons_per_pixel=30.0)
    x, z = places()
    expected = mirrored(x, z, 20.0)
    if kind == "rect":
        # A small Lambertian square: less light the further from its axis.
        expected *= (x + 3) / np.sqrt((x + 3) ** 2 + 1 + z**2)
    patch = (slice(16, 48), slice(16, 56))
    assert found[patch].mean() == pytest.approx(expected.reshape(64, 64)[patch].mean(), rel=0.02)


def test_a_ball_of_glass_bends_every_photon_as_snell_says() -> None:
    for distance in (1.2 * RADIUS, 1.5 * RADIUS, 2.5 * RADIUS):
        world = glass_ball(distance)
        shot = Shot(world, 4000)
        (beam,) = {id(batch.beam): batch.beam for batch in shot.batches}.values()
        origin, _, _ = started(world, beam, 0, beam.count)
        mine = shot.main_path()
        start = origin[shot.landed.number[mine]]
        h = np.hypot(start[:, 0], start[:, 2])
        inner = (h < 0.85 * RADIUS) & (h > 0.02)
        landed = shot.landed.position[mine][inner]
        outwards = start[inner][:, [0, 2]] / h[inner][:, None]
        expected = through_a_ball(h[inner], 1.5, distance)
        assert len(expected) > 1000
        assert np.abs((landed[:, [0, 2]] * outwards).sum(axis=1) - expected).max() < 0.02 * RADIUS, distance


def test_a_ball_gathers_light_under_it_brightest_near_its_focus() -> None:
    # f = n R / (2 (n - 1)) = 1.5 R behind the centre for rays at the axis; the others cross before it.
    peaks = {}
    for distance in (1.05, 1.5, 3.0):
        found, _ = layer(glass_ball(distance * RADIUS, shift=0.2), above(), photons_per_pixel=8.0, smoothing=2.0)
        grey = found.mean(axis=2)
        row, column = np.unravel_index(grey.argmax(), grey.shape)
        x, z = places()
        peaks[distance] = grey.max()
        if distance == 1.5:
            assert x[column] == pytest.approx(0.2, abs=0.05)
            assert z.reshape(64, 64)[row, 0] == pytest.approx(0.0, abs=0.05)
    assert peaks[1.5] > 2 * peaks[3.0]
    assert peaks[1.5] > 1.5 * peaks[1.05]
    assert peaks[1.5] > 10 * 3.0


@pytest.mark.parametrize("clear", [True, False])
def test_a_pane_at_right_angles_takes_what_fresnel_and_beer_say(clear: bool) -> None:
    glass = GLASS if clear else replace(GLASS, attenuation_color=(0.5, 0.5, 0.5), attenuation_distance=0.4)
    placed = [(quad(0, half=4.0), flat()), (box(0.5, 1), at(y=1.0, scale=(1.6, 0.4, 1.6)))]
    world = world_of(placed, [GROUND, glass], lights=[(Light("directional", intensity=10.0), down())])
    found, _ = layer(world, above(), photons_per_pixel=8.0, max_depth=16)
    # Light that is thrown back and forth inside comes out too: a geometric series.
    mirrored, kept = 0.04, 1.0 if clear else 0.5
    expected = 10.0 * kept * (1 - mirrored) ** 2 / (1 - (mirrored * kept) ** 2)
    assert found[20:44, 20:44].mean() == pytest.approx(expected, rel=0.01)
    assert np.std(found[20:44, 20:44] / expected) < 0.1
    assert found[:, 2].max() < 0.01 * expected  # x = -0.92 is not under the pane


def test_a_thin_wall_lets_light_pass_unbent() -> None:
    placed = [(quad(0, half=4.0), flat()), (quad(1, half=0.5), flat(1.0))]
    pane = replace(GLASS, thickness=0.0)
    world = world_of(placed, [GROUND, pane], lights=[(Light("directional", intensity=10.0), down())])
    found, _ = layer(world, above(), photons_per_pixel=8.0)
    assert found[24:40, 24:40].mean() == pytest.approx(10.0 * 0.96, rel=0.02)


def test_what_is_splatted_is_the_flux_that_landed() -> None:
    world = glass_ball(1.5 * RADIUS)
    shot = Shot(world, 64 * 64)
    radius = radii(shot.landed, object_radii(world), CausticsOptions().smoothing, None)
    middle = np.abs(shot.landed.position[:, [0, 2]]).max(axis=1)
    inside, outside = middle + radius < WIDE, middle - radius > WIDE
    found, _ = layer(world, above(256), photons_per_pixel=1 / 16)
    splatted = found.sum(axis=(0, 1), dtype=np.float64) * (2 * WIDE / 256) ** 2
    landed = shot.landed.flux[inside].sum(axis=0, dtype=np.float64)
    border = shot.landed.flux[~inside & ~outside].sum(axis=0, dtype=np.float64)
    assert (splatted >= landed * 0.995).all()
    assert (splatted <= (landed + border) * 1.005).all()
    assert (border < 0.1 * landed).all()


def test_the_light_that_a_ball_takes_is_the_light_that_it_lets_out() -> None:
    """Energy: of what meets the ball, all lands somewhere in a closed room, but for what the last bounces carry."""
    room = [(box(3.0, 0), at()), (sphere(48, RADIUS, 2), at())]
    world = world_of(room, MATERIALS, lights=[(Light("point", intensity=5.0), at(2.0, 0.5))])
    shot = Shot(world, 20000, depth=24)
    sine = RADIUS / np.hypot(2.0, 0.5)
    expected = 5.0 * 2 * np.pi * (1 - np.sqrt(1 - sine**2))
    assert shot.landed.flux.sum(axis=0, dtype=np.float64) == pytest.approx(np.full(3, expected), rel=0.01)


def test_rays_are_counted() -> None:
    shot = Shot(glass_ball(), 2000)
    assert shot.rays == shot.traced
    assert 2.5 * 2000 < shot.rays < 7 * 2000
