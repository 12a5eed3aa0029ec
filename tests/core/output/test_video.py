"""Video: what a player gets back, sizes, failures."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import needs
import numpy as np
import pytest

from phrt.errors import OptionError
from phrt.output.video import VideoWriter


def decode(path: Path) -> tuple[list[np.ndarray], float]:
    av = needs.package("av")
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert stream.codec_context.name == "h264"
        assert stream.codec_context.pix_fmt == "yuv420p"
        assert stream.codec_context.colorspace == 1
        return frames, float(stream.average_rate)


def test_frames_come_back_in_order_with_their_colours(tmp_path: Path) -> None:
    needs.package("av")
    colors = [(200, 40, 40), (40, 180, 60), (50, 60, 210), (128, 128, 128)]
    with VideoWriter(tmp_path / "out.mp4", (64, 48), 25) as video:
        for color in colors:
            video.add(np.full((48, 64, 3), color, np.uint8))
        assert not (tmp_path / "out.mp4").exists()
    frames, rate = decode(tmp_path / "out.mp4")
    assert rate == 25
    assert len(frames) == len(colors)
    for frame, color in zip(frames, colors, strict=True):
        assert np.abs(frame.reshape(-1, 3).mean(axis=0) - color).max() < 4


def test_an_odd_size_gets_its_edge_repeated(tmp_path: Path) -> None:
    needs.package("av")
    pixels = np.full((33, 65, 3), 30, np.uint8)
    pixels[:, -1] = 220
    with VideoWriter(tmp_path / "out.mkv", (65, 33), 29.97, crf=4) as video:
        video.add(pixels)
    (frame,), rate = decode(tmp_path / "out.mkv")
    assert frame.shape == (34, 66, 3)
    assert abs(int(frame[:, -1].mean()) - 220) < 8
    assert rate == pytest.approx(29.97, abs=0.01)


def test_an_error_between_frames_leaves_the_old_file_and_passes(tmp_path: Path) -> None:
    needs.package("av")
    path = tmp_path / "out.mp4"
    path.write_bytes(b"the old one")

    def interrupted() -> None:
        with VideoWriter(path, (16, 16), 30) as video:
            video.add(np.zeros((16, 16, 3), np.uint8))
            raise FileNotFoundError("something else")

    with pytest.raises(FileNotFoundError, match="something else"):
        interrupted()
    assert path.read_bytes() == b"the old one"
    assert os.listdir(tmp_path) == ["out.mp4"]


def test_what_cannot_be_written_is_refused_before_the_first_frame(tmp_path: Path) -> None:
    needs.package("av")
    for name, size, fps, message in (
        ("out.avi", (16, 16), 30.0, r"'\.avi' is not one of \.mp4, \.mov, \.mkv"),
        ("out.mp4", (0, 16), 30.0, "0x16"),
        ("out.mp4", (16, 16), 0.0, "frames per second"),
        ("no/out.mp4", (16, 16), 30.0, "does not exist"),
    ):
        with pytest.raises(OptionError, match=message):
            VideoWriter(tmp_path / name, size, fps)


def test_a_frame_of_another_size_is_refused(tmp_path: Path) -> None:
    needs.package("av")
    with (
        pytest.raises(ValueError, match=r"expected uint8\(16, 32, 3\)"),
        VideoWriter(tmp_path / "out.mp4", (32, 16), 30) as video,
    ):
        video.add(np.zeros((32, 16, 3), np.uint8))
    assert os.listdir(tmp_path) == []


def test_without_pyav_the_message_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(OptionError, match=r"pip install 'phrt\[video\]'"):
        VideoWriter(tmp_path / "out.mp4", (16, 16), 30)
    assert os.listdir(tmp_path) == []
