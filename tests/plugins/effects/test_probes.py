"""Probes: which are captured and when, and what they show of what is seen through glass."""

from __future__ import annotations

import numpy as np
import pytest
from scene_kit import GLASS, LAMBERT, MIRROR, Stage, at, ball, box, floor

import phrt
from phrt.camera import CameraView
from phrt.model import Material, TextureRef, Track
from phrt_plugins.effects.cube_kernels import FRESH
from phrt_plugins.effects.probes import Probes, probes_of, round_bodies
from phrt_plugins.effects.shadow_maps import STALE

CHECKER = np.zeros((8, 8, 4), np.uint8)
CHECKER[..., 3] = 255
CHECKER[::2, ::2, :3] = CHECKER[1::2, 1::2, :3] = 220


def stage(**motion: bool) -> Stage:
    """A mirror ball, a glass ball and a glass box in a coloured yard; with `moving`, a box goes by."""
    made = Stage(dome=(0.3, 0.4, 0.6))
    texture = TextureRef(made.image(CHECKER))
    made.add("/floor", floor(12), Material("floor", roughness=1.0, specular=0.0, base_color=(0.8, 0.5, 0.3, 1.0)))
    made.add("/wall", box(8, 4, 0.2), Material("wall", roughness=1.0, base_color_texture=texture), at(0, 1, -3))
    made.add("/mirror", ball(0.4, 4), MIRROR, at(-1.2, 0.5, 0)).add("/glass", ball(0.4, 4), GLASS, at(0, 0.5, 0))
    made.add("/block", box(0.5, 0.7, 0.5), GLASS, at(1.2, 0.5, 0)).add(
        "/box", box(0.6, 0.6, 0.6), LAMBERT, at(-2, 0.5, 1)
    )
    made.light("point", at(1, 4, 3), intensity=60.0).camera((0, 1.0, 4), (0, 0.5, 0), fov_y=0.7)
    if motion.get("moving"):
        keys = np.array([[-2, 0.5, 1], [2, 0.5, 1]], np.float32)
        made.scene.tracks.append(Track(made.scene.objects[5].node, "translation", np.array([0.0, 4.0]), keys))
    return made


def renderer(made: Stage, **options: object) -> phrt.Renderer:
    fixed = {"size": (96, 64), "gbuffer": "raycast", "threads": 2, "heuristic": "raster_only", "strict": True}
    return phrt.Renderer(made.scene, **(fixed | options))


def probes(made: phrt.Renderer) -> Probes:
    return probes_of(made.world, 64)


def test_effects_share_the_probes_of_a_world_and_worlds_share_none() -> None:
    with renderer(stage()) as one, renderer(stage()) as other:
        one.render()
        assert probes(one) is probes(one)
        assert probes(one) is not probes(other)
        assert len(probes(one)._places) == 3


def test_only_probes_that_are_looked_up_are_captured() -> None:
    with renderer(stage()) as made:
        view = CameraView(96, 64, at(-1.2, 0.5, 2.0), (0.3, 0.2))
        made.render(camera=view)
        assert (probes(made)._state == FRESH).sum() == 1


def test_a_box_is_not_round_and_a_ball_is() -> None:
    with renderer(stage()) as made:
        low, high = made.world.object_bounds()
        is_round, radius = round_bodies(made.world, low, high, made.world.triangle_count > 0)
    paths = ["", *(entry.path for entry in made.scene.objects)]
    assert [path for path, found in zip(paths, is_round, strict=True) if found] == ["/mirror", "/glass"]
    assert radius[paths.index("/glass")] == pytest.approx(0.4, abs=0.01)


def refraction_error(fallback: str, path: str) -> float:
    """Mean error of the refraction layer where `path` is seen, against tracing it."""
    effects = {"refractions": {"fallback": fallback}}
    with renderer(stage(), effects=effects) as plain, renderer(stage(), heuristic="all_trace") as traced:
        shown, truth = plain.render(), traced.render()
        number = 1 + [entry.path for entry in plain.scene.objects].index(path)
        where = truth.gbuffer.object_id == number
    assert where.sum() > 100
    return float(np.abs(shown.layers["refraction"] - truth.layers["refraction"])[where].mean())


def test_a_glass_ball_shows_the_world_upside_down_as_tracing_does() -> None:
    found = {name: refraction_error(name, "/glass") for name in ("probe", "alpha", "environment")}
    assert found["probe"] < 0.6 * found["alpha"]
    assert found["probe"] < 0.6 * found["environment"]


def test_glass_with_flat_faces_shows_what_lies_straight_behind() -> None:
    assert refraction_error("probe", "/block") == pytest.approx(refraction_error("alpha", "/block"))


def test_what_goes_by_makes_probes_stale_and_they_are_captured_a_few_a_frame() -> None:
    with renderer(stage(moving=True)) as made:
        made.render(0.0)
        own = probes(made)
        own._most_stale = 1
        states = []
        for number in range(1, 4):
            made.render(number / 30)
            states.append(own._state.tolist())
        assert all(state.count(STALE) == len(state) - 1 for state in states)
        assert len({state.index(FRESH) for state in states}) > 1, "they take turns"


def test_after_a_cut_probes_are_those_of_a_new_renderer() -> None:
    with renderer(stage(moving=True)) as made, renderer(stage(moving=True)) as new:
        made.render(0.0)
        probes(made)._most_stale = 0
        np.testing.assert_array_equal(made.render(3.0).layers["reflection"], new.render(3.0).layers["reflection"])


def test_another_run_sees_nothing_of_the_one_before() -> None:
    """Probes that were captured at other times would show where things were then."""
    with renderer(stage(moving=True)) as made, renderer(stage(moving=True)) as new:
        for number in range(5):
            made.render(number / 30)
        made.restart(heuristic="raster_only", strict=True)
        for number in (2, 3):
            again, first = made.render(number / 30), new.render(number / 30)
            np.testing.assert_array_equal(again.image, first.image)
