"""The paper's equations: how visible an object is, what an item costs, how relevant it is.

Andrade et al. 2014, section 4.2; the letters are its own. Everything is vectorised, and finite for objects behind the
observer, around it, and without geometry.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phrt.camera import CameraView
from phrt.scene import Scene
from phrt.world import World

DEFAULT_PERSISTENCE = 0.0001
"""I. V of an object that covers 0.2 % of the picture, halfway to its border and 10 m away, is 0.0001, which is the median of the
reference scene: an item that was traced counts as if such an object were added to it."""


def center_closeness(center_world: np.ndarray, view: CameraView) -> np.ndarray:
    """P (n,) float32 of centres (n, 3) in world space: 1 at the view centre, falling linearly to 0 at the border of the
    picture, 0 outside it and behind the observer.

    Ours: the paper does not say how it normalises; here by the border that is nearer, so that P is 0 all along it.
    """
    at = (center_world - view.position) @ view.world_from_view[:3, :3]
    ahead = -at[:, 2] > 0
    plane = np.ones(len(at)) if view.orthographic else np.where(ahead, -at[:, 2], 1.0)
    off_center = np.abs(at[:, :2] / plane[:, None] / np.array(view.tan_half)).max(axis=1, initial=0.0)
    return np.where(ahead, np.maximum(1.0 - off_center, 0.0), 0.0).astype(np.float32)


def observer_distance(center_world: np.ndarray, view: CameraView) -> np.ndarray:
    """D (n,) float32, metres from the observer to centres (n, 3).

    Ours: at least the near plane, so that V stays finite for an object around the observer.
    """
    return np.maximum(np.linalg.norm(center_world - view.position, axis=1), view.near).astype(np.float32)


def visibility(area: np.ndarray, closeness: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """V = A P / D. Andrade et al. 2014, eq. (1)."""
    return area * closeness / distance


def item_cost(visible: np.ndarray, ray_estimate: np.ndarray) -> np.ndarray:
    """C = V Q. Andrade et al. 2014, eq. (2)."""
    return visible * ray_estimate


def item_relevance(
    was_selected: np.ndarray, persistence: float, visible: np.ndarray, importance: np.ndarray
) -> np.ndarray:
    """R = (S I + V) K. Andrade et al. 2014, eq. (3)."""
    return (was_selected * np.float32(persistence) + visible) * importance


def importance_factors(scene: Scene) -> np.ndarray:
    """K (N + 1,) float32 of every object in the scene's situation; row 0, the background, is 0.

    The paper only says that K is how important an object is "in respect with the others"; here it is the object's importance
    over the mean of all objects (1 where the map says nothing), so that K is 1 on average and does not change the scale of R.
    """
    given = np.array(
        [entry.importance.get(scene.situation, entry.importance.get("default", 1.0)) for entry in scene.objects]
    )
    mean = given.mean() if len(given) else 0.0
    return np.concatenate([[0.0], given / mean if mean > 0 else given]).astype(np.float32)


@dataclass(frozen=True)
class ObjectLetters:
    """The letters that belong to an object, whatever the effect; (N + 1,) float32 each, row 0 the background."""

    area: np.ndarray
    center_closeness: np.ndarray
    distance: np.ndarray
    visibility: np.ndarray
    importance_factor: np.ndarray


class ObjectSight:
    """How the objects of a scene are seen from frame to frame."""

    def __init__(self, world: World) -> None:
        self._local_center = local_centers(world)
        self._importance = importance_factors(world.scene)

    def letters(self, world: World, view: CameraView, visible_pixels: np.ndarray) -> ObjectLetters:
        """A, P, D, V, K of every object; visible_pixels (N + 1,) are counted from `object_id`."""
        matrix = world.object_matrix
        center = np.einsum("nij,nj->ni", matrix[:, :3, :3], self._local_center) + matrix[:, :3, 3]
        area = (visible_pixels / (view.width * view.height)).astype(np.float32)
        closeness, distance = center_closeness(center, view), observer_distance(center, view)
        return ObjectLetters(area, closeness, distance, visibility(area, closeness, distance), self._importance)


def local_centers(world: World) -> np.ndarray:
    """(N + 1, 3) float64 centres of the objects' bounds in object space; zero for objects without vertices."""
    centers = np.zeros((world.object_count + 1, 3))
    filled = np.flatnonzero(world.vertex_count)
    if len(filled):
        low = np.minimum.reduceat(world.local_positions, world.first_vertex[filled])
        high = np.maximum.reduceat(world.local_positions, world.first_vertex[filled])
        centers[filled] = (low.astype(np.float64) + high) / 2
    return centers
