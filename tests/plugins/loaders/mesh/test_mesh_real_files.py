"""Third-party files, good and bad: an AssetError or a sound model, never anything else."""

from __future__ import annotations

import resource
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import needs
import numpy as np
import pytest

from phrt.errors import AssetError
from phrt.interfaces.loader import LoadContext
from phrt.model import Model
from phrt_plugins.loaders.mesh import SUFFIXES, MeshLoader
from phrt_plugins.loaders.options import MeshOptions

Context = Callable[[Path, list[str]], LoadContext]

FOLDERS = ("invalid", "cornell", "stanford", "armadillo")


ROOT = needs.ASSETS


def names() -> list[str]:
    """Every OBJ, PLY and STL of `FOLDERS`, relative to the assets; "none" where these are absent."""
    found = [
        path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*")) if path.suffix.lower() in SUFFIXES
    ]
    return [str(path.relative_to(ROOT)) for path in found] or ["none"]


def load(path: Path, context: Context, assets: Path) -> tuple[Model, list[str]]:
    warnings: list[str] = []
    beside = context(assets, warnings)

    def resolve(reference: str) -> Path:
        return beside.resolve(str(path.parent.relative_to(assets) / reference))

    return MeshLoader(MeshOptions()).load(path, LoadContext(resolve, warnings.append)), warnings


def assert_sound(model: Model) -> None:
    assert model.meshes
    assert [node.meshes for node in model.nodes] == [[index] for index in range(len(model.meshes))]
    for mesh in model.meshes:
        count = len(mesh.positions)
        assert len(mesh.triangles) == len(mesh.triangle_material) > 0
        assert 0 <= mesh.triangles.min() <= mesh.triangles.max() < count
        assert mesh.triangle_material.max() < len(model.materials)
        assert np.isfinite(mesh.positions).all()
        assert mesh.normals is not None
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1.0, atol=1e-4)
        for attribute, width in ((mesh.normals, 3), (mesh.uv0, 2), (mesh.colors, 4)):
            assert attribute is None or (attribute.shape == (count, width) and np.isfinite(attribute).all())


@pytest.mark.parametrize("name", names())
def test_every_file_is_a_sound_model_or_an_asset_error(assets: Path, context: Context, name: str) -> None:
    start, memory = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    try:
        model, _ = load(assets / name, context, assets)
    except AssetError as error:
        named = Path(name).name in str(error)
    else:
        named = True
        assert_sound(model)
    assert named
    # Not speed: a file that a reader hangs on or unpacks without bounds. Kilobytes on Linux.
    assert time.perf_counter() - start < 10
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory < 1_000_000


def test_the_largest_file_needs_little_memory(assets: Path, context: Context) -> None:
    tracemalloc.start()
    try:
        load(assets / "invalid" / "truncated" / "sponza_crytek_truncated.obj", context, assets)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 100e6


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("assimp/invalid/malformed.obj", "line 28: 'f 0 7 8 5' has an index before the first element"),
        ("assimp/invalid/empty.ply", "is empty"),
        ("assimp/invalid/crash-30d6d0f7c529b3b66b4131700b7a4580cd7082df.ply", "has no 'end_header'"),
        ("assimp/PLY_odd/points.ply", "has no faces, only 4 points"),
        ("trimesh/emptyIO/obj_wireframe.obj", "has no triangles, only 8 points"),
        ("trimesh/emptyIO/stl_empty_bin.stl", "has no triangles"),
        ("trimesh/face_in_group_name_mid_file.obj", "line 5: vn index 1 is past the end, the file has 0"),
    ],
)
def test_bad_files_say_what_is_wrong(assets: Path, context: Context, name: str, message: str) -> None:
    with pytest.raises(AssetError) as raised:
        load(assets / "invalid" / name, context, assets)
    assert message in str(raised.value)


@pytest.mark.parametrize(
    ("name", "triangles"),
    [
        ("armadillo/armadillo_100k.obj", 99_994),
        ("stanford/bun_zipper.ply", 69_451),
        ("stanford/dragon_20k.obj", 20_000),
        ("stanford/teapot.obj", 6_320),
        ("cornell/mcguire/CornellBox-Original.obj", 36),
        ("invalid/assimp/OBJ_odd/box_UTF16BE.obj", 12),
        ("invalid/assimp/PLY_odd/cube.ply", 12),
        ("invalid/trimesh/multibody.stl", 32),
    ],
)
def test_good_files_have_all_their_triangles(assets: Path, context: Context, name: str, triangles: int) -> None:
    model, _ = load(assets / name, context, assets)
    assert sum(len(mesh.triangles) for mesh in model.meshes) == triangles


def test_the_cornell_box_has_its_objects_and_its_light(assets: Path, context: Context) -> None:
    model, _ = load(assets / "cornell" / "mcguire" / "CornellBox-Original.obj", context, assets)
    names = [mesh.name for mesh in model.meshes]
    assert len(names) == 8
    assert {"floor", "ceiling", "light"} <= set(names)
    light = model.meshes[names.index("light")]
    assert {model.materials[index].emissive for index in light.triangle_material} == {(17.0, 12.0, 4.0)}


def test_the_truncated_sponza_says_that_it_is_cut_off(assets: Path, context: Context) -> None:
    _, warnings = load(assets / "invalid" / "truncated" / "sponza_crytek_truncated.obj", context, assets)
    assert any("the file is cut off" in warning for warning in warnings)
