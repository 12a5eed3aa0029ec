"""Accessors: strides, sparse data, normalisation, and every range that is checked."""

from __future__ import annotations

import numpy as np
import pytest

from phrt.errors import AssetError

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)


def mesh_of(build, load, positions: int, **attributes: int):
    build.draw({"attributes": {"POSITION": positions, **attributes}})
    return load(build.write())[0].meshes[0]


def test_interleaved_with_offset(build, load):
    rows = np.zeros(3, [("skip", "<f4"), ("position", "<f4", 3), ("normal", "<f4", 3)])
    rows["position"], rows["normal"] = CORNERS, (0, 0, 1)
    view = build.view(rows.tobytes(), byteStride=28)
    entry = {"bufferView": view, "componentType": 5126, "type": "VEC3", "count": 3}
    position, normal = (build.add("accessors", {**entry, "byteOffset": offset}) for offset in (4, 16))
    mesh = mesh_of(build, load, position, NORMAL=normal)
    assert (mesh.positions == CORNERS).all()
    assert (mesh.normals == (0, 0, 1)).all()


def test_sparse_over_data_and_over_zeros(build, load):
    places, values = build.view(np.array([2], "<u2").tobytes()), build.view(np.array([[5, 6, 7]], "<f4").tobytes())
    sparse = {
        "count": 1,
        "indices": {"bufferView": places, "componentType": 5123},
        "values": {"bufferView": values},
    }
    over_data = build.accessor(CORNERS, sparse=sparse)
    over_zeros = build.add("accessors", {"componentType": 5126, "type": "VEC3", "count": 3, "sparse": sparse})
    build.draw({"attributes": {"POSITION": over_data}})
    build.draw({"attributes": {"POSITION": over_zeros}})
    first, second = load(build.write())[0].meshes
    assert first.positions.tolist() == [[0, 0, 0], [1, 0, 0], [5, 6, 7]]
    assert second.positions.tolist() == [[0, 0, 0], [0, 0, 0], [5, 6, 7]]


@pytest.mark.parametrize(
    ("dtype", "values", "expected"),
    [
        ("uint8", [0, 51, 255], [0, 0.2, 1]),
        ("uint16", [0, 13107, 65535], [0, 0.2, 1]),
    ],
)
def test_normalised_texture_coordinates(build, load, dtype, values, expected):
    uv = build.accessor([[value, value] for value in values], dtype, normalized=True)
    mesh = mesh_of(build, load, build.accessor(CORNERS), TEXCOORD_0=uv)
    assert mesh.uv0[:, 0] == pytest.approx(expected)


@pytest.mark.parametrize(("dtype", "one"), [("int8", 127), ("int16", 32767)])
def test_quantised_positions_and_normals(build, load, dtype, one):
    """KHR_mesh_quantization: plain integers are lengths, normalised ones fractions; the lowest value is -1."""
    width = 4
    padded = np.zeros((3, width), dtype)
    padded[:, :3] = [[0, 0, 0], [100, 0, 0], [0, -100, 0]]
    size = padded.itemsize
    view = build.view(padded.tobytes(), byteStride=width * size)
    component = {"int8": 5120, "int16": 5122}[dtype]
    entry = {"bufferView": view, "componentType": component, "type": "VEC3", "count": 3}
    plain = build.add("accessors", entry)
    scaled = build.add("accessors", {**entry, "normalized": True})
    normal = np.zeros((3, width), dtype)
    normal[:, 2] = np.iinfo(dtype).min
    normals = build.add(
        "accessors", {**entry, "bufferView": build.view(normal.tobytes(), byteStride=width * size), "normalized": True}
    )
    build.draw({"attributes": {"POSITION": plain, "NORMAL": normals}})
    build.draw({"attributes": {"POSITION": scaled}})
    first, second = load(build.write())[0].meshes
    assert first.positions.tolist() == [[0, 0, 0], [100, 0, 0], [0, -100, 0]]
    assert (first.normals == (0, 0, -1)).all()
    assert second.positions[1, 0] == pytest.approx(100 / one)


@pytest.mark.parametrize(
    ("dtype", "values"),
    [("float32", [[1, 0.2, 0]]), ("uint8", [[255, 51, 0]]), ("uint16", [[65535, 13107, 0]])],
)
@pytest.mark.parametrize("alpha", [False, True])
def test_vertex_colours_of_every_type(build, load, dtype, values, alpha):
    rows = np.repeat(np.array(values, dtype), 3, axis=0)
    if alpha:
        rows = np.hstack([rows, np.zeros((3, 1), dtype)])
    mesh = mesh_of(build, load, build.accessor(CORNERS), COLOR_0=build.accessor(rows, dtype, normalized=True))
    assert mesh.colors.shape == (3, 4)
    assert mesh.colors[0] == pytest.approx([1, 0.2, 0, 0 if alpha else 1])


def test_colours_are_clamped_with_a_warning(build, load):
    colors = build.accessor(np.full((3, 3), 1.5))
    build.draw({"attributes": {"POSITION": build.accessor(CORNERS), "COLOR_0": colors}})
    model, warnings = load(build.write())
    assert model.meshes[0].colors.max() == 1
    assert warnings == ["has vertex colours outside 0 to 1, which are clamped"]


def test_arrays_are_ours_to_change(build, load):
    positions = mesh_of(build, load, build.accessor(CORNERS)).positions
    positions[:] = 7
    assert positions.flags.c_contiguous


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"count": 4}, "accessors[0]: ends at byte 48 of bufferViews[0], which has 36"),
        ({"byteOffset": 4}, "accessors[0]: ends at byte 40 of bufferViews[0]"),
        ({"count": -1}, "accessors[0].count: is -1"),
        ({"count": 2**53}, "ends at byte"),
        ({"count": 1e300}, "accessors[0].count"),
        ({"count": True}, "accessors[0].count: must be a whole number, not a boolean"),
        ({"count": "3"}, "accessors[0].count: must be a whole number, not a string"),
        ({"byteOffset": -12}, "accessors[0].byteOffset: is -12"),
        ({"bufferView": 9}, "accessors[0].bufferView: points at bufferViews[9], but there are 1 bufferViews"),
        ({"componentType": 5124}, "accessors[0].componentType: is 5124"),
        ({"type": "VEC5"}, "accessors[0].type: is 'VEC5'"),
        ({"type": "VEC2"}, "accessors[0]: is VEC2 of float32; POSITION must be VEC3"),
        ({"normalized": 1}, "accessors[0].normalized: must be true or false"),
        ({"sparse": {"count": 4}}, "accessors[0].sparse.count: is 4; it must be between 0 and 3"),
        ({"sparse": {"count": 1}}, "accessors[0].sparse: has no 'indices'"),
    ],
)
def test_what_an_accessor_may_not_say(build, load, change, reason):
    build.draw({"attributes": {"POSITION": build.accessor(CORNERS, **change)}})
    with pytest.raises(AssetError) as error:
        load(build.write())
    assert reason in str(error.value)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"byteLength": 37}, "bufferViews[0]: ends at byte 37 of buffers[0], which has 36"),
        ({"byteOffset": 2**50}, "bufferViews[0]: ends at byte"),
        ({"byteStride": 8}, "has elements of 12 bytes, but its buffer view a stride of 8"),
        ({"byteStride": 16}, "accessors[0]: ends at byte 44"),
        ({"buffer": 1}, "bufferViews[0].buffer: points at buffers[1]"),
    ],
)
def test_what_a_buffer_view_may_not_say(build, load, change, reason):
    build.draw({"attributes": {"POSITION": build.accessor(CORNERS)}})
    build.json["bufferViews"][0].update(change)
    with pytest.raises(AssetError) as error:
        load(build.write())
    assert reason in str(error.value)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", ["POSITION", "NORMAL", "TEXCOORD_0"])
def test_floats_must_be_finite(build, load, value, name):
    width = 2 if name == "TEXCOORD_0" else 3
    rows = np.ones((3, width), np.float32)
    rows[1, 0] = value
    attributes = {"POSITION": build.accessor(CORNERS)}
    attributes[name] = bad = build.accessor(rows)
    build.draw({"attributes": attributes})
    with pytest.raises(AssetError, match=rf"accessors\[{bad}\]: element 1 is not a finite number"):
        load(build.write())


def test_broken_data_nothing_draws_is_an_error_too(build, load):
    build.draw({"attributes": {"POSITION": build.accessor(CORNERS)}})
    build.accessor([np.nan])
    with pytest.raises(AssetError, match="is not a finite number"):
        load(build.write())


def test_sparse_index_past_the_end(build, load):
    places, values = build.view(np.array([3], "<u2").tobytes()), build.view(np.zeros(3, "<f4").tobytes())
    sparse = {"count": 1, "indices": {"bufferView": places, "componentType": 5123}, "values": {"bufferView": values}}
    build.draw({"attributes": {"POSITION": build.accessor(CORNERS, sparse=sparse)}})
    with pytest.raises(AssetError, match="lists element 3 of an accessor of 3"):
        load(build.write())


def test_placeholder_buffer_is_an_error_only_where_it_is_read(build, load):
    build.draw({"attributes": {"POSITION": build.accessor(CORNERS)}})
    path = build.write("a.glb")
    assert len(load(path)[0].meshes) == 1
    build.json["buffers"] = [{"byteLength": 36}]
    build.data = b""
    with pytest.raises(AssetError, match=r"accessors\[0\]: needs buffers\[0\], which has no data"):
        load(build.write("b.gltf"))
