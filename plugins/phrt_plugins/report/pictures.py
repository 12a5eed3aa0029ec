"""Pictures of the page: the same frame by everybody, beside the reference, and where they differ."""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from phrt_plugins.bench.results import BenchRun, Cell

MOST_BYTES = 8_000_000
"""Of all pictures together, as they stand in the page."""
BYTES_A_PIXEL = 0.5
"""About what a picture and its map take, as text."""
MOST_MAP_PIXELS = 8_000_000
"""FLIP takes more than a second a million pixels: maps beyond this are left out."""
THUMBNAIL_WIDTH = 320
QUALITY = 90
LOSSLESS_PIXELS = 40_000
"""Small pictures show every fault."""
REFERENCE, FLOOR = "reference (all-trace)", "raster only"


@dataclass(frozen=True)
class Shot:
    """One picture. name: who made it; picture, map: data: links, "" where there is no map; flip: mean FLIP, NaN unless measured."""

    name: str
    picture: str
    map: str
    flip: float


@dataclass(frozen=True)
class Frame:
    """A frame by everybody, the reference first."""

    number: int
    size: tuple[int, int]
    shots: tuple[Shot, ...]


@dataclass(frozen=True)
class Source:
    """A picture before it is read, and the reference that it is compared with."""

    name: str
    path: Path
    reference: Path
    flip: float


def frames_of(run: BenchRun, setup: str, cells: Sequence[Cell]) -> dict[int, list[Source]]:
    """Frame number -> its pictures, the reference first, of the frames that have one. setup: whose reference is shown; cells: one
    per contestant and budget, of setups that are compared with each other."""
    shown = run.references.get(setup)
    if shown is None:
        return {}
    references = {
        name: run.pictures(run.references[name]) for name in {cell.setup for cell in cells} & set(run.references)
    }
    found = {frame: [Source(REFERENCE, path, path, 0.0)] for frame, path in run.pictures(shown).items()}
    for frame, path in run.pictures(shown, "floor").items():
        if frame in found:
            flip = flip_at(run.measures(shown, ["frame", "flip"]), frame)
            found[frame].append(Source(FLOOR, path, found[frame][0].path, flip))
    for cell in cells:
        paths, own = run.pictures(cell), references.get(cell.setup, {})
        measured = run.measures(cell, ["frame", "flip"]) if paths else None
        for frame, path in paths.items():
            if frame in found:
                reference = own.get(frame, found[frame][0].path)
                found[frame].append(Source(f"{cell.label} · {cell.budget}", path, reference, flip_at(measured, frame)))
    return {frame: sources for frame, sources in sorted(found.items()) if len(sources) > 1}


def flip_at(measures: Any, frame: int) -> float:
    """Mean FLIP of a frame in a table of measures; NaN where it is not there."""
    if measures is None or "flip" not in measures.column_names:
        return math.nan
    rows = np.flatnonzero(np.asarray(measures.column("frame").to_numpy()) == frame)
    return float(np.asarray(measures.column("flip").to_numpy())[rows[0]]) if len(rows) else math.nan


@dataclass
class Album:
    """Chooses the frames that fit into the page, the middle one of every setup first, and makes their pictures."""

    sources: dict[str, dict[int, list[Source]]]
    made: dict[str, list[Frame]]
    left_out: int = 0

    @classmethod
    def of(cls, sources: dict[str, dict[int, list[Source]]]) -> Album:
        return cls(sources, {setup: [] for setup in sources})

    @property
    def steps(self) -> int:
        """Frames to look at."""
        return sum(map(len, self.sources.values()))

    def make(self, advance: Callable[[], None]) -> None:
        """Fill `made`. advance: called once per frame."""
        scale, spent, map_pixels = self._scale(), 0, 0
        for setup, frame in self._order():
            sources = self.sources[setup][frame]
            if spent and spent * (1 + 1 / max(sum(map(len, self.made.values())), 1)) > MOST_BYTES:
                self.left_out += 1
            else:
                made, pixels = frame_of(frame, sources, scale, MOST_MAP_PIXELS - map_pixels)
                map_pixels += pixels
                spent += sum(len(shot.picture) + len(shot.map) for shot in made.shots)
                self.made[setup] = sorted([*self.made[setup], made], key=lambda each: each.number)
            advance()

    @property
    def note(self) -> str:
        """What is to be said of frames that were left out, and of maps."""
        said = []
        if self.left_out:
            said.append(
                f"{self.left_out} further frames would make this file too large: their pictures are beside the cells."
            )
        shots = [shot for frames in self.made.values() for frame in frames for shot in frame.shots[1:]]
        bare = sum(not shot.map for shot in shots)
        if bare:
            said.append(f"{bare} of {len(shots)} pictures have no FLIP map.")
        return " ".join(said)

    def _order(self) -> Iterator[tuple[str, int]]:
        """One frame of every setup, then another: the middle one, then outwards."""
        rows = {setup: from_the_middle(list(frames)) for setup, frames in self.sources.items()}
        for turn in range(max(map(len, rows.values()), default=0)):
            yield from ((setup, frames[turn]) for setup, frames in rows.items() if turn < len(frames))

    def _scale(self) -> float:
        """By what pictures are made smaller so that one frame of every setup fits."""
        pixels = 0.0
        for frames in self.sources.values():
            most = max(frames.values(), key=len, default=[])
            pixels += len(most) * math.prod(size_of(most[0].path)) if most else 0
        return min(1.0, math.sqrt(MOST_BYTES / BYTES_A_PIXEL / pixels)) if pixels else 1.0


def from_the_middle(numbers: list[int]) -> list[int]:
    """The numbers, the middle one first, then its neighbours in turn."""
    middle = (len(numbers) - 1) // 2
    places = sorted(range(len(numbers)), key=lambda place: (abs(place - middle), place))
    return [numbers[place] for place in places]


def frame_of(number: int, sources: Sequence[Source], scale: float, most_map_pixels: int) -> tuple[Frame, int]:
    """A frame's pictures, and how many pixels of FLIP maps were made for it. most_map_pixels: no more than these."""
    width, height = size_of(sources[0].path)
    target = max(1, round(width * scale)), max(1, round(height * scale))
    shots, spent = [Shot(REFERENCE, encoded(read_picture(sources[0].path), target), "", 0.0)], 0
    for source in sources[1:]:
        picture = read_picture(source.path)
        shot, pixels = Shot(source.name, encoded(picture, target), "", source.flip), math.prod(picture.shape[:2])
        if spent + pixels <= most_map_pixels:
            errors = flip_errors(read_picture(source.reference), picture)
            if errors is not None:
                shot, spent = replace(shot, map=encoded(magma(errors), target)), spent + pixels
        shots.append(shot)
    return Frame(number, target, tuple(shots)), spent


def flip_errors(reference: np.ndarray, picture: np.ndarray) -> np.ndarray | None:
    """(H, W) float32; None where FLIP cannot be found: its package is missing, or the pictures do not fit together."""
    from phrt_plugins.metrics.flip import flip_map

    try:
        return flip_map(reference, picture)
    except (ImportError, ValueError):
        return None


def read_picture(path: Path) -> np.ndarray:
    """(H, W, 3) uint8 of a PNG."""
    from PIL import Image

    with Image.open(path) as image:
        return np.asarray(image.convert("RGB"))


def size_of(path: Path) -> tuple[int, int]:
    """(width, height) of a PNG."""
    from PIL import Image

    with Image.open(path) as image:
        return image.size


def thumbnail(path: Path) -> str:
    """A small picture as a data: link."""
    picture = read_picture(path)
    height, width = picture.shape[:2]
    share = min(1.0, THUMBNAIL_WIDTH / width)
    return encoded(picture, (max(1, round(width * share)), max(1, round(height * share))))


def encoded(picture: np.ndarray, size: tuple[int, int]) -> str:
    """(H, W, 3) uint8 as a data: link, made as large as `size` (width, height)."""
    from PIL import Image

    image = Image.fromarray(picture)
    if image.size != size:
        image = image.resize(size, Image.Resampling.LANCZOS)
    out = io.BytesIO()
    image.save(out, "WEBP", quality=QUALITY, method=3, lossless=math.prod(size) <= LOSSLESS_PIXELS)
    return "data:image/webp;base64," + base64.b64encode(out.getvalue()).decode("ascii")


def magma(errors: np.ndarray) -> np.ndarray:
    """(H, W, 3) uint8: FLIP 0 to 1 in the colours that its authors show it in."""
    table = (magma_table() * 255 + 0.5).astype(np.uint8)
    return table[np.clip(errors * 255 + 0.5, 0, 255).astype(np.uint8)]


def magma_table() -> np.ndarray:
    """(256, 3) float64, sRGB 0 to 1."""
    from matplotlib import colormaps

    return np.asarray(colormaps["magma"](np.arange(256)))[:, :3]


def magma_stops(count: int = 9) -> str:
    """The colour bar, as stops of a CSS gradient."""
    rows = np.linspace(0, 255, count).round().astype(int)
    return ", ".join("#" + "".join(f"{round(part * 255):02x}" for part in magma_table()[row]) for row in rows)
