"""OBJ text to a triangle soup, in batches of lines, so that memory stays near the size of the result.

Our own reader: trimesh's loses `o`, `g` and smoothing groups, changes vertex order, and takes wrong indices without
a word. Polygons, negative indices, vertex colours, line continuations and UTF-16 are read; curves are not.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from phrt.errors import AssetError
from phrt_plugins.loaders.mesh_polygons import triangulate
from phrt_plugins.loaders.mesh_soup import Soup, linear_from_srgb, upward_uvs
from phrt_plugins.loaders.options import MeshOptions

BATCH = 32768
"""Lines of one kind that are turned into arrays together."""

_SILENT = {
    b"l",
    b"p",
    b"vp",
    b"maplib",
    b"usemap",
    b"shadow_obj",
    b"trace_obj",
    b"lod",
    b"bevel",
    b"c_interp",
    b"d_interp",
}
_CURVES = {
    b"curv",
    b"curv2",
    b"surf",
    b"cstype",
    b"deg",
    b"bmat",
    b"step",
    b"parm",
    b"trim",
    b"hole",
    b"scrv",
    b"sp",
    b"end",
}
_NUMBER = re.compile(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")


@dataclass
class ObjFile:
    """A read OBJ: its triangles, the material names that `Soup.material` counts in, and the MTL files it names."""

    soup: Soup
    material_names: list[str]
    libraries: list[str]


def read_obj(data: bytes, name: str, options: MeshOptions, warn: Callable[[str], None]) -> ObjFile:
    """Read OBJ text. Raises AssetError, beginning with `name` and the line, for what cannot be read."""
    reader = _Reader(name, warn)
    reader.read(_as_utf8(data, name))
    return reader.finish(options)


def _as_utf8(data: bytes, name: str) -> bytes:
    """`data` without byte order mark and line continuations. Raises AssetError for what is not text."""
    for mark, encoding in ((b"\xff\xfe", "utf-16-le"), (b"\xfe\xff", "utf-16-be"), (b"\xef\xbb\xbf", "")):
        if data.startswith(mark):
            data = data[len(mark) :]
            data = data.decode(encoding, errors="replace").encode() if encoding else data
            break
    if b"\0" in data:
        raise AssetError(f"{name} is not an OBJ text file: it holds zero bytes")
    if b"\\" in data:
        data = re.sub(rb"\\\r?\n", b" ", data)
    return data if b"\n" in data else data.replace(b"\r", b"\n")


@dataclass
class _Batch:
    """Lines waiting to become arrays, and the arrays so far."""

    lines: list[bytes] = field(default_factory=list)
    numbers: list[int] = field(default_factory=list)
    count: int = 0
    arrays: list[np.ndarray] = field(default_factory=list)


class _Reader:
    def __init__(self, name: str, warn: Callable[[str], None]) -> None:
        self.name = name
        self.warn = warn
        self.values = {b"v": _Batch(), b"vt": _Batch(), b"vn": _Batch()}
        self.faces = _Batch()
        self.sizes: list[np.ndarray] = []
        self.face_lines: list[np.ndarray] = []
        self.relative: dict[int, tuple[int, int, int]] = {}
        # (first face, value) of every change of the state that faces inherit.
        self.states: dict[bytes, list[tuple[int, int]]] = {key: [(0, 0)] for key in (b"usemtl", b"o", b"g", b"s")}
        self.ids: dict[bytes, dict[str, int]] = {key: {"": 0} for key in self.states}
        self.libraries: list[str] = []
        self.ignored: dict[str, int] = {}
        self.malformed = 0

    def read(self, data: bytes) -> None:
        vertices, faces = self.values[b"v"], self.faces
        number = 0
        for number, line in enumerate(io.BytesIO(data), 1):
            start = line[:2]
            # The two frequent kinds, without a call: this loop is a third of the time of a large file.
            if start == b"v " and len(vertices.lines) < BATCH - 1:
                vertices.lines.append(line)
                vertices.numbers.append(number)
                vertices.count += 1
            elif start == b"f " and len(faces.lines) < BATCH - 1 and b"-" not in line:
                faces.lines.append(line)
                faces.numbers.append(number)
                faces.count += 1
            else:
                self._other(line, number)
        for batch in self.values.values():
            self._flush_values(batch)
        self._cut_off(data, number)
        self._flush_faces(faces)

    def _add_value(self, batch: _Batch, line: bytes, number: int) -> None:
        batch.lines.append(line)
        batch.numbers.append(number)
        batch.count += 1
        if len(batch.lines) >= BATCH:
            self._flush_values(batch)

    def _add_face(self, line: bytes, number: int) -> None:
        if b"-" in line:
            v, vt, vn = (self.values[key].count for key in (b"v", b"vt", b"vn"))
            self.relative[len(self.faces.lines)] = (v, vt, vn)
        self.faces.lines.append(line)
        self.faces.numbers.append(number)
        self.faces.count += 1
        if len(self.faces.lines) >= BATCH:
            self._flush_faces(self.faces)

    def _other(self, line: bytes, number: int) -> None:
        words = line.split(None, 1)
        if not words or words[0].startswith(b"#"):
            return
        key = words[0]
        if key in self.values:
            self._add_value(self.values[key], line, number)
        elif key in (b"f", b"fo"):
            self._add_face(line, number)
        elif key in self.states:
            self._change(key, words[1].split(b"#")[0].decode("utf-8", "replace").strip() if len(words) > 1 else "")
        elif key == b"mtllib":
            self.libraries.append(words[1].decode("utf-8", "replace").strip() if len(words) > 1 else "")
        elif key not in _SILENT:
            self.ignored.setdefault(key.decode("utf-8", "replace")[:20], number)

    def _change(self, key: bytes, value: str) -> None:
        if key == b"s":
            value = "" if value in ("off", "0") else value or "on"
        ids = self.ids[key]
        self.states[key].append((self.faces.count, ids.setdefault(value, len(ids))))

    def _flush_values(self, batch: _Batch) -> None:
        """Lines of numbers to (n, widest) float64, NaN where a line is shorter."""
        if not batch.lines:
            return
        rows = [line.split() for line in batch.lines]
        try:
            numbers = list(map(float, chain.from_iterable(row[1:] for row in rows)))
        except ValueError:
            rows = [self._clean(line, number) for line, number in zip(batch.lines, batch.numbers, strict=True)]
            numbers = list(map(float, chain.from_iterable(row[1:] for row in rows)))
        widths = np.fromiter(map(len, rows), dtype=np.int64, count=len(rows)) - 1
        least = 1 if rows[0][0] == b"vt" else 3
        if (widths < least).any():
            index = int(np.argmax(widths < least))
            raise AssetError(
                f"{self.name}, line {batch.numbers[index]}: '{_shown(batch.lines[index])}' has {widths[index]} "
                f"numbers, expected at least {least}"
            )
        table = np.full((len(rows), int(widths.max())), np.nan)
        table[np.arange(table.shape[1]) < widths[:, None]] = numbers
        batch.arrays.append(table[:, :8])
        batch.lines, batch.numbers = [], []

    def _clean(self, line: bytes, number: int) -> list[bytes]:
        """The words of `line` without comment, broken numbers cut at the first wrong character, as strtod does."""
        words = line.split(b"#")[0].split()
        for index, word in enumerate(words[1:], 1):
            try:
                float(word)
            except ValueError:
                good = _NUMBER.match(word)
                if good is None:
                    raise AssetError(f"{self.name}, line {number}: '{_shown(word)}' is not a number") from None
                words[index] = good[0]
                self.malformed += 1
        return words

    def _cut_off(self, data: bytes, number: int) -> None:
        """A face in an unterminated last line whose corners are written differently is half a face: leave it out."""
        batch = self.faces
        if not batch.lines or batch.numbers[-1] != number or data.endswith((b"\n", b"\r")):
            return
        forms = {_form(word) for word in batch.lines[-1].split()[1:]}
        if len(forms) > 1:
            self.relative.pop(len(batch.lines) - 1, None)
            del batch.lines[-1], batch.numbers[-1]
            batch.count -= 1
            self.warn(f"ends in the middle of line {number}: the file is cut off, the picture lacks the rest")

    def _flush_faces(self, batch: _Batch) -> None:
        """Face lines to (corners, 3) int64 zero-based indices, -1 for none, and their sizes."""
        if not batch.lines:
            return
        rows = [line.split()[1:] for line in batch.lines]
        words = list(chain.from_iterable(rows))
        sizes = np.fromiter(map(len, rows), dtype=np.int64, count=len(rows))
        try:
            table = _corner_table(words)
        except (ValueError, OverflowError):
            rows = [line.split(b"#")[0].split()[1:] for line in batch.lines]
            words = list(chain.from_iterable(rows))
            sizes = np.fromiter(map(len, rows), dtype=np.int64, count=len(rows))
            self._find_bad_corner(rows, batch.numbers)
            table = _corner_table(words)
        face = np.repeat(np.arange(len(rows)), sizes)
        if self.relative:
            counts = np.zeros((len(rows), 3), dtype=np.int64)
            counts[list(self.relative)] = list(self.relative.values())
            resolved = table + counts[face] + 1
            table = np.where(table < 0, np.where(resolved < 1, -1, resolved), table)
        wrong = (table < 0).any(axis=1) | (table[:, 0] == 0) if len(table) else np.zeros(0, dtype=bool)
        if wrong.any():
            index = int(face[np.argmax(wrong)])
            raise AssetError(
                f"{self.name}, line {batch.numbers[index]}: '{_shown(batch.lines[index])}' has an index before the "
                "first element (indices count from 1, negative ones back from the last)"
            )
        batch.arrays.append(table - 1)
        self.sizes.append(sizes)
        self.face_lines.append(np.array(batch.numbers, dtype=np.int64))
        batch.lines, batch.numbers, self.relative = [], [], {}

    def _find_bad_corner(self, rows: list[list[bytes]], numbers: list[int]) -> None:
        for row, number in zip(rows, numbers, strict=True):
            for word in row:
                if not re.fullmatch(rb"[+-]?\d{1,15}(/([+-]?\d{1,15})?){0,2}", word):
                    raise AssetError(
                        f"{self.name}, line {number}: '{_shown(word)}' is not a face corner (v, v/vt, v//vn or v/vt/vn)"
                    )

    def finish(self, options: MeshOptions) -> ObjFile:
        """Everything read, as triangles."""
        self._report()
        vertices = _stack(self.values[b"v"].arrays)
        uvs, normals = _stack(self.values[b"vt"].arrays), _stack(self.values[b"vn"].arrays)
        corners = _stack(self.faces.arrays).astype(np.int64).reshape(-1, 3)
        sizes = np.concatenate([np.zeros(0, np.int64), *self.sizes])
        lines = np.repeat(np.concatenate([np.zeros(0, np.int64), *self.face_lines]), sizes)
        for column, (array, what) in enumerate(((vertices, "vertex"), (uvs, "vt"), (normals, "vn"))):
            outside = corners[:, column] >= len(array)
            if outside.any():
                first = int(np.argmax(outside))
                raise AssetError(
                    f"{self.name}, line {lines[first]}: {what} index {corners[first, column] + 1} is past the end, "
                    f"the file has {len(array)}"
                )
        positions = vertices[:, :3] if len(vertices) else np.zeros((0, 3))
        triangles, face = triangulate(sizes, positions[corners[:, 0]], self.warn)
        parts, names = self._parts(options, face)
        soup = Soup(
            positions=positions,
            triangles=corners[triangles, 0],
            part_names=names,
            material=(self._state(b"usemtl", face) - 1).astype(np.int32),
            part=parts,
            smoothing=self._smoothing(face),
            colors=self._colors(vertices),
        )
        if (corners[:, 1] >= 0).any():
            soup.uvs, soup.uv_index = self._uvs(uvs), corners[triangles, 1]
        if (corners[:, 2] >= 0).any():
            soup.normals, soup.normal_index = normals[:, :3], corners[triangles, 2]
        return ObjFile(soup, list(self.ids[b"usemtl"])[1:], self.libraries)

    def _report(self) -> None:
        curves = [key for key in self.ignored if key.encode() in _CURVES]
        if curves:
            self.warn(f"curves and surfaces are not supported and were left out (line {self.ignored[curves[0]]})")
        unknown = {key: line for key, line in self.ignored.items() if key not in curves}
        if unknown:
            key, line = next(iter(unknown.items()))
            self.warn(
                f"{len(unknown)} kinds of lines are unknown and were left out, the first is '{key}' in line {line}"
            )
        if self.malformed:
            self.warn(f"{self.malformed} numbers are malformed and were read up to the first wrong character")

    def _state(self, key: bytes, face: np.ndarray) -> np.ndarray:
        """(T,) id of state `key` at every triangle's face."""
        first, value = np.array(self.states[key], dtype=np.int64).T
        return value[np.searchsorted(first, face, side="right") - 1]

    def _parts(self, options: MeshOptions, face: np.ndarray) -> tuple[np.ndarray, list[str]]:
        auto = b"o" if len(self.ids[b"o"]) > 1 else b"g"
        key = {"object": b"o", "group": b"g", "none": b"", "auto": auto}[options.group_by]
        whole = re.sub(r"\.\w+$", "", self.name) or "mesh"
        if not key or len(self.ids[key]) == 1:
            return np.zeros(len(face), dtype=np.int32), [whole]
        return self._state(key, face).astype(np.int32), [name or whole for name in self.ids[key]]

    def _smoothing(self, face: np.ndarray) -> np.ndarray:
        # A file that never says `s` leaves smoothing to the crease angle.
        if len(self.states[b"s"]) == 1:
            return np.ones(len(face), dtype=np.int32)
        return self._state(b"s", face).astype(np.int32)

    def _uvs(self, uvs: np.ndarray) -> np.ndarray:
        # `vt u` alone means v = 0.
        v = np.where(np.isnan(uvs[:, 1]), 0.0, uvs[:, 1]) if uvs.shape[1] > 1 else np.zeros(len(uvs))
        return upward_uvs(np.column_stack([uvs[:, 0], v]), self.warn)

    def _colors(self, vertices: np.ndarray) -> np.ndarray | None:
        """(V, 4) float32 linear from `v x y z r g b`, white where a vertex has none."""
        if vertices.ndim != 2 or vertices.shape[1] < 6:
            return None
        rgb = vertices[:, 3:6]
        stated = ~np.isnan(rgb).any(axis=1)
        partly = np.isnan(rgb).any(axis=1) & ~np.isnan(rgb[:, 0])
        if not stated.all():
            self.warn(
                f"{int((~stated).sum())} of {len(rgb)} vertices have no colour, or one that is NaN, and are white"
            )
        colors = np.ones((len(rgb), 4), dtype=np.float32)
        good = stated & ~partly
        values = rgb[good]
        # Some programs write 0..255.
        values = values / 255.0 if values.size and np.nanmax(values) > 1.5 else values
        colors[good, :3] = linear_from_srgb(np.clip(values, 0.0, 1.0))
        return colors


def _corner_table(words: list[bytes]) -> np.ndarray:
    """(n, 3) int64 of v, vt, vn as written; 0 where left out. Raises ValueError for what is no number."""
    table = np.zeros((len(words), 3), dtype=np.int64)
    if b"/" not in b"".join(words):
        table[:, 0] = list(map(int, words))
        return table
    parts = [word.split(b"/") for word in words]
    if max(map(len, parts)) > 3:
        raise ValueError("more than three indices")
    for column in range(3):
        table[:, column] = [int(part[column]) if len(part) > column and part[column] else 0 for part in parts]
    return table


def _stack(arrays: list[np.ndarray]) -> np.ndarray:
    """Arrays of several widths under each other, NaN where narrower; (0, 3) for none."""
    if not arrays:
        return np.zeros((0, 3))
    width = max(array.shape[1] for array in arrays)
    if all(array.shape[1] == width for array in arrays):
        return np.concatenate(arrays)
    return np.concatenate([np.pad(a, ((0, 0), (0, width - a.shape[1])), constant_values=np.nan) for a in arrays])


def _form(word: bytes) -> tuple[bool, ...]:
    """How a corner is written: which of its indices are there."""
    return tuple(bool(part) for part in word.split(b"/"))


def _shown(text: bytes) -> str:
    """`text` short enough for a message."""
    shown = text.decode("utf-8", "replace").strip()
    return shown if len(shown) <= 40 else shown[:37] + "..."
