"""The node hierarchy of one glTF scene: transforms, instances, and what hangs on the nodes."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from phrt.errors import AssetError, did_you_mean
from phrt.model import Node
from phrt_plugins.loaders.gltf_accessors import Accessors
from phrt_plugins.loaders.gltf_json import MAX_ENTRIES, Document, Element, fail
from phrt_plugins.loaders.gltf_meshes import MeshLibrary
from phrt_plugins.loaders.gltf_skins import Skins

INSTANCING = "EXT_mesh_gpu_instancing"
TRS = ("translation", "rotation", "scale")
MAX_WORLD = 1e18


@dataclass
class Hierarchy:
    """All nodes, checked: parents (-1: root), children, local matrices (N, 4, 4), and an order with parents first."""

    parent: list[int]
    children: list[list[int]]
    local: np.ndarray
    order: list[int] = field(default_factory=list)

    def world(self) -> np.ndarray:
        """(N, 4, 4) world matrices at rest. AssetError where they are beyond float32."""
        world = self.local.copy()
        with np.errstate(all="ignore"):
            for node in self.order:
                if self.parent[node] >= 0:
                    world[node] = world[self.parent[node]] @ self.local[node]
            lost = np.flatnonzero(~(np.abs(world) < MAX_WORLD).all(axis=(1, 2)))
        if len(lost):
            fail(f"nodes[{lost[0]}]", "is placed or scaled beyond what can be drawn")
        return world


def read_hierarchy(document: Document) -> Hierarchy:
    """Every node's place in the hierarchy. Raises AssetError for a node with two parents, and for cycles."""
    elements = document.lists["nodes"]
    children = [document.refer_all(element, "children", "nodes") for element in elements]
    parent = [-1] * len(elements)
    for node, listed in enumerate(children):
        for child in listed:
            if parent[child] >= 0:
                fail(f"nodes[{child}]", f"is a child of both nodes[{parent[child]}] and nodes[{node}]")
            parent[child] = node
    hierarchy = Hierarchy(parent, children, local_matrices(document, elements))
    pending = [node for node in reversed(range(len(elements))) if parent[node] < 0]
    while pending:
        node = pending.pop()
        hierarchy.order.append(node)
        pending.extend(reversed(children[node]))
    # With one parent each, nodes no root leads to are in cycles.
    if len(hierarchy.order) < len(elements):
        lost = next(iter(sorted(set(range(len(elements))) - set(hierarchy.order))))
        fail(f"nodes[{lost}]", "is its own ancestor; nodes must not form cycles")
    return hierarchy


def local_matrices(document: Document, elements: list[Element]) -> np.ndarray:
    """(N, 4, 4) float64 local transforms of nodes, from their matrices or their translations, rotations and scales."""
    local = np.tile(np.eye(4), (len(elements), 1, 1))
    moved = [i for i, element in enumerate(elements) if not element.data.keys().isdisjoint(TRS)]
    if moved:
        translation, rotation, scale = zip(*(read_trs(document, elements[i]) for i in moved), strict=True)
        local[moved] = trs_matrices(np.array(translation), np.array(rotation), np.array(scale))
    for i, element in enumerate(elements):
        if "matrix" in element:
            local[i] = read_matrix(document, element)
    return local


def read_matrix(document: Document, element: Element) -> np.ndarray:
    """(4, 4) float64 matrix of a node, affine."""
    matrix = np.array(element.numbers("matrix", 16)).reshape(4, 4).T
    if not np.array_equal(matrix[3], (0.0, 0.0, 0.0, 1.0)):
        document.warn(f"{element.where}.matrix is a projection; its last row is read as 0 0 0 1")
        matrix[3] = (0.0, 0.0, 0.0, 1.0)
    return matrix


def read_trs(document: Document, element: Element) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """Translation, rotation (a quaternion x y z w of any length but 0) and scale of a node."""
    rotation = element.numbers("rotation", 4, (0.0, 0.0, 0.0, 1.0))
    if math.hypot(*rotation) < 1e-12:
        document.warn(f"{element.where}.rotation is zero and is left out")
        rotation = (0.0, 0.0, 0.0, 1.0)
    return element.numbers("translation", 3, (0.0, 0.0, 0.0)), rotation, element.numbers("scale", 3, (1.0, 1.0, 1.0))


def trs_matrices(translation: np.ndarray, rotation: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """(n, 4, 4) translation (n, 3) times rotation (n, 4), quaternions x y z w of any length, times scale (n, 3)."""
    x, y, z, w = (rotation / np.linalg.norm(rotation, axis=1, keepdims=True)).T
    matrix = np.tile(np.eye(4), (len(rotation), 1, 1))
    matrix[:, 0, :3] = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=1)
    matrix[:, 1, :3] = np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=1)
    matrix[:, 2, :3] = np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=1)
    matrix[:, :3, :3] *= scale[:, None, :]
    matrix[:, :3, 3] = translation
    return matrix


def scene_roots(document: Document, hierarchy: Hierarchy, wanted: int | str | None) -> list[int]:
    """The root nodes of the scene asked for: by index, by name, or the file's default."""
    scenes = document.lists["scenes"]
    if wanted is not None:
        return document.refer_all(scenes[pick(scenes, wanted, "scene")], "nodes", "nodes")
    default = document.refer(document.root, "scene", "scenes")
    if default is None and not scenes:
        roots = [node for node, parent in enumerate(hierarchy.parent) if parent < 0]
        document.warn("has no scene; all of its nodes are drawn" if roots else "has neither scenes nor nodes")
        return roots
    return document.refer_all(scenes[default or 0], "nodes", "nodes")


def pick(elements: list[Element], wanted: int | str, what: str) -> int:
    """The index of the element asked for by index or name. Raises AssetError naming those there are."""
    names = [element.string("name", "") for element in elements]
    if isinstance(wanted, str) and wanted in names:
        return names.index(wanted)
    if isinstance(wanted, int) and 0 <= wanted < len(elements):
        return wanted
    listed = ", ".join(f"{i} '{name}'" if name else str(i) for i, name in enumerate(names[:20])) or "none"
    hint = did_you_mean(wanted, [name for name in names if name]) if isinstance(wanted, str) else ""
    raise AssetError(f"has no {what} {wanted!r}; it has {len(elements)}: {listed}.{hint}")


class NodeBuilder:
    """Makes the nodes of one scene. `model_node` maps a glTF node to its place in `nodes`; `skin_joints` are the glTF
    nodes that place skinned meshes."""

    def __init__(
        self, document: Document, accessors: Accessors, hierarchy: Hierarchy, library: MeshLibrary, skins: Skins
    ) -> None:
        self.document = document
        self.accessors = accessors
        self.hierarchy = hierarchy
        self.library = library
        self.skins = skins
        self.nodes: list[Node] = []
        self.model_node: dict[int, int] = {}
        self.skin_joints: set[int] = set()

    def build(self, roots: list[int]) -> None:
        """All nodes below `roots`, parents first; skinned meshes get root nodes of their own at the end."""
        skinned: list[Node] = []
        pending = [(node, -1) for node in reversed(roots)]
        while pending:
            node, parent = pending.pop()
            if node in self.model_node:
                fail(f"nodes[{node}]", "is listed twice in the scene")
            number = len(self.nodes)
            self.model_node[node] = number
            skinned += self._add(self.document.lists["nodes"][node], node, parent)
            pending.extend((child, number) for child in reversed(self.hierarchy.children[node]))
        self.nodes += skinned

    def _add(self, element: Element, index: int, parent: int) -> list[Node]:
        """Append a node, and its instances; returns the root node of its skinned mesh, if it has one."""
        node = Node(
            name=element.string("name", "") or f"node_{index}",
            parent=parent,
            matrix=self.hierarchy.local[index].copy(),
            camera=self.document.refer(element, "camera", "cameras"),
        )
        self.nodes.append(node)
        light = element.extension("KHR_lights_punctual")
        if light is not None:
            node.light = self.document.refer_required(light, "light", "lights")
        mesh = self.document.refer(element, "mesh", "meshes")
        skin = self.document.refer(element, "skin", "skins")
        if mesh is None:
            return []
        joints = None if skin is None else self.skins.matrices(skin)
        weights = element.numbers("weights", None) if "weights" in element else None
        shape = self.library.use(mesh, weights, skin, joints)
        if shape is None:
            return []
        if skin is not None:
            self.skin_joints |= self._with_ancestors(self.skins.joints[skin])
            # Joints alone place a skinned mesh; its node's transform is ignored (glTF 2.0, section 3.7.3.2).
            return [Node(name=f"{node.name}_skinned", meshes=[shape])]
        instancing = element.extension(INSTANCING)
        if instancing is None:
            node.meshes = [shape]
        else:
            self._instances(instancing, node.name, shape)
        return []

    def _with_ancestors(self, nodes: list[int]) -> set[int]:
        """`nodes` and all nodes above them: moving one moves the skin."""
        found: set[int] = set()
        for start in nodes:
            node = start
            while node >= 0 and node not in found:
                found.add(node)
                node = self.hierarchy.parent[node]
        return found

    def _instances(self, instancing: Element, name: str, shape: int) -> None:
        """One child node for each instance of EXT_mesh_gpu_instancing."""
        parent = len(self.nodes) - 1
        attributes = instancing.required("attributes")
        widths = {"TRANSLATION": "VEC3", "ROTATION": "VEC4", "SCALE": "VEC3"}
        values: dict[str, np.ndarray] = {}
        for key in widths.keys() & attributes.data.keys():
            index = self.document.refer_required(attributes, key, "accessors")
            if self.accessors.header(index).kind != widths[key]:
                fail(attributes.place(key), f"is {self.accessors.header(index).kind}; it must be {widths[key]}")
            values[key] = self.accessors.floats(index).astype(np.float64)
        counts = {len(array) for array in values.values()}
        if len(counts) != 1:
            fail(attributes.where, "must have TRANSLATION, ROTATION or SCALE, all of one count")
        count = counts.pop()
        if count + len(self.nodes) > MAX_ENTRIES:
            fail(attributes.where, f"makes more than {MAX_ENTRIES:,} nodes")
        rotation = values.get("ROTATION", np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)))
        rotation[~rotation.any(axis=1)] = (0.0, 0.0, 0.0, 1.0)
        matrices = trs_matrices(
            values.get("TRANSLATION", np.zeros((count, 3))), rotation, values.get("SCALE", np.ones((count, 3)))
        )
        self.nodes += [Node(f"{name}_{i}", parent, matrix, [shape]) for i, matrix in enumerate(matrices)]
