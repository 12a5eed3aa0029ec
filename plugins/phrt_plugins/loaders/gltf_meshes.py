"""One phrt Mesh for each glTF mesh: its primitives morphed, skinned, completed and merged."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phrt.model import Material, Mesh, TextureRef
from phrt_plugins.loaders.gltf_accessors import Accessors
from phrt_plugins.loaders.gltf_json import MAX_MAGNITUDE, Document, fail
from phrt_plugins.loaders.gltf_primitives import MAX_PRIMITIVES, Part, PrimitiveReader
from phrt_plugins.loaders.gltf_skins import skin_part
from phrt_plugins.loaders.gltf_tangents import make_tangents, orthonormal, unit


class MeshLibrary:
    """The meshes of a file. All are read, so that a broken one says so; what nodes use is built, once per shape."""

    def __init__(self, document: Document, accessors: Accessors, materials: list[Material]) -> None:
        self.document = document
        self.accessors = accessors
        reader = PrimitiveReader(document, accessors, materials)
        self.parts = [reader.read(element) for element in document.lists["meshes"]]
        self.meshes: list[Mesh] = []
        self._built: dict[object, int | None] = {}

    def use(
        self, index: int, weights: tuple[float, ...] | None, skin: int | None, joints: np.ndarray | None
    ) -> int | None:
        """Index into `Model.meshes` of glTF mesh `index` at a rest pose; None when it has no triangles.

        weights: the node's morph weights, None for the mesh's own. joints: (J, 4, 4) matrices of skin number `skin`.
        """
        element = self.document.lists["meshes"][index]
        own = element.numbers("weights", None, ())
        key = (index, weights or own, skin)
        if key not in self._built:
            name = element.string("name", "") or f"mesh_{index}"
            mesh = self._build(name, self.parts[index], weights or own, joints)
            self._built[key] = len(self.meshes) if mesh else None
            if len(self._built) > MAX_PRIMITIVES:
                fail(element.where, f"is drawn in more than {MAX_PRIMITIVES:,} poses")
            self.meshes += [mesh] if mesh else []
        return self._built[key]

    def _build(self, name: str, parts: list[Part], weights: Sequence[float], joints: np.ndarray | None) -> Mesh | None:
        parts = [part for part in parts if len(part.triangles)]
        for part in parts:
            self.accessors.budget.spend(part.positions.shape[0] * 64 + part.triangles.nbytes, part.where)
        posed = [self._posed(part, weights, joints) for part in parts]
        flat = any(part.normals is not None for part in posed) or any(part.normal_map is not None for part in posed)
        finished = [finish(part, make_flat=flat) for part in posed]
        return merge(name, finished) if finished else None

    def _posed(self, part: Part, weights: Sequence[float], joints: np.ndarray | None) -> Part:
        """A copy of `part` at its morph weights and joint matrices."""
        posed = Part(**vars(part))
        if part.targets:
            with np.errstate(all="ignore"):
                self._morph(posed, weights)
        if joints is not None:
            skin_part(self.document, posed, joints)
        self._check_directions(posed)
        return posed

    def _morph(self, part: Part, weights: Sequence[float]) -> None:
        """Add the weighted targets (glTF 2.0, section 3.7.2.2)."""
        if weights and len(weights) != len(part.targets):
            self.document.warn(f"{part.where} has {len(part.targets)} morph targets, but {len(weights)} weights")
        for target, weight in zip(part.targets, weights, strict=False):
            for name, index in target.items() if weight else ():
                if name == "POSITION":
                    part.positions = part.positions + np.float32(weight) * self._displacement(part, index)
                elif name == "NORMAL" and part.normals is not None:
                    part.normals = part.normals + np.float32(weight) * self._displacement(part, index)
                elif name == "TANGENT" and part.tangents is not None:
                    moved = part.tangents[:, :3] + np.float32(weight) * self._displacement(part, index)
                    part.tangents = np.hstack([moved, part.tangents[:, 3:]])
                elif name.startswith(("TEXCOORD_", "COLOR_")):
                    self.document.warn(f"morph targets of {name} are not applied")
        for values in (part.positions, part.normals, part.tangents):
            if values is not None and not (np.abs(values) < MAX_MAGNITUDE).all():
                fail(part.where, "has morph targets that move vertices to infinity")

    def _displacement(self, part: Part, index: int) -> np.ndarray:
        accessor = self.accessors.header(index)
        if accessor.kind != "VEC3" or accessor.count != len(part.positions):
            fail(
                accessor.where,
                f"is {accessor.count} {accessor.kind}; as a morph target it must be {len(part.positions)} VEC3",
            )
        return self.accessors.floats(index)

    def _check_directions(self, part: Part) -> None:
        """Make normals and tangents unit; a normal of length zero becomes the one of its triangles."""
        if part.normals is not None:
            part.normals = unit(part.normals)
            bad = ~part.normals.any(axis=1)
            if bad.any():
                self.document.warn(f"{part.where} has {int(bad.sum())} normals of length zero, which are made anew")
                part.normals = part.normals.copy()
                part.normals[bad] = smooth_normals(part)[bad]
        if part.tangents is not None:
            if part.normals is None:
                part.tangents = None
                return
            sign = part.tangents[:, 3:]
            if not np.isin(sign, (-1.0, 1.0)).all():
                self.document.warn(f"{part.where} has tangents whose w is neither 1 nor -1; its sign is used")
            direction = unit(part.tangents[:, :3])
            lost = ~direction.any(axis=1)
            direction[lost] = orthonormal(direction[lost], part.normals[lost])
            part.tangents = np.hstack([direction, np.where(sign < 0, np.float32(-1), np.float32(1))])


def smooth_normals(part: Part) -> np.ndarray:
    """(V, 3) float32 area-weighted vertex normals; +Y where a vertex has no area around it."""
    area = face_normals(part.positions, part.triangles)
    total = np.zeros(part.positions.shape)
    for corner in range(3):
        for axis in range(3):
            total[:, axis] += np.bincount(part.triangles[:, corner], area[:, axis], minlength=len(total))
    total = unit(total)
    total[~total.any(axis=1)] = (0.0, 1.0, 0.0)
    return total.astype(np.float32)


def face_normals(positions: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(T, 3) float64: twice the area times the normal."""
    corners = positions.astype(np.float64)[triangles]
    with np.errstate(all="ignore"):
        return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def finish(part: Part, *, make_flat: bool) -> Part:
    """Flat normals where missing and wanted, tangents where a normal map needs them, no vertex that nothing uses."""
    if part.normals is None and make_flat:
        part = flat_shaded(part)
    ref = part.normal_map
    if ref is not None and part.tangents is None and part.normals is not None and part.uvs[ref.uv_set] is not None:
        uv = transform_uv(part.uvs[ref.uv_set], ref)
        source, tangents, triangles = make_tangents(part.positions, part.normals, uv, part.triangles)
        part = take(part, source)
        part.tangents, part.triangles = tangents, triangles
    used = np.zeros(len(part.positions), bool)
    used[part.triangles] = True
    if used.all():
        return part
    number = np.cumsum(used) - 1
    kept = take(part, np.flatnonzero(used))
    kept.triangles = number[part.triangles]
    return kept


def transform_uv(uv: np.ndarray | None, ref: TextureRef) -> np.ndarray:
    """(V, 2) texture coordinates turned and scaled as KHR_texture_transform says (the offset changes no direction)."""
    assert uv is not None
    cos, sin = np.cos(ref.rotation), np.sin(ref.rotation)
    matrix = np.array([[cos, sin], [-sin, cos]]) @ np.diag(ref.scale)
    return (uv @ matrix.T).astype(np.float32)


def flat_shaded(part: Part) -> Part:
    """Every triangle with its own three vertices and its own normal."""
    flat = take(part, part.triangles.reshape(-1))
    normals = unit(face_normals(part.positions, part.triangles))
    normals[~normals.any(axis=1)] = (0.0, 1.0, 0.0)
    flat.normals = np.repeat(normals, 3, axis=0).astype(np.float32)
    flat.triangles = np.arange(len(flat.positions)).reshape(-1, 3)
    return flat


def take(part: Part, rows: np.ndarray) -> Part:
    """`part` with the vertices `rows`, its triangles not renumbered."""
    taken = Part(**vars(part))
    for name in ("positions", "normals", "tangents", "colors"):
        values = getattr(part, name)
        setattr(taken, name, None if values is None else values[rows])
    taken.uvs = [None if uv is None else uv[rows] for uv in part.uvs]
    return taken


def merge(name: str, parts: list[Part]) -> Mesh:
    """One mesh of several parts; what only some have is filled in: white, texture coordinate 0, tangent +X."""
    first = np.cumsum([0, *(len(part.positions) for part in parts)])
    triangles = [part.triangles + start for part, start in zip(parts, first[:-1], strict=True)]

    def joined(arrays: list[np.ndarray | None], fill: tuple[float, ...]) -> np.ndarray | None:
        if all(array is None for array in arrays):
            return None
        rows = [
            np.tile(np.array(fill, np.float32), (len(p.positions), 1)) if a is None else a
            for p, a in zip(parts, arrays, strict=True)
        ]
        return np.ascontiguousarray(np.concatenate(rows), dtype=np.float32)

    return Mesh(
        name=name,
        positions=np.concatenate([part.positions for part in parts]).astype(np.float32),
        triangles=np.concatenate(triangles).astype(np.int32),
        triangle_material=np.concatenate([part.triangle_material for part in parts]),
        normals=joined([part.normals for part in parts], (0.0, 1.0, 0.0)),
        tangents=joined([part.tangents for part in parts], (1.0, 0.0, 0.0, 1.0)),
        uv0=joined([part.uvs[0] for part in parts], (0.0, 0.0)),
        uv1=joined([part.uvs[1] for part in parts], (0.0, 0.0)),
        colors=joined([part.colors for part in parts], (1.0, 1.0, 1.0, 1.0)),
    )
