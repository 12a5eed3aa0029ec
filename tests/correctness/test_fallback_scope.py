"""Fallbacks and gap filling reach no pixel that tracing would leave alone, and odd coordinates reach no texel that is not there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scene_kit import QUAD_UV, Stage, at, ball, quad, render

from phrt.frame import FrameResult
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic, Request
from phrt.model import Material, TextureRef

HALF = np.zeros((2, 8, 4), np.uint8)
HALF[:, :4] = (255, 255, 255, 255)
"""Left half rough, right half smooth: roughness is the green channel, metalness the blue one."""
HALF[:, 4:] = (255, 0, 255, 255)


class OnePass(Heuristic):
    """Asks for one interleaved pass of everything."""

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self.left = list(range(len(candidates)))

    def next(self, remaining: float) -> Request | None:
        return Request(self.left.pop(), 1) if self.left else None


def half_mirror() -> Stage:
    """A square that fills the picture, rough metal on its left and a mirror on its right, under a grey dome."""
    stage = Stage(dome=(0.5, 0.5, 0.5))
    stage.image(HALF)
    ref = TextureRef(0, wrap_s="clamp", wrap_t="clamp", nearest=True)
    material = Material(metallic=1.0, roughness=1.0, metallic_roughness_texture=ref)
    return stage.add("/half", replace(quad(2, 2), uv0=QUAD_UV.copy()), material)


def mask(result: FrameResult) -> tuple[np.ndarray, np.ndarray]:
    whole = result.masks["reflection"]
    middle = whole.shape[1] // 2
    return whole[8:-8, 8 : middle - 2], whole[8:-8, middle + 2 : -8]


@pytest.mark.parametrize("heuristic", ["all_trace", "raster_only", OnePass()])
@pytest.mark.parametrize("fallback", ["none", "environment", "probe"])
def test_rough_pixels_of_a_material_that_is_partly_a_mirror_always_show_the_dome(
    heuristic: str | Heuristic, fallback: str
) -> None:
    scene = half_mirror().camera(eye=(0, 0, 2), target=(0, 0, 0), fov_y=0.9).scene
    result = render(scene, (64, 64), heuristic=heuristic, effects={"reflections": {"fallback": fallback}})
    rough, smooth = mask(result)
    assert not rough.any()
    if heuristic != "raster_only" or fallback != "environment":
        assert smooth.all()


@pytest.mark.parametrize("wrap", ["repeat", "clamp", "mirror"])
@pytest.mark.parametrize("scale", [1e9, 1e12, -1e12, 1e18])
def test_texture_coordinates_beyond_integers_read_no_foreign_memory(wrap: str, scale: float) -> None:
    stage = Stage()
    stage.image(np.full((4, 4, 4), 200, np.uint8))
    ref = TextureRef(0, wrap_s=wrap, wrap_t=wrap)  # type: ignore[arg-type]
    mesh = replace(quad(2, 2), uv0=(QUAD_UV * scale).astype(np.float32))
    scene = stage.add("/far", mesh, Material(base_color_texture=ref)).camera(eye=(0, 0, 2), target=(0, 0, 0)).scene
    base = render(scene, (16, 16)).gbuffer.base_color[8, 8]
    np.testing.assert_allclose(base, ((200 / 255 + 0.055) / 1.055) ** 2.4, rtol=1e-3)


def test_a_frame_without_any_effect_is_the_deferred_picture() -> None:
    off = {name: {"enabled": False} for name in ("shadows", "reflections", "refractions")}
    stage = Stage(dome=(0.5, 0.5, 0.5)).add("/ball", ball(), Material(), at())
    scene = stage.camera(eye=(0, 0, 2), target=(0, 0, 0)).scene
    result = render(scene, (16, 16), effects=off)
    assert len(result.decisions.candidates) == 0
    assert result.image[8, 8].mean() > 0.3
