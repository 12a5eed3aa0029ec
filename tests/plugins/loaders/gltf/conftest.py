"""A small glTF writer and a loader call for the tests of the glTF loader."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from phrt.errors import AssetError
from phrt.interfaces.loader import LoadContext
from phrt.model import Model
from phrt_plugins.loaders.gltf import GltfLoader
from phrt_plugins.loaders.options import GltfOptions

COMPONENTS = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


def context_beside(path: Path, warnings: list[str]) -> LoadContext:
    """A context whose only asset root is the file's own folder."""
    root = path.parent.resolve()

    def resolve(reference: str) -> Path:
        target = (root / reference).resolve()
        if not target.is_relative_to(root):
            raise AssetError(f"'{reference}' leaves the asset roots")
        if not target.is_file():
            raise AssetError(f"'{reference}' does not exist")
        return target

    return LoadContext(resolve, warnings.append)


@pytest.fixture
def load() -> Callable[..., tuple[Model, list[str]]]:
    """load(path, **options) -> the model and the warnings."""

    def call(path: Path, **options: Any) -> tuple[Model, list[str]]:
        warnings: list[str] = []
        return GltfLoader(GltfOptions(**options)).load(path, context_beside(path, warnings)), warnings

    return call


class Builder:
    """A glTF under construction. `json` is the document; `accessor` and `view` append data to its only buffer."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.data = b""
        self.json: dict[str, Any] = {"asset": {"version": "2.0"}}

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        self.json.setdefault(kind, []).append(entry)
        return len(self.json[kind]) - 1

    def view(self, data: bytes, **extra: Any) -> int:
        self.data += b"\0" * (-len(self.data) % 4)
        start = len(self.data)
        self.data += data
        return self.add("bufferViews", {"buffer": 0, "byteOffset": start, "byteLength": len(data), **extra})

    def accessor(self, values: Any, dtype: str = "float32", **extra: Any) -> int:
        array = np.asarray(values, dtype)
        width = 1 if array.ndim == 1 else int(np.prod(array.shape[1:]))
        entry = {"bufferView": self.view(array.tobytes()), "componentType": COMPONENTS[dtype], "count": len(array)}
        return self.add("accessors", {**entry, "type": TYPES[width], **extra})

    def image(self, pixels: Any = None, **extra: Any) -> int:
        """An embedded PNG, by default one grey pixel, with a texture; returns the texture."""
        import io

        from PIL import Image

        stream = io.BytesIO()
        Image.fromarray(np.full((1, 1, 3), 128, np.uint8) if pixels is None else pixels).save(stream, "PNG")
        source = self.add("images", {"bufferView": self.view(stream.getvalue()), "mimeType": "image/png"})
        return self.add("textures", {"source": source, **extra})

    def draw(self, *primitives: dict[str, Any], node: dict[str, Any] | None = None, **mesh: Any) -> int:
        """A mesh of `primitives` on a node of the scene; returns the node."""
        number = self.add("meshes", {"primitives": list(primitives), **mesh})
        return self.place({"mesh": number, **(node or {})})

    def place(self, node: dict[str, Any]) -> int:
        """A root node."""
        number = self.add("nodes", node)
        scenes = self.json.setdefault("scenes", [{"nodes": []}])
        scenes[0]["nodes"].append(number)
        return number

    def quad(self, **attributes: int) -> dict[str, Any]:
        """A primitive: the unit square in z = 0, facing +Z, counter-clockwise."""
        positions = self.accessor([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
        indices = self.accessor([0, 1, 2, 0, 2, 3], "uint16")
        return {"attributes": {"POSITION": positions, **attributes}, "indices": indices}

    def write(self, name: str = "made.gltf") -> Path:
        path = self.folder / name
        if self.data and path.suffix == ".gltf":
            uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
            self.json["buffers"] = [{"byteLength": len(self.data), "uri": uri}]
        elif self.data:
            self.json["buffers"] = [{"byteLength": len(self.data)}]
        text = json.dumps(self.json).encode()
        path.write_bytes(text if path.suffix == ".gltf" else glb(text, self.data))
        return path


def glb(text: bytes, binary: bytes | None = None) -> bytes:
    """A GLB of a JSON chunk and, where given, a binary chunk."""
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    if binary is not None:
        binary += b"\0" * (-len(binary) % 4)
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


@pytest.fixture
def build(tmp_path: Path) -> Builder:
    return Builder(tmp_path)
