"""A camera and lights for scenes that have none, so that a bare model file makes a picture."""

from __future__ import annotations

import logging
import math
from itertools import product

import numpy as np

from phrt.animation import Animator
from phrt.camera import look_at
from phrt.model import CameraLens, Light
from phrt.scene import Dome, Scene, SceneCamera, SceneLight, SceneNode

log = logging.getLogger("phrt")

FOV_Y = math.radians(45.0)
MARGIN = 1.06
"""How much wider the framed view is than the bounds."""

FRAMED_FROM = (0.55, 0.35, 1.0)
"""Direction from the middle of the scene to the default camera: in front, a little right and above."""

KEY_LUX, FILL_LUX, DOME_NITS = 2.2, 0.5, 0.35
"""Default lights: together they show a white surface a little under 1."""


def add_camera(scene: Scene) -> None:
    """A camera that sees all of the scene at its first moment, where there is none."""
    if scene.cameras:
        return
    low, high = bounds(scene)
    centre = (low + high) / 2
    towards = np.array(FRAMED_FROM) / np.linalg.norm(FRAMED_FROM)
    distance = framing_distance(low, high, towards)
    eye = centre + towards * distance
    node = _node(scene, "/DefaultCamera", look_at(tuple(eye.tolist()), tuple(centre.tolist())))
    # Aspect 1: a picture higher than wide sees as much as a square one.
    lens = CameraLens("DefaultCamera", FOV_Y, near=distance * 1e-3, far=math.inf, aspect=1.0)
    scene.cameras.append(SceneCamera("/DefaultCamera", node, lens))
    log.info("%s has no camera; one was added that sees all of it", scene.name)


def framing_distance(low: np.ndarray, high: np.ndarray, towards: np.ndarray) -> float:
    """Metres from a box's middle, along unit `towards`, from where a square picture just holds its corners."""
    half = np.maximum((high - low) / 2, 1e-6)
    corners = half * np.array(list(product((-1, 1), repeat=3)))
    axes = look_at(tuple(towards.tolist()), (0.0, 0.0, 0.0))[:3, :3]
    x, y, z = (corners @ axes).T
    return float((np.maximum(np.abs(x), np.abs(y)) * MARGIN / math.tan(FOV_Y / 2) + z).max())


def add_lights(scene: Scene) -> None:
    """A key and a fill light from the camera's side and a soft dome, where there is no light at all."""
    if scene.lights or scene.dome.pixels is not None or any(scene.dome.color):
        return
    camera = world_matrices(scene)[scene.cameras[0].node][:3, :3] if scene.cameras else np.eye(3)
    for name, towards, lux in (("Key", (-0.6, 0.9, 0.8), KEY_LUX), ("Fill", (0.9, 0.3, 0.6), FILL_LUX)):
        direction = camera @ np.array(towards)
        path = f"/Default{name}Light"
        node = _node(scene, path, look_at(tuple(direction.tolist()), (0.0, 0.0, 0.0)))
        light = Light("directional", name, intensity=lux, casts_shadow=name == "Key")
        scene.lights.append(SceneLight(path, node, light))
    scene.dome = Dome((DOME_NITS, DOME_NITS, DOME_NITS))
    log.info("%s has no lights; a key light, a fill light and a dome were added", scene.name)


def bounds(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest corner (3,) float64 of all objects at time 0; a unit box around the origin for none."""
    matrices = world_matrices(scene)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    for entry in scene.objects:
        mesh = scene.meshes[entry.mesh]
        if len(mesh.triangles):
            used = mesh.positions[np.unique(mesh.triangles)].astype(np.float64)
            placed = used @ matrices[entry.node][:3, :3].T + matrices[entry.node][:3, 3]
            low, high = np.minimum(low, placed.min(axis=0)), np.maximum(high, placed.max(axis=0))
    if not np.isfinite([low, high]).all():
        return np.full(3, -0.5), np.full(3, 0.5)
    return low, high


def world_matrices(scene: Scene) -> np.ndarray:
    """(nodes, 4, 4) float64 world_from_node at time 0."""
    return Animator(scene).world_from_node(0.0)


def _node(scene: Scene, path: str, matrix: np.ndarray) -> int:
    scene.nodes.append(SceneNode(path, -1, matrix))
    return len(scene.nodes) - 1
