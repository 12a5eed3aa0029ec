"""scripts/contact_sheet.py: one tile a model, failures shown and counted."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from PIL import Image

SCRIPT = Path(__file__).resolve().parents[1] / "scripts" / "contact_sheet.py"

TRIANGLE = {
    "asset": {"version": "2.0"},
    "scene": 0,
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 0]}
    ],
    "bufferViews": [{"buffer": 0, "byteLength": 36}],
    "buffers": [{"byteLength": 36, "uri": "points.bin"}],
}


@pytest.fixture(scope="module")
def sheet() -> ModuleType:
    spec = importlib.util.spec_from_file_location("contact_sheet", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    import sys

    sys.modules["contact_sheet"] = module
    spec.loader.exec_module(module)
    return module


def write_triangle(folder: Path, points: np.ndarray) -> None:
    folder.mkdir()
    (folder / "points.bin").write_bytes(points.astype(np.float32).tobytes())
    (folder / "model.gltf").write_text(json.dumps(TRIANGLE))


def test_good_models_are_pictures_and_bad_ones_red(sheet: ModuleType, tmp_path: Path) -> None:
    write_triangle(tmp_path / "good", np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    write_triangle(tmp_path / "truncated", np.array([[0, 0, 0]]))
    output = tmp_path / "sheet.png"
    assert sheet.main([str(tmp_path), "-o", str(output), "--size", "40x30", "--columns", "2", "--aa", "1"]) == 1
    pixels = np.asarray(Image.open(output).convert("RGB")).astype(int)
    assert pixels.shape == (30 + 18 + 2 * 6, 2 * (40 + 6) + 6, 3)
    good, bad = pixels[6:36, 6:46], pixels[6:36, 52:92]
    assert good.reshape(-1, 3).std(axis=0).max() > 5
    assert np.median(bad.reshape(-1, 3), axis=0).tolist() == [120, 20, 20]


def test_who_finds_what_is_seen_can_be_chosen(
    sheet: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_triangle(tmp_path / "good", np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    shared = [str(tmp_path / "good"), "-o", str(tmp_path / "sheet.png"), "--size", "40x30", "--aa", "1"]
    assert sheet.main([*shared, "--gbuffer", "raycast"]) == 0
    assert sheet.main([*shared, "--gbuffer", "raycats"]) == 1
    assert "raycats" in capsys.readouterr().err


def test_folder_without_models_is_the_users_mistake(
    sheet: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sheet.main([str(tmp_path), "-o", str(tmp_path / "sheet.png")]) == 2
    assert "no .gltf or .glb file" in capsys.readouterr().err
    assert not (tmp_path / "sheet.png").exists()


def test_long_names_keep_their_end(sheet: ModuleType) -> None:
    assert sheet.shortened("folder/of/models/Box.gltf", 12) == ".../Box.gltf"
    assert sheet.shortened("Box.gltf", 12) == "Box.gltf"
