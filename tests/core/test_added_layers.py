"""Layers that the composition does not know by name: what they add to the picture, and rays that serve every pixel."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
from scene_kit import GLASS, LAMBERT, Stage, at, ball, floor

import phrt
import phrt.renderer
from phrt.interfaces.effect import Adds, EffectResult, LayerSpec, RayEffect
from phrt.model import Material
from phrt.scene import Scene

LIGHT = np.array([3.0, 2.0, 1.0], np.float32)
CALLS: list[int] = []
LOCK = threading.Lock()


class Glow(RayEffect):
    """Brings LIGHT everywhere; its first call in a frame reports 1000 rays for all pixels."""

    name = "glow"
    reads = ()

    def __init__(self, adds: Adds) -> None:
        self.writes = LayerSpec("glow", 3, 0.0, "light", adds)

    def applies_to(self, world: Any) -> np.ndarray:
        return np.ones(len(world.materials), bool)

    def rays_per_pixel(self, world: Any) -> float:
        return 1.0

    def trace(self, frame: Any, pixels: np.ndarray) -> EffectResult:
        with LOCK:
            first = frame.index not in CALLS
            CALLS.append(frame.index)
        shared = 1000 * first
        return EffectResult(np.tile(LIGHT, (len(pixels), 1)), len(pixels) + shared, shared_rays=shared)

    def fallback(self, frame: Any, pixels: np.ndarray) -> np.ndarray | None:
        return None


@pytest.fixture(params=["", "irradiance", "radiance"])
def adds(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Adds:
    """What the only effect of every renderer adds; none where a renderer is told so."""
    CALLS.clear()
    monkeypatch.setattr(phrt.renderer, "make_effects", lambda scene, options: [] if options else [Glow(request.param)])
    added: Adds = request.param
    return added


def scene() -> Scene:
    """The floor, plastic, metal, glass and something unlit before nothing, all dark but for what is added."""
    made = Stage().add("/floor", floor(), LAMBERT)
    kinds = [Material(roughness=0.5), Material(metallic=1.0, roughness=0.5), GLASS, Material(unlit=True)]
    for number, material in enumerate(kinds):
        made.add(f"/ball{number}", ball(0.3, 3), material, at(-0.9 + 0.6 * number, 0.4))
    return made.camera((0, 1.0, 3.0), (0, 0.3, 0), fov_y=0.9, exposure=2.0).scene


def rendered(**arguments: Any) -> Any:
    given = {"size": (48, 32), "gbuffer": "raycast", "threads": 2, "strict": True}
    with phrt.Renderer(scene(), **(given | arguments)) as renderer:
        return renderer.render()


def test_light_is_added_as_the_layer_says(adds: Adds) -> None:
    frame = rendered()
    dark = rendered(effects={"glow": {"enabled": False}})
    added = frame.image - dark.image
    seen = {path: frame.gbuffer.object_id == number for number, path in enumerate(["", "floor", *"abcd"])}
    assert all(mask.any() for mask in seen.values())
    assert not added[seen[""]].any(), "the background shows no surface's light"
    if adds == "":
        assert not added.any()
        return
    if adds == "radiance":
        for path in ("floor", *"abcd"):
            np.testing.assert_allclose(added[seen[path]], np.broadcast_to(2 * LIGHT, (seen[path].sum(), 3)), rtol=1e-5)
        return
    np.testing.assert_allclose(added[seen["floor"]][0], 2 * LIGHT * 0.5 / np.pi, rtol=1e-4)
    plastic = added[seen["a"]] / (2 * LIGHT / np.pi)
    assert plastic.max() == pytest.approx(0.96, abs=0.005)  # all but what a dielectric reflects, straight on 4 %
    assert plastic.min() < 0.93
    for path in "bcd":
        assert not added[seen[path]].any(), "metal, glass and what is unlit have no body"


def test_a_layer_that_adds_light_has_three_components() -> None:
    with pytest.raises(ValueError, match="layer 'glow' adds radiance, so it has 3 components, not 1"):
        LayerSpec("glow", 1, 0.0, "light", "radiance")


def test_what_it_changes_is_measured(adds: Adds) -> None:
    with phrt.Renderer(scene(), size=(48, 32), gbuffer="raycast", threads=2, strict=True) as renderer:
        renderer.measure_change = True
        for _ in range(3):
            frame = renderer.render()
    change = frame.decisions.candidates.measured_change
    assert (np.nanmax(change) > 0) == bool(adds)


def test_rays_for_everybody_are_booked_on_everybody(adds: Adds) -> None:
    booked = []
    for threads in (1, 3):
        CALLS.clear()
        frame = rendered(threads=threads)
        pixels = frame.decisions.candidates.pixel_count
        assert frame.rays["glow"] == frame.decisions.rays.sum() == pixels.sum() + 1000
        assert np.abs(frame.decisions.rays - pixels * (1 + 1000 / pixels.sum())).max() <= 2
        booked.append(frame.decisions.rays)
    assert np.array_equal(*booked)
