"""Every glTF under invalid/: an AssetError with file and reason, or a model with sane arrays; never anything else."""

from __future__ import annotations

import json
import time
from pathlib import Path

import needs
import numpy as np
import pytest

from phrt.errors import AssetError

ROOT = needs.ASSETS / "invalid"
FILES = sorted(path.relative_to(ROOT).as_posix() for kind in ("*.gltf", "*.glb") for path in ROOT.rglob(kind))

# Codes of severity 0 (error) that leave no right picture: data out of bounds, missing or not a number, references to
# nothing, a structure that cannot be read. A file whose report has one of them must be refused.
FATAL = {
    "ACCESSOR_INDEX_OOB",
    "ACCESSOR_INVALID_FLOAT",
    "ACCESSOR_SMALL_BYTESTRIDE",
    "ACCESSOR_SPARSE_COUNT_OUT_OF_RANGE",
    "ACCESSOR_TOO_LONG",
    "ARRAY_TYPE_MISMATCH",
    "BUFFER_BYTE_LENGTH_MISMATCH",
    "BUFFER_MISSING_GLB_DATA",
    "BUFFER_VIEW_TOO_LONG",
    "GLB_CHUNK_LENGTH_UNALIGNED",
    "GLB_CHUNK_TOO_BIG",
    "GLB_DUPLICATE_CHUNK",
    "GLB_EMPTY_CHUNK",
    "GLB_INVALID_MAGIC",
    "GLB_INVALID_VERSION",
    "GLB_LENGTH_MISMATCH",
    "GLB_LENGTH_TOO_SMALL",
    "GLB_UNEXPECTED_BIN_CHUNK",
    "GLB_UNEXPECTED_END_OF_CHUNK_DATA",
    "GLB_UNEXPECTED_END_OF_CHUNK_HEADER",
    "GLB_UNEXPECTED_END_OF_HEADER",
    "GLB_UNEXPECTED_FIRST_CHUNK",
    "INVALID_JSON",
    "MESH_PRIMITIVE_ATTRIBUTES_ACCESSOR_INVALID_FORMAT",
    "MESH_PRIMITIVE_INDICES_ACCESSOR_INVALID_FORMAT",
    "MESH_PRIMITIVE_UNEQUAL_ACCESSOR_COUNT",
    "ONE_OF_MISMATCH",
    "TYPE_MISMATCH",
    "UNDEFINED_PROPERTY",
    "UNRESOLVED_REFERENCE",
}

# Codes of severity 0 that break a rule, but leave one reading of the file, which is the one drawn: declared bounds that
# are off (they are not used), alignment (data is read byte by byte), hints (targets, mime types, needless strides),
# attributes without a meaning, empty arrays, values that are clamped or made unit, and images, which get a placeholder.
HARMLESS = {
    "ACCESSOR_ELEMENT_OUT_OF_MAX_BOUND",
    "ACCESSOR_ELEMENT_OUT_OF_MIN_BOUND",
    "ACCESSOR_INDEX_PRIMITIVE_RESTART",  # within the vertices there; a warning
    "ACCESSOR_INVALID_SIGN",
    "ACCESSOR_JOINTS_INDEX_DUPLICATE",
    "ACCESSOR_JOINTS_INDEX_OOB",  # of points, which are not drawn; of triangles it is an error, see test_gltf_poses
    "ACCESSOR_MATRIX_ALIGNMENT",
    "ACCESSOR_MAX_MISMATCH",
    "ACCESSOR_MIN_MISMATCH",
    "ACCESSOR_NON_CLAMPED",
    "ACCESSOR_NORMALIZED_INVALID",
    "ACCESSOR_OFFSET_ALIGNMENT",
    "ACCESSOR_TOTAL_OFFSET_ALIGNMENT",
    "ACCESSOR_VECTOR3_NON_UNIT",
    "ACCESSOR_WEIGHTS_NEGATIVE",
    "ACCESSOR_WEIGHTS_NON_NORMALIZED",
    "BUFFER_DATA_URI_MIME_TYPE_INVALID",
    "BUFFER_VIEW_INVALID_BYTE_STRIDE",
    "BUFFER_VIEW_TARGET_OVERRIDE",
    "BUFFER_VIEW_TOO_BIG_BYTE_STRIDE",
    "EMPTY_ENTITY",
    "IMAGE_BUFFER_VIEW_WITH_BYTESTRIDE",
    "IMAGE_DATA_INVALID",
    "IMAGE_MIME_TYPE_INVALID",
    "IMAGE_UNEXPECTED_EOS",
    "INVALID_URI",  # fatal where a buffer's data is lost, see MUST_FAIL
    "IO_ERROR",  # a placeholder for images; for buffers see MUST_FAIL
    "MESH_INVALID_WEIGHTS_COUNT",
    "MESH_PRIMITIVES_UNEQUAL_TARGETS_COUNT",
    "MESH_PRIMITIVE_ACCESSOR_UNALIGNED",
    "MESH_PRIMITIVE_ACCESSOR_WITHOUT_BYTESTRIDE",
    "MESH_PRIMITIVE_ATTRIBUTES_ACCESSOR_UNSIGNED_INT",  # of an attribute that is not read
    "MESH_PRIMITIVE_INDEXED_SEMANTIC_CONTINUITY",
    "MESH_PRIMITIVE_INDICES_ACCESSOR_WITH_BYTESTRIDE",
    "MESH_PRIMITIVE_INVALID_ATTRIBUTE",
    "MESH_PRIMITIVE_JOINTS_WEIGHTS_MISMATCH",
    "MESH_PRIMITIVE_MORPH_TARGET_INVALID_ATTRIBUTE_COUNT",  # of a target without weight
    "MESH_PRIMITIVE_MORPH_TARGET_NO_BASE_ACCESSOR",
    "MESH_PRIMITIVE_POSITION_ACCESSOR_WITHOUT_BOUNDS",
    "MESH_PRIMITIVE_TOO_FEW_TEXCOORDS",  # a warning
    "UNSATISFIED_DEPENDENCY",
    "VALUE_MULTIPLE_OF",
    "VALUE_NOT_IN_RANGE",
}

MUST_FAIL = {
    "gltf-validator/buffer/invalid_uri_data.glb": "buffers[0].uri",
    "gltf-validator/buffer/invalid_uri_scheme.gltf": "buffers[0].uri",
    "gltf-validator/buffer/non_relative_uri.gltf": "has the scheme 'http:'",
    "gltf-validator/image/invalid_uri_scheme.gltf": "images[0].uri",
    "gltf-validator/buffer/not_found.gltf": "does not exist",
    "tinygltf/BoundsChecking/invalid-buffer-index.gltf": "points at buffers[1]",
    "tinygltf/BoundsChecking/invalid-buffer-view-index.gltf": "points at buffers[0]",
    "tinygltf/BoundsChecking/invalid-primitive-indices.gltf": "points at buffers[0]",
    "tinygltf/BoundsChecking/integer-out-of-bounds.gltf": "bufferViews[0].byteLength",
    "tinygltf/issue-416.gltf": "asset.version",
    "missing_bin/Sponza.gltf": "'Sponza.bin' does not exist",
    "assimp/glTF2/MissingBin/BoxTextured.gltf": "does not exist",
    "assimp/glTF2/BoxWithInfinites-glTF-Binary/BoxWithInfinites.glb": "is not a finite number",
    "assimp/glTF2/IncorrectVertexArrays/Cube.gltf": "bufferViews[2]: ends at byte",
    "assimp/glTF2/IndexOutOfRange/IndexOutOfRange.gltf": "holds index 255, but there are 24 vertices",
    "assimp/glTF2/IndexOutOfRange/AllIndicesOutOfRange.gltf": "holds index 65535, but there are 24 vertices",
    "assimp/glTF2/RecursiveNodes/RecursiveNodes.gltf": "nodes must not form cycles",
    "assimp/glTF2/TestNoRootNode/NoScene.gltf": "points at scenes[0]",
    "assimp/glTF2/wrongTypes/badArray.gltf": "must be an array, not an object",
    "assimp/glTF2/wrongTypes/badObject.gltf": "must be an object, not an array",
    "assimp/glTF2/wrongTypes/badUint.gltf": "is -1; it must be between",
    "assimp/glTF2/wrongTypes/badExtension.gltf": "must be an object, not a string",
}

LEGAL = [name for name in FILES if name.startswith(("gltf-empty-but-legal/", "tinygltf/regression/", "trimesh/"))]


def report_codes(path: Path) -> set[str]:
    """The error codes of the validator's report beside a file; empty where there is none."""
    report = path.with_name(path.name + ".report.json")
    if not report.exists():
        return set()
    return {issue["code"] for issue in json.loads(report.read_text())["issues"]["messages"] if issue["severity"] == 0}


def assert_sane(model) -> None:
    """Nothing a renderer could trip over."""
    for number, node in enumerate(model.nodes):
        assert -1 <= node.parent < number
        assert np.isfinite(node.matrix).all()
        assert all(0 <= mesh < len(model.meshes) for mesh in node.meshes)
    for mesh in model.meshes:
        assert np.isfinite(mesh.positions).all()
        assert mesh.triangles.min() >= 0
        assert mesh.triangles.max() < len(mesh.positions)
        assert mesh.triangle_material.max() < len(model.materials)


@pytest.mark.parametrize("name", FILES)
def test_ends_in_a_clear_error_or_a_sane_model(assets, load, name):
    path = assets / "invalid" / name
    codes = report_codes(path)
    assert codes <= FATAL | HARMLESS, "a new code: decide whether it leaves a right picture"
    start = time.monotonic()
    model, message = None, ""
    try:
        model, _ = load(path)
    except AssetError as error:
        message = str(error)
    assert time.monotonic() - start < 10
    if model is None:
        assert message.startswith(f"{path}: ")
        assert len(message) > len(f"{path}: ") + 10
        assert name not in LEGAL
    else:
        assert not codes & FATAL
        assert name not in MUST_FAIL
        assert_sane(model)


@pytest.mark.parametrize(("name", "reason"), MUST_FAIL.items())
def test_names_place_and_reason(assets, load, name, reason):
    with pytest.raises(AssetError) as error:
        load(assets / "invalid" / name)
    assert reason in str(error.value)


def test_the_corpus_is_there(assets):
    assert len(FILES) >= 160
    assert sum(bool(report_codes(assets / "invalid" / name) & FATAL) for name in FILES) >= 45
