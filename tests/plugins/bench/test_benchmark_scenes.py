"""The scenes that were made for comparisons hold what they promise: motion, glass, many lights, and a walk through air."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scene_kit import PLAIN_FALLBACKS

from phrt import Renderer, Scene, World, load_scene
from phrt.interfaces.tracer import Tracer
from phrt.rays import RayBatch
from phrt.registry import get_registry

SCENES = Path(__file__).resolve().parents[3] / "scenes"
NAMES = ("carousel", "glass_shop", "night_market")


@pytest.fixture(scope="module", params=NAMES)
def scene(request: pytest.FixtureRequest) -> Scene:
    return load_scene(SCENES / f"{request.param}.yaml")


def test_walk_keeps_clear_of_everything(scene: Scene) -> None:
    world = World(scene)
    tracer: Tracer = get_registry().create("tracer", "embree")
    tracer.build(world)
    random = np.random.default_rng(5).normal(size=(100, 3))
    around = (random / np.linalg.norm(random, axis=1, keepdims=True)).astype(np.float32)
    for frame in range(0, scene.settings.frames, 5):
        tracer.update(world, world.advance(frame / scene.settings.fps))
        eye = np.tile(np.float32(world.view(64, 36).position), (len(around), 1))
        nearest = tracer.closest_hit(RayBatch(eye, around, np.full(len(eye), np.inf, np.float32))).distance.min()
        assert nearest > 0.25, f"frame {frame} is {nearest:.2f} m from a surface"


def test_rays_change_the_picture_and_cost_what_they_should(scene: Scene) -> None:
    with Renderer(scene, size=(64, 36), heuristic="all_trace", history=False) as renderer:
        traced = renderer.render(2.0)
    with Renderer(scene, size=(64, 36), heuristic="raster_only", history=False, effects=PLAIN_FALLBACKS) as renderer:
        plain = renderer.render(2.0)
    assert np.isfinite(traced.image).all()
    assert np.abs(traced.image - plain.image).mean() > 0.05 * traced.image.mean()
    rays = traced.rays
    pixels = 64 * 36
    if scene.name == "Glass shop":
        assert rays["refractions"] > pixels
    if scene.name == "Night market":
        assert rays["shadows"] > 3 * pixels
    if scene.name == "Carousel":
        assert len(traced.decisions.candidates) > 50


def test_most_of_the_carousel_moves() -> None:
    scene = load_scene(SCENES / "carousel.yaml")
    world = World(scene)
    world.advance(1.0)
    moved = world.advance(1.1).objects
    assert len(moved) == 60
    assert len(scene.objects) == 62


def test_a_lamp_of_the_market_lights_only_what_is_near() -> None:
    lamps = [entry.light for entry in load_scene(SCENES / "night_market.yaml").lights if entry.light.kind == "point"]
    assert len(lamps) == 12
    assert {lamp.range for lamp in lamps} == {6.5}
