"""Simplified meshes: fewer triangles, the same shape, nothing torn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from phrt import OptionError, SceneError, load_scene
from phrt.description.shapes import icosphere
from phrt.model import Mesh
from phrt.splitting import split_mesh, weld
from phrt_plugins import packages
from phrt_plugins.loaders.decimate import TOLERANCE, decimated, point_triangle_distance
from phrt_plugins.loaders.simplify import simplification, simplified

ROOT = Path(__file__).resolve().parents[3]


def sheet(cells: int, wave: float = 0.0) -> Mesh:
    """A square of 2 `cells`^2 triangles in X and Z, one metre wide, u = x and v = z; material 1 where x > 0.5."""
    x, z = (axis.reshape(-1) for axis in np.meshgrid(*[np.linspace(0, 1, cells + 1)] * 2))
    y = wave * np.sin(3 * x) * np.sin(2 * z)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1)
    quad = np.stack([corner, corner + cells + 1, corner + cells + 2, corner + 1], axis=1)
    triangles = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]).astype(np.int32)
    points = np.stack([x, y, z], axis=1).astype(np.float32)
    material = (points[triangles, 0].mean(axis=1) > 0.5).astype(np.int32)
    return Mesh("sheet", points, triangles, material, uv0=np.ascontiguousarray(points[:, [0, 2]]))


def globe(segments: int) -> Mesh:
    """A ball of radius 1 with a seam: u goes once round from 0 to 1, and the places at its start are there twice."""
    u, v = np.meshgrid(np.arange(segments + 1) / segments, np.arange(1, segments) / segments)
    angle = 2 * np.pi * np.where(u == 1, 0, u)
    ring = np.sin(np.pi * v)
    points = np.stack([ring * np.cos(angle), np.cos(np.pi * v), -ring * np.sin(angle)], axis=-1).reshape(-1, 3)
    row, column = (
        axis.reshape(-1) for axis in np.meshgrid(np.arange(segments - 2), np.arange(segments), indexing="ij")
    )
    a = row * (segments + 1) + column
    quad = np.stack([a, a + segments + 1, a + segments + 2, a + 1], axis=1)
    poles = np.array([[0.0, 1, 0], [0, -1, 0]])
    top, bottom = len(points), len(points) + 1
    last = (segments - 2) * (segments + 1)
    around = np.arange(segments)
    caps = [[np.full(segments, top), around, around + 1], [np.full(segments, bottom), last + around + 1, last + around]]
    triangles = np.concatenate([quad[:, [0, 1, 2]], quad[:, [0, 2, 3]], *(np.stack(cap, axis=1) for cap in caps)])
    positions = np.concatenate([points, poles]).astype(np.float32)
    uv = np.concatenate([np.stack([u, v], axis=-1).reshape(-1, 2), [[0.5, 0.0], [0.5, 1.0]]]).astype(np.float32)
    return Mesh(
        "globe", positions, triangles.astype(np.int32), np.zeros(len(triangles), np.int32), positions.copy(), uv0=uv
    )


def area(mesh: Mesh) -> np.ndarray:
    corners = mesh.positions[mesh.triangles].astype(np.float64)
    return np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2


def rim_edges(mesh: Mesh) -> set[tuple[bytes, bytes]]:
    """Edges of one triangle only, by their places."""
    place = weld(mesh.positions)[mesh.triangles]
    edges = np.sort(np.concatenate([place[:, [0, 1]], place[:, [1, 2]], place[:, [2, 0]]]), axis=1)
    distinct, count = np.unique(edges, axis=0, return_counts=True)
    points = np.zeros((place.max() + 1, 3), np.float32)
    points[place.reshape(-1)] = mesh.positions[mesh.triangles.reshape(-1)]
    return {tuple(sorted(points[end].tobytes() for end in edge)) for edge in distinct[count == 1]}  # type: ignore[misc]


def test_a_ball_keeps_a_quarter_of_its_triangles_and_its_shape() -> None:
    ball = icosphere("ball", 0.5, 4)
    result = decimated(ball, 0.25)
    assert 0.2 * len(ball.triangles) <= len(result.triangles) <= 0.3 * len(ball.triangles)
    np.testing.assert_allclose(np.ptp(result.positions, axis=0), 1.0, atol=0.02)
    assert area(result).sum() == pytest.approx(area(ball).sum(), rel=0.02)
    assert result.normals is not None
    np.testing.assert_allclose(result.normals, result.positions / 0.5, atol=1e-3)


def test_more_is_left_of_a_larger_share() -> None:
    ball = icosphere("ball", 0.5, 4)
    counts = [len(decimated(ball, share).triangles) for share in (0.1, 0.25, 0.5, 0.9)]
    assert counts == sorted(counts)
    assert counts[0] < 0.15 * 5120
    assert counts[-1] > 0.8 * 5120


def test_a_flat_sheet_stays_flat_and_as_large_with_its_texture_and_materials_in_place() -> None:
    before = sheet(20)
    after = decimated(before, 0.25)
    assert len(after.triangles) < 0.4 * len(before.triangles)
    assert not after.positions[:, 1].any()
    assert after.uv0 is not None
    np.testing.assert_array_equal(after.uv0, after.positions[:, [0, 2]])
    np.testing.assert_array_equal(np.ptp(after.positions, axis=0), [1, 0, 1])
    assert area(after).sum() == pytest.approx(1.0, rel=1e-5)
    for material in (0, 1):
        assert area(after)[after.triangle_material == material].sum() == pytest.approx(0.5, rel=1e-5)
    up = np.cross(*(after.positions[after.triangles[:, k]] - after.positions[after.triangles[:, 0]] for k in (1, 2)))
    assert (up[:, 1] > 0).all()


def test_the_rim_stays_so_that_pieces_of_a_split_mesh_still_fit() -> None:
    pieces = split_mesh(sheet(24, wave=0.1), "grid", cells=(2, 1, 2))
    for piece in pieces:
        result = decimated(piece, 0.3)
        assert len(result.triangles) < 0.6 * len(piece.triangles)
        assert rim_edges(result) == rim_edges(piece)


def test_a_seam_is_neither_opened_nor_crossed() -> None:
    before = globe(48)
    after = decimated(before, 0.25)
    assert len(after.triangles) < 0.35 * len(before.triangles)
    assert rim_edges(before) == rim_edges(after) == set()
    assert after.uv0 is not None
    # A triangle over the seam would show nearly all of u, backwards. At the poles all of u comes together.
    corners = after.triangles[(np.abs(after.positions[after.triangles, 1]) < 0.9).all(axis=1)]
    middle = after.positions[corners].mean(axis=1)
    angle = np.arctan2(-middle[:, 2], middle[:, 0]) / (2 * np.pi)
    assert np.abs((after.uv0[corners, 0].mean(axis=1) - angle + 0.5) % 1 - 0.5).max() < 0.02
    assert np.ptp(after.uv0[corners, 0], axis=1).max() < 0.25
    assert (after.uv0.min(), after.uv0.max()) == (0.0, 1.0)
    angle = np.arctan2(-after.positions[:, 2], after.positions[:, 0]) / (2 * np.pi)
    off = (after.uv0[:, 0] - angle + 0.5) % 1 - 0.5
    assert np.abs(off[np.abs(after.positions[:, 1]) < 0.999]).max() < 1e-4


def test_no_place_is_farther_from_the_result_than_the_tolerance() -> None:
    before = sheet(24, wave=0.3)
    after = decimated(before, 0.1)
    assert len(after.triangles) < len(before.triangles)
    triangles = after.positions[after.triangles].astype(np.float64)
    point = np.repeat(before.positions.astype(np.float64), len(triangles), axis=0)
    distance = point_triangle_distance(point, np.tile(triangles, (len(before.positions), 1, 1)))
    diagonal = np.linalg.norm(np.ptp(before.positions, axis=0))
    assert distance.reshape(len(before.positions), -1).min(axis=1).max() <= TOLERANCE * diagonal * 1.001


def test_distance_of_a_point_from_a_triangle() -> None:
    triangle = np.tile(np.array([[0.0, 0, 0], [2, 0, 0], [0, 2, 0]]), (4, 1, 1))
    points = np.array([[0.5, 0.5, 3], [3, 0, 0], [1.5, 1.5, 0], [-3, -4, 0]])
    np.testing.assert_allclose(point_triangle_distance(points, triangle), [3, 1, np.sqrt(0.5), 5])


def test_every_vertex_of_the_result_was_one_before() -> None:
    before = globe(24)
    after = decimated(before, 0.5)
    rows = {np.concatenate(row).tobytes() for row in zip(before.positions, before.normals, before.uv0, strict=True)}  # type: ignore[arg-type]
    assert all(
        np.concatenate(row).tobytes() in rows
        for row in zip(after.positions, after.normals, after.uv0, strict=True)  # type: ignore[arg-type]
    )


def test_a_mesh_of_few_triangles_and_one_whose_triangles_share_nothing_are_left() -> None:
    small, loose = sheet(2), sheet(10)
    order = loose.triangles.reshape(-1)
    normals = np.tile(np.float32([0, 1, 0]), (len(order), 1))
    loose = Mesh(
        "loose",
        loose.positions[order],
        np.arange(len(order), dtype=np.int32).reshape(-1, 3),
        loose.triangle_material,
        normals,
    )
    assert decimated(small, 0.25) is small
    assert decimated(loose, 0.25) is loose


def test_a_scene_keeps_its_objects_and_counts_what_was_left() -> None:
    scene = load_scene(ROOT / "scenes" / "spheres.yaml")
    result = simplified(scene, 0.25)
    assert [entry.path for entry in result.objects] == [entry.path for entry in scene.objects]
    assert result.materials is scene.materials
    assert [mesh.name for mesh in result.meshes] == [mesh.name for mesh in scene.meshes]
    found = simplification(scene, result)
    assert found.left == ("Plane",)
    assert (found.before, found.after) == (scene_triangles(scene), scene_triangles(result))
    assert found.after < 0.3 * found.before
    assert str(found).endswith(f"1 of {len(scene.meshes)} meshes as they were")
    assert simplified(scene, 1.0) is scene


def scene_triangles(scene: object) -> int:
    return sum(len(mesh.triangles) for mesh in scene.meshes)  # type: ignore[attr-defined]


def test_the_same_mesh_is_simplified_in_the_same_way() -> None:
    first, second = decimated(globe(24), 0.4), decimated(globe(24), 0.4)
    np.testing.assert_array_equal(first.positions, second.positions)
    np.testing.assert_array_equal(first.triangles, second.triangles)


@pytest.mark.parametrize("share", [0.0, -1.0, 1.5, float("nan")])
def test_a_share_is_above_0_and_at_most_1(share: float) -> None:
    scene = load_scene(ROOT / "scenes" / "furnace.yaml")
    with pytest.raises(
        OptionError, match=r"simplify: given .*; wanted the share of triangles to keep, above 0 and at most 1"
    ):
        simplified(scene, share)


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(packages, "find_spec", lambda name: None)
    scene = load_scene(ROOT / "scenes" / "furnace.yaml")
    with pytest.raises(OptionError, match=r"'fast-simplification' is not installed: pip install 'phrt\[bench\]'"):
        simplified(scene, 0.5)
    with pytest.raises(SceneError, match=r"loader 'simplified' is not available here: .*pip install 'phrt\[bench\]'"):
        load_scene(written(tmp_path, "loader: simplified, options: {of: atrium}"))


def written(folder: Path, reference: str) -> Path:
    path = folder / "scene.yaml"
    path.write_text(f"phrt: 1\nprims:\n  Model: {{type: Reference, {reference}}}\n", encoding="utf-8")
    return path


def test_a_model_is_simplified_by_the_loader_around_its_own(tmp_path: Path) -> None:
    rows = [f"v {x} {z} {0.1 * np.sin(x + z):.6f}" for x in range(12) for z in range(12)]
    cells = [12 * x + z + 1 for x in range(11) for z in range(11)]
    rows += [f"f {c} {c + 12} {c + 13} {c + 1}" for c in cells]
    (tmp_path / "cloth.obj").write_text("\n".join(rows), encoding="utf-8")
    whole = load_scene(written(tmp_path, "asset: cloth.obj"))
    fewer = load_scene(written(tmp_path, "asset: cloth.obj, loader: simplified, options: {share: 0.4}"))
    assert whole.triangle_count == 242
    assert fewer.triangle_count < 170
    assert [entry.path for entry in fewer.objects] == [entry.path for entry in whole.objects]


def test_the_loader_around_another_needs_to_know_which(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"no loader reads '.yaml' files; name one by `of`"):
        load_scene(written(tmp_path, "loader: simplified"))
    with pytest.raises(SceneError, match="`of` must name another loader"):
        load_scene(written(tmp_path, "loader: simplified, options: {of: simplified}"))
