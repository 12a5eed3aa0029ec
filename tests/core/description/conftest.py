"""Writes small scene files and loads them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from phrt.errors import SceneError
from phrt.loading import load_scene
from phrt.scene import Scene

Write = Callable[..., Path]


@pytest.fixture(autouse=True)
def no_asset_folders(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Scenes find nothing by accident."""
    monkeypatch.delenv("PHRT_ASSETS", raising=False)


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """write(text, name="scene.yaml") puts a file into a folder of its own and returns its path."""

    def put(text: str, name: str = "scene.yaml") -> Path:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return path

    return put


@pytest.fixture
def load(write: Write) -> Callable[..., Scene]:
    """load(text, **options) is the scene that text describes."""

    def loaded(text: str, **options: object) -> Scene:
        return load_scene(write(text), **options)  # type: ignore[arg-type]

    return loaded


@pytest.fixture
def error_of(write: Write) -> Callable[..., str]:
    """error_of(text, **options) is the message of the SceneError that loading it raises, the folder left out."""

    def message(text: str, **options: object) -> str:
        path = write(text)
        with pytest.raises(SceneError) as caught:
            load_scene(path, **options)  # type: ignore[arg-type]
        return str(caught.value).replace(f"{path.parent}/", "")

    return message
