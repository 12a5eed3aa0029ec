"""OBJ: indices, polygons, groups, normals, colours and what is wrong with a file."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from phrt.errors import AssetError
from phrt.model import Mesh, Model

Load = Callable[..., Model]

QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n"
"""A unit square in the plane z = 0."""

CUBE = """
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 3 4 8 7\nf 2 3 7 6\nf 1 5 8 4
"""


def area(mesh: Mesh) -> float:
    a, b, c = (mesh.positions[mesh.triangles[:, k]].astype(np.float64) for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def volume(mesh: Mesh) -> float:
    a, b, c = (mesh.positions[mesh.triangles[:, k]].astype(np.float64) for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def only(model: Model) -> Mesh:
    (mesh,) = model.meshes
    return mesh


def test_arrays_have_the_types_of_the_contract(load: Load) -> None:
    mesh = only(load(QUAD + "f 1 2 3\n"))
    assert mesh.positions.dtype == np.float32
    assert mesh.triangles.dtype == np.int32
    assert mesh.triangle_material.dtype == np.int32
    assert mesh.normals is not None
    assert mesh.normals.dtype == np.float32
    assert mesh.uv0 is None
    assert mesh.colors is None
    assert mesh.positions.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
    assert mesh.normals.tolist() == [[0, 0, 1]] * 3


@pytest.mark.parametrize(
    "face",
    ["f 1 2 3", "f -4 -3 -2", "f 1/1 2/2 3/3", "f 1//1 2//1 3//1", "f 1/1/1 2/2/1 3/3/1", "f -4/-3/-1 -3/-2/1 3/-1/-1"],
)
def test_every_way_to_write_a_corner(load: Load, face: str) -> None:
    mesh = only(load(QUAD + "vt 0 0\nvt 1 0\nvt 1 0.25\nvn 0 0 2\n" + face))
    assert mesh.positions[mesh.triangles[0]].tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0]]
    assert np.allclose(mesh.normals, (0, 0, 1))
    if "/1/" in face or "1/1" in face or "-3/-1" in face:
        assert mesh.uv0 is not None
        # v runs up in the file and down in the model.
        assert mesh.uv0[mesh.triangles[0]].tolist() == [[0, 1], [1, 1], [1, 0.75]]


def test_negative_indices_count_back_from_where_the_face_stands(load: Load) -> None:
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 0 0\nv 6 0 0\nv 5 1 0\nf -3 -2 -1\n"
    mesh = only(load(text))
    assert mesh.positions[mesh.triangles[1]].tolist() == [[5, 0, 0], [6, 0, 0], [5, 1, 0]]


def test_files_of_many_batches_keep_order_and_relative_indices(load: Load) -> None:
    count = 40_000
    text = "".join(f"v {i} 0 0\nv {i} 1 0\nv {i} 0 1\nf -3 -2 -1\n" for i in range(count))
    mesh = only(load(text, normals="flat"))
    assert np.array_equal(mesh.positions[mesh.triangles[:, 0], 0], np.arange(count))
    assert area(mesh) == pytest.approx(count / 2)


def test_polygons_are_tiled_convex_or_not(load: Load) -> None:
    arrow = "v 0 0 0\nv 2 1 0\nv 0 2 0\nv 0.5 1 0\nf {}\n"
    for order in ("1 2 3 4", "2 3 4 1", "3 4 1 2", "4 1 2 3"):
        mesh = only(load(arrow.format(order)))
        assert area(mesh) == pytest.approx(1.5)
        assert np.allclose(mesh.normals, (0, 0, 1))
    comb = [(0, 0), (5, 0), (5, 2), (4, 2), (4, 1), (3, 1), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2), (0, 2)]
    text = "".join(f"v {x} {y} 0\n" for x, y in comb)
    assert area(only(load(text + "f 1 2 3 4 5 6 7 8 9 10 11 12"))) == pytest.approx(8.0)
    turned = only(load(text + "f 12 11 10 9 8 7 6 5 4 3 2 1"))
    assert area(turned) == pytest.approx(8.0)
    assert np.allclose(turned.normals, (0, 0, -1))


def test_a_cube_is_closed_faces_out_and_has_hard_edges(load: Load) -> None:
    mesh = only(load(CUBE))
    assert len(mesh.triangles) == 12
    assert volume(mesh) == pytest.approx(1.0)
    assert len(mesh.positions) == 24
    assert mesh.normals is not None
    assert np.abs(mesh.normals).max(axis=1) == pytest.approx(np.ones(24))


def test_at_180_degrees_a_cube_is_smooth_all_over(load: Load) -> None:
    mesh = only(load(CUBE, crease_angle=180))
    assert len(mesh.positions) == 8
    assert mesh.normals is not None
    outward = (mesh.positions - 0.5) / np.linalg.norm(mesh.positions - 0.5, axis=1)[:, None]
    # By area, a face with two triangles at a corner counts twice there: within 20 degrees of the diagonal.
    assert (np.einsum("ij,ij->i", mesh.normals, outward) > np.cos(np.radians(20))).all()
    assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(np.ones(8))


@pytest.mark.parametrize(("angle", "shared"), [(29.0, False), (31.0, True)])
def test_the_crease_angle_decides_which_edges_are_smooth(load: Load, angle: float, shared: bool) -> None:
    # Two equal triangles that meet at the y axis and differ by 30 degrees.
    x, z = np.cos(np.radians(30)), np.sin(np.radians(30))
    text = f"v -1 0 0\nv 0 0 0\nv 0 1 0\nv {x} 0 {-z}\nf 1 2 3\nf 2 4 3\n"
    mesh = only(load(text, crease_angle=angle))
    assert len(mesh.positions) == (4 if shared else 6)
    assert mesh.normals is not None
    at_edge = mesh.normals[(mesh.positions[:, 0] == 0)]
    expected = (np.sin(np.radians(15)), 0, np.cos(np.radians(15)))
    assert bool(np.allclose(at_edge, expected, atol=1e-6)) is shared


def test_smoothing_groups_are_kept_apart_and_off_is_flat(load: Load) -> None:
    x, z = np.cos(np.radians(10)), np.sin(np.radians(10))
    vertices = f"v -1 0 0\nv 0 0 0\nv 0 1 0\nv -1 1 0\nv {x} 0 {-z}\nv {x} 1 {-z}\n"
    assert len(only(load(vertices + "s 1\nf 1 2 3 4\nf 2 5 6 3\n")).positions) == 6
    assert len(only(load(vertices + "s 1\nf 1 2 3 4\ns 2\nf 2 5 6 3\n")).positions) == 8
    # Two triangles a square, each on its own.
    assert len(only(load(vertices + "s off\nf 1 2 3 4\nf 2 5 6 3\n")).positions) == 12


def test_vertices_written_twice_are_smooth_when_welded(load: Load) -> None:
    x, z = np.cos(np.radians(10)), np.sin(np.radians(10))
    text = f"v -1 0 0\nv 0 0 0\nv 0 1 0\nv 0 0 0\nv {x} 0 {-z}\nv 0 1 0\nf 1 2 3\nf 4 5 6\n"
    welded, apart = only(load(text)), only(load(text, weld=False))
    assert welded.normals is not None
    assert apart.normals is not None
    at_edge = welded.positions[:, 0] == 0
    assert np.allclose(welded.normals[at_edge], (np.sin(np.radians(5)), 0, np.cos(np.radians(5))), atol=1e-6)
    assert np.allclose(apart.normals[apart.triangles[0]], (0, 0, 1))
    assert np.allclose(apart.normals[apart.triangles[1]], (z, 0, x))


def test_own_normals_are_kept_missing_and_zero_ones_computed(load: Load) -> None:
    warnings: list[str] = []
    mesh = only(load(QUAD + "vn 0 0.6 0.8\nvn 0 0 0\nf 1//1 2//2 3\n", warnings=warnings))
    assert mesh.normals is not None
    assert mesh.normals[mesh.triangles[0]] == pytest.approx(np.array([[0, 0.6, 0.8], [0, 0, 1], [0, 0, 1]]))
    assert warnings == ["1 of 3 normals are zero or not finite and were computed"]
    assert np.allclose(only(load(QUAD + "vn 0 0.6 0.8\nf 1//1 2//1 3//1\n", normals="flat")).normals, (0, 0, 1))


def test_objects_by_o_else_by_g_merged_by_name(load: Load) -> None:
    text = QUAD + "o a\ng x\nf 1 2 3\no b\nf 1 3 4\ng y\nf 1 2 4\no a\nf 2 3 4\n"

    def names(**options: object) -> dict[str, int]:
        return {mesh.name: len(mesh.triangles) for mesh in load(text, **options).meshes}

    assert names() == {"a": 2, "b": 2}
    assert names(group_by="group") == {"x": 2, "y": 2}
    assert names(group_by="none") == {"thing": 4}
    model = load(text.replace("o a\n", "").replace("o b\n", ""))
    assert [mesh.name for mesh in model.meshes] == ["x", "y"]
    assert [(node.name, node.meshes, node.parent) for node in model.nodes] == [("x", [0], -1), ("y", [1], -1)]


def test_vertex_colours_become_linear_and_missing_ones_white(load: Load) -> None:
    warnings: list[str] = []
    mesh = only(load("v 0 0 0 1 0.5 0\nv 1 0 0\nv 0 1 0 nan 0 0\nf 1 2 3\n", warnings=warnings))
    assert mesh.colors is not None
    assert mesh.colors == pytest.approx(np.array([[1, 0.2140411, 0, 1], [1, 1, 1, 1], [1, 1, 1, 1]]), abs=1e-6)
    assert warnings == ["2 of 3 vertices have no colour, or one that is NaN, and are white"]


def test_line_continuations_comments_utf16_and_old_line_ends(load: Load) -> None:
    text = "v 0 0 0 # origin\nv 1 0 \\\n 0\n  v 0 1 0\n\nf 1 2 3 # the only one\n"
    for data in (
        text.encode(),
        text.replace("\n", "\r\n").encode(),
        text.encode("utf-16"),
        b"\xef\xbb\xbf" + text.encode(),
    ):
        assert area(only(load(data))) == pytest.approx(0.5)
    assert area(only(load(b"v 0 0 0\rv 1 0 0\rv 0 1 0\rf 1 2 3\r"))) == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "thing.obj is empty"),
        ("# nothing\n", "thing.obj has no triangles"),
        (QUAD, "thing.obj has no triangles, only 4 points"),
        (QUAD + "f 1 2 5\n", "thing.obj, line 5: vertex index 5 is past the end, the file has 4"),
        (QUAD + "f 1/1 2/1 3/1\n", "line 5: vt index 1 is past the end, the file has 0"),
        (QUAD + "f 0 1 2\n", "line 5: 'f 0 1 2' has an index before the first"),
        (QUAD + "f -5 1 2\n", "line 5: 'f -5 1 2' has an index before the first"),
        (QUAD + "vt 0 0\nf 1/-2 1 2\n", "has an index before the first"),
        (QUAD + "f 1 2 x\n", "line 5: 'x' is not a face corner"),
        (QUAD + "f 1 2 99999999999999999999\n", "is not a face corner"),
        (QUAD + "f 1 2 1/2/3/4\n", "is not a face corner"),
        ("v 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "line 1: 'v 0 0' has 2 numbers, expected at least 3"),
        ("v 0 0 zero\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "line 1: 'zero' is not a number"),
        ("v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "position of vertex 1 is NaN, infinite or beyond 1e18"),
        ("v 0 0 0\nv 1e39 0 0\nv 0 1 0\nf 1 2 3\n", "position of vertex 2 is NaN, infinite or beyond 1e18"),
        ("v 1 1 1\n" * 3 + "f 1 2 3\n", "zero size"),
        (b"v 0 0 0\0\0\0", "not an OBJ text file"),
    ],
)
def test_broken_files_are_refused_with_file_place_and_reason(load: Load, text: str | bytes, message: str) -> None:
    with pytest.raises(AssetError) as raised:
        load(text)
    assert str(raised.value).startswith("thing.obj")
    assert message in str(raised.value)


def test_all_triangles_without_area_are_an_error_and_some_a_warning(load: Load) -> None:
    warnings: list[str] = []
    with pytest.raises(AssetError, match="none of its 1 triangles has an area"):
        load("v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n", warnings=warnings)
    assert len(only(load(QUAD + "f 1 2 3\nf 1 1 2\n", warnings=warnings)).triangles) == 1
    assert warnings == ["1 of 2 triangles have no area and were left out"]


def test_unused_bad_vertices_do_no_harm(load: Load) -> None:
    assert area(only(load(QUAD + "v nan inf 0\nf 1 2 3 4\n"))) == pytest.approx(1.0)


def test_texture_coordinates_beyond_float32_are_zero_and_said(load: Load) -> None:
    warnings: list[str] = []
    mesh = only(load(QUAD + "v 1e300 0 0\nvt 1e39 0\nvt 0.5\nvt nan 0\nf 1/1 2/2 3/3\n", warnings=warnings))
    assert mesh.uv0 is not None
    assert mesh.uv0[mesh.triangles[0]].tolist() == [[0, 0], [0.5, 1], [0, 0]]
    assert warnings == ["2 of 3 texture coordinates are not finite and were set to 0"]


def test_odd_lines_warn_once(load: Load) -> None:
    warnings: list[str] = []
    load(QUAD + "f 1 2\n<<<<<<< HEAD\nfoo\ncurv 0 1\nl 1 2\nf 1 2 3\n", warnings=warnings)
    assert warnings == [
        "curves and surfaces are not supported and were left out (line 8)",
        "2 kinds of lines are unknown and were left out, the first is '<<<<<<<' in line 6",
        "1 faces have fewer than three corners and were left out",
    ]


def test_a_file_cut_off_within_a_face_says_so(load: Load) -> None:
    warnings: list[str] = []
    mesh = only(load(QUAD + "vt 0 0\nf 1/1 2/1 3/1\nf 1/1 3/1 4", warnings=warnings))
    assert len(mesh.triangles) == 1
    assert warnings == ["ends in the middle of line 7: the file is cut off, the picture lacks the rest"]


def test_a_fan_of_thousands_of_faces_stays_cheap(load: Load) -> None:
    count = 3000
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    rim = "".join(f"v {np.cos(a):.6f} 0 {np.sin(a):.6f}\n" for a in angles)
    faces = "".join(f"f 1 {2 + (i + 1) % count} {2 + i}\n" for i in range(count))
    mesh = only(load("v 0 1 0\n" + rim + faces, crease_angle=5))
    assert mesh.normals is not None
    assert mesh.normals[0] == pytest.approx((0, 1, 0), abs=1e-3)
