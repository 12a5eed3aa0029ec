"""Pictures of the page: which are taken, how large they are, and what their maps show."""

from __future__ import annotations

import base64
import io
import math
from pathlib import Path

import needs
import numpy as np
import pytest
from PIL import Image

from phrt.errors import OptionError
from phrt_plugins.report import maps, pictures
from phrt_plugins.report.maps import Pair, encoded, flip_errors, magma, make_maps, map_of
from phrt_plugins.report.pictures import Album, Source, from_the_middle, thumbnail

needs.package("matplotlib")
NOISE = np.random.default_rng(3).integers(0, 256, (36, 64, 3), np.uint8)


def decoded(link: str) -> np.ndarray:
    assert link.startswith("data:image/webp;base64,")
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(link.partition("base64,")[2]))).convert("RGB"))


def sources(
    folder: Path, frames: int, contestants: int = 2, size: tuple[int, int] = (64, 36)
) -> dict[int, list[Source]]:
    """Frames of noise."""
    random, made = np.random.default_rng(4), {}
    for frame in range(frames):
        paths = [folder / f"{folder.name}-{frame}-{number}.png" for number in range(contestants + 1)]
        for path in paths:
            Image.fromarray(random.integers(0, 256, (size[1], size[0], 3), np.uint8)).save(path)
        made[frame] = [Source(str(number), path, paths[0], 0.1 * number) for number, path in enumerate(paths)]
    return made


def made(sources_of: dict[str, dict[int, list[Source]]]) -> Album:
    album = Album.of(sources_of)
    steps: list[int] = []
    album.make(lambda: steps.append(1))
    assert len(steps) == album.steps
    return album


def test_small_pictures_are_kept_bit_for_bit() -> None:
    assert np.array_equal(decoded(encoded(NOISE, (64, 36))), NOISE)


def test_large_pictures_lose_little() -> None:
    picture = np.repeat(np.repeat(NOISE, 8, axis=0), 8, axis=1)
    assert np.abs(decoded(encoded(picture, (512, 288))).astype(float) - picture).mean() < 12
    assert len(encoded(picture, (512, 288))) < picture.size


def test_a_thumbnail_is_small(tmp_path: Path) -> None:
    path = tmp_path / "wide.png"
    Image.fromarray(np.zeros((100, 1000, 3), np.uint8)).save(path)
    assert decoded(thumbnail(path)).shape == (32, 320, 3)


def test_the_middle_comes_first() -> None:
    assert from_the_middle([10, 20, 30, 40, 50]) == [30, 20, 40, 10, 50]
    assert from_the_middle([1, 2]) == [1, 2]
    assert from_the_middle([]) == []


def test_maps_are_black_where_nothing_differs() -> None:
    needs.package("flip_evaluator")
    other = NOISE.copy()
    other[:, 40:] = 255 - other[:, 40:]
    errors = flip_errors(NOISE, other)
    assert errors is not None
    assert errors[:, :30].max() < 0.02
    assert errors[:, 50:].mean() > 0.3
    shown = magma(errors)
    assert shown[:, :20].max() < 20
    assert shown[:, 50:].mean() > 60


def test_pictures_that_do_not_fit_have_no_map() -> None:
    assert flip_errors(NOISE, NOISE[:20]) is None


def test_everything_is_shown_where_there_is_room(tmp_path: Path) -> None:
    album = made({"a": sources(tmp_path, 3)})
    assert [frame.number for frame in album.made["a"]] == [0, 1, 2]
    assert all(frame.size == (64, 36) for frame in album.made["a"])
    assert [shot.flip for shot in album.made["a"][0].shots] == [0.0, 0.1, 0.2]
    assert [bool(shot.map) for shot in album.made["a"][0].shots] == [False, True, True]
    assert (album.left_out, album.note) == (0, "")


def test_frames_beyond_the_room_are_left_out_and_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "MOST_BYTES", 150_000)
    folders = [tmp_path / name for name in ("a", "b")]
    for folder in folders:
        folder.mkdir()
    album = made({folder.name: sources(folder, 5) for folder in folders})
    counts = {name: len(frames) for name, frames in album.made.items()}
    assert counts["a"] >= 1
    assert counts["b"] >= 1
    assert album.left_out == 10 - sum(counts.values()) > 0
    assert album.made["a"][0].number <= 2 <= album.made["a"][-1].number
    assert f"{album.left_out} further frames" in album.note
    taken = sum(len(s.picture) + len(s.map) for frames in album.made.values() for f in frames for s in f.shots)
    assert taken < 200_000


def test_many_contestants_make_pictures_smaller(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "MOST_BYTES", 3000)
    album = made({"a": sources(tmp_path, 1, contestants=5)})
    frame = album.made["a"][0]
    assert math.prod(frame.size) < 64 * 36 / 2
    assert decoded(frame.shots[1].picture).shape[:2] == frame.size[::-1]


def test_maps_beyond_their_time_are_left_out_and_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "MOST_MAP_PIXELS", 64 * 36 * 3)
    album = made({"a": sources(tmp_path, 2)})
    assert sum(bool(shot.map) for frame in album.made["a"] for shot in frame.shots) == 3
    assert album.note == "1 of 4 pictures have no FLIP map."


def test_processes_make_the_same_maps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    needs.package("flip_evaluator")
    pairs = [Pair(each.reference, each.path, (64, 36)) for each in sources(tmp_path, 1, contestants=4)[0]]
    Image.fromarray(NOISE[:20]).save(pairs[2].picture)
    here = [map_of(pair) for pair in pairs]
    assert [bool(link) for link in here] == [True, True, False, True, True]
    monkeypatch.setattr(maps, "FEWEST_A_PROCESS", 2)
    monkeypatch.setattr(maps, "usable_cores", lambda: 2)
    assert make_maps(pairs) == here


def test_a_process_that_dies_costs_its_maps_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = [Pair(each.reference, each.path, (64, 36)) for each in sources(tmp_path, 1, contestants=3)[0]]
    monkeypatch.setattr(maps, "FEWEST_A_PROCESS", 2)
    monkeypatch.setattr(maps, "usable_cores", lambda: 2)
    monkeypatch.setattr(maps.sys, "executable", "/bin/false")
    assert make_maps(pairs) == ["", "", "", ""]


def test_a_picture_that_is_not_whole_is_named(tmp_path: Path) -> None:
    path = tmp_path / "half.png"
    Image.fromarray(NOISE).save(path)
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(OptionError, match=r"half\.png' cannot be read"):
        thumbnail(path)
