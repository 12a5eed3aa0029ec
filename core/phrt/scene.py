"""A scene as it was described: nodes, objects, meshes, materials, lights, cameras, animation. No backend, no frame.

`phrt.load_scene` makes one from a descriptor or a model file. A `World` (phrt.world) turns it into the flat arrays
that tracers, G-buffer producers and kernels work on, at a time.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from phrt.controls import ControlKey
from phrt.model import CameraLens, Image, Light, Material, Mesh, Track

EffectSwitch = Literal["auto", "always", "never"]


@dataclass
class SceneNode:
    """One transform. `path` is absolute, as in USD ("/atrium/statue"); parents precede children.

    parent : index into `Scene.nodes`, -1 for none
    matrix : (4, 4) float64, parent_from_local, metres, column vectors
    """

    path: str
    parent: int
    matrix: np.ndarray


@dataclass
class SceneObject:
    """What a heuristic can choose: one mesh at one node.

    node, mesh: indices into `Scene.nodes` and `Scene.meshes`; the mesh's vertices are in the node's space.
    effects: per effect name "auto" (the heuristic decides), "always" (mandatory) or "never"; absent means auto.
    importance: the designer's value per situation, "default" being the fallback. tags: what it is, for attention.
    """

    path: str
    node: int
    mesh: int
    casts_shadow: bool = True
    effects: dict[str, EffectSwitch] = field(default_factory=dict)
    importance: dict[str, float] = field(default_factory=dict)
    tags: tuple[str, ...] = ()


@dataclass
class SceneLight:
    path: str
    node: int
    light: Light


@dataclass
class SceneCamera:
    path: str
    node: int
    lens: CameraLens


@dataclass
class Dome:
    """Light from infinitely far away: `color` (3,) nits times `pixels` (H, W, 3) float32 equirectangular, where given.

    The image's centre column looks down -Z and its left half is -X, turned by `rotation` radians about +Y.
    """

    color: tuple[float, float, float] = (0.0, 0.0, 0.0)
    pixels: np.ndarray | None = None
    rotation: float = 0.0
    visible: bool = True


@dataclass
class RenderSettings:
    """Defaults a scene carries for its own pictures; the command line and `Renderer` arguments come first.

    track: controls that change along the scene's time, at rising times.
    """

    size: tuple[int, int] | None = None
    heuristic: str | None = None
    tone_map: str | None = None
    exposure: float = 1.0
    fps: float = 30.0
    frames: int = 1
    effects: dict[str, dict[str, object]] = field(default_factory=dict)
    track: list[ControlKey] = field(default_factory=list)


@dataclass
class Scene:
    """Everything a descriptor or a model file says, composed and resolved.

    situation: the selected variant, which is also the situation that importance is looked up for until a control says
    otherwise. situations: `default` and every variant that could have been selected.
    """

    name: str
    source: Path | None = None
    nodes: list[SceneNode] = field(default_factory=list)
    objects: list[SceneObject] = field(default_factory=list)
    meshes: list[Mesh] = field(default_factory=list)
    materials: list[Material] = field(default_factory=list)
    images: list[Image] = field(default_factory=list)
    lights: list[SceneLight] = field(default_factory=list)
    cameras: list[SceneCamera] = field(default_factory=list)
    tracks: list[Track] = field(default_factory=list)
    dome: Dome = field(default_factory=Dome)
    settings: RenderSettings = field(default_factory=RenderSettings)
    situation: str = "default"
    situations: tuple[str, ...] = ("default",)

    @property
    def triangle_count(self) -> int:
        return sum(len(self.meshes[o.mesh].triangles) for o in self.objects)

    @property
    def duration(self) -> float:
        """Seconds until the last keyframe; 0 for a still scene."""
        return max((float(track.times[-1]) for track in self.tracks if len(track.times)), default=0.0)
