"""Node transforms over time: keyframe tracks, and the hierarchy they drive."""

from __future__ import annotations

import numpy as np

from phrt.model import Track
from phrt.scene import Scene


class Animator:
    """World matrices of every node at any time. Only nodes that move, and what hangs below them, are computed again."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._tracks: dict[int, list[Track]] = {}
        for track in scene.tracks:
            if len(track.times):
                self._tracks.setdefault(track.node, []).append(track)
        self._rest = {node: decompose(scene.nodes[node].matrix) for node in self._tracks}
        self._moving: list[int] = []
        moving = np.zeros(len(scene.nodes), dtype=bool)
        self._matrix = np.empty((len(scene.nodes), 4, 4))
        for index, node in enumerate(scene.nodes):
            parent = self._matrix[node.parent] if node.parent >= 0 else np.eye(4)
            self._matrix[index] = parent @ node.matrix
            moving[index] = index in self._tracks or (node.parent >= 0 and moving[node.parent])
            if moving[index]:
                self._moving.append(index)

    def moves(self, nodes: np.ndarray) -> np.ndarray:
        """(n,) bool: which of `nodes` (n,) int a track moves, its own or that of a node above it."""
        return np.isin(nodes, self._moving)

    def world_from_node(self, time: float) -> np.ndarray:
        """(nodes, 4, 4) float64 at `time` seconds, held at the ends of every track. A fresh array."""
        matrix = self._matrix.copy()
        for index in self._moving:
            node = self._scene.nodes[index]
            local = self._local(index, time) if index in self._tracks else node.matrix
            matrix[index] = matrix[node.parent] @ local if node.parent >= 0 else local
        return matrix

    def _local(self, index: int, time: float) -> np.ndarray:
        translation, rotation, scale = self._rest[index]
        for track in self._tracks[index]:
            value = sample(track, time)
            if track.target == "translation":
                translation = value
            elif track.target == "rotation":
                rotation = value
            else:
                scale = value
        return compose(translation, rotation, scale)


def sample(track: Track, time: float) -> np.ndarray:
    """The value of `track` at `time`: (3,), or a unit quaternion (4,) x y z w. glTF 2.0 section 3.11."""
    times, values = track.times, track.values
    if track.interpolation == "cubic":
        return _cubic(track, time)
    right = int(np.searchsorted(times, time, side="right"))
    if right == 0 or right == len(times) or track.interpolation == "step":
        return np.asarray(values[max(right - 1, 0)], dtype=np.float64)
    fraction = (time - times[right - 1]) / (times[right] - times[right - 1])
    before, after = np.asarray(values[right - 1], np.float64), np.asarray(values[right], np.float64)
    if track.target == "rotation":
        return slerp(before, after, fraction)
    return before + (after - before) * fraction


def _cubic(track: Track, time: float) -> np.ndarray:
    times, values = track.times, np.asarray(track.values, dtype=np.float64)
    right = int(np.searchsorted(times, time, side="right"))
    if right == 0 or right == len(times):
        result = values[max(right - 1, 0), 1]
    else:
        span = times[right] - times[right - 1]
        s = (time - times[right - 1]) / span
        s2, s3 = s * s, s * s * s
        result = (
            (2 * s3 - 3 * s2 + 1) * values[right - 1, 1]
            + span * (s3 - 2 * s2 + s) * values[right - 1, 2]
            + (3 * s2 - 2 * s3) * values[right, 1]
            + span * (s3 - s2) * values[right, 0]
        )
    return result / np.linalg.norm(result) if track.target == "rotation" else result


def slerp(a: np.ndarray, b: np.ndarray, fraction: float) -> np.ndarray:
    """Spherical interpolation of unit quaternions the short way round."""
    cosine = float(a @ b)
    if cosine < 0:
        b, cosine = -b, -cosine
    if cosine > 0.9995:
        mixed = a + (b - a) * fraction
        return mixed / np.linalg.norm(mixed)
    angle = np.arccos(cosine)
    return (np.sin((1 - fraction) * angle) * a + np.sin(fraction * angle) * b) / np.sin(angle)


def rotation_matrix(quaternion: np.ndarray) -> np.ndarray:
    """(3, 3) of a unit quaternion x y z w."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_of(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternion x y z w of a rotation matrix (3, 3)."""
    m = rotation
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    if trace > 0:
        s = 2 * np.sqrt(trace + 1)
        q = [(m[2, 1] - m[1, 2]) / s, (m[0, 2] - m[2, 0]) / s, (m[1, 0] - m[0, 1]) / s, s / 4]
    else:
        i = int(np.argmax(np.diag(m)))
        j, k = (i + 1) % 3, (i + 2) % 3
        s = 2 * np.sqrt(max(1 + m[i, i] - m[j, j] - m[k, k], 1e-12))
        q = [0.0, 0.0, 0.0, (m[k, j] - m[j, k]) / s]
        q[i], q[j], q[k] = s / 4, (m[j, i] + m[i, j]) / s, (m[k, i] + m[i, k]) / s
    result = np.array(q)
    return result / np.linalg.norm(result)


def decompose(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Translation, quaternion and scale of `matrix` (4, 4); a mirrored one gets a negative x scale, shear is dropped."""
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if np.linalg.det(matrix[:3, :3]) < 0:
        scale[0] = -scale[0]
    rotation = matrix[:3, :3] / np.where(scale == 0, 1, scale)
    return matrix[:3, 3].copy(), quaternion_of(rotation), scale


def compose(translation: np.ndarray, quaternion: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """(4, 4) from translation (3,), unit quaternion x y z w and scale (3,)."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation_matrix(quaternion) * np.asarray(scale)[None, :]
    matrix[:3, 3] = translation
    return matrix
