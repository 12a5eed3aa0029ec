"""Splitting a mesh loses nothing: the same triangles, the same area, the same attributes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phrt.description.shapes import box, icosphere
from phrt.model import Mesh
from phrt.splitting import SplitMode, connected_components, extract, split_mesh


def corners(mesh: Mesh) -> np.ndarray:
    """(T, 3, 3) float32, triangles as positions."""
    return mesh.positions[mesh.triangles]


def area(mesh: Mesh) -> float:
    p = corners(mesh).astype(np.float64)
    return float(np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum() / 2)


def sorted_triangles(meshes: list[Mesh]) -> np.ndarray:
    rows = np.concatenate([corners(mesh).reshape(-1, 9) for mesh in meshes])
    return rows[np.lexsort(rows.T)]


def together(*meshes: Mesh) -> Mesh:
    """One mesh of several, mesh k with material k."""
    first = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
    return Mesh(
        name="all",
        positions=np.concatenate([mesh.positions for mesh in meshes]),
        triangles=np.concatenate([mesh.triangles + first[k] for k, mesh in enumerate(meshes)]).astype(np.int32),
        triangle_material=np.repeat(np.arange(len(meshes), dtype=np.int32), [len(m.triangles) for m in meshes]),
        normals=np.concatenate([mesh.normals for mesh in meshes if mesh.normals is not None]),
        uv0=np.concatenate([mesh.uv0 for mesh in meshes if mesh.uv0 is not None]),
    )


def moved(mesh: Mesh, by: tuple[float, float, float]) -> Mesh:
    return Mesh(
        mesh.name, mesh.positions + np.array(by, np.float32), mesh.triangles, mesh.triangle_material, mesh.normals,
        uv0=mesh.uv0,
    )  # fmt: skip


SCENE = together(icosphere("a", 1.0, 2), moved(box("b", (1, 1, 1)), (5, 0, 0)), moved(box("c", (1, 2, 1)), (0, 0, 9)))


@pytest.mark.parametrize(
    ("mode", "options", "count"),
    [
        ("material", {}, 3),
        ("components", {}, 3),
        ("grid", {"cells": (2, 1, 1)}, 2),
        ("grid", {"cells": (1, 1, 1)}, 1),
        ("grid", {"size": 100.0}, 1),
    ],
)
def test_pieces_hold_every_triangle_once(mode: SplitMode, options: dict[str, object], count: int) -> None:
    pieces = split_mesh(SCENE, mode, **options)  # type: ignore[arg-type]
    assert len(pieces) == count
    assert sum(len(piece.triangles) for piece in pieces) == len(SCENE.triangles)
    assert sum(area(piece) for piece in pieces) == pytest.approx(area(SCENE), rel=1e-6)
    assert np.array_equal(sorted_triangles(pieces), sorted_triangles([SCENE]))


def test_pieces_hold_only_the_vertices_they_use_with_their_attributes() -> None:
    for piece in split_mesh(SCENE, "components"):
        assert piece.normals is not None
        assert piece.uv0 is not None
        assert len(piece.positions) == len(piece.normals) == len(piece.uv0) == len(np.unique(piece.triangles))
        assert piece.triangles.dtype == np.int32
    sphere = split_mesh(SCENE, "material")[0]
    assert sphere.normals == pytest.approx(sphere.positions, abs=1e-6)


def test_a_box_whose_sides_share_no_vertex_is_one_component() -> None:
    assert len(np.unique(connected_components(box("b", (1, 1, 1)).positions, box("b", (1, 1, 1)).triangles))) == 1


def test_negative_zero_is_the_same_place_as_zero() -> None:
    positions = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-0.0, 0, 0], [-1, 0, 0], [0, -1, 0]], np.float32)
    triangles = np.array([[0, 1, 2], [3, 4, 5]], np.int32)
    assert connected_components(positions, triangles).tolist() == [0, 0]


def test_a_long_strip_is_one_component() -> None:
    count = 3000
    shuffled = np.random.default_rng(3).permutation(count + 2)
    positions = np.stack([shuffled, shuffled % 7, shuffled % 3], axis=1).astype(np.float32)
    triangles = np.stack([np.arange(count), np.arange(count) + 1, np.arange(count) + 2], axis=1).astype(np.int32)
    assert set(connected_components(positions, triangles).tolist()) == {0}


def test_a_grid_piece_lies_in_its_cell_by_centroid() -> None:
    pieces = split_mesh(icosphere("a", 1.0, 3), "grid", cells=(2, 2, 2))
    assert len(pieces) == 8
    octants = {tuple(np.sign(corners(piece).mean(axis=1).mean(axis=0)).astype(int)) for piece in pieces}
    assert len(octants) == 8


def test_an_empty_mesh_stays_whole() -> None:
    empty = extract(SCENE, np.zeros(0, np.int64), "empty")
    assert split_mesh(empty, "grid") == [empty]


@settings(max_examples=80, deadline=None)
@given(st.data())
def test_components_are_those_of_a_plain_search(data: st.DataObject) -> None:
    places = data.draw(st.integers(3, 14))
    vertex_place = np.array(data.draw(st.lists(st.integers(0, places - 1), min_size=3, max_size=24)))
    index = st.integers(0, len(vertex_place) - 1)
    triangles = np.array(data.draw(st.lists(st.tuples(index, index, index), min_size=1, max_size=20)), np.int32)
    positions = np.stack([vertex_place, vertex_place * 0, vertex_place * 0], axis=1).astype(np.float32)
    found = connected_components(positions, triangles)
    groups = list(range(places))
    for triangle in vertex_place[triangles]:
        merged = {groups[place] for place in triangle}
        groups = [min(merged) if group in merged else group for group in groups]
    wanted = [groups[vertex_place[triangle[0]]] for triangle in triangles]
    for a in range(len(triangles)):
        for b in range(a):
            assert (found[a] == found[b]) == (wanted[a] == wanted[b])


def test_sponza_splits_without_loss(assets: Path) -> None:
    from phrt.description.assets import AssetRoots
    from phrt.description.models import ModelStore, join
    from phrt.errors import PhrtWarning

    path = assets / "sponza" / "sponza_textured.glb"
    with pytest.warns(PhrtWarning, match="normals of length zero"):
        model = ModelStore(AssetRoots(path.parent)).model(path, None, {}, path)
    mesh = join(model, "sponza")
    for mode in ("material", "components", "grid"):
        pieces = split_mesh(mesh, mode)  # type: ignore[arg-type]
        assert sum(len(piece.triangles) for piece in pieces) == 66_454
        assert sum(area(piece) for piece in pieces) == pytest.approx(area(mesh), rel=1e-5)
