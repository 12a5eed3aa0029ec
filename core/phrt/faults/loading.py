"""Models by loaders, whoever wrote them: what one raises names it and the file, and what it returns is checked."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from phrt.errors import PhrtError, SceneError
from phrt.faults.fault import CAUGHT, Nonsense, fault_of, raised
from phrt.faults.making import make
from phrt.interfaces.loader import LoadContext, Loader
from phrt.model import CameraLens, Image, Light, Material, Mesh, Model, Node, TextureRef, Track

VERTEX_ARRAYS = {"positions": 3, "normals": 3, "tangents": 4, "uv0": 2, "uv1": 2, "colors": 4}
"""Arrays of a mesh with a row a vertex: their columns."""


def load_model(name: str, options: Mapping[str, object], path: Path, context: LoadContext) -> Model:
    """What loader `name` makes of `path`. Raises what making and loading raise on purpose, and SceneError naming the file, the
    loader and the cause for everything else."""
    loader: Loader = make("loader", name, options)
    try:
        model = loader.load(path, context)
        check_model(model)
    except (PhrtError, MemoryError):
        raise
    except CAUGHT as error:
        fault = fault_of("loader", loader, raised("load()", error))
        raise SceneError(f"{path}: {fault}") from error
    return model


def check_model(model: Model) -> None:
    """Raises Nonsense unless `model` is what `phrt.model` says: shapes, dtypes, indices, and finite numbers."""
    _need(isinstance(model, Model), type(model).__name__, "a phrt.model.Model")
    for name, kind in KINDS.items():
        for number, each in enumerate(getattr(model, name)):
            _need(isinstance(each, kind), f"{name}[{number}] as {type(each).__name__}", f"a phrt.model.{kind.__name__}")
    for number, image in enumerate(model.images):
        _image(f"images[{number}]", image)
    for number, material in enumerate(model.materials):
        _material(f"materials[{number}]", material, len(model.images))
    for number, mesh in enumerate(model.meshes):
        _mesh(f"meshes[{number}] '{mesh.name}'", mesh, len(model.materials))
    for number, light in enumerate(model.lights):
        _numbers(f"lights[{number}]", light)
    for number, lens in enumerate(model.cameras):
        _numbers(f"cameras[{number}]", lens)
    for number, node in enumerate(model.nodes):
        _node(f"nodes[{number}] '{node.name}'", number, node, model)
    for number, track in enumerate(model.tracks):
        _track(f"tracks[{number}]", track, len(model.nodes))


KINDS: dict[str, type] = {
    "nodes": Node, "meshes": Mesh, "materials": Material, "images": Image, "lights": Light, "cameras": CameraLens,
    "tracks": Track,
}  # fmt: skip
"""What the lists of a model hold."""


def _need(condition: object, given: str, wanted: str) -> None:
    if not condition:
        raise Nonsense(given, wanted)


def _array(title: str, array: object, shape: tuple[int | None, ...], dtype: type[np.generic]) -> np.ndarray:
    """`array`, when it has this dtype and shape; None stands for any number."""
    rows = ", ".join("n" if size is None else str(size) for size in shape)
    wanted = f"{np.dtype(dtype)}({rows})"
    if not isinstance(array, np.ndarray):
        raise Nonsense(f"{title} as {type(array).__name__}", wanted)
    fits = array.ndim == len(shape) and all(size in (None, n) for size, n in zip(shape, array.shape, strict=True))
    _need(fits and array.dtype == dtype, f"{title} as {array.dtype}{array.shape}", wanted)
    return array


def _finite(title: str, array: np.ndarray) -> None:
    _need(np.isfinite(array).all(), f"{title} with NaN or infinity in it", "finite numbers")


def _within(title: str, array: np.ndarray, low: int, count: int) -> None:
    if len(array):
        least, largest = int(array.min()), int(array.max())
        wrong = least if least < low else largest
        _need(low <= least and largest < count, f"{title} with {wrong} in it", f"{low} to {count - 1}")


def _image(title: str, image: Image) -> None:
    pixels = _array(f"{title}.pixels", image.pixels, (None, None, 4), np.uint8)
    _need(pixels.size, f"{title} without a pixel", "one at least")


def _material(title: str, material: Material, images: int) -> None:
    _numbers(title, material)
    for field in dataclasses.fields(material):
        texture = getattr(material, field.name)
        if isinstance(texture, TextureRef):
            _need(0 <= texture.image < images, f"{title}.{field.name}.image {texture.image}", f"one of {images} images")


def _mesh(title: str, mesh: Mesh, materials: int) -> None:
    count = len(_array(f"{title}.positions", mesh.positions, (None, 3), np.float32))
    for name, columns in VERTEX_ARRAYS.items():
        values = getattr(mesh, name)
        if values is not None:
            _finite(f"{title}.{name}", _array(f"{title}.{name}", values, (count, columns), np.float32))
    triangles = _array(f"{title}.triangles", mesh.triangles, (None, 3), np.int32)
    _within(f"{title}.triangles", triangles.reshape(-1), 0, count)
    rows = _array(f"{title}.triangle_material", mesh.triangle_material, (len(triangles),), np.int32)
    _within(f"{title}.triangle_material", rows, -1, materials)


def _node(title: str, number: int, node: Node, model: Model) -> None:
    _need(-1 <= node.parent < number, f"{title} with parent {node.parent}", "one of the nodes before it, or -1")
    matrix = np.asarray(node.matrix, np.float64)
    _need(matrix.shape == (4, 4), f"{title}.matrix of shape {matrix.shape}", "(4, 4)")
    _finite(f"{title}.matrix", matrix)
    for name, given, count in (
        ("mesh", node.meshes, len(model.meshes)),
        ("light", [] if node.light is None else [node.light], len(model.lights)),
        ("camera", [] if node.camera is None else [node.camera], len(model.cameras)),
    ):
        for index in given:
            _need(0 <= index < count, f"{title} with {name} {index}", f"0 to {count - 1}")


def _track(title: str, track: Track, nodes: int) -> None:
    _need(0 <= track.node < nodes, f"{title} of node {track.node}", f"0 to {nodes - 1}")
    times, values = np.asarray(track.times), np.asarray(track.values)
    columns = 4 if track.target == "rotation" else 3
    cubic = (3,) if track.interpolation == "cubic" else ()
    shape = (len(times), *cubic, columns)
    _need(times.ndim == 1 and len(times), f"{title}.times of shape {times.shape}", "(n,), one at least")
    _need(values.shape == shape, f"{title}.values of shape {values.shape}", str(shape))
    _finite(f"{title}.times", times)
    _finite(f"{title}.values", values)
    _need((np.diff(times) >= 0).all(), f"{title}.times that go back", "times in order")


def _numbers(title: str, record: Any) -> None:
    """No number of a dataclass is NaN, also within tuples."""
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        for each in value if isinstance(value, tuple) else (value,):
            _need(not (isinstance(each, float) and math.isnan(each)), f"{title}.{field.name} {value}", "numbers")
