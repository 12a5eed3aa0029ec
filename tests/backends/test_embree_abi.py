"""The ABI file agrees with Embree: packets made by hand are answered as embreex's own binding answers."""

from __future__ import annotations

import ctypes
import importlib.util
from pathlib import Path

import needs
import numpy as np
import pytest

from phrt_backends.availability import embree_reason
from phrt_backends.options import EmbreeOptions
from phrt_backends.tracers import embree_abi as abi
from phrt_backends.tracers.embree import EmbreeTracer
from phrt_backends.tracers.embree_scene import EmbreeDevice, EmbreeScene

pytestmark = needs.all_need(embree_reason())

SEED = 7


@pytest.fixture
def library() -> abi.EmbreeLibrary:
    abi.load_library.cache_clear()
    return abi.load_library()


@pytest.fixture
def soup() -> tuple[np.ndarray, np.ndarray]:
    """200 random triangles: padded vertices (601, 3) float32, triangles (200, 3) int32."""
    random = np.random.default_rng(SEED)
    corners = random.uniform(-1, 1, (200, 1, 3)) + random.normal(0, 0.3, (200, 3, 3))
    vertices = np.zeros((601, 3), np.float32)
    vertices[:-1] = corners.reshape(-1, 3)
    return vertices, np.arange(600, dtype=np.int32).reshape(-1, 3)


@pytest.fixture
def scene(library: abi.EmbreeLibrary, soup: tuple[np.ndarray, np.ndarray]) -> EmbreeScene:
    """The soup as two geometries, ids 5 and 9, the first with mask 1, the second with mask 3."""
    vertices, triangles = soup
    made = EmbreeScene(EmbreeDevice(library), "medium", robust=False)
    made.attach_triangles(5, vertices, triangles[:120], mask=1)
    made.attach_triangles(9, vertices, triangles[120:], mask=3)
    made.commit()
    return made


def sixteen_rays() -> tuple[np.ndarray, np.ndarray]:
    """Origins 4 m from the soup, twelve directions into it and four away from it."""
    random = np.random.default_rng(SEED)
    origin = random.normal(size=(16, 3))
    origin = (4.0 * origin / np.linalg.norm(origin, axis=1, keepdims=True)).astype(np.float32)
    direction = random.uniform(-0.5, 0.5, (16, 3)) - origin
    direction[::4] *= -1.0
    return origin, (direction / np.linalg.norm(direction, axis=1, keepdims=True)).astype(np.float32)


def ask(
    scene: EmbreeScene, query: str, t_far: float = np.inf, mask: int = abi.INVALID_ID, flags: int = 0
) -> np.ndarray:
    """The packet (rows, 16) uint32 after one call of `query` through ctypes, outside the kernels."""
    origin, direction = sixteen_rays()
    storage = np.zeros(abi.PACKET_ROWS * 16 + 16 + 32, np.uint32)
    start = (-storage.ctypes.data % 64) // 4
    words = storage[start : start + abi.PACKET_ROWS * 16].reshape(abi.PACKET_ROWS, 16)
    valid = storage[start + abi.PACKET_ROWS * 16 :][:16]
    valid[:] = 0xFFFFFFFF
    floats = words.view(np.float32)
    floats[abi.ORIGIN_ROW : abi.ORIGIN_ROW + 3] = origin.T
    floats[abi.DIRECTION_ROW : abi.DIRECTION_ROW + 3] = direction.T
    floats[abi.T_FAR_ROW] = t_far
    words[abi.MASK_ROW] = mask
    words[abi.GEOMETRY_ROW] = words[abi.INSTANCE_ROW] = abi.INVALID_ID
    words[-8:] = 0xABCDEF01
    arguments = abi.QueryArguments(flags=flags, feature_mask=abi.FEATURES_ALL)
    function = getattr(scene.device.functions, query)
    function.restype, function.argtypes = None, [ctypes.c_void_p] * 4
    function(valid.ctypes.data, scene.handle, words.ctypes.data, ctypes.addressof(arguments))
    scene.device.check("asking")
    assert (words[-8:] == 0xABCDEF01).all(), "Embree writes past the rows the ABI file allows for"
    return words.copy()


def embreex_answer(soup: tuple[np.ndarray, np.ndarray]) -> dict[str, np.ndarray]:
    """What embreex's own compiled binding says about `sixteen_rays`."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene as EmbreexScene

    theirs = EmbreexScene()
    TriangleMesh(theirs, soup[0], soup[1])
    answer: dict[str, np.ndarray] = theirs.run(*sixteen_rays(), output=True)
    return answer


@pytest.mark.parametrize("flags", [0, abi.QUERY_COHERENT])
def test_every_row_of_a_packet_is_where_embreex_says(
    scene: EmbreeScene, soup: tuple[np.ndarray, np.ndarray], flags: int
) -> None:
    words, answer = ask(scene, "rtcIntersect16", flags=flags), embreex_answer(soup)
    floats, hit = words.view(np.float32), answer["primID"] >= 0
    assert 4 <= hit.sum() <= 15
    offset = np.where(words[abi.GEOMETRY_ROW] == 9, 120, 0)
    assert np.array_equal(words[abi.GEOMETRY_ROW] != abi.INVALID_ID, hit)
    assert np.array_equal((words[abi.PRIMITIVE_ROW] + offset)[hit], answer["primID"][hit])
    np.testing.assert_allclose(floats[abi.T_FAR_ROW][hit], answer["tfar"][hit], rtol=1e-5)
    np.testing.assert_allclose(floats[abi.U_ROW][hit], answer["u"][hit], atol=1e-5)
    np.testing.assert_allclose(floats[abi.V_ROW][hit], answer["v"][hit], atol=1e-5)
    np.testing.assert_allclose(floats[abi.NORMAL_ROW : abi.NORMAL_ROW + 3].T[hit], answer["Ng"][hit], atol=1e-5)
    assert np.isinf(floats[abi.T_FAR_ROW][~hit]).all()


def test_occlusion_is_minus_infinity_where_embreex_finds_a_hit(
    scene: EmbreeScene, soup: tuple[np.ndarray, np.ndarray]
) -> None:
    blocked = np.isneginf(ask(scene, "rtcOccluded16").view(np.float32)[abi.T_FAR_ROW])
    assert np.array_equal(blocked, embreex_answer(soup)["primID"] >= 0)


def test_ray_masks_select_geometries(scene: EmbreeScene) -> None:
    hit_by = {mask: set(ask(scene, "rtcIntersect16", mask=mask)[abi.GEOMETRY_ROW].tolist()) for mask in (1, 2, 4)}
    assert hit_by == {1: {5, 9, abi.INVALID_ID}, 2: {9, abi.INVALID_ID}, 4: {abi.INVALID_ID}}


def test_instances_report_the_inner_geometry_and_the_instance(scene: EmbreeScene) -> None:
    top = EmbreeScene(scene.device, "medium", robust=False)
    shift = np.eye(4)
    top.attach_instance(3, scene, shift)
    top.commit()
    direct, through = ask(scene, "rtcIntersect16"), ask(top, "rtcIntersect16")
    assert np.array_equal(through[abi.GEOMETRY_ROW], direct[abi.GEOMETRY_ROW])
    hit = direct[abi.GEOMETRY_ROW] != abi.INVALID_ID
    assert (through[abi.INSTANCE_ROW][hit] == 3).all()
    shift[:3, 3] = 100.0
    top.move_instance(3, shift)
    top.commit()
    assert (ask(top, "rtcIntersect16")[abi.GEOMETRY_ROW] == abi.INVALID_ID).all()


def test_arguments_have_the_size_and_offsets_of_the_header() -> None:
    fields = {name: getattr(abi.QueryArguments, name).offset for name, *_ in abi.QueryArguments._fields_}
    assert fields == {
        "flags": 0,
        "feature_mask": 4,
        "context": 8,
        "filter": 16,
        "intersect": 24,
        "min_width_distance_factor": 32,
    }


def test_library_is_version_4_and_the_one_embreex_ships(library: abi.EmbreeLibrary) -> None:
    assert library.version[0] == 4
    spec = importlib.util.find_spec("embreex")
    assert spec is not None
    assert spec.origin is not None
    assert library.path.is_relative_to(Path(spec.origin).parent.parent)
    assert all(library.query_address.values())


def test_embree_errors_are_raised_with_what_was_being_done(library: abi.EmbreeLibrary) -> None:
    scene = EmbreeScene(EmbreeDevice(library), "medium", robust=False)
    with pytest.raises(abi.EmbreeError, match="Embree failed while detaching a geometry: invalid"):
        scene.detach(12)


def test_without_the_library_embreex_serves_and_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    abi.load_library.cache_clear()
    monkeypatch.setattr(abi, "library_candidates", list)
    assert EmbreeTracer(EmbreeOptions()).capabilities.description == (
        "Embree through embreex's own `run`, one ray at a time: no Embree 4 library beside the embreex package"
    )
    with pytest.raises(abi.EmbreeError, match="no Embree 4 library"):
        EmbreeTracer(EmbreeOptions(binding="packets"))


def test_a_library_that_is_not_embree_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    abi.load_library.cache_clear()
    other = tmp_path / "libembree4.so.4"
    other.write_bytes(b"not a library")
    monkeypatch.setattr(abi, "library_candidates", lambda: [other])
    with pytest.raises(abi.EmbreeError, match=r"libembree4\.so\.4 does not load as Embree 4"):
        abi.load_library()


def test_another_major_version_is_refused(library: abi.EmbreeLibrary, monkeypatch: pytest.MonkeyPatch) -> None:
    answers = {abi.PROPERTY_VERSION_MAJOR: 5}
    monkeypatch.setattr(library.functions, "rtcGetDeviceProperty", lambda device, which: answers.get(which, 0))
    with pytest.raises(abi.EmbreeError, match=r"is Embree 5\.0\.0, expected 4\.x"):
        abi._checked_version(library.path, library.functions)


def test_reasons_name_the_package_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    from phrt_backends import availability

    monkeypatch.setattr(availability.ctypes.util, "find_library", lambda name: None)
    monkeypatch.setattr(availability.sys, "platform", "linux")
    monkeypatch.setattr(availability.importlib.util, "find_spec", lambda name: object())
    assert availability.embree_reason() is None
    assert "apt-get install libusb-1.0-0 libgomp1" in str(availability.open3d_reason())
    monkeypatch.setattr(availability.importlib.util, "find_spec", lambda name: None)
    assert "pip install embreex" in str(availability.embree_reason())
    assert "pip install 'phrt[open3d]'" in str(availability.open3d_reason())
