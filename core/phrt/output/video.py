"""H.264 video through PyAV (the `video` extra): BT.709, limited range, 4:2:0, as players expect."""

from __future__ import annotations

import os
from contextlib import AbstractContextManager
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from phrt.errors import OptionError
from phrt.limits import MAX_SIDE
from phrt.output.files import check_output, temporary_beside

VIDEO_SUFFIXES = (".mp4", ".mov", ".mkv")


class VideoWriter(AbstractContextManager["VideoWriter"]):
    """Writes frames of one size to one file. The file appears, or an older one is replaced, only when the `with` block
    ends well. A size that is odd is made even by repeating the last column or row: 4:2:0 has one colour per 2x2 pixels.

    size : (width, height) in pixels; fps : frames per second; crf : x264 quality, 0 lossless to 51 worst.
    Raises OptionError for a path, suffix, size or rate that cannot be written, and where PyAV is missing.
    """

    def __init__(self, path: str | Path, size: tuple[int, int], fps: float, *, crf: int = 16) -> None:
        self.path = check_output(path, VIDEO_SUFFIXES)
        if min(size) < 1 or max(size) > MAX_SIDE:
            raise OptionError(f"video size {size[0]}x{size[1]} is not within 1x1 to {MAX_SIDE}x{MAX_SIDE}")
        if not 0 < fps <= 1000:
            raise OptionError(f"{fps} frames per second is not above 0 and at most 1000")
        self.size = size
        self._av = _import_av()
        self._temporary = temporary_beside(self.path)
        try:
            self._container = self._av.open(str(self._temporary), mode="w")
            self._stream = self._add_stream(fps, crf)
        except (OSError, ValueError, self._av.FFmpegError) as error:
            self._temporary.unlink(missing_ok=True)
            raise OptionError(f"cannot write '{self.path}': {error}") from error

    def _add_stream(self, fps: float, crf: int) -> Any:
        stream = self._container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1001))
        stream.width, stream.height = (side + side % 2 for side in self.size)
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": str(crf), "preset": "medium"}
        # 1 is BT.709 in FFmpeg's enumerations of primaries, transfer and matrix; colour range 1 is limited.
        context = stream.codec_context
        context.color_primaries = context.color_trc = context.colorspace = context.color_range = 1
        return stream

    def add(self, pixels: np.ndarray) -> None:
        """Append one frame, (H, W, 3) uint8 sRGB. Raises ValueError for another shape or type."""
        width, height = self.size
        if pixels.shape != (height, width, 3) or pixels.dtype != np.uint8:
            raise ValueError(f"expected uint8{(height, width, 3)}, got {pixels.dtype}{pixels.shape}")
        even = np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
        frame = self._av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")
        frame = frame.reformat(format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG")
        for packet in self._stream.encode(frame):
            self._container.mux(packet)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if error is None:
                for packet in self._stream.encode():
                    self._container.mux(packet)
            self._container.close()
            if error is None:
                os.replace(self._temporary, self.path)
        except (OSError, self._av.FFmpegError) as failure:
            if error is None:
                raise OptionError(f"cannot write '{self.path}': {failure}") from failure
        finally:
            self._temporary.unlink(missing_ok=True)


def _import_av() -> Any:
    try:
        import av
    except ImportError as error:
        raise OptionError("writing video needs PyAV: pip install 'phrt[video]'") from error
    return av
