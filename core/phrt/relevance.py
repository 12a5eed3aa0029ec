"""The paper's equations: how visible an object is, what an item costs, how relevant it is.

Andrade et al. 2014, section 4.2; the letters are its own. Everything is vectorised, and finite for objects behind the
observer, around it, and without geometry.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from phrt.camera import CameraView
from phrt.controls import LARGEST, Conditions
from phrt.scene import Scene
from phrt.view_motion import ViewMotion, picture_place
from phrt.world import World


def center_closeness(center_world: np.ndarray, view: CameraView) -> np.ndarray:
    """P (n,) float32 of centres (n, 3) in world space: 1 at the view centre, falling linearly to 0 at the border of the
    picture, 0 outside it and behind the observer.

    Ours: the paper does not say how it normalises; here by the border that is nearer, so that P is 0 all along it.
    """
    place, ahead = picture_place(center_world, view)
    off_center = np.abs(place).max(axis=1, initial=0.0)
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


def importance_factors(
    scene: Scene, situation: str | None = None, attention: Mapping[str, float] | None = None
) -> np.ndarray:
    """K (N + 1,) float32 of every object in `situation` (the scene's own where it is not given); row 0, the background, is 0.

    The paper only says that K is how important an object is "in respect with the others"; here it is the object's importance
    over the mean of all objects (1 where the map says nothing), so that K is 1 on average and does not change the scale of R.

    attention: factor by tag. K is multiplied by that of each of the object's tags, so that what is both golden and a coin is
    looked at for both reasons; a factor below 1 turns away. After Funkhouser and Sequin 1993, whose benefit is a product of
    factors too; ours: K is not normalised again, so that attention to one object leaves the others as they are.
    """
    situation = scene.situation if situation is None else situation
    given = np.array([entry.importance.get(situation, entry.importance.get("default", 1.0)) for entry in scene.objects])
    mean = given.mean() if len(given) else 0.0
    factors = given / mean if mean > 0 else given
    if attention:
        looked_for = np.array([math.prod(attention.get(tag, 1.0) for tag in entry.tags) for entry in scene.objects])
        factors = factors * np.nan_to_num(looked_for, posinf=LARGEST)
    return np.concatenate([[0.0], np.minimum(factors, LARGEST)]).astype(np.float32)


def slowed(visible: np.ndarray, speed: np.ndarray, strength: float) -> np.ndarray:
    """V (n,) of objects that move at `speed` (n,) picture widths a second: V / (1 + strength speed).

    Andrade et al. 2014, section 4.1, ask for it without a formula; Funkhouser and Sequin 1993 reduce an object's benefit with its
    apparent speed. Ours: at strength 1, what crosses the picture in a second counts half.
    """
    return visible / (np.float32(1.0) + np.float32(strength) * speed)


@dataclass(frozen=True)
class ObjectLetters:
    """The letters that belong to an object, whatever the effect; (N + 1,) float32 each, row 0 the background.

    speed: in the picture, widths a second; `visibility` is lowered by it where that is asked for.
    """

    area: np.ndarray
    center_closeness: np.ndarray
    distance: np.ndarray
    visibility: np.ndarray
    importance_factor: np.ndarray
    speed: np.ndarray


class ObjectSight:
    """How the objects of a scene are seen from frame to frame.

    view_speed: how fast the view moves in the present frame, picture widths a second (see `ViewMotion`).
    """

    def __init__(self, world: World) -> None:
        self._local_center = local_centers(world)
        self._motion = ViewMotion()
        self._known_factors: tuple[tuple[object, ...], np.ndarray] | None = None
        self._importance = importance_factors(world.scene)
        self._speed = np.zeros(world.object_count + 1, np.float32)
        self._strength = 0.0
        self._typical_distance = math.inf
        self.view_speed = 0.0

    def begin_frame(self, world: World, view: CameraView, time: float, conditions: Conditions) -> None:
        """A new frame, seen by `view` at `time` seconds: what moved since the last one, and what counts now."""
        self._speed, self.view_speed = self._motion.advance(self._centers(world), view, time, self._typical_distance)
        self._strength = conditions.view_speed
        self._importance = self._factors(world.scene, conditions)

    def letters(self, world: World, view: CameraView, visible_pixels: np.ndarray) -> ObjectLetters:
        """A, P, D, V, K of every object; visible_pixels (N + 1,) are counted from `object_id`."""
        center = self._centers(world)
        area = (visible_pixels / (view.width * view.height)).astype(np.float32)
        closeness, distance = center_closeness(center, view), observer_distance(center, view)
        seen = float(area[1:].sum())
        self._typical_distance = float(area[1:] @ distance[1:]) / seen if seen > 0 else math.inf
        visible = slowed(visibility(area, closeness, distance), self._speed, self._strength)
        return ObjectLetters(area, closeness, distance, visible, self._importance, self._speed)

    def _centers(self, world: World) -> np.ndarray:
        """(N + 1, 3) float64 centres in world space."""
        matrix = world.object_matrix
        return np.einsum("nij,nj->ni", matrix[:, :3, :3], self._local_center) + matrix[:, :3, 3]

    def _factors(self, scene: Scene, conditions: Conditions) -> np.ndarray:
        """K, made anew only when the situation or the attention changes."""
        key = (conditions.situation, *sorted(conditions.attention.items()))
        if self._known_factors is None or self._known_factors[0] != key:
            self._known_factors = (key, importance_factors(scene, conditions.situation, conditions.attention))
        return self._known_factors[1]


def local_centers(world: World) -> np.ndarray:
    """(N + 1, 3) float64 centres of the objects' bounds in object space; zero for objects without vertices."""
    centers = np.zeros((world.object_count + 1, 3))
    filled = np.flatnonzero(world.vertex_count)
    if len(filled):
        low = np.minimum.reduceat(world.local_positions, world.first_vertex[filled])
        high = np.maximum.reduceat(world.local_positions, world.first_vertex[filled])
        centers[filled] = (low.astype(np.float64) + high) / 2
    return centers
