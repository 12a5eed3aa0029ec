"""`import phrt` is light, and everything it promises is there."""

from __future__ import annotations

import subprocess
import sys

import pytest

import phrt


def run_python(code: str) -> None:
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, timeout=120)


def test_importing_phrt_imports_no_heavy_library() -> None:
    heavy = "numba moderngl open3d embreex trimesh OpenEXR numpy pydantic typer"
    run_python(f"import phrt, sys; found = set({heavy!r}.split()) & set(sys.modules); assert not found, found")


def test_errors_and_register_need_no_numba() -> None:
    run_python("import phrt, sys; phrt.InputError, phrt.register; assert 'numba' not in sys.modules")


@pytest.mark.parametrize("name", phrt.__all__)
def test_every_public_name_is_there(name: str) -> None:
    assert getattr(phrt, name) is not None
    assert name in dir(phrt)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'phrt' has no attribute 'render_scene'"):
        _ = phrt.render_scene  # type: ignore[attr-defined]


def test_every_error_is_one_of_phrts() -> None:
    for name in ("SceneError", "AssetError", "OptionError", "PluginError"):
        assert issubclass(getattr(phrt, name), phrt.InputError)
    assert issubclass(phrt.InputError, phrt.PhrtError)
