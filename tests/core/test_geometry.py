"""Flat geometry: normals, winding, transforms and texture density."""

from __future__ import annotations

import numpy as np
import pytest
from scene_kit import Stage, at, ball, box, flipped, mesh_of, quad, turned

from phrt.geometry import FlatGeometry, flatten, texture_density, with_normals

MIRRORED = np.diag([-1.0, 1.0, 1.0, 1.0])


def flat(made: Stage) -> FlatGeometry:
    return flatten(made.scene, np.stack([node.matrix for node in made.scene.nodes]))


def face_normals(geometry: FlatGeometry) -> np.ndarray:
    a, b, c = np.moveaxis(geometry.positions[geometry.triangles].astype(float), 1, 0)
    normals = np.cross(b - a, c - a)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def test_objects_own_contiguous_rows_one_after_the_other() -> None:
    geometry = flat(Stage().add("/a", quad()).add("/b", box()).add("/c", ball(1.0, 1)))
    np.testing.assert_array_equal(geometry.first_triangle, np.cumsum(geometry.triangle_count) - geometry.triangle_count)
    assert geometry.triangle_count.tolist() == [0, 2, 12, 80]
    np.testing.assert_array_equal(geometry.triangle_object, np.repeat([1, 2, 3], [2, 12, 80]))
    np.testing.assert_array_equal(geometry.triangle_material, geometry.triangle_object)
    for k in (1, 2, 3):
        mine = geometry.triangles[geometry.triangle_object == k]
        assert mine.min() == geometry.first_vertex[k]
        assert mine.max() == geometry.first_vertex[k] + geometry.vertex_count[k] - 1


def test_a_mesh_without_normals_is_flat_shaded() -> None:
    geometry = flat(Stage().add("/box", box()))
    assert len(geometry.positions) == 36
    np.testing.assert_allclose(
        geometry.normals[geometry.triangles], face_normals(geometry)[:, None].repeat(3, 1), atol=1e-6
    )


def test_flat_corners_keep_their_own_attributes() -> None:
    mesh = quad()
    mesh.colors = np.eye(4, dtype=np.float32)
    prepared = with_normals(mesh)
    order = mesh.triangles.reshape(-1)
    np.testing.assert_array_equal(prepared.uv0, mesh.uv0[order])  # type: ignore[index]
    np.testing.assert_array_equal(prepared.colors, mesh.colors[order])
    np.testing.assert_array_equal(prepared.positions, mesh.positions[order])


def test_smooth_normals_are_weighted_by_area() -> None:
    # A large floor triangle and a small wall triangle share the edge a-b.
    positions = [[0, 0, 0], [1, 0, 0], [0, 0, -10], [0, 1, 0]]
    mesh = mesh_of(positions, [[0, 1, 2], [0, 1, 3]], smooth=True)
    normals = with_normals(mesh).normals
    assert normals is not None
    expected = np.array([0, 10, 1]) / np.sqrt(101)
    np.testing.assert_allclose(normals[:2], np.tile(expected, (2, 1)), atol=1e-6)
    np.testing.assert_allclose(normals[2:], [[0, 1, 0], [0, 0, 1]], atol=1e-6)


def test_a_triangle_without_area_gets_a_unit_normal_all_the_same() -> None:
    normals = with_normals(mesh_of(np.zeros((3, 3)), [[0, 1, 2]])).normals
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1)


@pytest.mark.parametrize(
    "matrix", [np.eye(4), MIRRORED, turned("y", 30) @ MIRRORED, -np.eye(4) + np.diag([0, 0, 0, 2.0])]
)
@pytest.mark.parametrize("shape", [ball(1.0, 2), box()])
def test_faces_and_normals_point_outwards_under_mirroring_too(matrix: np.ndarray, shape: object) -> None:
    geometry = flat(Stage().add("/shape", shape, matrix=at(3, 2, 1) @ matrix))  # type: ignore[arg-type]
    outwards = geometry.positions[geometry.triangles].mean(axis=1) - [3, 2, 1]
    assert np.all(np.sum(face_normals(geometry) * outwards, axis=1) > 0)
    assert np.all(np.sum(geometry.normals * (geometry.positions - [3, 2, 1]), axis=1) > 0)


def test_inside_out_shapes_stay_inside_out() -> None:
    geometry = flat(Stage().add("/shape", flipped(ball(1.0, 2))))
    assert np.all(np.sum(face_normals(geometry) * geometry.positions[geometry.triangles].mean(axis=1), axis=1) < 0)


def test_normals_stay_at_right_angles_under_uneven_scale() -> None:
    stretch = np.diag([3.0, 0.5, 1.0, 1.0]) @ turned("z", 30)
    geometry = flat(Stage().add("/ball", ball(1.0, 3), matrix=stretch))
    smooth = geometry.normals[geometry.triangles].mean(axis=1)
    cosine = np.sum(smooth / np.linalg.norm(smooth, axis=1, keepdims=True) * face_normals(geometry), axis=1)
    assert cosine.min() > 0.99
    np.testing.assert_allclose(np.linalg.norm(geometry.normals, axis=1), 1, atol=1e-6)


def test_a_squashed_object_keeps_finite_unit_normals() -> None:
    geometry = flat(Stage().add("/ball", ball(1.0, 2), matrix=np.diag([1.0, 0.0, 1.0, 1.0])))
    np.testing.assert_allclose(np.linalg.norm(geometry.normals, axis=1), 1, atol=1e-6)


def test_tangents_turn_with_the_object_and_change_hand_when_mirrored() -> None:
    mesh = quad()
    mesh.normals = np.tile(np.float32([0, 0, 1]), (4, 1))
    mesh.tangents = np.tile(np.float32([1, 0, 0, 1]), (4, 1))
    geometry = flat(Stage().add("/a", mesh, matrix=turned("z", 90)).add("/b", mesh, matrix=MIRRORED))
    np.testing.assert_allclose(geometry.tangents[:4], np.tile([0, 1, 0, 1], (4, 1)), atol=1e-6)
    np.testing.assert_allclose(geometry.tangents[4:], np.tile([-1, 0, 0, -1], (4, 1)), atol=1e-6)


def test_attributes_nobody_has_take_no_room_and_are_filled_in_where_some_do() -> None:
    plain = flat(Stage().add("/a", quad()))
    assert (len(plain.uv1), len(plain.colors), len(plain.tangents)) == (0, 0, 0)
    colored = quad()
    colored.colors = np.full((4, 4), 0.5, np.float32)
    mixed = flat(Stage().add("/a", quad()).add("/b", colored))
    np.testing.assert_array_equal(mixed.colors, np.repeat([1.0, 0.5], 6)[:, None] * np.ones(4))


def test_moving_rewrites_only_what_moved() -> None:
    made = Stage().add("/a", box()).add("/b", box(), matrix=at(3, 0, 0))
    geometry = flat(made)
    before = geometry.positions.copy()
    matrices = np.stack([node.matrix for node in made.scene.nodes])
    assert geometry.move(matrices, {}) == ([], [])
    assert geometry.move(matrices, {2: at(0, 5, 0) @ turned("x", 90)}) == ([2], [])
    np.testing.assert_array_equal(geometry.positions[:36], before[:36])
    moved = (before[36:] - [3, 0, 0]) @ turned("x", 90)[:3, :3].T + [0, 5, 0]
    np.testing.assert_allclose(geometry.positions[36:], moved, atol=1e-5)
    np.testing.assert_allclose(
        geometry.normals[geometry.triangles[12:]], face_normals(geometry)[12:, None].repeat(3, 1), atol=1e-5
    )
    assert geometry.move(matrices, {}) == ([2], [])
    np.testing.assert_allclose(geometry.positions, before, atol=1e-6)


def test_bounds_enclose_each_object() -> None:
    low, high = flat(Stage().add("/a", box(1, 2, 3)).add("/b", ball(0.5), matrix=at(5, 0, 0))).object_bounds()
    np.testing.assert_allclose(low, [[0, 0, 0], [-0.5, -1, -1.5], [4.5, -0.5, -0.5]], atol=0.01)
    np.testing.assert_allclose(high, [[0, 0, 0], [0.5, 1, 1.5], [5.5, 0.5, 0.5]], atol=0.01)


def test_texture_density_is_half_the_log_of_the_area_ratio() -> None:
    mesh = quad(4.0, 4.0)
    assert mesh.uv0 is not None
    np.testing.assert_allclose(texture_density(mesh.positions, mesh.uv0, mesh.triangles), np.log2(1 / 4), atol=1e-6)
    assert np.isfinite(texture_density(np.zeros((3, 3)), np.zeros((3, 2)), np.array([[0, 1, 2]]))).all()


def test_an_object_that_is_mirrored_while_moving_has_its_triangles_turned_and_turned_back() -> None:
    made = Stage().add("/a", box()).add("/b", box(), matrix=at(3, 0, 0))
    geometry = flat(made)
    matrices, before = np.stack([node.matrix for node in made.scene.nodes]), geometry.triangles.copy()
    assert geometry.move(matrices, {2: at(3, 0, 0) @ MIRRORED}) == ([2], [2])
    np.testing.assert_array_equal(geometry.triangles[:12], before[:12])
    outwards = geometry.positions[geometry.triangles[12:]].mean(axis=1) - [3, 0, 0]
    assert np.all(np.sum(face_normals(geometry)[12:] * outwards, axis=1) > 0)
    assert geometry.move(matrices, {}) == ([2], [2])
    np.testing.assert_array_equal(geometry.triangles, before)
