"""References: rendered once, kept by what they show, and never trusted."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from run_bench_kit import SCENE, write_config

import phrt
from phrt.camera import CameraView
from phrt.output.tonemap import to_8bit
from phrt.renderer import Renderer
from phrt_plugins.bench import references as module
from phrt_plugins.bench.checks import checked_plan
from phrt_plugins.bench.content import scene_digest
from phrt_plugins.bench.pictures import read_arrays, shots, write_arrays
from phrt_plugins.bench.plan import Setup
from phrt_plugins.bench.reading import read_config
from phrt_plugins.bench.references import References, reference_key
from phrt_plugins.bench.scenes import open_renderer


@pytest.fixture(scope="module")
def setup(tmp_path_factory: pytest.TempPathFactory) -> Setup:
    return checked_plan(read_config(write_config(tmp_path_factory.mktemp("config")))).setups[0]


@pytest.fixture(scope="module")
def renderer(setup: Setup) -> Iterator[Renderer]:
    with open_renderer(setup, base=True) as made:
        yield made


@pytest.fixture(scope="module")
def kept(setup: Setup, renderer: Renderer, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache with the second block's reference."""
    cache = tmp_path_factory.mktemp("cache")
    References(cache).make(setup, setup.blocks()[1], lambda: renderer)
    return cache


@pytest.fixture
def cache(kept: Path, tmp_path: Path) -> Path:
    """A copy that may be damaged."""
    return Path(shutil.copytree(kept, tmp_path / "cache"))


def no_renderer() -> Renderer:
    raise AssertionError("it is rendered again")


def test_it_is_rendered_once(setup: Setup, kept: Path) -> None:
    pictures = References(kept).make(setup, setup.blocks()[1], no_renderer)
    assert sorted(pictures) == [4, 5, 6, 7]
    assert [number for number, picture in pictures.items() if picture.floor is not None] == [5, 7]
    assert [number for number, picture in pictures.items() if picture.motion is not None] == [5, 7]


def test_it_is_what_all_trace_and_raster_only_show(setup: Setup, kept: Path) -> None:
    picture = References(kept).make(setup, setup.blocks()[1], no_renderer)[5]
    scene = phrt.load_scene(setup.file)
    for heuristic, image, display in (
        ("all_trace", picture.image, picture.display),
        ("raster_only", picture.floor, picture.floor_display),
    ):
        with Renderer(
            scene, size=(64, 36), heuristic=heuristic, tracer="embree", gbuffer="raycast", history=False
        ) as other:
            frame = other.render(5 / 30, frame_index=5)
        assert image is not None
        np.testing.assert_array_equal(to_8bit(frame.image, "neutral"), display)
        np.testing.assert_allclose(image, frame.image, rtol=1e-3, atol=1e-6)
    assert 0.01 < picture.changeable.mean() < 0.99


def test_motion_leads_to_the_frame_before(setup: Setup, kept: Path, renderer: Renderer) -> None:
    motion = References(kept).make(setup, setup.blocks()[1], no_renderer)[5].motion
    assert motion is not None
    renderer.restart(heuristic="raster_only", history=False)
    before = renderer.render(4 / 30).view
    frame = renderer.render(5 / 30)
    seen = frame.gbuffer.object_id > 0
    points = frame.gbuffer.position_world[seen]
    # Nothing moves but the camera: motion is the difference of where two views see the same points.
    expected = pixels_of(before, points) - pixels_of(frame.view, points)
    np.testing.assert_allclose(motion[seen], expected, atol=2e-3)
    assert np.abs(expected).max() > 0.05


def pixels_of(view: CameraView, points: np.ndarray) -> np.ndarray:
    """(n, 2) where `view` sees `points` (n, 3): pixels, x right and y down."""
    homogeneous = np.c_[points, np.ones(len(points))].astype(np.float64) @ np.linalg.inv(view.world_from_view).T
    x, y = (homogeneous[:, axis] / -homogeneous[:, 2] / view.tan_half[axis] for axis in (0, 1))
    return np.stack([(1 + x) / 2 * view.width, (1 - y) / 2 * view.height], axis=1)


def test_shots_know_the_frame_before(setup: Setup, kept: Path) -> None:
    references = References(kept).make(setup, setup.blocks()[1], no_renderer)
    images = {number: picture.image for number, picture in references.items()}
    found = list(shots(images, references, [5, 7], "neutral"))
    assert [shot.index for shot in found] == [5, 7]
    assert found[1].previous is not None
    assert found[1].previous.index == 6
    np.testing.assert_array_equal(found[0].image, found[0].reference)
    (alone,) = shots({5: images[5]}, references, [5], "neutral")
    assert alone.previous is None
    assert alone.motion is None


@pytest.mark.parametrize("keep", [0, 1, 100, -1])
def test_a_file_that_is_cut_off_is_not_trusted(
    setup: Setup, cache: Path, renderer: Renderer, kept: Path, keep: int
) -> None:
    block = setup.blocks()[1]
    path = References(cache).folder(setup, block) / "frame-000006.npz"
    whole = path.read_bytes()
    path.write_bytes(whole[:keep])
    assert References(cache).read(setup, block) is None
    again = References(cache).make(setup, block, lambda: renderer)
    first = References(kept).make(setup, block, no_renderer)
    for number in first:
        np.testing.assert_array_equal(again[number].image, first[number].image)
    assert path.read_bytes() == whole


def test_a_damaged_byte_is_noticed(setup: Setup, cache: Path) -> None:
    block = setup.blocks()[1]
    path = References(cache).folder(setup, block) / "frame-000005.npz"
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(bytes(data))
    assert References(cache).read(setup, block) is None


def test_a_file_of_another_frame_is_not_trusted(setup: Setup, cache: Path) -> None:
    block = setup.blocks()[1]
    folder = References(cache).folder(setup, block)
    shutil.copy(folder / "frame-000005.npz", folder / "frame-000007.npz")
    assert References(cache).read(setup, block) is None


@pytest.mark.parametrize(
    "name", ["frame-000004.npz", "frames.parquet", "candidates.parquet", "run.json", "reference.json"]
)
@pytest.mark.parametrize("text", [None, b"", b"something else"])
def test_every_file_must_be_there_and_its_own(setup: Setup, cache: Path, name: str, text: bytes | None) -> None:
    block = setup.blocks()[1]
    path = References(cache).folder(setup, block) / name
    path.unlink()
    if text is not None:
        path.write_bytes(text)
    assert References(cache).read(setup, block) is None


def test_arrays_larger_than_a_picture_are_not_read(setup: Setup, cache: Path) -> None:
    block = setup.blocks()[1]
    path = References(cache).folder(setup, block) / "frame-000004.npz"
    arrays = read_arrays(path, 10**9)
    assert arrays is not None
    write_arrays(path, arrays | {"image": np.zeros((4000, 4000, 3), np.float16)})
    assert References(cache).read(setup, block) is None


def test_pickles_are_not_read(tmp_path: Path) -> None:
    np.savez(tmp_path / "evil.npz", key=np.array([object()], dtype=object))
    assert read_arrays(tmp_path / "evil.npz", 10**6) is None


def test_arrays_come_back_as_they_were(tmp_path: Path) -> None:
    arrays = {"a": np.linspace(0, 1, 30, dtype=np.float16).reshape(5, 6), "b": np.arange(4, dtype=np.uint8)}
    write_arrays(tmp_path / "a.npz", arrays)
    found = read_arrays(tmp_path / "a.npz", 1000)
    assert found is not None
    assert set(found) == {"a", "b"}
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype


@pytest.mark.parametrize(
    "change",
    [
        {"content": "0" * 32}, {"size": (32, 18)}, {"camera": "/Eye"}, {"tracer": "numpy"}, {"gbuffer": "moderngl"},
        {"base_effects": {"shadows": {"samples": 4}}}, {"simplify": 0.5}, {"tone_map": "aces"}, {"judge_every": 3},
    ],
    ids=lambda change: next(iter(change)),
)  # fmt: skip
def test_its_name_changes_with_what_it_shows(setup: Setup, change: dict[str, Any]) -> None:
    block = setup.blocks()[1]
    assert reference_key(replace(setup, **change), block) != reference_key(setup, block)


@pytest.mark.parametrize(
    "change", [{"clock": None}, {"warm_up": 7}, {"threads": 2}, {"effects": {"shadows": {"samples": 4}}}, {"pictures": 9}],
    ids=lambda change: next(iter(change)),
)  # fmt: skip
def test_its_name_stays_with_what_it_does_not_show(setup: Setup, change: dict[str, Any]) -> None:
    block = setup.blocks()[1]
    assert reference_key(replace(setup, **change), block) == reference_key(setup, block)


def test_its_name_changes_with_the_code(setup: Setup, monkeypatch: pytest.MonkeyPatch) -> None:
    block = setup.blocks()[1]
    before = reference_key(setup, block)
    monkeypatch.setattr(module, "code_digest", lambda: "another version")
    assert reference_key(setup, block) != before


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("intensity: 50", "intensity: 50.001"), ("radius: 0.5", "radius: 0.5001"), ("ior: 1.5", "ior: 1.51"),
        ("eye: [2, 1.9, 4.6]", "eye: [2, 1.9, 4.7]"), ("roughness: 0.0", "roughness: 0.01"), ("fov: 40", "fov: 41"),
    ],
)  # fmt: skip
def test_the_digest_of_a_scene_sees_every_change(tmp_path: Path, old: str, new: str) -> None:
    (tmp_path / "a.yaml").write_text(SCENE)
    (tmp_path / "b.yaml").write_text(SCENE.replace(old, new, 1))
    assert scene_digest(phrt.load_scene(tmp_path / "a.yaml")) != scene_digest(phrt.load_scene(tmp_path / "b.yaml"))


def test_the_digest_of_a_scene_does_not_depend_on_where_it_lies(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "scene.yaml").write_text(SCENE)
    one, two = (scene_digest(phrt.load_scene(tmp_path / name / "scene.yaml")) for name in ("one", "two"))
    assert one == two


def test_the_digest_of_a_scene_sees_its_files(tmp_path: Path) -> None:
    model = "o tri\nv 0 0 0\nv 1 0 0\nv 0 {} 0\nf 1 2 3\n"
    (tmp_path / "scene.yaml").write_text("phrt: 1\nprims:\n  Model: {type: Reference, asset: tri.obj}\n")
    digests = set()
    for height in (1, 2):
        (tmp_path / "tri.obj").write_text(model.format(height))
        digests.add(scene_digest(phrt.load_scene(tmp_path / "scene.yaml")))
    assert len(digests) == 2
