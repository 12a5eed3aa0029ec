"""scenes/atrium.yaml: what it describes, and that its walk goes through air only."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from phrt import Scene, World, load_scene
from phrt.interfaces.tracer import Tracer
from phrt.rays import RayBatch
from phrt.registry.manager import get_registry

DESCRIPTOR = Path(__file__).resolve().parents[3] / "scenes" / "atrium.yaml"
CLEARANCE = 0.3
"""Metres the camera keeps from everything."""


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(DESCRIPTOR)


@pytest.fixture(scope="module")
def walk(scene: Scene) -> tuple[Tracer, np.ndarray]:
    """A tracer of the scene, and the eye (300, 3) float32 in every frame."""
    world = World(scene)
    tracer: Tracer = get_registry().create("tracer", "embree")
    tracer.build(world)
    eyes = []
    for frame in range(scene.settings.frames):
        world.advance(frame / scene.settings.fps)
        eyes.append(world.view(64, 36).position)
    return tracer, np.array(eyes, dtype=np.float32)


def distances(tracer: Tracer, origin: np.ndarray, direction: np.ndarray) -> np.ndarray:
    origin = np.ascontiguousarray(origin, dtype=np.float32)
    direction = np.ascontiguousarray(np.broadcast_to(direction, origin.shape), dtype=np.float32)
    return tracer.closest_hit(RayBatch(origin, direction, np.full(len(origin), np.inf, np.float32))).distance


def test_three_lights_and_a_sky(scene: Scene) -> None:
    assert [light.light.kind for light in scene.lights] == ["directional", "sphere", "sphere"]
    assert scene.dome.color[2] > scene.dome.color[0] > 0


def test_walk_has_300_frames_at_30_a_second(scene: Scene) -> None:
    assert (scene.settings.frames, scene.settings.fps) == (300, 30.0)
    assert scene.duration == pytest.approx(10.0)


def test_objects_carry_tags_and_importance(scene: Scene) -> None:
    by_path = {entry.path: entry for entry in scene.objects}
    assert 60 <= len(by_path) == len(scene.objects)
    assert by_path["/Atrium/spheres/mirror_00"].importance["default"] == 3.0
    assert "building" in by_path["/Atrium/columns/column_07"].tags
    assert {tag for entry in scene.objects for tag in entry.tags} >= {"statue", "sphere", "drape"}
    assert not any(entry.casts_shadow for entry in scene.objects if "lantern" in entry.tags)


def test_night_dims_the_sky_and_turns_up_the_lamps(scene: Scene) -> None:
    night = load_scene(DESCRIPTOR, variant="night")
    assert night.dome.color[2] < 0.2 * scene.dome.color[2]
    assert night.lights[0].light.intensity < scene.lights[0].light.intensity
    assert night.lights[1].light.intensity > scene.lights[1].light.intensity


def test_walk_keeps_clear_of_everything(walk: tuple[Tracer, np.ndarray]) -> None:
    tracer, eyes = walk
    random = np.random.default_rng(5).normal(size=(200, 3))
    around = random / np.linalg.norm(random, axis=1, keepdims=True)
    nearest = np.min([distances(tracer, eyes, direction) for direction in around], axis=0)
    assert nearest.min() > CLEARANCE, f"frame {nearest.argmin()} is {nearest.min():.2f} m from a surface"


def test_walk_is_smooth_and_never_passes_a_surface(walk: tuple[Tracer, np.ndarray]) -> None:
    tracer, eyes = walk
    step = np.diff(eyes, axis=0)
    length = np.linalg.norm(step, axis=1)
    assert length.max() < 0.15
    assert np.linalg.norm(np.diff(step, axis=0), axis=1).max() < 0.02
    moving = length > 1e-6
    ahead = distances(tracer, eyes[:-1][moving], step[moving] / length[moving, None])
    assert (ahead > length[moving]).all()


def test_walk_goes_from_the_open_under_a_roof_and_out_again(walk: tuple[Tracer, np.ndarray]) -> None:
    tracer, eyes = walk
    roofed = np.isfinite(distances(tracer, eyes, np.array([0.0, 1.0, 0.0])))
    assert not roofed[0]
    assert not roofed[-1]
    assert 75 <= roofed.sum() <= 180
    assert np.count_nonzero(np.diff(roofed.astype(int))) == 2
