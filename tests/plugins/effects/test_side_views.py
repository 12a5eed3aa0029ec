"""What effects render beside the main view (probes, shadow maps, looks behind glass) leaves the main view's motion alone."""

from __future__ import annotations

from dataclasses import replace

import needs
import numpy as np
import pytest
from scene_kit import GLASS, LAMBERT, MIRROR, Stage, at, ball, floor

import phrt
from phrt.camera import CameraView
from phrt.registry.manager import get_registry

FALLBACKS = {
    "probes": {
        "reflections": {"fallback": "probe", "probe_size": 8},
        "refractions": {"fallback": "probe", "probe_size": 8},
    },
    "behind glass": {"refractions": {"fallback": "alpha"}},
    "shadow maps": {"shadows": {"fallback": "shadow_map", "map_size": 16}},
}


def stage() -> Stage:
    made = Stage(dome=(0.4, 0.4, 0.4)).add("/floor", floor(), LAMBERT, at(0, -0.5, 0))
    made.add("/glass", ball(0.4, 2), GLASS, at(-0.5, 0, 0)).add("/mirror", ball(0.4, 2), MIRROR, at(0.5, 0, 0))
    return made.light("point", at(0, 3, 2), intensity=20.0).camera((0, 0.5, 3), (0, 0, 0))


def motion(gbuffer: str, effects: dict[str, dict[str, object]] | None) -> np.ndarray:
    """Motion from one view to the next; with `effects`, a frame of a third view lies between."""
    options = {"gbuffer": gbuffer, "heuristic": "raster_only", "size": (32, 24), "strict": True}
    with phrt.Renderer(stage().scene, effects=effects, **options) as renderer:
        view = renderer.world.view(32, 24)
        renderer.producer.render(moved(view, -0.2))
        if effects is not None:
            assert renderer.render().image.any()
        return renderer.producer.render(moved(view, 0.3)).motion.copy()


def moved(view: CameraView, x: float) -> CameraView:
    """`view` from `x` metres further along the world's X."""
    return replace(view, world_from_view=at(x) @ view.world_from_view)


@pytest.mark.parametrize("gbuffer", ["raycast", "moderngl"])
@pytest.mark.parametrize("fallback", FALLBACKS)
def test_side_views_leave_motion_alone(fallback: str, gbuffer: str) -> None:
    reason = get_registry().find("gbuffer", gbuffer).unavailable_reason()
    if reason:
        needs.absent(reason)
    expected = motion(gbuffer, None)
    assert np.abs(expected).max() > 1
    np.testing.assert_array_equal(motion(gbuffer, FALLBACKS[fallback]), expected)
