"""PLY and STL: encodings, attributes, lists of mixed length, and files that are cut off."""

from __future__ import annotations

import struct
from collections.abc import Callable

import numpy as np
import pytest

from phrt.errors import AssetError
from phrt.model import Model

Load = Callable[..., Model]

HEADER = """ply
format {} 1.0
comment a square and a triangle
element vertex 5
property float x
property float y
property double z
property uchar red
property uchar green
property uchar blue
property float s
property float t
element face 2
property list uchar int vertex_indices
property uchar flags
end_header
"""
VERTICES = [
    (0, 0, 0, 255, 0, 0, 0, 0),
    (1, 0, 0, 255, 0, 0, 1, 0),
    (1, 1, 0, 255, 0, 0, 1, 1),
    (0, 1, 0, 0, 128, 0, 0, 1),
    (2, 0, 0, 0, 128, 0, 2, 0),
]
FACES = [(0, 1, 2, 3), (1, 4, 2)]


def ply(encoding: str) -> bytes:
    head = HEADER.format(encoding).encode()
    if encoding == "ascii":
        rows = [" ".join(map(str, row)) for row in VERTICES]
        rows += [" ".join(map(str, (len(face), *face, 7))) for face in FACES]
        return head + "\n".join(rows).encode() + b"\n"
    order = ">" if "big" in encoding else "<"
    body = b"".join(struct.pack(order + "ffdBBBff", *row) for row in VERTICES)
    body += b"".join(struct.pack(f"{order}B{len(face)}iB", len(face), *face, 7) for face in FACES)
    return head + body


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_every_encoding_gives_the_same_mesh(load: Load, encoding: str) -> None:
    (mesh,) = load(ply(encoding), ".ply").meshes
    assert mesh.name == "thing"
    corners = mesh.positions[mesh.triangles]
    assert corners[2].tolist() == [[1, 0, 0], [2, 0, 0], [1, 1, 0]]
    assert np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() == 3.0
    assert np.allclose(mesh.normals, (0, 0, 1))
    assert mesh.colors is not None
    green = np.isclose(mesh.positions[:, 0], 2)
    assert mesh.colors[green] == pytest.approx(np.array([[0, 0.2158605, 0, 1]]), abs=1e-6)
    assert mesh.uv0 is not None
    assert mesh.uv0[green].tolist() == [[2, 1]]


def test_uniform_faces_and_mixed_ones_agree(load: Load) -> None:
    head = HEADER.format("binary_little_endian").replace("element face 2", "element face 3").encode()
    body = b"".join(struct.pack("<ffdBBBff", *row) for row in VERTICES)
    body += b"".join(struct.pack("<B3iB", 3, *face, 7) for face in ((0, 1, 2), (0, 2, 3), (1, 4, 2)))
    uniform, mixed = load(head + body, ".ply").meshes[0], load(ply("binary_little_endian"), ".ply").meshes[0]
    assert np.array_equal(uniform.positions[uniform.triangles], mixed.positions[mixed.triangles])


def test_own_normals_and_texcoord_lists(load: Load) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 3\n" + "".join(
        f"property float {n}\n" for n in ["x", "y", "z", "nx", "ny", "nz"]
    )
    head += "element face 1\nproperty list uchar int vertex_index\nproperty list uchar float texcoord\nend_header\n"
    body = "0 0 0 0 0.6 0.8\n1 0 0 0 0.6 0.8\n0 1 0 0 0.6 0.8\n3 0 1 2 6 0 0 1 0 1 0.25\n"
    (mesh,) = load(head + body, ".ply").meshes
    assert np.allclose(mesh.normals, (0, 0.6, 0.8))
    assert mesh.uv0 is not None
    assert mesh.uv0.tolist() == [[0, 1], [1, 1], [1, 0.75]]


def test_every_cut_through_a_ply_is_refused_or_harmless(load: Load) -> None:
    for encoding in ("ascii", "binary_little_endian"):
        whole = ply(encoding)
        for length in range(1, len(whole) - 2, 7):
            with pytest.raises(AssetError, match=r"^thing\.ply"):
                load(whole[:length], ".ply")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ((b"element vertex 5", b"element vertex 4000000000"), "is cut off: its header promises at least"),
        ((b"element vertex 5", b"element vertex -1"), "has -1 rows"),
        ((b"element vertex 5", b"element vertex"), "header line 4 'element vertex' is not understood"),
        ((b"property float y", b"property quad y"), "header line 6 'property quad y' is not understood"),
        ((b"property float y", b"property float x"), "two properties of one name"),
        ((b"property float y", b"property float w"), "has no vertex property y"),
        ((b"ascii", b"utf-7"), "PLY format 'utf-7' is not"),
        ((b"end_header", b"end"), "has no 'end_header'"),
        ((b"3 1 4 2 7", b"3 1 5 2 7"), "vertex index 5 is outside 0 to 4"),
        ((b"3 1 4 2 7", b"3 1 -1 2 7"), "vertex index -1 is outside 0 to 4"),
        ((b"3 1 4 2 7", b"999999 1 4 2 7"), "element 'face' cannot be read: it is cut off"),
        ((b"2 0 0 0", b"nan 0 0 0"), "position of vertex 5 is NaN"),
        ((b"2 0 0 0", b"x 0 0 0"), "element 'vertex' cannot be read: could not convert"),
        ((b"ply", b"PNG"), "does not begin with 'ply'"),
    ],
)
def test_broken_ply_files_are_refused(load: Load, change: tuple[bytes, bytes], message: str) -> None:
    data = ply("ascii")
    assert change[0] in data
    with pytest.raises(AssetError) as raised:
        load(data.replace(*change, 1), ".ply")
    assert message in str(raised.value)


def test_a_binary_list_that_claims_too_much_is_refused(load: Load) -> None:
    data = ply("binary_little_endian").replace(b"list uchar int", b"list uint32 int")
    with pytest.raises(AssetError, match="cut off, or a list says it has"):
        load(data + b"\xff" * 64, ".ply")


CORNER = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 0], [0, 1, 0], [0, 0, 1]]], np.float32)


def binary_stl(triangles: np.ndarray, header: bytes = b"") -> bytes:
    facets = b"".join(struct.pack("<12fH", 0, 0, 0, *triangle.reshape(-1), 0) for triangle in triangles)
    return header.ljust(80, b" ") + struct.pack("<I", len(triangles)) + facets


def ascii_stl(triangles: np.ndarray, name: str = "part") -> str:
    facets = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {x} {y} {z}\n" for x, y, z in triangle)
        + "endloop\nendfacet\n"
        for triangle in triangles
    )
    return f"solid {name}\n{facets}endsolid {name}\n"


@pytest.mark.parametrize("data", [binary_stl(CORNER), binary_stl(CORNER, b"solid but binary"), ascii_stl(CORNER)])
def test_stl_both_ways_with_hard_edges_or_smooth(load: Load, data: str | bytes) -> None:
    (mesh,) = load(data, ".stl").meshes
    assert mesh.positions[mesh.triangles].tolist() == CORNER.tolist()
    assert len(mesh.positions) == 6
    assert mesh.normals is not None
    assert mesh.normals[mesh.triangles].tolist() == [[[0, 0, 1]] * 3, [[1, 0, 0]] * 3]
    (smooth,) = load(data, ".stl", crease_angle=180).meshes
    assert len(smooth.positions) == 4
    (apart,) = load(data, ".stl", crease_angle=180, weld=False).meshes
    assert len(apart.positions) == 6


def test_solids_become_objects(load: Load) -> None:
    model = load(ascii_stl(CORNER[:1], "left") + ascii_stl(CORNER[1:], "right"), ".stl")
    assert [(mesh.name, len(mesh.triangles)) for mesh in model.meshes] == [("left", 1), ("right", 1)]


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (binary_stl(CORNER)[:-10], "is cut off: its header promises 184 bytes, it has 174"),
        (binary_stl(CORNER[:0]), "has no triangles"),
        (binary_stl(CORNER * np.float32(np.nan)), "is NaN, infinite"),
        (b"hello", "neither a binary header nor the word 'solid'"),
        (ascii_stl(CORNER)[:-60], "is cut off or malformed: 2 facets"),
        (ascii_stl(CORNER).replace("vertex 1.0 0.0 0.0\n", "", 1), "is cut off or malformed: 2 facets, 2 ends"),
        (ascii_stl(CORNER).replace("vertex 1.0 0.0 0.0", "vertex one 0 0", 1), "cannot be read as STL"),
    ],
)
def test_broken_stl_files_are_refused(load: Load, data: str | bytes, message: str) -> None:
    with pytest.raises(AssetError) as raised:
        load(data, ".stl")
    assert message in str(raised.value)


def test_bytes_after_the_last_facet_warn(load: Load) -> None:
    warnings: list[str] = []
    assert len(load(binary_stl(CORNER) + b"tail", ".stl", warnings=warnings).meshes[0].triangles) == 2
    assert warnings == ["4 bytes after the last facet were left out"]
