"""The kit finds what a loader does wrong. Each broken one is a sound one with one thing changed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from phrt.errors import AssetError
from phrt.interfaces.loader import LoadContext, Loader
from phrt.model import Image, Material, Mesh, Model, Node, TextureRef
from phrt.registry import Options
from phrt.testing import BrokenContract, check_loader

CORNERS = "0 0 0\n1 0 0\n0 1 0\n"
calls = 0


class Sound(Loader):
    """Three corners, a line each, and one triangle between them."""

    def __init__(self, options: Options) -> None:
        pass

    def load(self, path: Path, context: LoadContext) -> Model:
        try:
            rows = [[float(each) for each in line.split()] for line in path.read_text().splitlines()]
            corners = np.array(rows, np.float32).reshape(3, 3)
        except (OSError, ValueError) as error:
            raise AssetError(f"{path.name}: {error}") from error
        if not np.isfinite(corners).all():
            raise AssetError(f"{path.name}: not finite")
        return self.made(corners)

    def made(self, corners: np.ndarray) -> Model:
        mesh = Mesh("triangle", corners, np.array([[0, 1, 2]], np.int32), np.zeros(1, np.int32))
        return Model([Node("node", meshes=[0])], [mesh], [Material("plain")])


class Changed(Sound):
    """A sound one whose mesh, node, material or model has other values."""

    mesh: ClassVar[dict[str, Any]] = {}
    node: ClassVar[dict[str, Any]] = {}
    material: ClassVar[dict[str, Any]] = {}
    model: ClassVar[dict[str, Any]] = {}

    def made(self, corners: np.ndarray) -> Model:
        model = super().made(corners)
        return replace(
            model, meshes=[replace(model.meshes[0], **self.mesh)], nodes=[replace(model.nodes[0], **self.node)],
            materials=[replace(model.materials[0], **self.material)], **self.model,
        )  # fmt: skip


def changed(**parts: dict[str, Any]) -> type[Changed]:
    return type("Changed", (Changed,), parts)


class Forgets(Sound):
    def load(self, path: Path, context: LoadContext) -> Model:
        return None  # type: ignore[return-value]


class NeverTheSame(Sound):
    def made(self, corners: np.ndarray) -> Model:
        global calls
        calls += 1
        return super().made(corners + np.float32(calls))


class Careless(Sound):
    def load(self, path: Path, context: LoadContext) -> Model:
        return self.made(np.loadtxt(path, dtype=np.float32).reshape(3, 3))


class Credulous(Sound):
    """Takes any number of a broken file."""

    def load(self, path: Path, context: LoadContext) -> Model:
        count = len(path.read_bytes())
        return changed(mesh={"triangles": np.array([[0, 1, min(count // 9, 2)]], np.int32) + (count < 9) * 9})(
            Options()
        ).made(np.eye(3, dtype=np.float32))


class WritesIntoTheFile(Sound):
    def load(self, path: Path, context: LoadContext) -> Model:
        model = super().load(path, context)
        path.write_text(path.read_text().rstrip())
        return model


PICTURE = Image("picture", np.zeros((2, 2, 3), np.uint8))
BROKEN: list[tuple[type[Loader], str]] = [
    (Forgets, r"it returns a phrt\.model\.Model, not None"),
    (NeverTheSame, "the same file gives the same model"),
    (Careless, r"a broken file is an AssetError, or gives a model, but load\(\) raised .*corner\.txt, (empty|cut off)"),
    (Credulous, r"triangles name vertices .*corner\.txt, (cut off|empty)"),
    (WritesIntoTheFile, "a file is not written to"),
    (changed(mesh={"positions": np.zeros((3, 3))}), r"positions are float32\(3, 3\), not float64\(3, 3\)"),
    (changed(mesh={"positions": np.full((3, 3), np.nan, np.float32)}), "positions are finite"),
    (changed(mesh={"triangles": np.array([[0, 1, 3]], np.int32)}), "triangles name vertices"),
    (changed(mesh={"triangle_material": np.array([1], np.int32)}), "triangles have a material that is there"),
    (changed(mesh={"normals": np.full((3, 3), 0.5, np.float32)}), "normals have unit length"),
    (changed(mesh={"uv0": np.zeros((2, 2), np.float32)}), r"uv0 are float32\(3, 2\), not float32\(2, 2\)"),
    (changed(node={"meshes": [1]}), "a node's meshes are there"),
    (changed(node={"parent": 0}), "parents come before their children"),
    (changed(node={"light": 0}), "a node's light is there"),
    (changed(node={"matrix": np.eye(3)}), "a matrix is 4 x 4 finite numbers"),
    (changed(material={"roughness": float("nan")}), "roughness is finite"),
    (changed(material={"base_color_texture": TextureRef(0)}), "base_color_texture names an image that is there"),
    (changed(model={"images": [PICTURE]}), r"pixels are uint8\(H, W, 4\), not uint8\(2, 2, 3\)"),
]  # fmt: skip


@pytest.fixture
def corner(tmp_path: Path) -> Path:
    path = tmp_path / "corner.txt"
    path.write_text(CORNERS)
    return path


def test_a_sound_one_passes(corner: Path) -> None:
    check_loader(Sound, [corner], Options())
    check_loader(Changed, [corner], Options())


@pytest.mark.parametrize(("broken", "message"), BROKEN)
def test_what_is_wrong_is_found(broken: type[Loader], message: str, corner: Path) -> None:
    with pytest.raises(BrokenContract, match=f"(?s)breaks its contract: {message}"):
        check_loader(broken, [corner], Options())


def test_a_procedural_one_needs_no_file() -> None:
    class Made(Sound):
        def load(self, path: Path, context: LoadContext) -> Model:
            return self.made(np.eye(3, dtype=np.float32))

    check_loader(Made, options=Options())
