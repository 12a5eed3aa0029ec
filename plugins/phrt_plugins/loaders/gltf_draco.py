"""KHR_draco_mesh_compression through DracoPy, which is an extra: `pip install phrt[draco]`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phrt.errors import AssetError
from phrt_plugins.loaders.gltf_accessors import Accessors, to_float
from phrt_plugins.loaders.gltf_json import Document, Element, fail

EXTENSION = "KHR_draco_mesh_compression"


@dataclass(frozen=True)
class DracoPrimitive:
    """A decoded primitive: triangles (T, 3) int64, and per attribute name (V, components) in the stored type."""

    triangles: np.ndarray
    attributes: dict[str, np.ndarray]


def decode_draco(document: Document, accessors: Accessors, primitive: Element, draco: Element) -> DracoPrimitive | None:
    """Decode a primitive; None when DracoPy is absent and the file also carries the primitive uncompressed."""
    try:
        import DracoPy
    except ImportError:
        position = document.refer_required(primitive.required("attributes"), "POSITION", "accessors")
        if accessors.header(position).view is not None:
            document.warn("is also compressed with Draco, which needs DracoPy; its uncompressed copy is used")
            return None
        raise AssetError("is compressed with Draco; to read it: pip install phrt[draco]") from None
    expected = primitive_counts(document, accessors, primitive)
    view = document.refer_required(draco, "bufferView", "bufferViews")
    data = bytes(accessors.view_bytes(view, draco.where))
    try:
        mesh = DracoPy.decode(data)
        faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
        by_id = {int(entry["unique_id"]): np.asarray(entry["data"]) for entry in mesh.attributes}
    except Exception as error:  # a native decoder on untrusted data: whatever it raises means "unreadable"
        fail(draco.where, f"cannot be decoded: {error}")
    names = draco.required("attributes")
    attributes = {}
    for name in names.data:
        number = names.integer(name)
        if number not in by_id:
            fail(names.place(name), f"is Draco attribute {number}, which the data does not have")
        values = by_id[number]
        if values.ndim != 2 or len(values) != expected:
            fail(names.place(name), f"decodes to {len(values)} elements, but the accessor has {expected}")
        accessors.budget.spend(values.nbytes, draco.where)
        attributes[name] = values
    return DracoPrimitive(faces, attributes)


def primitive_counts(document: Document, accessors: Accessors, primitive: Element) -> int:
    """The vertex count a primitive's POSITION accessor announces, counted against the memory budget before decoding."""
    index = document.refer_required(primitive.required("attributes"), "POSITION", "accessors")
    count = accessors.header(index).count
    accessors.budget.spend(count * 32, primitive.where)
    return count


def draco_floats(values: np.ndarray, normalized: bool, where: str) -> np.ndarray:
    """Decoded values as float32; AssetError for NaN and infinities."""
    result = to_float(values, normalized)
    if not np.isfinite(result).all():
        fail(where, "has an element that is not a finite number")
    return result
