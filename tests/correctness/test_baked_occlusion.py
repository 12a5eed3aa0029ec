"""Occlusion baked into a texture keeps the dome's light away, seen directly and in a mirror, and no other light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scene_kit import LAMBERT, MIRROR, QUAD_UV, Stage, at, flipped, floor, quad

from phrt.model import Material, TextureRef

HALF = (128 / 255, 200 / 255)
"""Occlusion is the texture's red, 128; its green, 200, is of no interest."""


def wall(made: Stage, material: Material) -> Stage:
    """A square that fills the picture, of `material` with an occlusion texture."""
    texture = TextureRef(made.image(np.tile(np.uint8([128, 200, 0, 255]), (2, 2, 1))))
    return made.add("/wall", quad(), replace(material, occlusion_texture=texture)).camera(
        (0, 0, 2), (0, 0, 0), ortho_height=1.0
    )


@pytest.mark.parametrize("gbuffer", ["raycast", "moderngl"])
def test_a_half_occluded_texture_halves_the_ambient_term_alone(gbuffer: str) -> None:
    lamp = {"matrix": at(0, 0, 2), "intensity": 3.0}
    open_dark = wall(Stage(), LAMBERT).light("point", **lamp).render((8, 8), gbuffer=gbuffer).image
    both = wall(Stage(dome=(0.4, 0.6, 0.8)), LAMBERT).light("point", **lamp).render((8, 8), gbuffer=gbuffer).image
    np.testing.assert_allclose(
        both - open_dark, np.broadcast_to(0.5 * np.array([0.4, 0.6, 0.8]) * HALF[0], (8, 8, 3)), rtol=1e-4
    )
    assert open_dark.min() > 0.01


def test_it_darkens_the_dome_where_that_stands_in_for_a_reflection() -> None:
    brushed = wall(Stage(dome=(0.4, 0.6, 0.8)), replace(MIRROR, roughness=0.6)).render((4, 4))
    np.testing.assert_allclose(brushed.image[0, 0], np.array([0.4, 0.6, 0.8]) * HALF[0], rtol=1e-4)
    traced = wall(Stage(dome=(0.4, 0.6, 0.8)), MIRROR).render((4, 4))
    assert traced.masks["reflection"].all(), "rays know better than a texture"
    np.testing.assert_allclose(traced.image[0, 0], [0.4, 0.6, 0.8], rtol=1e-4)


@pytest.mark.parametrize("roughness", [1.0, 0.3])
def test_a_mirror_shows_it(roughness: float) -> None:
    """A ceiling over a mirror floor, both larger than the picture: diffuse and metal take the dome, darkened."""
    material = replace(LAMBERT if roughness == 1 else MIRROR, base_color=(0.5, 0.5, 0.5, 1.0), roughness=roughness)
    made = Stage(dome=(0.4, 0.6, 0.8)).add("/mirror", floor(2), MIRROR)
    texture = TextureRef(made.image(np.tile(np.uint8([128, 200, 0, 255]), (2, 2, 1))))
    ceiling = replace(flipped(floor(9)), uv0=QUAD_UV.copy())
    made.add("/ceiling", ceiling, replace(material, occlusion_texture=texture), at(0, 2, 0))
    made.camera((0, 1, 0), (0, 0, 0), ortho_height=1.0)
    seen = made.render((4, 4)).image
    plain = Stage(dome=(0.4, 0.6, 0.8)).add("/mirror", floor(2), MIRROR)
    plain.add("/ceiling", ceiling, material, at(0, 2, 0)).camera((0, 1, 0), (0, 0, 0), ortho_height=1.0)
    np.testing.assert_allclose(seen, plain.render((4, 4)).image * HALF[0], rtol=1e-3)
    assert seen.min() > 0.05
