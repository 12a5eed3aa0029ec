"""glTF mesh primitives as arrays: attributes, triangles, and which of them share vertices."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from phrt.model import Material, TextureRef
from phrt_plugins.loaders.gltf_accessors import Accessors
from phrt_plugins.loaders.gltf_draco import EXTENSION as DRACO
from phrt_plugins.loaders.gltf_draco import DracoPrimitive, decode_draco, draco_floats
from phrt_plugins.loaders.gltf_json import MAX_MAGNITUDE, Document, Element, fail

POINT_AND_LINE_MODES = {0: "points", 1: "lines", 2: "line loops", 3: "line strips"}
TRIANGLES, STRIP, FAN = 4, 5, 6

MAX_PRIMITIVES = 50_000
"""Most primitives of a file, and most meshes made of them."""

ATTRIBUTE_TYPES = {
    "POSITION": ("VEC3",),
    "NORMAL": ("VEC3",),
    "TANGENT": ("VEC4",),
    "TEXCOORD": ("VEC2",),
    "COLOR": ("VEC3", "VEC4"),
    "JOINTS": ("VEC4",),
    "WEIGHTS": ("VEC4",),
}
ALWAYS_NORMALIZED = ("NORMAL", "TANGENT", "COLOR", "WEIGHTS")
"""Their integers mean fractions whatever the accessor says; there is no other use for them."""


@dataclass
class Part:
    """Primitives that share vertices. V vertices, T triangles, float32 arrays, absent attributes None.

    positions (V, 3); normals (V, 3); tangents (V, 4); uvs: per set (V, 2); colors (V, 4); joints (V, 4 * sets) int64
    and weights (V, 4 * sets); triangles (T, 3) int64; triangle_material (T,) int32; targets: per morph target, accessor
    by attribute; normal_map: the texture tangents are needed for.
    """

    where: str
    positions: np.ndarray
    normals: np.ndarray | None = None
    tangents: np.ndarray | None = None
    uvs: list[np.ndarray | None] = field(default_factory=lambda: [None, None])
    colors: np.ndarray | None = None
    joints: np.ndarray | None = None
    weights: np.ndarray | None = None
    triangles: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    triangle_material: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int32))
    targets: list[dict[str, int]] = field(default_factory=list)
    normal_map: TextureRef | None = None


class PrimitiveReader:
    """Reads the primitives of meshes, grouped into parts that share their vertices."""

    def __init__(self, document: Document, accessors: Accessors, materials: list[Material]) -> None:
        self.document = document
        self.accessors = accessors
        self.materials = materials
        self.seen = 0

    def read(self, mesh: Element) -> list[Part]:
        """The parts of a mesh. Points and lines are left out with a warning."""
        parts: dict[object, Part] = {}
        pieces: dict[int, list[tuple[np.ndarray, np.ndarray]]] = {}
        for primitive in mesh.items("primitives"):
            self.seen += 1
            if self.seen > MAX_PRIMITIVES:
                fail(primitive.where, f"is one of more than {MAX_PRIMITIVES:,} primitives")
            self._add(primitive, parts, pieces)
        for part in parts.values():
            part.triangles = np.concatenate([triangles for triangles, _ in pieces[id(part)]])
            part.triangle_material = np.concatenate([number for _, number in pieces[id(part)]])
        return list(parts.values())

    def _add(
        self, primitive: Element, parts: dict[object, Part], pieces: dict[int, list[tuple[np.ndarray, np.ndarray]]]
    ) -> None:
        """Put a primitive's triangles into the part that shares its vertices."""
        attributes = self._attributes(primitive)
        targets = [self._references(target) for target in primitive.items("targets")]
        indices = self.document.refer(primitive, "indices", "accessors")
        material = self.document.refer(primitive, "material", "materials")
        mode = primitive.integer("mode", TRIANGLES, high=6)
        if "POSITION" not in attributes:
            self.document.warn(f"{primitive.where} has no POSITION and is not drawn")
            return
        if mode in POINT_AND_LINE_MODES:
            self.document.warn(f"{primitive.where} is made of {POINT_AND_LINE_MODES[mode]}, which are not drawn")
            return
        draco = primitive.extension(DRACO)
        decoded = decode_draco(self.document, self.accessors, primitive, draco) if draco else None
        normal_map = self.materials[material].normal_texture if material is not None else None
        key = (
            tuple(sorted(attributes.items())),
            tuple(tuple(sorted(target.items())) for target in targets),
            None if normal_map is None else (normal_map.uv_set, normal_map.rotation, normal_map.scale),
            primitive.where if decoded else None,
        )
        if key not in parts:
            parts[key] = self._part(primitive, attributes, decoded)
            parts[key].targets, parts[key].normal_map = targets, normal_map
        part = parts[key]
        triangles = self._triangles(primitive, indices, mode, len(part.positions), decoded)
        number = np.full(len(triangles), -1 if material is None else material, np.int32)
        pieces.setdefault(id(part), []).append((triangles, number))
        self._warn_of_missing_uvs(primitive, part, material)

    def _references(self, element: Element) -> dict[str, int]:
        return {name: self.document.refer_required(element, name, "accessors") for name in element.data}

    def _attributes(self, primitive: Element) -> dict[str, int]:
        """Accessor by attribute, all of them counted alike; sets PHRT does not read are left out with a warning."""
        attributes = self._references(primitive.required("attributes"))
        counts = {name: self.accessors.header(index).count for name, index in attributes.items()}
        if len(set(counts.values())) > 1:
            listed = ", ".join(f"{name} {count}" for name, count in counts.items())
            fail(primitive.place("attributes"), f"have different counts: {listed}")
        used = {}
        for name, index in attributes.items():
            semantic, _, number = name.partition("_")
            if semantic not in ATTRIBUTE_TYPES or name.startswith("_"):
                continue
            if (semantic == "TEXCOORD" and number not in ("0", "1")) or (semantic == "COLOR" and number != "0"):
                self.document.warn(f"{name} is not read; only TEXCOORD_0, TEXCOORD_1 and COLOR_0 are")
                continue
            used[name] = index
        return used

    def _values(self, name: str, index: int, decoded: DracoPrimitive | None) -> np.ndarray:
        """(V, components) float32 of an attribute."""
        accessor, semantic = self.accessors.header(index), name.partition("_")[0]
        allowed = ATTRIBUTE_TYPES[semantic]
        if accessor.kind not in allowed or accessor.dtype == np.dtype("<u4"):
            fail(
                accessor.where,
                f"is {accessor.kind} of {accessor.dtype.name}; {name} must be {' or '.join(allowed)}, and not uint32",
            )
        normalize = semantic in ALWAYS_NORMALIZED or accessor.normalized
        if decoded is None or name not in decoded.attributes:
            return self.accessors.floats(index, normalize=normalize)
        values = draco_floats(decoded.attributes[name], normalize, accessor.where)
        if values.shape[1] != accessor.components:
            fail(accessor.where, f"is {accessor.kind}, but its Draco data has {values.shape[1]} components")
        return values

    def _part(self, primitive: Element, attributes: dict[str, int], decoded: DracoPrimitive | None) -> Part:
        """A part without triangles: the attributes of a primitive."""

        def read(name: str) -> np.ndarray | None:
            return self._values(name, attributes[name], decoded) if name in attributes else None

        positions = read("POSITION")
        assert positions is not None
        if not (np.abs(positions) < MAX_MAGNITUDE).all():
            fail(primitive.where, f"has positions beyond {MAX_MAGNITUDE:g}")
        part = Part(
            primitive.where, positions, read("NORMAL"), read("TANGENT"), [read("TEXCOORD_0"), read("TEXCOORD_1")]
        )
        part.colors = self._colors(read("COLOR_0"))
        sets = sorted(name for name in attributes if name.startswith("JOINTS_") and f"WEIGHTS_{name[7:]}" in attributes)
        if sets:
            part.joints = np.hstack([self._joints(attributes[name]) for name in sets])
            part.weights = np.hstack(
                [self._values(f"WEIGHTS_{name[7:]}", attributes[f"WEIGHTS_{name[7:]}"], decoded) for name in sets]
            )
        return part

    def _joints(self, index: int) -> np.ndarray:
        accessor = self.accessors.header(index)
        if accessor.kind != "VEC4" or accessor.dtype.kind != "u" or accessor.dtype.itemsize > 2:
            fail(accessor.where, f"is {accessor.kind} of {accessor.dtype.name}; joints are VEC4 of uint8 or uint16")
        return self.accessors.raw(index).astype(np.int64)

    def _colors(self, colors: np.ndarray | None) -> np.ndarray | None:
        """(V, 4) in [0, 1], alpha 1 where the file has none."""
        if colors is None:
            return None
        if len(colors) and (colors.min() < 0 or colors.max() > 1):
            self.document.warn("has vertex colours outside 0 to 1, which are clamped")
            colors = np.clip(colors, 0, 1)
        if colors.shape[1] == 3:
            colors = np.hstack([colors, np.ones((len(colors), 1), np.float32)])
        return colors

    def _triangles(
        self, primitive: Element, indices: int | None, mode: int, vertices: int, decoded: DracoPrimitive | None
    ) -> np.ndarray:
        """(T, 3) int64 vertex numbers, all below `vertices`."""
        if decoded is not None:
            triangles = decoded.triangles
        else:
            order = np.arange(vertices) if indices is None else self._indices(indices)
            triangles = self._assemble(primitive, order, mode)
        self.accessors.budget.spend(triangles.nbytes, primitive.where)
        if len(triangles) and int(triangles.max()) >= vertices:
            fail(primitive.place("indices"), f"holds index {int(triangles.max())}, but there are {vertices} vertices")
        return triangles

    def _indices(self, index: int) -> np.ndarray:
        accessor = self.accessors.header(index)
        if accessor.kind != "SCALAR" or accessor.dtype.kind != "u":
            fail(
                accessor.where,
                f"is {accessor.kind} of {accessor.dtype.name}; indices are SCALAR of uint8, uint16 or uint32",
            )
        indices = self.accessors.raw(index)[:, 0]
        if len(indices) and indices.max() == np.iinfo(indices.dtype).max:
            self.document.warn(f"{accessor.where} uses an index that glTF reserves; it is read as any other")
        return indices.astype(np.int64)

    def _assemble(self, primitive: Element, order: np.ndarray, mode: int) -> np.ndarray:
        """Triangles of vertices in order: lists, strips (every second one turned), fans (glTF 2.0, section 3.7.2.1)."""
        if mode == TRIANGLES:
            if len(order) % 3:
                self.document.warn(
                    f"{primitive.where} has {len(order)} indices, no multiple of 3; the last are left out"
                )
            return order[: len(order) // 3 * 3].reshape(-1, 3)
        if len(order) < 3:
            self.document.warn(f"{primitive.where} has {len(order)} indices, too few for a triangle")
            return np.zeros((0, 3), np.int64)
        first = np.arange(len(order) - 2)
        if mode == FAN:
            return np.stack([order[first + 1], order[first + 2], np.broadcast_to(order[0], first.shape)], axis=1)
        odd = first % 2
        return np.stack([order[first], order[first + 1 + odd], order[first + 2 - odd]], axis=1)

    def _warn_of_missing_uvs(self, primitive: Element, part: Part, material: int | None) -> None:
        if material is None:
            return
        refs = [ref for ref in vars(self.materials[material]).values() if isinstance(ref, TextureRef)]
        for uv_set in {ref.uv_set for ref in refs}:
            if part.uvs[uv_set] is None:
                self.document.warn(f"{primitive.where} has no TEXCOORD_{uv_set}, which its material's textures use")
