"""What moved between two frames, as few bounding spheres: before and after."""

from __future__ import annotations

import numpy as np

from phrt.world import World

MOST_SPHERES = 32
"""More are merged with their neighbours: each costs a test per tile of the picture and light."""

_SMALL_STEP = 1.3
"""Before and after become one sphere when that is at most so many times as large."""


class BoundingSpheres:
    """Spheres around the objects of a world, measured once in their own space."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._local: dict[int, tuple[np.ndarray, float]] = {}

    def of(self, object_id: int, matrix: np.ndarray) -> np.ndarray:
        """(4,) float64 centre and radius, world space, of an object that stands at `matrix` (4, 4); radius -1 when it is empty."""
        centre, radius = self._measured(object_id)
        stretch = float(np.linalg.norm(matrix[:3, :3], ord=2))
        return np.array([*(matrix[:3, :3] @ centre + matrix[:3, 3]), radius * stretch if radius >= 0 else -1.0])

    def of_all(self, objects: np.ndarray, matrices: np.ndarray) -> np.ndarray:
        """(n, 4) float64: `of` for every one of `objects` (n,) that stand at matrices[object] (N + 1, 4, 4)."""
        local = [self._measured(object_id) for object_id in objects.tolist()]
        centre = np.array([own for own, _ in local]).reshape(-1, 3)
        radius, placed = np.array([own for _, own in local]), matrices[objects, :3]
        stretch = np.linalg.norm(placed[:, :, :3], ord=2, axis=(1, 2))
        world = np.einsum("nij,nj->ni", placed[:, :, :3], centre) + placed[:, :, 3]
        return np.column_stack([world, np.where(radius >= 0, radius * stretch, -1.0)])

    def _measured(self, object_id: int) -> tuple[np.ndarray, float]:
        if object_id not in self._local:
            first, count = self._world.first_vertex[object_id], self._world.vertex_count[object_id]
            points = self._world.local_positions[first : first + count].astype(np.float64)
            if count:
                centre = (points.min(axis=0) + points.max(axis=0)) / 2
                # Vertices are float32, in the world too.
                self._local[object_id] = centre, float(np.linalg.norm(points - centre, axis=1).max()) * 1.0001
            else:
                self._local[object_id] = np.zeros(3), -1.0
        return self._local[object_id]

    def swept(self, objects: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        """(M, 4) float32, M <= MOST_SPHERES: where `objects` (n,) were and are; before, after (N + 1, 4, 4) world_from_local."""
        spheres: list[np.ndarray] = []
        for object_id in objects.tolist():
            pair = [self.of(object_id, matrix[object_id]) for matrix in (before, after)]
            both = enclosing(np.array(pair))
            if pair[0][3] >= 0:
                spheres += [both] if both[3] <= _SMALL_STEP * max(pair[0][3], pair[1][3]) else pair
        return merged(np.array(spheres).reshape(-1, 4)).astype(np.float32)


def enclosing(spheres: np.ndarray) -> np.ndarray:
    """(4,) a sphere around all of `spheres` (n, 4): around the middle of their box, so not always the smallest."""
    low = (spheres[:, :3] - spheres[:, 3:]).min(axis=0)
    high = (spheres[:, :3] + spheres[:, 3:]).max(axis=0)
    centre = (low + high) / 2
    return np.array([*centre, (np.linalg.norm(spheres[:, :3] - centre, axis=1) + spheres[:, 3]).max()])


def merged(spheres: np.ndarray, most: int = MOST_SPHERES) -> np.ndarray:
    """`spheres` (n, 4), or `most` that enclose them: neighbours along the axis on which they are spread widest go together."""
    if len(spheres) <= most:
        return spheres
    axis = int(np.argmax(np.ptp(spheres[:, :3], axis=0)))
    groups = np.array_split(spheres[np.argsort(spheres[:, axis], kind="stable")], most)
    return np.array([enclosing(group) for group in groups])
