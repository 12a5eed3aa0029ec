"""What a picture of a scene would lack, said before it is rendered; and places no picture can be made of."""

from __future__ import annotations

import numpy as np

from phrt.description.framing import world_matrices
from phrt.description.layers import DESCRIPTOR_SUFFIXES
from phrt.errors import SceneError
from phrt.scene import Scene

LARGEST_PLACE = 1e18
"""Metres. Areas of larger triangles do not fit into float32."""

SMALLEST_SIZE = 1e-12
"""Metres. What is smaller in two directions is nothing."""


def check_places(scene: Scene) -> None:
    """Raises SceneError that names the first object, camera or light whose place or size at time 0 is beyond
    `LARGEST_PLACE`: transforms multiply, and each one alone may look harmless."""
    with np.errstate(all="ignore"):
        matrices = world_matrices(scene)
        size = np.array([_extent(scene, index) for index in range(len(scene.meshes))])
        placed = [(entry.path, entry.node, float(size[entry.mesh])) for entry in scene.objects]
        placed += [(camera.path, camera.node, 0.0) for camera in scene.cameras]
        placed += [(light.path, light.node, 0.0) for light in scene.lights]
        for path, node, extent in placed:
            matrix = matrices[node]
            reach = np.abs(matrix[:3, :3]).sum() * max(extent, 1.0) + np.abs(matrix[:3, 3]).max()
            if not reach <= LARGEST_PLACE:
                raise SceneError(
                    f"{scene.source or scene.name}: {path}: its transforms together place or scale it beyond "
                    f"{LARGEST_PLACE:g} m"
                )


def lacking(scene: Scene) -> list[str]:
    """Why the picture may be emptier than meant: nothing to draw, no light, or objects without a size."""
    name = scene.source or scene.name
    if not scene.triangle_count and scene.source and scene.source.suffix.lower() not in DESCRIPTOR_SUFFIXES:
        # The loader of a model file has said so.
        return []
    if not scene.triangle_count:
        return [f"{name}: has nothing to draw; the picture shows the background only"]
    messages = []
    flat = _flattened(scene)
    if flat:
        others = f" and {len(flat) - 1} more" if len(flat) > 1 else ""
        messages.append(f"{name}: {flat[0]}{others}: no larger than {SMALLEST_SIZE:g} m, and not seen")
    if not _lit(scene):
        messages.append(f"{name}: has no light, and nothing in it glows; the picture is black")
    return messages


def _lit(scene: Scene) -> bool:
    if any(any(entry.light.color) and entry.light.intensity > 0 for entry in scene.lights) or any(scene.dome.color):
        return True
    used = {int(number) for entry in scene.objects for number in np.unique(scene.meshes[entry.mesh].triangle_material)}
    return any(scene.materials[number].unlit or any(scene.materials[number].emissive) for number in used if number >= 0)


def _flattened(scene: Scene) -> list[str]:
    """Paths of objects that are but a line or a point at rest; none that move, as they may grow."""
    if not scene.objects:
        return []
    moving = {track.node for track in scene.tracks}
    for number, node in enumerate(scene.nodes):
        if node.parent in moving:
            moving.add(number)
    still = [entry for entry in scene.objects if entry.node not in moving]
    matrices = world_matrices(scene)[[entry.node for entry in still]]
    width = np.linalg.svd(matrices[:, :3, :3], compute_uv=False)[:, 1] if still else np.zeros(0)
    return [
        entry.path
        for entry, factor in zip(still, width, strict=True)
        if factor * _extent(scene, entry.mesh) < SMALLEST_SIZE
    ]


def _extent(scene: Scene, mesh: int) -> float:
    """The largest coordinate of a mesh, in its own space."""
    positions = scene.meshes[mesh].positions
    return float(np.abs(positions).max()) if len(positions) else 0.0
