"""A bare model file is framed and lit."""

from __future__ import annotations

import base64
import json
import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from phrt.animation import Animator
from phrt.camera import CameraView
from phrt.errors import AssetError
from phrt.loading import load_scene
from phrt.scene import Scene

Write = Callable[..., Path]

SLAB = (
    "\n".join(f"v {x} {y} {z}" for x in (10, 13) for y in (-4, 4) for z in (100, 100.5))
    + "\nf 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n"
)


def moving_triangle(seconds: float) -> str:
    """A glTF of one triangle that moves along X from 0 to `seconds`."""
    data = np.array([*np.eye(3).ravel(), 0, seconds, 0, 0, 0, 5, 0, 0], "<f4").tobytes()
    views = [(0, 36, "VEC3", 3), (36, 8, "SCALAR", 2), (44, 24, "VEC3", 2)]
    document = {
        "asset": {"version": "2.0"},
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "buffers": [{"byteLength": 68, "uri": "data:;base64," + base64.b64encode(data).decode()}],
        "bufferViews": [{"buffer": 0, "byteOffset": at, "byteLength": size} for at, size, _, _ in views],
        "accessors": [
            {"bufferView": k, "componentType": 5126, "type": kind, "count": count}
            for k, (_, _, kind, count) in enumerate(views)
        ],
        "animations": [
            {
                "samplers": [{"input": 1, "output": 2}],
                "channels": [{"sampler": 0, "target": {"node": 0, "path": "translation"}}],
            }
        ],
    }
    return json.dumps(document)


def in_picture(scene: Scene, width: int, height: int) -> np.ndarray:
    """(V, 2) normalised picture coordinates of all vertices, -1 to 1 inside."""
    entry = scene.cameras[0]
    matrices = Animator(scene).world_from_node(0)
    clip = CameraView.from_lens(entry.lens, matrices[entry.node], width, height).clip_from_world()
    points = np.concatenate([scene.meshes[o.mesh].positions for o in scene.objects])
    placed = np.c_[points, np.ones(len(points))] @ clip.T
    assert (placed[:, 3] > entry.lens.near).all()
    return placed[:, :2] / placed[:, 3:]


@pytest.mark.parametrize("size", [(640, 360), (100, 100), (90, 160)])
def test_a_bare_model_is_wholly_in_the_picture_and_fills_most_of_it(write: Write, size: tuple[int, int]) -> None:
    scene = load_scene(write(SLAB, "slab.obj"))
    xy = np.abs(in_picture(scene, *size))
    assert xy.max() < 1
    # The slab is higher than wide: a portrait picture is as wide as a square one, and sees more above and below.
    assert xy.max() > (0.6 if size[0] >= size[1] else 0.4)


def test_a_bare_model_gets_lights_and_says_so(write: Write, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, "phrt"):
        scene = load_scene(write(SLAB, "slab.obj"))
    assert [entry.light.kind for entry in scene.lights] == ["directional", "directional"]
    assert min(scene.dome.color) > 0
    assert "has no camera" in caplog.text
    assert "has no lights" in caplog.text
    assert scene.name == "slab"
    assert all(entry.path.startswith("/slab") for entry in scene.objects)


def test_the_key_light_shines_on_what_the_camera_sees(write: Write) -> None:
    scene = load_scene(write(SLAB, "slab.obj"))
    matrices = Animator(scene).world_from_node(0)
    view = -matrices[scene.cameras[0].node][:3, 2]
    for entry in scene.lights:
        assert -matrices[entry.node][:3, 2] @ view > 0.3


def test_a_described_scene_without_a_camera_is_framed_but_not_lit(write: Write) -> None:
    scene = load_scene(write("prims:\n  Ball: {type: Sphere}\n"))
    assert np.abs(in_picture(scene, 64, 64)).max() < 1
    assert scene.lights == []
    assert scene.dome.color == (0, 0, 0)


def test_an_empty_scene_can_be_framed(write: Write) -> None:
    scene = load_scene(write("name: Nothing\n"))
    assert scene.objects == []
    assert scene.name == "Nothing"
    assert np.isfinite(scene.nodes[scene.cameras[0].node].matrix).all()


def test_a_broken_model_file_is_an_asset_error(write: Write) -> None:
    with pytest.raises(AssetError, match=r"broken\.glb"):
        load_scene(write("not a model", "broken.glb"))


def test_a_bare_model_takes_overrides(write: Write) -> None:
    scene = load_scene(write(SLAB, "slab.obj"), overrides=["/slab.all_materials.metallic=1", "fps=12"])
    assert scene.settings.fps == 12
    scene = load_scene(write(SLAB, "slab.obj"), overrides={"/slab.tags": ["thing"]})
    assert {entry.tags for entry in scene.objects} == {("thing",)}


@pytest.mark.parametrize(
    ("seconds", "overrides", "frames"),
    [
        (2.0, [], 61),
        (2.0, ["fps=12"], 25),
        (0.7, [], 22),  # 0.7 s in float32 is a little less than 21 frames
        (0.71, [], 23),
        (2.0, ["frames=1"], 1),
        (1e9, [], 1_000_000),
    ],
)
def test_a_bare_model_is_as_long_as_its_animation(
    write: Write, seconds: float, overrides: list[str], frames: int
) -> None:
    scene = load_scene(write(moving_triangle(seconds), "moving.gltf"), overrides=overrides)
    assert scene.settings.frames == frames


def test_a_bare_model_that_does_not_move_has_one_frame(write: Write) -> None:
    assert load_scene(write(SLAB, "slab.obj")).settings.frames == 1


def test_a_model_keeps_its_own_camera_and_lights(assets: Path) -> None:
    scene = load_scene(assets / "gltf" / "Lights" / "Lights.glb")
    assert not any(entry.path.startswith("/Default") for entry in scene.lights)
    cameras = load_scene(assets / "gltf" / "Cameras" / "Cameras.gltf").cameras
    assert len(cameras) == 2
    assert not any(entry.path.startswith("/Default") for entry in cameras)


def test_a_models_animation_moves_its_nodes_below_the_reference(assets: Path, write: Write) -> None:
    path = write(
        "prims:\n  Before: {type: Sphere}\n"
        "  R: {type: Reference, asset: BoxAnimated/glTF-Binary/BoxAnimated.glb, xform: {translate: [0, 9, 0]}}\n"
    )
    found = next((assets / "gltf" / "BoxAnimated").rglob("*.glb"))
    path.write_text(path.read_text().replace("BoxAnimated/glTF-Binary/BoxAnimated.glb", found.name))
    scene = load_scene(path, search=[found.parent])
    assert scene.tracks
    assert all(scene.nodes[track.node].path.startswith("/R/") for track in scene.tracks)
    animator = Animator(scene)
    start, later = animator.world_from_node(0), animator.world_from_node(scene.duration / 2)
    moved = {scene.nodes[k].path for k in range(len(scene.nodes)) if not np.allclose(start[k], later[k])}
    assert moved
    assert all(path.startswith("/R/") for path in moved)
