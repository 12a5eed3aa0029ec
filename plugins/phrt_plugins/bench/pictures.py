"""Pictures of judged frames, and the shots that metrics look at."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from phrt.interfaces.metric import Column, Shot
from phrt.output.tonemap import to_8bit
from phrt.workers import Workers
from phrt_plugins.metrics.pictures import checked_pair, mean_over

LARGEST_HALF = 65504.0
"""A brighter pixel saturates in float16."""
HEADER_BYTES = 4096
"""More than what stands before the numbers of an array in a file."""
ALL_TRACE_ERROR = Column(
    "all_trace_error", "display_error against all-trace, where the reference is another", "", "lower"
)
"""What the oracle is held against: it knows all-trace, and no other reference."""


@dataclass(frozen=True)
class ReferencePicture:
    """A frame to compare with, and, of a judged one, the frame in which nothing was traced.

    Linear values are what is left of them in float16.

    image, floor: (H, W, 3) float32, linear, exposure applied; display, floor_display: (H, W, 3) uint8, sRGB
    motion : (H, W, 2) float32 pixels, as of `Shot`; None where the frame before is not known
    traced_display: (H, W, 3) uint8, what tracing everything shows, of a judged frame that is path traced; of others it is `display`
    """

    image: np.ndarray
    display: np.ndarray
    floor: np.ndarray | None = None
    floor_display: np.ndarray | None = None
    motion: np.ndarray | None = None
    traced_display: np.ndarray | None = None

    @property
    def changeable(self) -> np.ndarray:
        """(H, W) bool: could a decision change the pixel?"""
        if self.floor_display is None:
            return np.zeros(self.display.shape[:2], bool)
        everything = self.display if self.traced_display is None else self.traced_display
        return np.asarray((everything != self.floor_display).any(axis=2))


def shots(
    images: Mapping[int, np.ndarray],
    references: Mapping[int, ReferencePicture],
    judged: Sequence[int],
    curve: str,
    workers: Workers | None = None,
) -> Iterator[Shot]:
    """A shot per judged frame, with the one before where its picture is there.

    images: (H, W, 3) float32, linear, exposure applied, by number of frame; curve: from linear to shown
    """

    def shot(number: int, changeable: np.ndarray, before: Shot | None) -> Shot:
        shown = to_8bit(images[number], curve, pool=workers)
        return one_shot(number, images[number], shown, references[number], changeable, before)

    for number in judged:
        reference = references[number]
        before = None
        if number - 1 in images and number - 1 in references:
            before = shot(number - 1, reference.changeable, None)
        yield shot(number, reference.changeable, before)


def floor_shots(references: Mapping[int, ReferencePicture], judged: Sequence[int]) -> Iterator[Shot]:
    """A shot per judged frame of the frames in which nothing was traced; without the one before."""
    for number in judged:
        reference = references[number]
        if reference.floor is not None and reference.floor_display is not None:
            yield one_shot(number, reference.floor, reference.floor_display, reference, reference.changeable, None)


def one_shot(
    number: int,
    image: np.ndarray,
    display: np.ndarray,
    reference: ReferencePicture,
    changeable: np.ndarray,
    before: Shot | None,
) -> Shot:
    """A picture beside its reference."""
    return Shot(
        index=number,
        image=image,
        display=display,
        reference=reference.image,
        reference_display=reference.display,
        changeable=changeable,
        previous=before,
        motion=reference.motion if before is not None else None,
    )


def all_trace_errors(
    references: Mapping[int, ReferencePicture], displays: Mapping[int, np.ndarray]
) -> dict[str, np.ndarray]:
    """The column ALL_TRACE_ERROR of judged `displays`, by number of frame; no column where references are all-trace themselves."""
    errors = []
    for number, display in displays.items():
        traced = references[number].traced_display
        if traced is None:
            return {}
        wanted, got = checked_pair(traced, display)
        errors.append(mean_over(np.abs(got - wanted)))
    return {ALL_TRACE_ERROR.name: np.array(errors, np.float64)}


def halved(image: np.ndarray) -> np.ndarray:
    """`image` as float16 keeps it."""
    return np.clip(image, -LARGEST_HALF, LARGEST_HALF).astype(np.float16)


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Arrays as an .npz, lightly compressed. Raises OSError."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, array, allow_pickle=False)


def read_arrays(path: Path, most_bytes: int) -> dict[str, np.ndarray] | None:
    """What `write_arrays` wrote; None for a file that is cut off, damaged, too large or something else. No pickles are read."""
    try:
        with zipfile.ZipFile(path) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > most_bytes + HEADER_BYTES * len(
                archive.infolist()
            ):
                return None
            found = {}
            for entry in archive.infolist():
                with archive.open(entry) as file:
                    found[entry.filename.removesuffix(".npy")] = np.lib.format.read_array(file, allow_pickle=False)
            return found
    except (OSError, ValueError, EOFError, KeyError, NotImplementedError, RuntimeError, zipfile.BadZipFile, zlib.error):
        return None
