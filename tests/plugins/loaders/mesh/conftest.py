"""`load` of the mesh loader's tests: text or bytes as a file, through a context that is confined to its folder."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from phrt.errors import AssetError
from phrt.interfaces.loader import LoadContext
from phrt.model import Model
from phrt_plugins.loaders.mesh import MeshLoader
from phrt_plugins.loaders.options import MeshOptions


def confined(root: Path, warnings: list[str]) -> LoadContext:
    """A context that finds files in `root` only, as the scene loader does, and collects warnings."""

    def resolve(reference: str) -> Path:
        path = (root / reference).resolve()
        if not path.is_relative_to(root.resolve()):
            raise AssetError(f"'{reference}' is outside the asset roots")
        if not path.is_file():
            raise AssetError(f"'{reference}' does not exist")
        return path

    return LoadContext(resolve, warnings.append)


@pytest.fixture
def context() -> Callable[[Path, list[str]], LoadContext]:
    return confined


@pytest.fixture
def load(tmp_path: Path) -> Callable[..., Model]:
    """load(content, suffix=".obj", warnings=None, **options): the model of a file `thing` with `content`.

    Warnings go into the list `warnings`; without one, a warning is an AssertionError."""

    def load_content(
        content: str | bytes, suffix: str = ".obj", warnings: list[str] | None = None, **options: object
    ) -> Model:
        path = tmp_path / f"thing{suffix}"
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        collected: list[str] = []
        model = MeshLoader(MeshOptions.model_validate(options)).load(path, confined(tmp_path, collected))
        if warnings is None:
            assert collected == []
        else:
            warnings.extend(collected)
        return model

    return load_content
