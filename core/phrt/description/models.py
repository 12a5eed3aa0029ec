"""Model files of a scene: read once through the registry's loaders, split or joined as their prims ask."""

from __future__ import annotations

import json
import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from phrt.description.assets import AssetRoots
from phrt.description.prims import Split
from phrt.errors import AssetError, PhrtWarning
from phrt.faults.loading import load_model
from phrt.geometry import with_normals
from phrt.interfaces.loader import LoadContext
from phrt.model import Mesh, Model
from phrt.splitting import split_mesh


class ModelStore:
    """Every model of a scene, each file read once for the same options."""

    def __init__(self, roots: AssetRoots) -> None:
        self._roots = roots
        self._models: dict[tuple[object, ...], Model] = {}
        self._pieces: dict[tuple[int, Split], list[Mesh]] = {}
        self._joined: dict[int, Mesh] = {}

    def model(self, path: Path | None, loader: str | None, options: Mapping[str, Any], beside: Path) -> Model:
        """The model in `path` (resolved), or what procedural loader `loader` makes; `beside` is the scene file.

        Raises AssetError, OptionError, PluginError or SceneError, each naming the file or the loader.
        """
        from phrt.registry.manager import get_registry

        registry = get_registry()
        name = loader if loader is not None else loader_name(path)
        if path is None and (suffixes := getattr(registry.get("loader", name), "suffixes", ())):
            raise AssetError(f"loader '{name}' reads files; give asset, ending in {' or '.join(suffixes)}")
        key = (path, name, json.dumps(dict(options), sort_keys=True, default=str))
        if key not in self._models:
            source = path if path is not None else beside
            self._models[key] = load_model(name, options, source, self._context(source))
        return self._models[key]

    def _context(self, path: Path) -> LoadContext:
        def resolve(reference: str) -> Path:
            return self._roots.find(reference, path.parent)

        def warn(message: str) -> None:
            warnings.warn(f"{path.name}: {message}", PhrtWarning, stacklevel=2)

        return LoadContext(resolve, warn)

    def pieces(self, mesh: Mesh, split: Split) -> list[Mesh]:
        """`mesh` split as asked, the same pieces for the same mesh."""
        if split.by == "none" or len(mesh.triangles) < split.min_triangles:
            return [mesh]
        key = (id(mesh), split)
        if key not in self._pieces:
            self._pieces[key] = split_mesh(mesh, split.by, cells=split.cells, size=split.size)
        return self._pieces[key]

    def joined(self, model: Model, name: str) -> Mesh:
        """All surfaces of `model` in one mesh, in the model's space."""
        if id(model) not in self._joined:
            self._joined[id(model)] = join(model, name)
        return self._joined[id(model)]


def loader_name(path: Path | None) -> str:
    """The loader for a file's suffix. Raises AssetError listing what can be read."""
    from phrt.registry.manager import get_registry

    registry = get_registry()
    suffix = path.suffix if path is not None else ""
    plugin = registry.loader_for(suffix)
    if plugin is None:
        readable = sorted({s for entry in registry.plugins("loader") for s in getattr(entry.plugin, "suffixes", ())})
        allowed = ", ".join([*readable, ".yaml", ".yml", ".json"])
        raise AssetError(f"{path}: no loader reads '{suffix}' files; read are: {allowed}")
    return plugin.name


def world_matrices(model: Model) -> list[np.ndarray]:
    """(4, 4) model_from_node of every node at rest."""
    result: list[np.ndarray] = []
    for node in model.nodes:
        result.append(result[node.parent] @ node.matrix if node.parent >= 0 else np.asarray(node.matrix, np.float64))
    return result


def join(model: Model, name: str) -> Mesh:
    """One mesh of everything in `model`, node transforms applied."""
    matrices = world_matrices(model)
    placed = [
        transformed(model.meshes[index], matrix)
        for node, matrix in zip(model.nodes, matrices, strict=True)
        for index in node.meshes
    ]
    if not placed:
        return Mesh(name, np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), np.zeros(0, np.int32))
    if any(mesh.normals is None for mesh in placed) and any(mesh.normals is not None for mesh in placed):
        placed = [with_normals(mesh) for mesh in placed]
    first = np.cumsum([0, *(len(mesh.positions) for mesh in placed)])
    columns = {"normals": 3, "tangents": 4, "uv0": 2, "uv1": 2, "colors": 4}
    joined: dict[str, np.ndarray] = {}
    for key, width in columns.items():
        if any(getattr(mesh, key) is not None for mesh in placed):
            fill = 1.0 if key == "colors" else 0.0
            parts = [_or_filled(getattr(mesh, key), (len(mesh.positions), width), fill) for mesh in placed]
            joined[key] = np.concatenate(parts)
    return Mesh(
        name=name,
        positions=np.concatenate([mesh.positions for mesh in placed]),
        triangles=np.concatenate([mesh.triangles + first[k] for k, mesh in enumerate(placed)]).astype(np.int32),
        triangle_material=np.concatenate([mesh.triangle_material for mesh in placed]),
        smooth=all(mesh.smooth for mesh in placed),
        **joined,
    )


def _or_filled(values: np.ndarray | None, shape: tuple[int, int], fill: float) -> np.ndarray:
    return np.full(shape, fill, np.float32) if values is None else values


def transformed(mesh: Mesh, matrix: np.ndarray) -> Mesh:
    """`mesh` moved by `matrix` (4, 4); a mirroring one turns the triangles, so that fronts stay fronts."""
    if np.array_equal(matrix, np.eye(4)):
        return mesh
    linear = matrix[:3, :3]
    mirrored = np.linalg.det(linear) < 0
    changes: dict[str, Any] = {"positions": (mesh.positions @ linear.T + matrix[:3, 3]).astype(np.float32)}
    if mesh.normals is not None:
        cofactor = np.stack(
            [np.cross(linear[1], linear[2]), np.cross(linear[2], linear[0]), np.cross(linear[0], linear[1])]
        )
        changes["normals"] = _unit(mesh.normals @ cofactor.T * (-1 if mirrored else 1))
    if mesh.tangents is not None:
        hand = mesh.tangents[:, 3:] * (-1 if mirrored else 1)
        changes["tangents"] = np.concatenate([_unit(mesh.tangents[:, :3] @ linear.T), hand], axis=1).astype(np.float32)
    if mirrored:
        changes["triangles"] = np.ascontiguousarray(mesh.triangles[:, [0, 2, 1]])
    return replace(mesh, **changes)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return (vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-20)).astype(np.float32)
