"""Primitives: modes, merging, what is filled in and what is left out; tangents."""

from __future__ import annotations

import sys

import needs
import numpy as np
import pytest

from phrt.errors import AssetError
from phrt_plugins.loaders.gltf_tangents import make_tangents

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)
QUAD = np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize(
    ("mode", "triangles"),
    [
        (4, [[0, 1, 2]]),
        (5, [[0, 1, 2], [1, 3, 2], [2, 3, 4]]),
        (6, [[1, 2, 0], [2, 3, 0], [3, 4, 0]]),
    ],
)
@pytest.mark.parametrize("indexed", [False, True])
def test_modes(build, load, mode, triangles, indexed):
    primitive = {"attributes": {"POSITION": build.accessor(np.arange(15.0).reshape(5, 3))}, "mode": mode}
    if indexed:
        primitive["indices"] = build.accessor(np.arange(5), "uint8")
    build.draw(primitive)
    model, warnings = load(build.write())
    mesh = model.meshes[0]
    assert (mesh.positions[mesh.triangles][..., 0] / 3 == triangles).all()
    assert len(warnings) == (mode == 4)


@pytest.mark.parametrize("mode", [0, 1, 2, 3])
def test_points_and_lines_are_left_out_with_a_warning(build, load, mode):
    build.draw(build.quad(), {**build.quad(), "mode": mode})
    model, warnings = load(build.write())
    assert len(model.meshes[0].triangles) == 2
    assert len(warnings) == 1
    assert "which are not drawn" in warnings[0]


def test_unknown_mode(build, load):
    build.draw({**build.quad(), "mode": 7})
    with pytest.raises(AssetError, match=r"meshes\[0\].primitives\[0\].mode: is 7"):
        load(build.write())


def test_primitives_become_one_mesh_with_a_material_per_triangle(build, load):
    for name in ("red", "blue"):
        build.add("materials", {"name": name})
    build.draw({**build.quad(), "material": 1}, build.quad(), {**build.quad(), "material": 0}, name="three")
    model, _ = load(build.write())
    (mesh,) = model.meshes
    assert mesh.name == "three"
    assert mesh.triangle_material.tolist() == [1, 1, -1, -1, 0, 0]
    assert len(mesh.positions) == 12
    assert mesh.normals is None


def test_primitives_with_the_same_attributes_share_vertices(build, load):
    first = build.quad()
    build.draw(first, {**first, "indices": build.accessor([0, 1, 3], "uint8")})
    mesh = load(build.write())[0].meshes[0]
    assert len(mesh.positions) == 4
    assert mesh.triangles.tolist() == [[0, 1, 2], [0, 2, 3], [0, 1, 3]]


def test_what_only_some_primitives_have_is_filled_in(build, load):
    bare = build.quad()
    full = build.quad(
        NORMAL=build.accessor(np.tile([0.0, 1.0, 0.0], (4, 1))),
        TEXCOORD_0=build.accessor(UV),
        COLOR_0=build.accessor(np.full((4, 3), 0.5)),
    )
    build.draw(bare, full)
    mesh = load(build.write())[0].meshes[0]
    assert len(mesh.positions) == 6 + 4, "a primitive without normals is shaded flat, so its corners are unshared"
    assert (mesh.normals[:6] == (0, 0, 1)).all()
    assert (mesh.normals[6:] == (0, 1, 0)).all()
    assert (mesh.uv0[:6] == 0).all()
    assert (mesh.uv0[6:] == UV).all()
    assert (mesh.colors[:6] == 1).all()
    assert (mesh.colors[6:, :3] == 0.5).all()


def test_vertices_that_nothing_uses_are_dropped(build, load):
    positions = build.accessor(np.vstack([[[9, 9, 9]], CORNERS[:3]]))
    build.draw({"attributes": {"POSITION": positions}, "indices": build.accessor([1, 2, 3], "uint16")})
    mesh = load(build.write())[0].meshes[0]
    assert (mesh.positions == CORNERS[:3]).all()
    assert mesh.triangles.tolist() == [[0, 1, 2]]


def test_meshes_are_shared_by_nodes(build, load):
    build.draw(build.quad())
    build.place({"mesh": 0, "translation": [5, 0, 0]})
    model, _ = load(build.write())
    assert [node.meshes for node in model.nodes] == [[0], [0]]


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "uint32"])
def test_index_past_the_end(build, load, dtype):
    build.draw({**build.quad(), "indices": build.accessor([0, 1, 4], dtype)})
    with pytest.raises(AssetError, match=r"primitives\[0\].indices: holds index 4, but there are 4 vertices"):
        load(build.write())


def test_broken_mesh_nothing_draws_is_an_error_too(build, load):
    build.draw(build.quad())
    build.add("meshes", {"primitives": [{**build.quad(), "indices": build.accessor([0, 1, 9], "uint8")}]})
    with pytest.raises(AssetError, match=r"meshes\[1\].primitives\[0\].indices: holds index 9"):
        load(build.write())


def test_primitives_are_limited(build, load):
    primitive = {"attributes": {"POSITION": build.accessor(CORNERS[:3])}}
    build.draw(*[primitive] * 50_001)
    with pytest.raises(AssetError, match="is one of more than 50,000 primitives"):
        load(build.write())


def test_counts_must_agree(build, load):
    build.draw(build.quad(NORMAL=build.accessor(np.ones((3, 3)))))
    with pytest.raises(AssetError, match=r"attributes: have different counts: POSITION 4, NORMAL 3"):
        load(build.write())


@pytest.mark.parametrize(("dtype", "values"), [("float32", [0, 1, 2]), ("int16", [0, 1, 2])])
def test_indices_must_be_unsigned(build, load, dtype, values):
    build.draw({**build.quad(), "indices": build.accessor(values, dtype)})
    with pytest.raises(AssetError, match="indices are SCALAR of uint8, uint16 or uint32"):
        load(build.write())


def test_further_uv_sets_and_colours_are_a_warning(build, load):
    uv = build.accessor(UV)
    build.draw(build.quad(TEXCOORD_1=uv, TEXCOORD_2=uv, COLOR_1=build.accessor(np.ones((4, 3))), _TEMPERATURE=uv))
    model, warnings = load(build.write())
    assert (model.meshes[0].uv1 == UV).all()
    assert [warning.split()[0] for warning in warnings] == ["TEXCOORD_2", "COLOR_1"]


def test_missing_uv_set_of_a_texture_is_a_warning(build, load):
    build.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": build.image(), "texCoord": 1}}})
    build.draw({**build.quad(TEXCOORD_0=build.accessor(UV)), "material": 0})
    assert "has no TEXCOORD_1" in load(build.write())[1][0]


def test_zero_normals_are_made_anew(build, load):
    build.draw(build.quad(NORMAL=build.accessor(np.zeros((4, 3)))))
    model, warnings = load(build.write())
    assert (model.meshes[0].normals == (0, 0, 1)).all()
    assert "4 normals of length zero" in warnings[0]


def test_normals_are_made_unit(build, load):
    build.draw(build.quad(NORMAL=build.accessor(np.tile([0.0, 0.0, 3e30], (4, 1)))))
    assert (load(build.write())[0].meshes[0].normals == (0, 0, 1)).all()


# Tangents


def normal_mapped(build, load, uv, transform=None, **attributes):
    info = {"index": build.image(), **({"extensions": {"KHR_texture_transform": transform}} if transform else {})}
    build.add("materials", {"normalTexture": info})
    build.draw({**build.quad(TEXCOORD_0=build.accessor(uv), **attributes), "material": 0})
    return load(build.write())[0].meshes[0]


def test_tangent_of_an_upright_texture_points_along_u(build, load):
    mesh = normal_mapped(build, load, UV, NORMAL=build.accessor(np.tile([0.0, 0.0, 1.0], (4, 1))))
    assert mesh.tangents == pytest.approx(np.tile([1, 0, 0, 1], (4, 1)))


def test_tangent_of_a_mirrored_texture_has_the_other_hand(build, load):
    mirrored = UV * (-1, 1) + (1, 0)
    mesh = normal_mapped(build, load, mirrored, NORMAL=build.accessor(np.tile([0.0, 0.0, 1.0], (4, 1))))
    assert mesh.tangents == pytest.approx(np.tile([-1, 0, 0, -1], (4, 1)))


def test_tangent_follows_the_texture_transform(build, load):
    """A quarter turn: u' = v, so the tangent points where v grows, which is down."""
    mesh = normal_mapped(
        build, load, UV, {"rotation": np.pi / 2}, NORMAL=build.accessor(np.tile([0.0, 0.0, 1.0], (4, 1)))
    )
    assert mesh.tangents == pytest.approx(np.tile([0, -1, 0, 1], (4, 1)), abs=1e-6)


def test_normal_map_without_normals_gets_flat_ones(build, load):
    mesh = normal_mapped(build, load, UV)
    assert (mesh.normals == (0, 0, 1)).all()
    assert mesh.tangents == pytest.approx(np.tile([1, 0, 0, 1], (6, 1)))


def test_the_files_own_tangents_are_kept(build, load):
    own = build.accessor(np.tile([0.0, 1.0, 0.0, -1.0], (4, 1)))
    mesh = normal_mapped(build, load, UV, NORMAL=build.accessor(np.tile([0.0, 0.0, 1.0], (4, 1))), TANGENT=own)
    assert (mesh.tangents == (0, 1, 0, -1)).all()


def test_mirror_seam_splits_its_vertices():
    positions = np.array([[-1, 0, 0], [0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [-1, 1, 0]], np.float32)
    uv = np.array([[1, 1], [0, 1], [1, 1], [1, 0], [0, 0], [1, 0]], np.float32)
    triangles = np.array([[0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4]])
    normals = np.tile(np.float32([0, 0, 1]), (6, 1))
    source, tangents, split = make_tangents(positions, normals, uv, triangles)
    assert len(source) == 8
    assert (source[split] == triangles).all()
    assert (tangents[split[:2].reshape(-1)] == (-1, 0, 0, -1)).all()
    assert (tangents[split[2:].reshape(-1)] == (1, 0, 0, 1)).all()


def test_tangents_are_smooth_over_vertices_that_are_equal():
    """Unshared corners of a bent strip get the tangents of the shared ones."""
    bend = np.array([[-1, -1, 0], [0, 0, 0], [1, -1, 0], [1, -1, -1], [0, 0, -1], [-1, -1, -1]], np.float32)
    uv = np.array([[0, 1], [1, 1], [2, 1], [2, 0], [1, 0], [0, 0]], np.float32)
    normals = np.tile(np.float32([0, 1, 0]), (6, 1))
    triangles = np.array([[0, 1, 4], [0, 4, 5], [1, 2, 3], [1, 3, 4]])
    _, shared, split = make_tangents(bend, normals, uv, triangles)
    order = triangles.reshape(-1)
    source, unshared, corners = make_tangents(bend[order], normals[order], uv[order], np.arange(12).reshape(4, 3))
    assert len(source) == 12
    assert unshared[corners.reshape(-1)] == pytest.approx(shared[split.reshape(-1)])
    assert shared[:, :3] == pytest.approx(np.tile([1, 0, 0], (6, 1)))


def test_triangles_without_texture_area_still_get_unit_tangents():
    normals = np.tile(np.float32([0, 0, 1]), (4, 1))
    _, tangents, _ = make_tangents(CORNERS, normals, np.zeros((4, 2), np.float32), QUAD)
    assert np.linalg.norm(tangents[:, :3], axis=1) == pytest.approx(1)
    assert tangents[:, 2] == pytest.approx(0)


# Draco


def test_draco_without_dracopy_names_the_extra(assets, load, monkeypatch):
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(AssetError, match=r"pip install phrt\[draco\]"):
        load(assets / "gltf" / "variants" / "Box-glTF-Draco" / "Box.gltf")


def draco_quad(build, data: bytes):
    primitive = build.quad()
    attributes = {"POSITION": 0}
    extension = {"bufferView": build.view(data), "attributes": attributes}
    build.json["extensionsUsed"] = ["KHR_draco_mesh_compression"]
    build.draw({**primitive, "extensions": {"KHR_draco_mesh_compression": extension}})


def test_uncompressed_copy_serves_without_dracopy(build, load, monkeypatch):
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    draco_quad(build, b"")
    model, warnings = load(build.write())
    assert len(model.meshes[0].triangles) == 2
    assert "needs DracoPy" in warnings[0]


@pytest.mark.parametrize("data", [b"", b"DRACO", b"DRACO\x02\x02\x01\x01" + bytes(40)])
def test_broken_draco_data(build, load, data):
    needs.package("DracoPy", "DracoPy is not installed (extra: draco)")
    draco_quad(build, data)
    with pytest.raises(AssetError, match="KHR_draco_mesh_compression: cannot be decoded"):
        load(build.write())
