"""A scene is data: one that names plugins is told where they belong."""

from __future__ import annotations

from pathlib import Path

import pytest

from phrt.errors import SceneError
from phrt.loading import load_scene

PLUGIN = "raise SystemExit('this must never run')\n"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("phrt: 1\nplugins: [mine.py]\nprims: {}\n", 2),
        ("phrt: 1\nprims:\n  Ball: {type: Sphere}\nvariants:\n  night:\n    plugins: [mine.py]\n", 6),
        ("phrt: 1\nprims:\n  Settings:\n    type: RenderSettings\n    plugins: [mine.py]\n", 5),
        ("phrt: 1\nprims:\n  Ball:\n    type: Sphere\n    plugins: mine\n", 5),
    ],
)
def test_plugins_in_a_scene_are_an_error_that_says_where_they_belong(text: str, line: int, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(PLUGIN)
    (tmp_path / "scene.yaml").write_text(text)
    with pytest.raises(SceneError) as refused:
        load_scene(tmp_path / "scene.yaml")
    message = str(refused.value)
    assert f"scene.yaml:{line}: " in message
    for part in (
        "a scene is data and brings no code",
        "--plugin MODULE_OR_FILE",
        "config of a benchmark",
        "phrt.register",
    ):
        assert part in message


def test_other_unknown_keys_are_told_as_ever(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text("phrt: 1\nplugin: [mine.py]\nprims: {}\n")
    with pytest.raises(SceneError, match="unknown key 'plugin' in the scene"):
        load_scene(tmp_path / "scene.yaml")
