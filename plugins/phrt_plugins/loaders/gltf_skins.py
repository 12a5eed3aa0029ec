"""glTF skins at their rest pose: vertices where the joints of the unanimated node hierarchy put them."""

from __future__ import annotations

import numpy as np

from phrt_plugins.loaders.gltf_accessors import Accessors
from phrt_plugins.loaders.gltf_json import MAX_MAGNITUDE, Document, fail
from phrt_plugins.loaders.gltf_primitives import Part
from phrt_plugins.loaders.gltf_tangents import unit


class Skins:
    """Joint matrices of the file's skins, from the rest matrices of its nodes."""

    def __init__(self, document: Document, accessors: Accessors, world_from_node: np.ndarray) -> None:
        self.document = document
        self.joints = [document.refer_all(skin, "joints", "nodes") for skin in document.lists["skins"]]
        self._bind = [self._inverse_bind(index, accessors) for index in range(len(self.joints))]
        self._world = world_from_node

    def _inverse_bind(self, index: int, accessors: Accessors) -> np.ndarray:
        """(J, 4, 4) float64; identity where the skin has none."""
        skin, count = self.document.lists["skins"][index], len(self.joints[index])
        accessor = self.document.refer(skin, "inverseBindMatrices", "accessors")
        if accessor is None:
            return np.tile(np.eye(4), (count, 1, 1))
        header = accessors.header(accessor)
        if header.kind != "MAT4" or header.count < count:
            fail(skin.where, f"has {header.count} {header.kind} inverse bind matrices for {count} joints")
        # Stored column by column.
        return accessors.floats(accessor)[:count].astype(np.float64).reshape(count, 4, 4).transpose(0, 2, 1)

    def matrices(self, index: int) -> np.ndarray:
        """(J, 4, 4) float64: from a vertex in the mesh to the scene, per joint."""
        if not self.joints[index]:
            fail(self.document.lists["skins"][index].where, "has no joints")
        return self._world[self.joints[index]] @ self._bind[index]


def skin_part(document: Document, part: Part, joint_matrices: np.ndarray) -> None:
    """Move a part's vertices by their joints, in place (glTF 2.0, section 3.7.3)."""
    if part.joints is None or part.weights is None:
        document.warn(f"{part.where} belongs to a skin, but has no JOINTS and WEIGHTS; it is drawn without the skin")
        return
    if len(part.joints) and int(part.joints.max()) >= len(joint_matrices):
        fail(part.where, f"has joint {int(part.joints.max())}, but its skin has {len(joint_matrices)}")
    weights = np.maximum(part.weights.astype(np.float64), 0.0)
    total = weights.sum(axis=1, keepdims=True)
    # A vertex without any weight follows its first joint.
    weights[total[:, 0] <= 0, 0] = 1.0
    weights /= np.where(total > 0, total, 1.0)
    matrix = np.zeros((len(part.positions), 3, 4))
    with np.errstate(all="ignore"):
        for column in range(weights.shape[1]):
            matrix += weights[:, column, None, None] * joint_matrices[part.joints[:, column], :3, :]
        part.positions = (np.einsum("vij,vj->vi", matrix[:, :, :3], part.positions) + matrix[:, :, 3]).astype(
            np.float32
        )
        if part.normals is not None:
            part.normals = unit(np.einsum("vij,vj->vi", cofactor(matrix[:, :, :3]), part.normals)).astype(np.float32)
        if part.tangents is not None:
            turned = unit(np.einsum("vij,vj->vi", matrix[:, :, :3], part.tangents[:, :3])).astype(np.float32)
            part.tangents = np.hstack([turned, part.tangents[:, 3:]])
    if not (np.abs(part.positions) < MAX_MAGNITUDE).all():
        fail(part.where, "is moved to infinity by its skin")


def cofactor(matrix: np.ndarray) -> np.ndarray:
    """(n, 3, 3) the matrices that turn normals: inverse transpose times determinant, defined for singular ones too."""
    a, b, c = matrix[:, :, 0], matrix[:, :, 1], matrix[:, :, 2]
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=2)
