"""Loader of OBJ (with MTL), PLY and STL files.

One object per OBJ `o` (or `g` where there is no `o`), per STL `solid`, else one for the file; polygons
become triangles, `v` of texture coordinates is turned to run down, vertex colours become linear. What is not read:
docs/loaders/mesh.md.

Options: `phrt_plugins.loaders.options.MeshOptions`. Example, in a scene descriptor:

    /statue: {type: Reference, asset: armadillo_100k.obj, crease_angle: 60}

Nothing but the file itself and what `LoadContext.resolve` allows is opened; all parsers work on bytes in memory.
"""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np

from phrt.errors import AssetError
from phrt.interfaces.loader import MAX_FILE_BYTES, LoadContext, Loader
from phrt.model import Material, Model, Node
from phrt_plugins.loaders.mesh_mtl import DEFAULT_MATERIAL, MaterialLibrary
from phrt_plugins.loaders.mesh_obj import ObjFile, read_obj
from phrt_plugins.loaders.mesh_ply import read_ply
from phrt_plugins.loaders.mesh_soup import Soup, build_meshes, check
from phrt_plugins.loaders.mesh_stl import read_stl
from phrt_plugins.loaders.options import MeshOptions

SUFFIXES = (".obj", ".ply", ".stl")


class MeshLoader(Loader):
    """Reads one OBJ, PLY or STL file, told apart by suffix."""

    def __init__(self, options: MeshOptions) -> None:
        self.options = options

    def load(self, path: Path, context: LoadContext) -> Model:
        """The model in `path`; every mesh has normals. Raises AssetError, naming the file and what is wrong."""
        # Values that are not finite meet arithmetic before `check` refuses them.
        with np.errstate(all="ignore"):
            soup, model = self._read(path, context)
        model.meshes = build_meshes(soup, self.options, context.warn)
        model.nodes = [Node(mesh.name, meshes=[index]) for index, mesh in enumerate(model.meshes)]
        return model

    def _read(self, path: Path, context: LoadContext) -> tuple[Soup, Model]:
        """The checked triangles of `path`, and a model with the materials they count in."""
        name, suffix, data = path.name, path.suffix.lower(), read_file(path)
        if suffix == ".obj":
            obj = read_obj(data, name, self.options, context.warn)
            obj.soup = check(obj.soup, name, context.warn)
            return obj.soup, _with_materials(obj, context, self.options)
        if suffix == ".ply":
            soup = read_ply(data, name, context.warn)
        else:
            soup = read_stl(data, name, self.options.weld, context.warn)
        soup = check(soup, name, context.warn)
        soup.material[:] = 0
        return soup, Model(materials=[_default_material()])


def read_file(path: Path) -> bytes:
    """The bytes of `path`. Raises AssetError for a suffix, size or file that cannot be read."""
    if path.suffix.lower() not in SUFFIXES:
        raise AssetError(f"{path.name}: '{path.suffix}' is not one of {', '.join(SUFFIXES)}")
    try:
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise AssetError(f"{path.name} has {size} bytes, more than the {MAX_FILE_BYTES} that are read")
        if size == 0:
            raise AssetError(f"{path.name} is empty")
        return path.read_bytes()
    except OSError as error:
        raise AssetError(f"{path.name} cannot be read: {error.strerror or error}") from error


def _with_materials(obj: ObjFile, context: LoadContext, options: MeshOptions) -> Model:
    """A model with the materials and images that `obj`'s triangles use; renumbers `Soup.material` to them."""
    library = MaterialLibrary(context, options.max_texture_size)
    for statement in obj.libraries:
        library.add_files(statement)
    used = np.unique(obj.soup.material)
    materials: list[Material] = []
    renumbered = np.zeros(len(obj.material_names) + 1, dtype=np.int32)
    default = -1
    unknown: list[str] = []
    for old in used:
        entry = library.entries.get(obj.material_names[old]) if old >= 0 else None
        if entry is not None:
            renumbered[old + 1] = len(materials)
            materials.append(library.material(entry))
            continue
        if old >= 0:
            unknown.append(obj.material_names[old])
        if default < 0:
            default = len(materials)
            materials.append(_default_material())
        renumbered[old + 1] = default
    if unknown and library.entries:
        context.warn(
            f"{len(unknown)} materials are in no material library and are plain grey, the first is '{unknown[0]}'"
        )
    elif unknown:
        context.warn(f"no material library was found; {len(unknown)} materials are plain grey")
    obj.soup.material = renumbered[obj.soup.material + 1]
    return Model(materials=materials, images=library.images)


def _default_material() -> Material:
    return copy.copy(DEFAULT_MATERIAL)
