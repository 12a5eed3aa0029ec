"""Where rendered frames go: one picture, a numbered sequence, a video, and the folder of layers."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np

from phrt.errors import OptionError
from phrt.output.files import check_output
from phrt.output.images import PICTURE_SUFFIXES, write_png
from phrt.output.layers import write_layers, write_light_exr
from phrt.output.tonemap import curve_code, to_8bit
from phrt.output.video import VIDEO_SUFFIXES, VideoWriter

if TYPE_CHECKING:
    from phrt.frame import FrameResult


class FrameWriter(ABC):
    """Takes frames in order; what it wrote is complete when the `with` block ends."""

    files: list[Path]

    @abstractmethod
    def add(self, index: int, frame: FrameResult) -> None:
        """Write frame number `index`."""

    def __enter__(self) -> FrameWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return None


class PictureWriter(FrameWriter):
    """One file a frame: tone mapped .png, or .exr with the linear picture and every layer of light."""

    def __init__(self, output: Path, tone_map: str, layers: Path | None, many: bool, tint: str | None) -> None:
        self.files = []
        self._output, self._tone_map, self._layers, self._many = output, tone_map, layers, many
        self._tint = tint

    def add(self, index: int, frame: FrameResult) -> None:
        path = numbered(self._output, index)
        if path.suffix.lower() == ".exr":
            self.files.append(write_light_exr(path, frame))
        else:
            self.files.append(write_png(path, developed(frame, self._tone_map, self._tint)))
        add_layers(self, self._layers, index if self._many else None, frame, self._tone_map)


class MovieWriter(FrameWriter):
    """All frames into one video."""

    def __init__(
        self, output: Path, tone_map: str, layers: Path | None, size: tuple[int, int], fps: float, tint: str | None
    ) -> None:
        self.files = []
        self._output, self._tone_map, self._layers, self._tint = output, tone_map, layers, tint
        self._video = VideoWriter(output, size, fps)

    def add(self, index: int, frame: FrameResult) -> None:
        self._video.add(developed(frame, self._tone_map, self._tint))
        add_layers(self, self._layers, index, frame, self._tone_map)

    def __enter__(self) -> FrameWriter:
        self._video.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._video.__exit__(kind, error, trace)
        if error is None:
            self.files.insert(0, self._output)


def developed(frame: FrameResult, tone_map: str, tint: str | None) -> np.ndarray:
    """(H, W, 3) uint8 sRGB: the picture, or its overlay of the effect `tint` ("all" for all of them)."""
    if tint is None:
        return to_8bit(frame.image, tone_map)
    from phrt.overlay import overlay

    return overlay(frame, tint, tone_map=tone_map)


def open_writer(
    output: Path,
    frame_count: int,
    size: tuple[int, int],
    fps: float,
    tone_map: str,
    layers: Path | None,
    tint: str | None = None,
) -> FrameWriter:
    """The writer for `output`. Cheap; raises OptionError for a path that cannot be written or fits no sequence.

    tint: the effect whose overlay is written instead of the picture, "all" for all of them.
    """
    curve_code(tone_map)
    check_output(numbered(output, 0), (*PICTURE_SUFFIXES, *VIDEO_SUFFIXES))
    if layers is not None and layers.exists() and not layers.is_dir():
        raise OptionError(f"cannot write layers into '{layers}': it is a file, not a folder")
    if tint is not None and output.suffix.lower() == ".exr":
        raise OptionError(f"--overlay tints what is seen, and '{output}' holds light: give a .png or a video")
    if output.suffix.lower() in VIDEO_SUFFIXES:
        return MovieWriter(output, tone_map, layers, size, fps, tint)
    if frame_count > 1 and not is_pattern(output):
        pattern = output.with_name(f"{output.stem}_%04d{output.suffix}")
        raise OptionError(
            f"{frame_count} frames do not fit into '{output}': give a pattern, as in {pattern}, or a video (.mp4)"
        )
    return PictureWriter(output, tone_map, layers, frame_count > 1, tint)


def is_video(output: Path) -> bool:
    return output.suffix.lower() in VIDEO_SUFFIXES


def is_pattern(output: Path) -> bool:
    """Does the file name hold a place for the frame's number, as in frame_%04d.png?"""
    return re.search(r"%0?\d*d", output.name) is not None


def numbered(output: Path, index: int) -> Path:
    """`output` with its place for a number filled in."""
    return output.with_name(re.sub(r"%(0?\d*)d", lambda match: format(index, f"{match[1]}d"), output.name))


def add_layers(writer: FrameWriter, folder: Path | None, index: int | None, frame: FrameResult, tone_map: str) -> None:
    """Write the layers of `frame` into `folder`, a folder a frame where there are several."""
    if folder is not None:
        target = folder if index is None else folder / f"{index:04d}"
        writer.files.extend(write_layers(target, frame, tone_map=tone_map))
