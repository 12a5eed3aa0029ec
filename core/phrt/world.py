"""The scene at a time, as the flat arrays that tracers, G-buffer producers and kernels work on.

Positions and normals are in world space; a moving object's rows are rewritten in place by `advance`, and `Changes`
says which, so that backends touch nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phrt.animation import Animator
from phrt.camera import CameraView
from phrt.environment import Environment
from phrt.geometry import FlatGeometry, flatten
from phrt.lights import light_table
from phrt.materials import ALPHA_BLEND, ALPHA_MASK, material_table, texture_refs
from phrt.scene import Scene
from phrt.textures import TextureAtlas, build_atlas


@dataclass(frozen=True)
class Changes:
    """What moved between two times. objects: 1-based ids whose transform changed; lights: whether any light did.

    turned: those of `objects` whose transform began or ceased to mirror; their rows of `World.triangles` were rewritten.
    """

    objects: tuple[int, ...] = ()
    lights: bool = False
    turned: tuple[int, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.objects) or self.lights


class World:
    """One scene at one time. Object and material arrays have a row 0 for the background and the default material.

    Geometry (V vertices, T triangles, N objects; world space):
      positions (V, 3) float32; normals (V, 3) float32 unit; tangents (V, 4) float32, or (0, 4) when nothing is normal-mapped;
      uv0 (V, 2) float32; uv1 (V, 2) float32, or (0, 2); colors (V, 4) float32, or (0, 4) when all are white;
      triangles (T, 3) int32; triangle_object (T,) int32, 1-based; triangle_material (T,) int32, row of `materials`;
      triangle_lod (T,) float32, log2 of texture-space per world-space length of uv0 (times 0.5 of the areas' ratio).
    Objects: first_vertex, vertex_count, first_triangle, triangle_count (N + 1,) int32: objects own contiguous ranges;
      object_matrix (N + 1, 4, 4) float64, world_from_local; object_casts_shadow, object_opaque (N + 1,) bool.
      moving_objects: 1-based ids of those that the scene's animation may move; any other may still be placed by hand.
      local_positions (V, 3) float32: object space, what `object_matrix` moves.
    has_cutouts: does any surface have holes that rays must pass through (alpha mask or blend)?
    materials: MATERIAL_DTYPE (M + 1,); textures: TextureAtlas; lights: LIGHT_DTYPE (L,); environment: Environment.
    kept: what effects keep of this world together, under names of their own; it should not refer back to the world.
    """

    def __init__(self, scene: Scene, time: float = 0.0) -> None:
        self.scene = scene
        self.time = time
        refs = texture_refs(scene.materials)
        self.textures: TextureAtlas = build_atlas(scene.images, refs)
        self.materials = material_table(scene.materials, self.textures.rows)
        self.animator = Animator(scene)
        self.node_matrix = self.animator.world_from_node(time)
        self.overrides: dict[int, np.ndarray] = {}
        geometry: FlatGeometry = flatten(scene, self.node_matrix)
        self.geometry = geometry
        self.positions = geometry.positions
        self.normals = geometry.normals
        self.tangents = geometry.tangents
        self.uv0, self.uv1, self.colors = geometry.uv0, geometry.uv1, geometry.colors
        self.triangles = geometry.triangles
        self.triangle_object = geometry.triangle_object
        self.triangle_material = geometry.triangle_material
        self.triangle_lod = geometry.triangle_lod
        self.local_positions = geometry.local_positions
        self.first_vertex, self.vertex_count = geometry.first_vertex, geometry.vertex_count
        self.first_triangle, self.triangle_count = geometry.first_triangle, geometry.triangle_count

        animated = self.animator.moves(geometry.object_node[1:])
        self.moving_objects: tuple[int, ...] = tuple((np.flatnonzero(animated) + 1).tolist())
        self.object_casts_shadow = np.array([False, *(o.casts_shadow for o in scene.objects)])
        self.object_materials = object_material_mask(geometry, len(self.materials))
        self.object_opaque = ~self.object_has(self.material_lets_light_through())
        self.lights = light_table(scene.lights, self.node_matrix)
        self.environment = Environment.from_dome(scene.dome)
        self.has_cutouts = self._has_cutouts()
        self.kept: dict[object, object] = {}

    @property
    def object_matrix(self) -> np.ndarray:
        """(N + 1, 4, 4) float64 world_from_local of every object now."""
        return self.geometry.object_matrix

    @property
    def object_count(self) -> int:
        """Objects of the scene, the background not counted."""
        return len(self.scene.objects)

    def _has_cutouts(self) -> bool:
        """Does any surface have holes that rays must pass through (alpha mask or blend)?"""
        used = self.object_materials.any(axis=0)
        return bool(np.any(used & np.isin(self.materials["alpha_mode"], (ALPHA_MASK, ALPHA_BLEND))))

    def material_lets_light_through(self) -> np.ndarray:
        """(materials,) bool: transmissive or alpha-blended."""
        return (self.materials["transmission"] > 0) | (self.materials["alpha_mode"] == ALPHA_BLEND)

    def object_has(self, material_mask: np.ndarray) -> np.ndarray:
        """(N + 1,) bool: does the object use any material of `material_mask` (materials,)?"""
        return (self.object_materials & material_mask[None, :]).any(axis=1)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest corner (3,) float32 of all geometry; a unit box around the origin for an empty scene."""
        if not len(self.positions):
            return np.full(3, -0.5, np.float32), np.full(3, 0.5, np.float32)
        return self.positions.min(axis=0), self.positions.max(axis=0)

    def object_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """(N + 1, 3) float32 smallest and largest corners of every object in world space; row 0 is zero."""
        return self.geometry.object_bounds()

    def set_object_matrix(self, object_id: int, matrix: np.ndarray | None) -> None:
        """Place an object at `matrix` (4, 4) world_from_local from the next `advance` on; None gives it back to its node."""
        if matrix is None:
            self.overrides.pop(object_id, None)
        else:
            self.overrides[object_id] = np.asarray(matrix, dtype=np.float64)

    def advance(self, time: float) -> Changes:
        """Move to `time` seconds, rewrite what moved in place, and say what it was."""
        self.time = time
        self.node_matrix = self.animator.world_from_node(time)
        moved, turned = self.geometry.move(self.node_matrix, self.overrides)
        lights = light_table(self.scene.lights, self.node_matrix)
        lights_changed = lights.tobytes() != self.lights.tobytes()
        self.lights = lights
        return Changes(objects=tuple(moved), lights=lights_changed, turned=tuple(turned))

    def view(self, width: int, height: int, camera: int = 0) -> CameraView:
        """The view of scene camera number `camera` at the current time."""
        entry = self.scene.cameras[camera]
        return CameraView.from_lens(entry.lens, self.node_matrix[entry.node], width, height)


def object_material_mask(geometry: FlatGeometry, material_count: int) -> np.ndarray:
    """(N + 1, materials) bool: which materials an object's triangles use."""
    mask = np.zeros((len(geometry.first_triangle), material_count), dtype=bool)
    mask[geometry.triangle_object, geometry.triangle_material] = True
    return mask
