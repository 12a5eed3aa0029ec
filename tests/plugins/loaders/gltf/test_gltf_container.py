"""The outside: GLB structure, JSON that must not be trusted, URIs and what they may name."""

from __future__ import annotations

import json
import struct

import numpy as np
import pytest

from phrt.errors import AssetError
from phrt.interfaces.loader import MAX_FILE_BYTES

TEXT = b'{"asset":{"version":"2.0"}}'


def glb(text: bytes, binary: bytes | None = None) -> bytes:
    """A GLB of a JSON chunk and, where given, a binary chunk."""
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary is not None:
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def test_glb_and_gltf_give_the_same_mesh(build, load):
    build.draw(build.quad())
    embedded, _ = load(build.write("a.gltf"))
    binary, _ = load(build.write("a.glb"))
    assert (embedded.meshes[0].positions == binary.meshes[0].positions).all()


def test_glb_is_known_by_its_magic(build, load):
    build.draw(build.quad())
    path = build.write("a.glb")
    assert len(load(path.rename(path.with_name("b.gltf")))[0].meshes) == 1


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"", "is cut short"),
        (b"abcd" + glb(TEXT)[4:], "starts with b'abcd'"),
        (glb(TEXT)[:-3], "the file is truncated at"),
        (glb(TEXT).replace(b"\x02\0\0\0", b"\x01\0\0\0", 1), "is version 1"),
        (glb(TEXT, b"1234")[:12] + glb(TEXT, b"1234")[12:].replace(b"JSON", b"BIN\0"), "the first chunk is not JSON"),
        (struct.pack("<4sIIII", b"glTF", 2, 20, 400, 0x4E4F534A), "is 400 bytes long, but only 0 are left"),
    ],
)
def test_broken_glb_says_what_is_broken(tmp_path, load, data, reason):
    path = tmp_path / "broken.glb"
    path.write_bytes(data)
    with pytest.raises(AssetError, match=r"broken\.glb: GLB") as error:
        load(path)
    assert reason in str(error.value)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (b"", "is not valid JSON"),
        (b"[]", "must be a JSON object, not an array"),
        (b'{"asset":', "is not valid JSON"),
        (b'{"asset":{"version":"2.0"},"x":NaN}', "NaN is not a JSON number"),
        (b'{"asset":{"version":"2.0"},"x":"\xff"}', "is not UTF-8"),
        (b'{"asset":{"version":"2.0","version":"2.0"}}', "duplicate key 'version'"),
        (b'{"a":' + b"[" * 200_000 + b"]" * 200_000 + b"}", "is nested too deeply"),
        (b'{"x":' + b"9" * 10_000 + b"}", "is not valid JSON"),
        (b'{"x":[' + b"1," * 4_000_001 + b"1]}", "JSON values"),
        (b"{}", "has no 'asset'"),
        (b'{"asset":{"version":"1.0"}}', "only glTF 2.0 is read"),
        (b'{"asset":{"version":"2.1","minVersion":"2.1"}}', "asset.minVersion"),
        (b'{"asset":{"version":2}}', "asset.version: must be a string, not a number"),
        (b'{"asset":{"version":"2.0"},"nodes":{}}', "nodes: must be an array, not an object"),
        (b'{"asset":{"version":"2.0"},"nodes":[null]}', "nodes[0]: must be an object, not null"),
    ],
)
def test_broken_json_says_what_is_broken(tmp_path, load, text, reason):
    path = tmp_path / "broken.gltf"
    path.write_bytes(text)
    with pytest.raises(AssetError, match=r"broken\.gltf") as error:
        load(path)
    assert reason in str(error.value)


def test_byte_order_mark_is_a_warning(tmp_path, load):
    path = tmp_path / "mark.gltf"
    path.write_bytes(b"\xef\xbb\xbf" + TEXT)
    assert any("byte order mark" in warning for warning in load(path)[1])


def test_missing_file_and_folder(tmp_path, load):
    with pytest.raises(AssetError, match="does not exist"):
        load(tmp_path / "nothing.gltf")
    with pytest.raises(AssetError, match="is not a file"):
        load(tmp_path)


def test_file_over_the_limit_is_not_read(tmp_path, load):
    path = tmp_path / "huge.glb"
    with path.open("wb") as stream:
        stream.truncate(MAX_FILE_BYTES + 1)
    with pytest.raises(AssetError, match="is larger than 512 MiB"):
        load(path)


def external(build, uri: str):
    """A quad whose buffer is named by `uri`; returns the buffer's bytes and the file."""
    build.draw(build.quad())
    data, build.data = build.data, b""
    build.json["buffers"] = [{"byteLength": len(data), "uri": uri}]
    return data, build.write()


@pytest.mark.parametrize(
    ("uri", "name"),
    [
        ("plain.bin", "plain.bin"),
        ("with%20space.bin", "with space.bin"),
        ("with space.bin", "with space.bin"),
        ("100%25.bin", "100%.bin"),
        ("50%20.bin", "50%20.bin"),
        ("%E2%9D%A4.bin", "❤.bin"),
        ("./plain.bin", "plain.bin"),
        ("sub\\windows.bin", "sub/windows.bin"),
    ],
)
def test_names_of_external_buffers(build, load, tmp_path, uri, name):
    data, path = external(build, uri)
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_bytes(data)
    assert len(load(path)[0].meshes[0].triangles) == 2


REFUSED = [
    ("http://127.0.0.1:9/a.bin", "has the scheme 'http:'"),
    ("https%3A//127.0.0.1:9/a.bin", "has the scheme 'https:'"),
    ("file:///etc/hostname", "has the scheme 'file:'"),
    ("ftp:x", "has the scheme 'ftp:'"),
    ("//host/a.bin", "names another machine"),
    ("\\\\host\\a.bin", "names another machine"),
    ("/etc/hostname", "leaves the asset roots"),
    ("../outside.bin", "leaves the asset roots"),
    ("%2e%2e/outside.bin", "leaves the asset roots"),
    ("a%00b", "is not a file name"),
    ("", "is not a file name"),
]
BROKEN = [
    ("x" * 5000, "cannot be opened"),
    ("missing.bin", "does not exist"),
    ("data:application/octet-stream;base64", "is a data URI without data"),
    ("data:;base64,@@@@", "broken base64"),
    ("data:;base64,AAAA", "is truncated: byteLength says 60, but there are 3 bytes"),
]


@pytest.mark.parametrize(("uri", "reason"), REFUSED + BROKEN)
def test_what_no_buffer_may_name(build, load, tmp_path, uri, reason):
    (tmp_path.parent / "outside.bin").write_bytes(bytes(60))
    _, path = external(build, uri)
    with pytest.raises(AssetError, match=r"made.gltf: buffers\[0\]") as error:
        load(path)
    assert reason in str(error.value)


@pytest.mark.parametrize(("uri", "reason"), REFUSED)
def test_what_no_image_may_name(build, load, tmp_path, uri, reason):
    (tmp_path.parent / "outside.bin").write_bytes(bytes(60))
    texture = build.add("textures", {"source": build.add("images", {"uri": uri})})
    build.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}})
    with pytest.raises(AssetError, match=r"made.gltf: images\[0\].uri") as error:
        load(build.write())
    assert reason in str(error.value)


def test_percent_encoded_data_uri(build, load):
    data, path = external(build, "")
    document = json.loads(path.read_text())
    document["buffers"][0]["uri"] = "data:application/octet-stream," + "".join(f"%{byte:02x}" for byte in data)
    path.write_text(json.dumps(document))
    assert len(load(path)[0].meshes[0].triangles) == 2


def test_unprintable_names_are_made_printable(build, load):
    build.draw(build.quad(), node={"name": "a\ud800b"})
    assert load(build.write())[0].nodes[0].name.encode() == b"a?b"


def test_extensions(build, load):
    build.draw(build.quad())
    build.json["extensionsUsed"] = ["ACME_shiny", "KHR_materials_unlit", "KHR_xmp_json_ld"]
    assert load(build.write())[1] == ["uses the extension ACME_shiny, which is ignored"]
    build.json["extensionsRequired"] = ["ACME_shiny"]
    with pytest.raises(AssetError, match="requires ACME_shiny, which PHRT does not support"):
        load(build.write())


def test_warnings_do_not_flood(build, load):
    build.draw(*({"attributes": {}} for _ in range(500)), build.quad())
    _, warnings = load(build.write())
    assert len(warnings) == 51
    assert warnings[-1] == "has more faults than are listed"


def test_a_count_without_data_cannot_exhaust_memory(build, load):
    huge = build.add("accessors", {"componentType": 5126, "type": "VEC3", "count": 2**40})
    build.draw({"attributes": {"POSITION": huge}})
    with pytest.raises(AssetError, match="needs more memory than the 512 MiB"):
        load(build.write())


def test_views_read_many_times_cannot_exhaust_memory(build, load):
    positions = np.zeros((300_000, 3), np.float32)
    view = build.view(positions.tobytes())
    entry = {"bufferView": view, "componentType": 5126, "type": "VEC3", "count": 300_000}
    build.draw(*({"attributes": {"POSITION": build.add("accessors", dict(entry))}} for _ in range(150)))
    with pytest.raises(AssetError, match="needs more memory than the 512 MiB"):
        load(build.write("many.glb"))
