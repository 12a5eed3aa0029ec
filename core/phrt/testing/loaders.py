"""check_loader: the rules of `phrt.interfaces.loader.Loader`, on files that are good and on the same files broken."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from phrt.errors import AssetError, InputError
from phrt.interfaces.loader import LoadContext, Loader
from phrt.model import Image, Material, Mesh, Model, Node, TextureRef
from phrt.registry.manager import describe
from phrt.testing.contract import BROKEN_BY_THE_PLUGIN, BrokenContract, Contract, Given, Maker

__tracebackhide__ = BROKEN_BY_THE_PLUGIN

UNIT = 1e-3
"""How far from 1 the length of a normal may be."""
BREAKS = 12
"""In how many ways every file is broken, at least."""


def check_loader(
    loader: Given,
    files: Sequence[str | PathLike[str]] = (),
    options: Mapping[str, object] | BaseModel | None = None,
) -> None:
    """Put a loader through its contract. Raises BrokenContract naming the rule and the case.

    loader: the name of a registered one, a descriptor, or a class that takes `options`
    files : small files that it can read; none for a procedural one

    What is a model is looked at all over: shapes, dtypes, numbers, and every index. Then each file is cut off and changed here and
    there: such a file gives a model, or an AssetError, and nothing else.
    """
    make = Maker("loader", loader, options)
    contract = make.contract
    contract.holds(isinstance(make(), Loader), "it is a phrt.interfaces.loader.Loader")
    for file in map(Path, files) if files else [Path("scene.yaml")]:
        before = file.read_bytes() if file.is_file() else b""
        load = partial(_loaded, make, file)
        model = contract.call("load()", load, file.name)
        contract.holds(isinstance(model, Model), f"it returns a phrt.model.Model, not {model!r:.80}", file.name)
        check_model(contract, model, file.name)
        again = contract.call("load()", load, file.name)
        contract.holds(same(model, again), "the same file gives the same model", file.name)
        if file.is_file():
            contract.holds(file.read_bytes() == before, "a file is not written to", file.name)
            _check_broken_files(contract, make, file)


def _loaded(make: Maker, file: Path) -> Any:
    """What a new loader makes of `file`."""
    return make().load(file, context_of(file))


def context_of(file: Path) -> LoadContext:
    """For `file`: references are looked for beside it, warnings go nowhere."""
    folder = file.absolute().parent

    def resolve(reference: str) -> Path:
        found = folder / reference
        if Path(reference).is_absolute() or ".." in Path(reference).parts or not found.is_file():
            raise AssetError(f"{file.name}: '{reference}' is not there")
        return found

    return LoadContext(resolve, lambda message: None)


# What a model is


def check_model(contract: Contract, model: Model, case: str) -> None:
    """Raises BrokenContract where `model` is not what phrt.model says."""
    for number, node in enumerate(model.nodes):
        _check_node(contract, model, node, number, case)
    for mesh in model.meshes:
        _check_mesh(contract, mesh, len(model.materials), f"{case}, mesh '{mesh.name}'")
    for material in model.materials:
        _check_material(contract, material, len(model.images), f"{case}, material '{material.name}'")
    for image in model.images:
        _check_image(contract, image, f"{case}, image '{image.name}'")
    for track in model.tracks:
        contract.holds(0 <= track.node < len(model.nodes), "a track moves a node that is there", case)
        contract.holds(len(track.times) == len(track.values), "a track has a value for every time", case)
        contract.holds(np.all(np.diff(track.times) > 0), "times of a track rise", case)


def _check_node(contract: Contract, model: Model, node: Node, number: int, case: str) -> None:
    case = f"{case}, node '{node.name}'"
    contract.holds(-1 <= node.parent < number, "parents come before their children", case)
    matrix = np.asarray(node.matrix)
    contract.holds(matrix.shape == (4, 4) and np.isfinite(matrix).all(), "a matrix is 4 x 4 finite numbers", case)
    contract.holds(all(0 <= mesh < len(model.meshes) for mesh in node.meshes), "a node's meshes are there", case)
    for what, index, held in (("light", node.light, model.lights), ("camera", node.camera, model.cameras)):
        contract.holds(index is None or 0 <= index < len(held), f"a node's {what} is there", case)


def _check_mesh(contract: Contract, mesh: Mesh, materials: int, case: str) -> None:
    vertices, faces = len(mesh.positions), len(mesh.triangles)
    expected: dict[str, tuple[tuple[int, ...], type]] = {
        "positions": ((vertices, 3), np.float32),
        "triangles": ((faces, 3), np.int32),
        "triangle_material": ((faces,), np.int32),
    }
    optional = {"normals": 3, "tangents": 4, "uv0": 2, "uv1": 2, "colors": 4}
    expected |= {n: ((vertices, k), np.float32) for n, k in optional.items() if getattr(mesh, n) is not None}
    for name, (shape, kind) in expected.items():
        array = getattr(mesh, name)
        given = f"{array.dtype}{array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
        fits = isinstance(array, np.ndarray) and array.shape == shape and array.dtype == kind
        contract.holds(fits, f"{name} are {np.dtype(kind)}{shape}, not {given}", case)
        contract.holds(np.isfinite(array).all(), f"{name} are finite", case)
    if faces:
        contract.holds(0 <= mesh.triangles.min() <= mesh.triangles.max() < vertices, "triangles name vertices", case)
        rows = mesh.triangle_material
        contract.holds(
            -1 <= rows.min() <= rows.max() < materials, "triangles have a material that is there, or -1", case
        )
    if mesh.normals is not None and vertices:
        lengths = np.linalg.norm(mesh.normals, axis=1)
        contract.holds(np.abs(lengths - 1).max() < UNIT, "normals have unit length", case)


def _check_material(contract: Contract, material: Material, images: int, case: str) -> None:
    for name, value in vars(material).items():
        if isinstance(value, TextureRef):
            contract.holds(0 <= value.image < images, f"{name} names an image that is there", case)
        elif isinstance(value, (int, float, tuple)) and name != "attenuation_distance":
            contract.holds(np.isfinite(value).all(), f"{name} is finite", case)


def _check_image(contract: Contract, image: Image, case: str) -> None:
    pixels = image.pixels
    fits = pixels.ndim == 3 and pixels.shape[2] == 4 and pixels.dtype == np.uint8 and min(pixels.shape[:2]) > 0
    contract.holds(fits, f"pixels are uint8(H, W, 4), not {pixels.dtype}{pixels.shape}", case)


def same(one: Any, other: Any) -> bool:
    """Are two models, or parts of them, equal?"""
    if isinstance(one, np.ndarray):
        return isinstance(other, np.ndarray) and one.dtype == other.dtype and np.array_equal(one, other, equal_nan=True)
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(same, one, other))
    if hasattr(one, "__dataclass_fields__"):
        return type(one) is type(other) and all(same(vars(one)[name], vars(other)[name]) for name in vars(one))
    return bool(one == other)


# Broken files


def _check_broken_files(contract: Contract, make: Maker, file: Path) -> None:
    with tempfile.TemporaryDirectory(prefix="phrt-loader-") as scratch:
        broken = Path(scratch) / file.name
        for what, content in broken_versions(file.read_bytes()):
            broken.write_bytes(content)
            case = f"{file.name}, {what}"
            try:
                model = make().load(broken, context_of(file))
            except InputError:
                continue
            except Exception as error:
                rule = f"a broken file is an AssetError, or gives a model, but load() raised {describe(error)}"
                raise BrokenContract(contract.message(rule, case)) from error
            contract.holds(isinstance(model, Model), f"a broken file gives a Model, not {model!r:.80}", case)
            check_model(contract, model, case)


def broken_versions(content: bytes) -> Iterator[tuple[str, bytes]]:
    """`content`, broken in many ways, each with what was done to it; always in the same ways."""
    yield "empty", b""
    random = np.random.default_rng(4)
    for share in np.linspace(0.1, 0.9, BREAKS // 2):
        yield f"cut off after {share:.0%}", content[: int(len(content) * share)]
    for number in range(BREAKS // 2):
        changed = np.frombuffer(content, np.uint8).copy()
        where = random.integers(0, max(len(changed), 1), max(len(changed) // 200, 1))
        if len(changed):
            changed[where] = random.integers(0, 256, len(where))
        yield f"{len(where)} bytes changed, number {number}", changed.tobytes()
