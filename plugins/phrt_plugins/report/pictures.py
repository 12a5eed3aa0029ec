"""Pictures of the page: the same frame by everybody, beside the reference, and where they differ."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from phrt_plugins.bench.results import BenchRun, Cell
from phrt_plugins.report.maps import Pair, encoded, make_maps, read_picture, size_of

MOST_BYTES = 8_000_000
"""Of all pictures together, as they stand in the page, about."""
PICTURES_SHARE = 0.7
"""Of them; the rest is for the maps."""
BYTES_A_PIXEL = 0.5
"""About what a picture and its map take, as text."""
MOST_MAP_PIXELS = 16_000_000
"""FLIP takes more than a second a million pixels: maps beyond this are left out."""
THUMBNAIL_WIDTH = 320
FLOOR = "raster only"


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
    names = (setup, *(cell.setup for cell in cells))
    shown = next((run.references[name] for name in names if name in run.references), None)
    if shown is None:
        return {}
    references = {
        name: run.pictures(run.references[name]) for name in {cell.setup for cell in cells} & set(run.references)
    }
    title = f"reference ({run.reference_name})"
    found = {frame: [Source(title, path, path, 0.0)] for frame, path in run.pictures(shown).items()}
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
        scale, spent = self._scale(), 0
        chosen: list[tuple[str, Frame]] = []
        for setup, number in self._order():
            if spent and spent * (1 + 1 / len(chosen)) > PICTURES_SHARE * MOST_BYTES:
                self.left_out += 1
            else:
                frame = frame_of(number, self.sources[setup][number], scale)
                spent += sum(len(shot.picture) for shot in frame.shots)
                chosen.append((setup, frame))
            advance()
        for setup, frame in self._with_maps(chosen):
            self.made[setup] = sorted([*self.made[setup], frame], key=lambda each: each.number)

    def _with_maps(self, chosen: list[tuple[str, Frame]]) -> Iterator[tuple[str, Frame]]:
        """The frames with FLIP maps, as many as there is time for."""
        room, wanted = MOST_MAP_PIXELS, []
        for setup, frame in chosen:
            for source in self.sources[setup][frame.number][1:]:
                room -= math.prod(size_of(source.path))
                wanted += [Pair(source.reference, source.path, frame.size)] if room >= 0 else []
        maps = iter(make_maps(wanted))
        for setup, frame in chosen:
            shots = [frame.shots[0], *(replace(shot, map=next(maps, "")) for shot in frame.shots[1:])]
            yield setup, replace(frame, shots=tuple(shots))

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


def frame_of(number: int, sources: Sequence[Source], scale: float) -> Frame:
    """A frame's pictures, without maps."""
    width, height = size_of(sources[0].path)
    target = max(1, round(width * scale)), max(1, round(height * scale))
    shots = (Shot(each.name, encoded(read_picture(each.path), target), "", each.flip) for each in sources)
    return Frame(number, target, tuple(shots))


def thumbnail(path: Path) -> str:
    """A small picture as a data: link."""
    picture = read_picture(path)
    height, width = picture.shape[:2]
    share = min(1.0, THUMBNAIL_WIDTH / width)
    return encoded(picture, (max(1, round(width * share)), max(1, round(height * share))))
