"""glTF buffers, buffer views and accessors as numpy arrays; nothing is read before its range is checked."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phrt.interfaces.loader import MAX_FILE_BYTES, LoadContext
from phrt_plugins.loaders.gltf_container import check_uri, decode_data_uri, is_data_uri, read_bytes, resolve_uri
from phrt_plugins.loaders.gltf_json import Document, Element, fail

COMPONENT_DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
TYPE_SHAPES = {
    "SCALAR": (1, 1),
    "VEC2": (1, 2),
    "VEC3": (1, 3),
    "VEC4": (1, 4),
    "MAT2": (2, 2),
    "MAT3": (3, 3),
    "MAT4": (4, 4),
}
"""Columns and rows; matrices are stored column by column, each column padded to four bytes."""


class Budget:
    """Bytes a file may still make us allocate: a small one can ask for much, by counts without data."""

    def __init__(self, limit: int = MAX_FILE_BYTES) -> None:
        self.limit = limit
        self.left = limit

    def spend(self, size: int, where: str) -> None:
        """Count `size` bytes; AssetError when they are too many."""
        self.left -= size
        if self.left < 0:
            fail(where, f"needs more memory than the {self.limit // 2**20} MiB a file may unpack to")


@dataclass(frozen=True)
class View:
    """A buffer view: bytes `start` to `start + length` of a buffer; stride 0 means packed."""

    buffer: int
    start: int
    length: int
    stride: int


@dataclass(frozen=True)
class Accessor:
    """An accessor's header. `item` is the size of one element in bytes, `column` the bytes from column to column."""

    where: str
    kind: str
    dtype: np.dtype[np.generic]
    columns: int
    rows: int
    column: int
    item: int
    count: int
    normalized: bool
    view: int | None
    offset: int
    sparse: Element | None

    @property
    def components(self) -> int:
        return self.columns * self.rows


class Accessors:
    """Reads the accessors of one document. Construction checks every buffer, view and accessor, used or not."""

    def __init__(self, document: Document, binary: bytes | None, is_glb: bool, context: LoadContext) -> None:
        self.document = document
        self.budget = Budget()
        self.buffers = [
            self._buffer(i, element, binary if i == 0 else None, is_glb, context)
            for i, element in enumerate(document.lists["buffers"])
        ]
        self.views = [self._view(element) for element in document.lists["bufferViews"]]
        self._headers: dict[int, Accessor] = {}
        self._raw: dict[int, np.ndarray] = {}

    def _buffer(
        self, number: int, element: Element, binary: bytes | None, is_glb: bool, context: LoadContext
    ) -> bytes | None:
        """The data of a buffer, exactly byteLength long; None for a placeholder without data."""
        length = element.integer("byteLength", high=MAX_FILE_BYTES)
        if "uri" in element:
            uri, where = element.string("uri"), element.place("uri")
            check_uri(uri, where)
            if is_data_uri(uri):
                data = decode_data_uri(uri, where)
            else:
                data = read_bytes(resolve_uri(uri, where, context))
                self.budget.spend(len(data), where)
        elif number == 0 and is_glb:
            if binary is None and length:
                fail(element.where, "has no uri, and the GLB has no binary chunk")
            data = binary or b""
        else:
            return None
        if len(data) < length:
            fail(element.where, f"is truncated: byteLength says {length}, but there are {len(data)} bytes")
        return data

    def _view(self, element: Element) -> View:
        buffer = self.document.refer_required(element, "buffer", "buffers")
        start, length = element.integer("byteOffset", 0), element.integer("byteLength")
        size = self.document.lists["buffers"][buffer].integer("byteLength")
        if start + length > size:
            fail(element.where, f"ends at byte {start + length} of buffers[{buffer}], which has {size}")
        return View(buffer, start, length, element.integer("byteStride", 0))

    def view_bytes(self, index: int, where: str) -> memoryview:
        """The bytes of a buffer view (its stride ignored)."""
        view = self.views[index]
        data = self.buffers[view.buffer]
        if data is None:
            fail(where, f"needs buffers[{view.buffer}], which has no data")
        return memoryview(data)[view.start : view.start + view.length]

    def header(self, index: int) -> Accessor:
        """The checked header of an accessor."""
        if index not in self._headers:
            self._headers[index] = self._header(self.document.lists["accessors"][index])
        return self._headers[index]

    def _header(self, element: Element) -> Accessor:
        component, kind = element.integer("componentType"), element.string("type")
        if component not in COMPONENT_DTYPES:
            element.fail("componentType", f"is {component}; glTF has {', '.join(map(str, COMPONENT_DTYPES))}")
        if kind not in TYPE_SHAPES:
            element.fail("type", f"is '{kind}'; glTF has {', '.join(TYPE_SHAPES)}")
        dtype, (columns, rows) = np.dtype(COMPONENT_DTYPES[component]), TYPE_SHAPES[kind]
        column = rows * dtype.itemsize if columns == 1 else -(-rows * dtype.itemsize // 4) * 4
        item = column * (columns - 1) + rows * dtype.itemsize
        accessor = Accessor(
            where=element.where,
            kind=kind,
            dtype=dtype,
            columns=columns,
            rows=rows,
            column=column,
            item=item,
            count=element.integer("count"),
            normalized=element.boolean("normalized"),
            view=self.document.refer(element, "bufferView", "bufferViews"),
            offset=element.integer("byteOffset", 0),
            sparse=element.child("sparse"),
        )
        if accessor.view is not None:
            self._check_range(accessor, self.views[accessor.view])
        if accessor.sparse is not None:
            accessor.sparse.integer("count", high=accessor.count)
        return accessor

    @staticmethod
    def _check_range(accessor: Accessor, view: View) -> None:
        padded = accessor.column * accessor.columns
        stride = view.stride or padded
        if stride < accessor.item:
            fail(accessor.where, f"has elements of {accessor.item} bytes, but its buffer view a stride of {stride}")
        end = accessor.offset + (accessor.count - 1) * stride + accessor.item if accessor.count else 0
        if end > view.length:
            fail(accessor.where, f"ends at byte {end} of bufferViews[{accessor.view}], which has {view.length}")

    def check_all(self) -> None:
        """Check every accessor's header and data, so that a broken file says so whatever is drawn of it."""
        for index, element in enumerate(self.document.lists["accessors"]):
            if self._is_unknown(element) and index not in self._headers:
                self.document.warn(f"{element.where} has an unknown type and is ignored")
                continue
            accessor = self.header(index)
            if accessor.view is not None and self.buffers[self.views[accessor.view].buffer] is not None:
                self.raw(index)

    @staticmethod
    def _is_unknown(element: Element) -> bool:
        """Is an accessor of a type or component type that glTF 2.0 does not have (rather than without one)?"""
        kind, component = element.data.get("type"), element.data.get("componentType")
        return (isinstance(kind, str) and kind not in TYPE_SHAPES and component is not None) or (
            isinstance(component, int) and component not in COMPONENT_DTYPES and kind is not None
        )

    def raw(self, index: int) -> np.ndarray:
        """(count, components) in the stored type, read-only; matrices column by column. Floats are finite."""
        if index not in self._raw:
            values = self._read(self.header(index))
            values.flags.writeable = False
            self._raw[index] = values
        return self._raw[index]

    def _read(self, accessor: Accessor) -> np.ndarray:
        self.budget.spend(accessor.count * accessor.components * accessor.dtype.itemsize, accessor.where)
        if accessor.view is None:
            values = np.zeros((accessor.count, accessor.components), accessor.dtype)
        else:
            values = self._strided(accessor, accessor.view, accessor.offset, accessor.count)
        if accessor.sparse is not None:
            self._apply_sparse(accessor, accessor.sparse, values)
        if accessor.dtype.kind == "f" and not np.isfinite(values).all():
            bad = int(np.flatnonzero(~np.isfinite(values).all(axis=1))[0])
            fail(accessor.where, f"element {bad} is not a finite number")
        return values

    def _strided(self, accessor: Accessor, view: int, offset: int, count: int) -> np.ndarray:
        """A packed copy (count, components) of strided elements, ranges already checked."""
        data = self.view_bytes(view, accessor.where)
        stride = self.views[view].stride or accessor.column * accessor.columns
        strided: np.ndarray = (
            np.ndarray(
                (count, accessor.columns, accessor.rows),
                accessor.dtype,
                data,
                offset,
                (stride, accessor.column, accessor.dtype.itemsize),
            )
            if count
            else np.empty((0, accessor.columns, accessor.rows), accessor.dtype)
        )
        return np.array(strided.reshape(count, accessor.components), order="C")

    def _apply_sparse(self, accessor: Accessor, sparse: Element, values: np.ndarray) -> None:
        """Replace the elements a sparse accessor lists (glTF 2.0, section 3.6.2.3)."""
        count = sparse.integer("count", high=accessor.count)
        places, replacements = sparse.required("indices"), sparse.required("values")
        component = places.integer("componentType")
        if component not in (5121, 5123, 5125):
            places.fail("componentType", f"is {component}; indices are 5121, 5123 or 5125")
        index_type = np.dtype(COMPONENT_DTYPES[component])
        rows = self._packed(places, index_type, 1, count)[:, 0]
        if len(rows) and int(rows.max()) >= accessor.count:
            fail(places.where, f"lists element {int(rows.max())} of an accessor of {accessor.count}")
        values[rows] = self._packed(replacements, accessor.dtype, accessor.components, count)

    def _packed(self, element: Element, dtype: np.dtype[np.generic], components: int, count: int) -> np.ndarray:
        """(count, components) tightly packed elements of the view that a sparse part names."""
        view = self.document.refer_required(element, "bufferView", "bufferViews")
        start, size = element.integer("byteOffset", 0), count * components * dtype.itemsize
        data = self.view_bytes(view, element.where)
        if start + size > len(data):
            fail(element.where, f"ends at byte {start + size} of bufferViews[{view}], which has {len(data)}")
        return np.frombuffer(data[start : start + size], dtype).reshape(count, components)

    def floats(self, index: int, *, normalize: bool | None = None) -> np.ndarray:
        """(count, components) float32, a fresh array; integers normalised where it, or `normalize`, says so."""
        accessor, values = self.header(index), self.raw(index)
        self.budget.spend(values.size * 4, accessor.where)
        return to_float(values, accessor.normalized if normalize is None else normalize)


def to_float(values: np.ndarray, normalized: bool) -> np.ndarray:
    """Integers as float32; normalised ones over [0, 1] or [-1, 1] (glTF 2.0, section 3.11)."""
    result = values.astype(np.float32)
    if normalized and values.dtype.kind in "iu":
        result /= np.float32(np.iinfo(values.dtype).max)
        np.maximum(result, np.float32(-1.0), out=result)
    return result
