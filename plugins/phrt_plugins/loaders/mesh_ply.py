"""PLY, ASCII and binary, to a triangle soup.

Our own reader: trimesh's leaves out polygons of more than four corners and takes indices past the end; and a PLY's
header says how large its body is at least, which is checked here before anything is allocated.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from phrt.errors import AssetError
from phrt_plugins.loaders.mesh_polygons import triangulate
from phrt_plugins.loaders.mesh_soup import Soup, linear_from_srgb, simple_soup, upward_uvs

_TYPES = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
}
_TYPES |= {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"}
_TYPES |= {"float32": "f4", "float64": "f8", "int64": "i8", "uint64": "u8"}
_UV_NAMES = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"))
_MAX_HEADER = 1 << 20


@dataclass
class Property:
    """One column; a list when `count_type` is set."""

    name: str
    type: str
    count_type: str = ""


@dataclass
class Element:
    name: str
    count: int
    properties: list[Property] = field(default_factory=list)

    @property
    def least_bytes(self) -> int:
        """Of one row in a binary body: lists are at least their count."""
        return sum(np.dtype(p.count_type or p.type).itemsize for p in self.properties)


@dataclass
class Table:
    """A read element: scalar columns (n,) by name; lists as (sizes (n,), all values) by name."""

    columns: dict[str, np.ndarray] = field(default_factory=dict)
    lists: dict[str, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)


def read_ply(data: bytes, name: str, warn: Callable[[str], None]) -> Soup:
    """The triangles of PLY file `data`. Raises AssetError, beginning with `name`, for what cannot be read."""
    encoding, elements, body = _header(data, name)
    _check_sizes(elements, encoding, len(data) - body, name)
    tables: dict[str, Table] = {}
    if encoding == "ascii":
        _read_ascii(data[body:].split(), elements, tables, name)
    else:
        _read_binary(data, body, elements, ">" if "big" in encoding else "<", tables, name)
    return _soup(tables, elements, name, warn)


def _header(data: bytes, name: str) -> tuple[str, list[Element], int]:
    """Encoding, elements and where the body starts."""
    if data[:3] != b"ply":
        raise AssetError(f"{name} is not a PLY file: it does not begin with 'ply'")
    end = data.find(b"end_header", 0, _MAX_HEADER)
    if end < 0:
        raise AssetError(f"{name}: the PLY header has no 'end_header': the file is cut off or not a PLY file")
    body = end + len(b"end_header")
    line_end = data.find(b"\n", body)
    body = len(data) if line_end < 0 else line_end + 1
    encoding = ""
    elements: list[Element] = []
    # Only the body's bytes may look odd; a header in another encoding has odd comments at most.
    for number, line in enumerate(data[:end].decode("latin-1").replace("\r", "\n").split("\n"), 1):
        words = line.split()
        try:
            if not words or words[0] in ("ply", "comment", "obj_info"):
                continue
            if words[0] == "format":
                encoding = words[1]
            elif words[0] == "element":
                elements.append(Element(words[1], int(words[2])))
            elif words[0] == "property" and words[1] == "list":
                elements[-1].properties.append(Property(words[4], _TYPES[words[3]], _TYPES[words[2]]))
            elif words[0] == "property":
                elements[-1].properties.append(Property(words[2], _TYPES[words[1]]))
            else:
                raise ValueError(words[0])
        except (IndexError, KeyError, ValueError):
            raise AssetError(f"{name}: PLY header line {number} '{line.strip()[:60]}' is not understood") from None
    if encoding not in ("ascii", "binary_little_endian", "binary_big_endian"):
        raise AssetError(f"{name}: PLY format '{encoding}' is not ascii, binary_little_endian or binary_big_endian")
    return encoding, elements, body


def _check_sizes(elements: list[Element], encoding: str, size: int, name: str) -> None:
    """Does the body hold at least what the header promises? One ASCII value takes two bytes, but for the last."""
    for element in elements:
        if element.count < 0:
            raise AssetError(f"{name}: element '{element.name}' has {element.count} rows")
        names = [p.name for p in element.properties]
        if len(set(names)) != len(names):
            raise AssetError(f"{name}: element '{element.name}' has two properties of one name")
    if encoding == "ascii":
        least = sum(element.count * 2 * len(element.properties) for element in elements) - 1
    else:
        least = sum(element.count * element.least_bytes for element in elements)
    if size < least:
        raise AssetError(f"{name} is cut off: its header promises at least {least} bytes of data, it has {size}")


def _read_ascii(words: list[bytes], elements: list[Element], tables: dict[str, Table], name: str) -> None:
    at = 0
    for element in elements:
        try:
            if any(p.count_type for p in element.properties):
                tables[element.name], at = _ascii_lists(words, at, element)
            else:
                width = len(element.properties)
                values = np.array(list(map(float, words[at : at + element.count * width])))
                at += element.count * width
                rows = values.reshape(element.count, width)
                tables[element.name] = Table({p.name: rows[:, k] for k, p in enumerate(element.properties)})
        except (ValueError, IndexError, OverflowError) as error:
            reason = str(error) if "convert" in str(error) else "it is cut off, or a value is missing"
            raise AssetError(f"{name}: element '{element.name}' cannot be read: {reason}") from None


def _ascii_lists(words: list[bytes], at: int, element: Element) -> tuple[Table, int]:
    """Rows with lists, word by word."""
    columns: dict[str, list[float]] = {p.name: [] for p in element.properties if not p.count_type}
    sizes: dict[str, list[int]] = {p.name: [] for p in element.properties if p.count_type}
    values: dict[str, list[bytes]] = {key: [] for key in sizes}
    for _ in range(element.count):
        for item in element.properties:
            if not item.count_type:
                columns[item.name].append(float(words[at]))
                at += 1
                continue
            size = int(words[at])
            if size < 0 or at + 1 + size > len(words):
                raise IndexError
            sizes[item.name].append(size)
            values[item.name].extend(words[at + 1 : at + 1 + size])
            at += 1 + size
    table = Table({key: np.array(column) for key, column in columns.items()})
    for key, size_list in sizes.items():
        table.lists[key] = (np.array(size_list, dtype=np.int64), np.array(list(map(float, values[key]))))
    return table, at


def _read_binary(
    data: bytes, at: int, elements: list[Element], endian: str, tables: dict[str, Table], name: str
) -> None:
    for element in elements:
        if any(p.count_type for p in element.properties):
            table, at = _binary_lists(data, at, element, endian, name)
        else:
            row = np.dtype([(p.name, endian + p.type) for p in element.properties])
            if at + element.count * row.itemsize > len(data):
                raise AssetError(f"{name} is cut off in element '{element.name}'")
            rows = np.frombuffer(data, dtype=row, count=element.count, offset=at)
            table = Table({p.name: rows[p.name] for p in element.properties})
            at += element.count * row.itemsize
        tables[element.name] = table


def _binary_lists(data: bytes, at: int, element: Element, endian: str, name: str) -> tuple[Table, int]:
    """Rows with lists: at once when all lists are as long as the first row's, else row by row."""
    fixed = _uniform_lists(data, at, element, endian)
    if fixed is not None:
        return fixed
    columns: dict[str, list[np.ndarray]] = {p.name: [] for p in element.properties}
    sizes: dict[str, list[int]] = {p.name: [] for p in element.properties if p.count_type}
    for _ in range(element.count):
        for item in element.properties:
            size = 1
            if item.count_type:
                size = int(_values(data, at, item.count_type, 1, endian, name)[0])
                at += np.dtype(item.count_type).itemsize
                sizes[item.name].append(size)
            values = _values(data, at, item.type, size, endian, name)
            at += values.nbytes
            columns[item.name].append(values)
    table = Table()
    for item in element.properties:
        joined = np.concatenate([np.zeros(0, endian + item.type), *columns[item.name]])
        if item.count_type:
            table.lists[item.name] = (np.array(sizes[item.name], dtype=np.int64), joined)
        else:
            table.columns[item.name] = joined
    return table, at


def _uniform_lists(data: bytes, at: int, element: Element, endian: str) -> tuple[Table, int] | None:
    """The table where every row has the first row's list lengths, else None."""
    fields: list[tuple[str, str] | tuple[str, str, tuple[int]]] = []
    place = at
    for item in element.properties:
        if item.count_type:
            count = np.frombuffer(data[place : place + 8].ljust(8, b"\0"), dtype=endian + item.count_type, count=1)
            size = int(count[0])
            if not 0 <= size <= 1024:
                return None
            fields += [(f"{item.name} count", endian + item.count_type), (item.name, endian + item.type, (size,))]
            place += count.itemsize + size * np.dtype(item.type).itemsize
        else:
            fields.append((item.name, endian + item.type))
            place += np.dtype(item.type).itemsize
    row = np.dtype(fields)
    if at + row.itemsize * element.count > len(data):
        return None
    rows = np.frombuffer(data, dtype=row, count=element.count, offset=at)
    table = Table()
    for item in element.properties:
        if item.count_type:
            sizes = rows[f"{item.name} count"].astype(np.int64)
            if len(sizes) and (sizes != sizes[0]).any():
                return None
            table.lists[item.name] = (sizes, rows[item.name].reshape(-1))
        else:
            table.columns[item.name] = rows[item.name]
    return table, at + row.itemsize * element.count


def _values(data: bytes, at: int, kind: str, count: int, endian: str, name: str) -> np.ndarray:
    if count < 0 or at + count * np.dtype(kind).itemsize > len(data):
        raise AssetError(f"{name} is cut off, or a list says it has {count} values")
    return np.frombuffer(data, dtype=endian + kind, count=count, offset=at)


def _soup(tables: dict[str, Table], elements: list[Element], name: str, warn: Callable[[str], None]) -> Soup:
    vertex = tables.get("vertex", Table()).columns
    missing = [axis for axis in "xyz" if axis not in vertex]
    if missing:
        raise AssetError(f"{name} has no vertex property {', '.join(missing)}")
    positions = _columns(vertex, ("x", "y", "z"))
    if "tristrips" in tables:
        warn("triangle strips are not supported and were left out")
    faces = tables.get("face", Table()).lists
    key = next((key for key in ("vertex_indices", "vertex_index") if key in faces), None)
    if key is None:
        raise AssetError(f"{name} has no faces, only {len(positions)} points")
    sizes, index = faces[key]
    index = index.astype(np.int64)
    outside = (index < 0) | (index >= len(positions))
    if outside.any():
        raise AssetError(f"{name}: vertex index {index[np.argmax(outside)]} is outside 0 to {len(positions) - 1}")
    corners, _ = triangulate(sizes, positions[index], warn)
    soup = simple_soup(positions, index[corners], name.rpartition(".")[0] or name)
    types = {p.name: p.type for element in elements if element.name == "vertex" for p in element.properties}
    _normals(soup, vertex)
    _uvs(soup, vertex, faces, sizes, corners, warn)
    _colors(soup, vertex, types, warn)
    return soup


def _normals(soup: Soup, vertex: dict[str, np.ndarray]) -> None:
    if all(key in vertex for key in ("nx", "ny", "nz")):
        soup.normals, soup.normal_index = _columns(vertex, ("nx", "ny", "nz")), soup.triangles


def _uvs(
    soup: Soup,
    vertex: dict[str, np.ndarray],
    faces: dict[str, tuple[np.ndarray, np.ndarray]],
    sizes: np.ndarray,
    corners: np.ndarray,
    warn: Callable[[str], None],
) -> None:
    """Texture coordinates per vertex, or per corner from a `texcoord` list of u v pairs. v runs up in the file."""
    names = next((pair for pair in _UV_NAMES if pair[0] in vertex and pair[1] in vertex), None)
    if names is not None:
        uvs, index = _columns(vertex, names), soup.triangles
    elif "texcoord" in faces and (faces["texcoord"][0] == 2 * sizes).all():
        uvs, index = faces["texcoord"][1].reshape(-1, 2).astype(np.float64), corners
    else:
        return
    soup.uvs, soup.uv_index = upward_uvs(uvs, warn), index


def _colors(soup: Soup, vertex: dict[str, np.ndarray], types: dict[str, str], warn: Callable[[str], None]) -> None:
    """sRGB colours, integers 0 to the type's largest, floats 0..1, as linear ones; alpha is linear already."""
    if not all(key in vertex for key in ("red", "green", "blue")):
        return
    colors = np.ones((len(soup.positions), 4), dtype=np.float64)
    for column, key in enumerate(("red", "green", "blue", "alpha")):
        if key in vertex:
            kind = np.dtype(types[key])
            colors[:, column] = vertex[key] / (float(np.iinfo(kind).max) if kind.kind in "iu" else 1.0)
    bad = ~np.isfinite(colors).all(axis=1)
    if bad.any():
        warn(f"{int(bad.sum())} of {len(colors)} vertex colours are not finite and are white")
        colors[bad] = 1.0
    colors = np.clip(colors, 0.0, 1.0)
    colors[:, :3] = linear_from_srgb(colors[:, :3])
    soup.colors = colors.astype(np.float32)


def _columns(columns: dict[str, np.ndarray], names: tuple[str, ...]) -> np.ndarray:
    """(n, len(names)) float64."""
    return np.column_stack([np.asarray(columns[name], dtype=np.float64) for name in names])
