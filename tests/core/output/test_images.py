"""PNG and EXR round trips, output paths, and what happens to an older file."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from phrt.errors import OptionError
from phrt.output.files import check_output, complete_file
from phrt.output.images import write_exr, write_picture, write_png
from phrt.output.tonemap import to_8bit


@pytest.fixture
def picture() -> np.ndarray:
    return np.random.default_rng(3).integers(0, 256, (9, 14, 3), dtype=np.uint8)


def read_exr(path: Path) -> dict[str, np.ndarray]:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: channel.pixels for name, channel in file.channels().items()}


def test_png_round_trip_in_grey_colour_and_alpha(tmp_path: Path, picture: np.ndarray) -> None:
    for pixels in (picture[:, :, 0], picture, np.dstack([picture, picture[:, :, :1]])):
        write_png(tmp_path / "out.png", np.ascontiguousarray(pixels))
        with Image.open(tmp_path / "out.png") as image:
            assert np.array_equal(np.asarray(image), pixels)


def test_png_says_it_is_srgb(tmp_path: Path, picture: np.ndarray) -> None:
    data = write_png(tmp_path / "out.png", picture).read_bytes()
    place = data.index(b"sRGB")
    assert struct.unpack(">I", data[place - 4 : place]) == (1,)
    assert place < data.index(b"IDAT")


def test_exr_round_trip_of_named_layers(tmp_path: Path) -> None:
    random = np.random.default_rng(5)
    image = random.normal(size=(6, 7, 3)).astype(np.float32)
    shadows = random.random((6, 7, 5)).astype(np.float32)
    depth = np.full((6, 7), np.inf, np.float32)
    ids = np.full((6, 7), 0xFFFFFFFF, np.uint32)
    layers = {"": image, "shadows": shadows, "reflection": image[:, ::-1], "depth": depth, "object_id": ids}
    write_exr(tmp_path / "out.exr", layers, names={"depth": ("Z",), "object_id": ("id",)})
    read = read_exr(tmp_path / "out.exr")
    assert np.array_equal(np.dstack([read["R"], read["G"], read["B"]]), image)
    assert np.array_equal(read["reflection.G"], image[:, ::-1, 1])
    assert all(np.array_equal(read[f"shadows.{i}"], shadows[:, :, i]) for i in range(5))
    assert np.array_equal(read["depth.Z"], depth)
    assert read["object_id.id"].dtype == np.uint32
    assert np.array_equal(read["object_id.id"], ids)
    assert len(read) == 3 + 5 + 3 + 1 + 1


def test_half_exr_saturates_instead_of_overflowing(tmp_path: Path) -> None:
    image = np.array([[[1.0, 1e6, -1e6], [0.25, 3.0, np.inf]]], np.float32)
    read = read_exr(write_exr(tmp_path / "out.exr", {"": image}, half=True))
    assert read["R"].dtype == np.float16
    assert read["R"].tolist() == [[1.0, 0.25]]
    assert read["G"].tolist() == [[65504.0, 3.0]]
    assert read["B"].tolist() == [[-65504.0, np.inf]]


def test_write_picture_tone_maps_png_and_leaves_exr_linear(tmp_path: Path) -> None:
    image = np.random.default_rng(0).random((4, 5, 3), dtype=np.float32) * 4
    with Image.open(write_picture(tmp_path / "a.PNG", image, "aces")) as png:
        assert np.array_equal(np.asarray(png), to_8bit(image, "aces"))
    assert np.array_equal(read_exr(write_picture(tmp_path / "a.exr", image))["B"], image[:, :, 2])


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("out.jpg", r"'\.jpg' is not one of \.png, \.exr"),
        ("out.pngg", r"Did you mean '\.png'"),
        ("out", r"no suffix is not one of"),
        ("missing/out.png", r"the folder '.*missing' does not exist"),
        ("folder.png", r"it is a folder"),
    ],
)
def test_paths_that_cannot_be_written_are_named(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / "folder.png").mkdir()
    with pytest.raises(OptionError, match=message):
        check_output(tmp_path / name, (".png", ".exr"))


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_named(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(OptionError, match="no permission"):
        check_output(tmp_path / "out.png", (".png",))


@pytest.mark.parametrize("writer", ["png", "exr"])
def test_a_writer_that_fails_half_way_leaves_the_old_file(
    tmp_path: Path, writer: str, picture: np.ndarray, monkeypatch: pytest.MonkeyPatch
) -> None:
    def half_way(self: object, target: object, *args: object, **options: object) -> None:
        Path(str(target)).write_bytes(b"half a pic")
        raise OSError(28, "No space left on device")

    path = tmp_path / f"out.{writer}"
    path.write_bytes(b"the old one")
    monkeypatch.setattr(Image.Image, "save", half_way)
    monkeypatch.setattr(OpenEXR.File, "write", half_way)
    with pytest.raises(OptionError, match=r"cannot write .*No space left"):
        write_png(path, picture) if writer == "png" else write_exr(path, {"": picture.astype(np.float32)})
    assert path.read_bytes() == b"the old one"
    assert os.listdir(tmp_path) == [path.name]


def test_complete_file_cleans_up_after_any_error_and_passes_it_on(tmp_path: Path) -> None:
    def interrupted() -> None:
        with complete_file(tmp_path / "a.txt") as temporary:
            temporary.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert os.listdir(tmp_path) == []
    with complete_file(tmp_path / "a.txt") as temporary:
        temporary.write_text("whole")
        assert not (tmp_path / "a.txt").exists()
    assert (tmp_path / "a.txt").read_text() == "whole"
