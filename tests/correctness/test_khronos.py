"""Khronos's test models against pictures that were looked at once, mark by mark, with the models' README.

Check marks must be where the README wants them, arrows must point at their targets; every wrong loader or producer that
the README warns of (and some more) must fail. References: tests/references. `python tests/correctness/test_khronos.py
FOLDER` writes what is rendered now into FOLDER, to be looked at before it becomes a reference.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import needs
import numpy as np
import pytest
from PIL import Image
from scene_kit import PLAIN_FALLBACKS

import phrt
import phrt.geometry
from phrt.camera import CameraView, look_at
from phrt.materials import TEXTURE_SLOTS
from phrt.model import Light, Wrap
from phrt.output.tonemap import to_8bit
from phrt.registry.manager import get_registry
from phrt.scene import Dome, Scene, SceneLight, SceneNode
from phrt.world import World

REFERENCES = Path(__file__).resolve().parents[1] / "references"
WIDTH, HEIGHT, TILE = 320, 240, 16
TOLERANCE = 0.03
"""Largest mean difference, sRGB-encoded 0..1, in any tile of 16 x 16 pixels. Producers differ in how they filter
textures, by 0.017 at most; the mildest mutant below makes 0.089."""

PICTURES = {
    "negative_scale": ("NegativeScaleTest", (0.0, 0.0, 1.0)),
    "texture_settings": ("TextureSettingsTest", (0.0, 0.0, 1.0)),
    "orientation_front": ("OrientationTest", (1.0, 0.8, 1.2)),
    "orientation_back": ("OrientationTest", (-1.0, -0.8, -1.2)),
}
"""A model, and the direction it is seen from."""

Mutant = Callable[[Scene], None]


def load(assets: Path, model: str) -> Scene:
    """The model under a grey dome and one sun from the upper left of its front, whatever the default lighting is."""
    scene = phrt.load_scene(assets / "gltf" / model / f"{model}.glb")
    scene.nodes.append(SceneNode("/test_sun", -1, look_at((-1.0, 2.0, 3.0), (0.0, 0.0, 0.0))))
    scene.lights[:] = [SceneLight("/test_sun", len(scene.nodes) - 1, Light("directional", intensity=2.0))]
    scene.dome = Dome((0.3, 0.3, 0.3))
    return scene


def framed(world: World, towards: tuple[float, float, float]) -> CameraView:
    """The whole model from direction `towards`, without perspective."""
    low, high = (corner.astype(float) for corner in world.bounds())
    centre, radius = (low + high) / 2, float(np.linalg.norm(high - low)) / 2
    eye = centre + np.array(towards) / np.linalg.norm(towards) * radius * 2
    matrix = look_at(tuple(eye.tolist()), tuple(centre.tolist()))  # type: ignore[arg-type]
    corners = np.array([[(low, high)[i >> k & 1][k] for k in range(3)] for i in range(8)])
    half = np.abs((corners - centre) @ matrix[:3, :2]).max(axis=0) * 1.02
    height = max(half[1], half[0] * HEIGHT / WIDTH)
    return CameraView(WIDTH, HEIGHT, matrix, (height * WIDTH / HEIGHT, height), orthographic=True)


def picture(scene: Scene, towards: tuple[float, float, float], gbuffer: str) -> np.ndarray:
    """(240, 320, 3) uint8 sRGB: G-buffer, light and dome; nothing traced, nothing random."""
    options = {"heuristic": "raster_only", "effects": PLAIN_FALLBACKS}
    with phrt.Renderer(scene, size=(WIDTH, HEIGHT), gbuffer=gbuffer, aa=4, **options) as renderer:
        image = renderer.render(camera=framed(renderer.world, towards)).image
    assert np.isfinite(image).all()
    return to_8bit(image, "srgb")


def difference(image: np.ndarray, reference: np.ndarray) -> float:
    """Mean difference of the worst tile, 0..1."""
    assert image.shape == reference.shape == (HEIGHT, WIDTH, 3)
    error = np.abs(image.astype(float) - reference.astype(float)).mean(axis=2) / 255
    return float(error.reshape(HEIGHT // TILE, TILE, WIDTH // TILE, TILE).mean(axis=(1, 3)).max())


def reference(name: str) -> np.ndarray:
    return np.asarray(Image.open(REFERENCES / f"{name}.png").convert("RGB"))


@pytest.mark.parametrize("gbuffer", ["raycast", "moderngl"])
@pytest.mark.parametrize("name", PICTURES)
def test_a_khronos_model_looks_as_its_readme_says(name: str, gbuffer: str, assets: Path, tmp_path: Path) -> None:
    reason = get_registry().find("gbuffer", gbuffer).unavailable_reason()
    if reason:
        needs.absent(reason)
    model, towards = PICTURES[name]
    image = picture(load(assets, model), towards, gbuffer)
    Image.fromarray(image).save(tmp_path / f"{name}_{gbuffer}.png")
    assert difference(image, reference(name)) < TOLERANCE, f"look at {tmp_path}"


# --- what must fail -------------------------------------------------------------------------------------------------


def flip_v(scene: Scene) -> None:
    for mesh in scene.meshes:
        if mesh.uv0 is not None:
            mesh.uv0 = mesh.uv0 * np.float32([1, -1]) + np.float32([0, 1])


def mirror_u(scene: Scene) -> None:
    for mesh in scene.meshes:
        if mesh.uv0 is not None:
            mesh.uv0 = mesh.uv0 * np.float32([-1, 1]) + np.float32([1, 0])


def mirror_x(scene: Scene) -> None:
    """The picture the other way round, by a mirrored world."""
    for node in scene.nodes:
        if node.parent < 0 and node.path != "/test_sun":
            node.matrix = np.diag([-1.0, 1.0, 1.0, 1.0]) @ node.matrix


def wrap_everything(mode: Wrap) -> Mutant:
    def mutant(scene: Scene) -> None:
        for material in scene.materials:
            for slot in TEXTURE_SLOTS:
                ref = getattr(material, slot)
                if ref is not None:
                    setattr(material, slot, replace(ref, wrap_s=mode, wrap_t=mode))

    return mutant


def sides(double: bool) -> Mutant:
    def mutant(scene: Scene) -> None:
        for material in scene.materials:
            material.double_sided = double

    return mutant


def transpose_rotations(scene: Scene) -> None:
    """The mistake the model's README shows."""
    for node in scene.nodes:
        if node.path != "/test_sun":
            node.matrix = node.matrix.copy()
            node.matrix[:3, :3] = node.matrix[:3, :3].T


def inside_out(scene: Scene) -> None:
    """Normals that point into what is mirrored."""
    for entry in scene.objects:
        if np.linalg.det(scene.nodes[entry.node].matrix[:3, :3]) < 0:
            mesh = scene.meshes[entry.mesh]
            if mesh.normals is not None:
                scene.meshes.append(replace(mesh, normals=-mesh.normals))
                entry.mesh = len(scene.meshes) - 1


MUTANTS: list[tuple[str, str, Mutant]] = [
    ("negative_scale", "flip v", flip_v),
    ("negative_scale", "mirror u", mirror_u),
    ("negative_scale", "mirror x", mirror_x),
    ("negative_scale", "all double-sided", sides(double=True)),
    ("negative_scale", "inside out", inside_out),
    ("texture_settings", "flip v", flip_v),
    ("texture_settings", "mirror u", mirror_u),
    ("texture_settings", "mirror x", mirror_x),
    ("texture_settings", "wrap modes dropped", wrap_everything("repeat")),
    ("texture_settings", "all clamped", wrap_everything("clamp")),
    ("texture_settings", "all mirrored", wrap_everything("mirror")),
    ("texture_settings", "all double-sided", sides(double=True)),
    ("texture_settings", "all single-sided", sides(double=False)),
    ("orientation_front", "mirror x", mirror_x),
    ("orientation_front", "transposed", transpose_rotations),
    ("orientation_back", "transposed", transpose_rotations),
]


@pytest.mark.parametrize(("name", "what", "mutant"), MUTANTS, ids=[f"{name}-{what}" for name, what, _ in MUTANTS])
def test_a_mistake_fails(name: str, what: str, mutant: Mutant, assets: Path) -> None:
    model, towards = PICTURES[name]
    scene = load(assets, model)
    mutant(scene)
    assert difference(picture(scene, towards, "raycast"), reference(name)) > 2 * TOLERANCE, what


def test_winding_that_does_not_turn_with_a_negative_scale_fails(assets: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(phrt.geometry, "mirrors", lambda matrix: np.zeros(len(matrix), bool))
    model, towards = PICTURES["negative_scale"]
    image = picture(load(assets, model), towards, "raycast")
    assert difference(image, reference("negative_scale")) > 2 * TOLERANCE


if __name__ == "__main__":
    for picture_name, (model_name, seen_from) in PICTURES.items():
        pixels = picture(load(needs.ASSETS, model_name), seen_from, "raycast")
        Image.fromarray(pixels).save(Path(sys.argv[1]) / f"{picture_name}.png")
