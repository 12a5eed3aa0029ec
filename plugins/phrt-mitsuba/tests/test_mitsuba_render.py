"""Pictures of a real scene with Mitsuba's rays are those of Embree's."""

from __future__ import annotations

from pathlib import Path

import needs
import numpy as np
import pytest

import phrt
from phrt.output.tonemap import to_8bit
from phrt_mitsuba.availability import unavailable_reason

pytestmark = needs.all_need(unavailable_reason())

SIZE = (96, 54)


def picture(scene: phrt.Scene, tracer: str, time: float) -> np.ndarray:
    """(height, width, 3) uint8, everything traced, nothing left to fallbacks."""
    with phrt.Renderer(
        scene, size=SIZE, tracer=tracer, gbuffer="raycast", heuristic="all_trace", threads=2
    ) as renderer:
        frame = renderer.render(time=time)
    return to_8bit(frame.image).astype(int)


@pytest.mark.parametrize("time", [0.0, 3.0])
def test_a_picture_by_mitsuba_is_that_by_embree(time: float) -> None:
    scene = phrt.load_scene(Path(needs.PROJECT) / "scenes" / "atrium.yaml")
    found, wanted = picture(scene, "mitsuba", time), picture(scene, "embree", time)
    assert wanted.std() > 20, "there is nothing to see"
    different = (np.abs(found - wanted) > 2).any(axis=2)
    assert different.mean() <= 0.001
    assert np.abs(found - wanted).mean() < 0.01
