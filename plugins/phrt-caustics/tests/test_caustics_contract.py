"""The contract of effects: conformance, who throws and who shows, threads, what is kept and what it costs."""

from __future__ import annotations

import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import numpy as np
import phrt_caustics.keeping
import pytest
from caustics_kit import GLASS, GROUND, MATERIALS, RADIUS, above, down, every_pixel, flat, glass_ball, layer
from phrt_caustics.effect import Caustics
from phrt_caustics.options import CausticsOptions

import phrt
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.model import Light
from phrt.testing import check_effect
from phrt.testing.frames import frame_of
from phrt.testing.worlds import at, quad, sphere, world_of
from phrt.world import World

ONLY = {name: {"enabled": False} for name in ("reflections", "refractions", "ambient_occlusion")}


def renderer(world: World, size: int = 48, **arguments: Any) -> phrt.Renderer:
    """Shadows and caustics of `world`, for the view from `above`."""
    effects = ONLY | {"caustics": {"photons_per_pixel": 2.0} | arguments.pop("caustics", {})}
    given = {"gbuffer": "raycast", "threads": 2, "strict": True, "effects": effects} | arguments
    return phrt.Renderer(world.scene, size=(size, size), **given)


class Listed(Heuristic):
    """Traces the items of the effects that it is told to."""

    def __init__(self) -> None:
        self.wanted: tuple[str, ...] = ()

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        names = [candidates.effect_names[effect] for effect in candidates.effect]
        self.queue = iter([item for item, name in enumerate(names) if name in self.wanted])

    def next(self, remaining: float) -> int | None:
        return next(self.queue, None)


@pytest.mark.parametrize("options", [{}, {"fallback": "none", "smoothing": 2.0, "max_radius": 0.1, "history": False}])
def test_it_keeps_the_contract(options: dict[str, Any]) -> None:
    check_effect("caustics", options)
    check_effect(Caustics, CausticsOptions(**options))


@pytest.mark.parametrize("missing", ["casters", "lights", "shadows of lights", "shadows of casters"])
def test_without_glass_or_light_nothing_is_traced(missing: str) -> None:
    light = Light("directional", intensity=3.0, casts_shadow=missing != "shadows of lights")
    ball = sphere(16, RADIUS, 0 if missing == "casters" else 2)
    lights = [] if missing == "lights" else [(light, down())]
    casts = [True, missing != "shadows of casters"]
    world = world_of([(quad(0, half=4.0), flat()), (ball, at(y=1.0))], MATERIALS, lights=lights, casts=casts)
    assert not Caustics(CausticsOptions()).applies_to(world).any()
    found, result = layer(world, above(16), photons_per_pixel=4.0)
    assert not found.any()
    assert result.rays == result.shared_rays == 0
    with renderer(world, 16) as made:
        frame = made.render(camera=above(16))
    assert "caustics" not in [frame.decisions.candidates.effect_names[e] for e in frame.decisions.candidates.effect]
    assert not frame.layers["caustics"].any()
    assert frame.rays.get("caustics", 0) == 0


def test_it_applies_to_what_has_a_diffuse_body() -> None:
    world = glass_ball()
    applies = Caustics(CausticsOptions()).applies_to(world)
    # The default material, the ground, the mirror, the glass.
    assert applies.tolist() == [True, True, False, False]


def test_rough_glass_throws_nothing() -> None:
    glass = replace(GLASS, roughness=0.5)
    world = world_of(
        [(quad(0, half=4.0), flat()), (sphere(16, RADIUS, 1), at(y=1.0))],
        [GROUND, glass],
        lights=[(Light("directional"), down())],
    )
    assert not Caustics(CausticsOptions()).applies_to(world).any()
    assert Caustics(CausticsOptions(roughness_cutoff=0.6)).applies_to(world).any()


def test_every_ray_is_reported_once_however_many_threads_ask_at_once() -> None:
    with frame_of(glass_ball(), above()) as frame:
        alone = Caustics(CausticsOptions(photons_per_pixel=4.0))
        whole = alone.trace(frame, every_pixel(frame))
        assert whole.rays == whole.shared_rays == frame.tracer.rays  # type: ignore[attr-defined]
        assert alone.trace(frame, every_pixel(frame)[:5]).rays == 0
        for _ in range(3):
            effect, start = Caustics(CausticsOptions(photons_per_pixel=4.0)), threading.Barrier(8)

            def ask(rows: np.ndarray, effect: Caustics = effect, start: threading.Barrier = start) -> Any:
                start.wait()
                return effect.trace(frame, np.ascontiguousarray(rows))

            with ThreadPoolExecutor(8) as pool:
                parts = list(pool.map(ask, np.array_split(every_pixel(frame), 8)))
            assert sum(part.rays for part in parts) == whole.rays
            assert np.array_equal(np.concatenate([part.values for part in parts]), whole.values)


def test_a_failure_reaches_everyone_who_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def broken(*arguments: Any) -> Any:
        calls.append(1)
        if len(calls) == 3:
            raise RuntimeError("the lamp broke")
        return original(*arguments)

    original = phrt_caustics.keeping.trace_photons
    monkeypatch.setattr(phrt_caustics.keeping, "trace_photons", broken)
    with frame_of(glass_ball(), above()) as frame:
        effect, start = Caustics(CausticsOptions(photons_per_pixel=8.0)), threading.Barrier(4)

        def ask(number: int) -> str:
            start.wait()
            try:
                effect.trace(frame, every_pixel(frame)[:10])
            except RuntimeError as error:
                return str(error)
            return "no error"

        with ThreadPoolExecutor(4) as pool:
            assert set(pool.map(ask, range(4))) == {"the lamp broke"}


def test_photons_are_kept_until_something_moves() -> None:
    world = glass_ball()
    with renderer(world) as made:
        rays = [made.render(camera=above(48)).rays["caustics"] for _ in range(3)]
        assert rays[0] > 0
        assert rays[1:] == [0, 0]
        made.move("/n1", at(0.1, 2 * RADIUS))
        assert made.render(camera=above(48)).rays["caustics"] > 0
        assert made.render(camera=above(48)).rays["caustics"] == 0


def test_a_run_takes_what_the_first_one_took() -> None:
    with renderer(glass_ball()) as made:
        runs = []
        for _ in range(2):
            runs.append([made.render(camera=above(48)).rays["caustics"] for _ in range(2)])
            made.restart()
    assert runs[0] == runs[1]


def test_a_frame_is_let_go_when_its_photons_are_made() -> None:
    effect = Caustics(CausticsOptions())
    with frame_of(glass_ball(), above()) as frame:
        before = sys.getrefcount(frame)
        effect.trace(frame, every_pixel(frame))
        assert sys.getrefcount(frame) == before


@pytest.mark.parametrize("budget", [None, "9000rays"])
def test_pictures_and_decisions_do_not_depend_on_threads(budget: str | None) -> None:
    worlds = [world_of(
        [(quad(0, half=4.0), flat()), (sphere(24, 0.3, 2), at(-0.4, 0.6)), (sphere(24, 0.3, 1), at(0.4, 0.6)),
         (sphere(16, 0.2, 0), at(0.0, 0.2, 0.6))],
        MATERIALS, lights=[(Light("point", intensity=30.0), at(0.5, 3.0))],
    ) for _ in range(2)]  # fmt: skip
    view = replace(above(48), world_from_view=above(48).world_from_view @ at(z=3.0))
    seen = []
    for world, threads in zip(worlds, (1, 4), strict=True):
        with renderer(world, threads=threads, budget=budget, heuristic="greedy_relevance") as made:
            frames = []
            for number in range(3):
                made.move("/n1", at(-0.4 + 0.1 * number, 0.6))
                frames.append(made.render(camera=view))
            seen.append(frames)
    for one, other in zip(*seen, strict=True):
        assert np.array_equal(one.image, other.image)
        assert np.array_equal(one.decisions.rays, other.decisions.rays)
        assert np.array_equal(one.decisions.order, other.decisions.order)
        assert one.decisions.rays.sum() == sum(one.rays[name] for name in ("shadows", "caustics") if name in one.rays)
    assert any(frame.rays.get("caustics", 0) for frame in seen[0])


def test_a_caustic_goes_where_its_ball_goes_and_leaves_no_ghost() -> None:
    heuristic = Listed()
    with renderer(glass_ball(), heuristic=heuristic, caustics={"fallback": "none"}) as made:

        def shown(*wanted: str) -> np.ndarray:
            heuristic.wanted = wanted
            return made.render(camera=above(48)).layers["caustics"].mean(axis=2)

        def middle(grey: np.ndarray) -> float:
            along = (np.arange(48) + 0.5) / 24 - 1
            return float((grey.sum(axis=0) * along).sum() / grey.sum())

        first = shown("caustics")
        assert middle(first) == pytest.approx(0.0, abs=0.02)
        assert np.array_equal(shown(), first)  # nothing moved: an earlier frame stands in
        made.move("/n1", at(0.4, 2 * RADIUS))
        assert not shown().any()  # what was there is gone, and nothing was traced
        moved = shown("caustics")
        assert middle(moved) == pytest.approx(0.4, abs=0.05)  # a little of it is out of sight
        assert moved[:, :10].max() < 0.05 * first.max()


def test_the_coarse_fallback_is_nearer_to_the_truth_than_none() -> None:
    world, view, error, rays = glass_ball(), above(48), {}, {}
    with frame_of(world, view) as frame:
        truth = Caustics(CausticsOptions(photons_per_pixel=16.0)).trace(frame, every_pixel(frame)).values
        for name in ("none", "coarse"):
            effect = Caustics(CausticsOptions(photons_per_pixel=2.0, fallback=name))  # type: ignore[arg-type]
            frame.tracer.rays = 0  # type: ignore[attr-defined]
            effect.prepare_fallback(frame)
            rays[name] = frame.tracer.rays  # type: ignore[attr-defined]
            values = effect.fallback(frame, every_pixel(frame))
            error[name] = np.abs((0 if values is None else values) - truth).mean()
        traced = Caustics(CausticsOptions(photons_per_pixel=2.0)).trace(frame, every_pixel(frame))
        error["traced"] = np.abs(traced.values - truth).mean()
    assert error["coarse"] < 0.6 * error["none"]
    assert error["traced"] < 0.8 * error["coarse"]
    assert rays["none"] == 0
    assert 0 < rays["coarse"] < traced.rays / 12


def test_the_picture_gets_brighter_by_the_diffuse_share_of_what_arrives() -> None:
    with renderer(glass_ball()) as made:
        frame = made.render(camera=above(48))
    with renderer(glass_ball(), caustics={"enabled": False}) as made:
        plain = made.render(camera=above(48))
    np.testing.assert_allclose(frame.image - plain.image, frame.layers["caustics"] * 0.5 / np.pi, rtol=1e-3, atol=1e-4)
    # Where the ball's shadow is, nothing else arrives: no light is counted twice.
    shadow = plain.layers["visibility"][..., 0] == 0
    assert shadow.any()
    assert not plain.image[shadow].any()
