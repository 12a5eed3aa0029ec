"""A world's triangles as Mitsuba scenes: what stands still and what moves, apart.

A scene of Mitsuba has no ray masks and rebuilds the whole of its BVH when any of its shapes changes. So a world becomes
two layers of one mesh each, and moving an object rebuilds only the layer of movers; and where an object casts no shadow,
a layer has a second scene of its shadow casters. Positions are those of the world: no instances, no transforms.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from phrt.world import World


@dataclass(frozen=True)
class Layer:
    """Some objects of a world.

    scene      : all their triangles
    casters    : the triangles that cast a shadow: `scene` itself where all do, None where none does
    world_rows : a Dr.Jit array, the row in `World.triangles` of each triangle of `scene`; None where they are the same
    """

    scene: Any
    casters: Any | None
    world_rows: Any | None


def make_layer(mitsuba: Any, world: World, objects: np.ndarray, robust: bool) -> Layer | None:
    """The layer of `objects` (n,) 1-based ids, None where they have no triangles. mitsuba: a variant's module."""
    chosen = np.zeros(len(world.triangle_count), bool)
    chosen[objects] = True
    rows = np.flatnonzero(chosen[world.triangle_object])
    if not len(rows):
        return None
    casting = rows[world.object_casts_shadow[world.triangle_object[rows]]]
    scene = make_scene(mitsuba, world, rows, robust)
    casters = (
        scene if len(casting) == len(rows) else make_scene(mitsuba, world, casting, robust) if len(casting) else None
    )
    world_rows = None if len(rows) == len(world.triangles) else mitsuba.UInt32(rows.astype(np.uint32))
    return Layer(scene, casters, world_rows)


def make_scene(mitsuba: Any, world: World, rows: np.ndarray, robust: bool) -> Any:
    """A Mitsuba scene of one mesh: triangles `rows` (n,) of the world, in this order; its arrays are copies."""
    # Not through `load_dict`, which makes what the variant of the moment asks for: that one may be another's.
    from mitsuba import Properties, traverse

    positions, faces = own_mesh(world, rows)
    mesh = mitsuba.Mesh("world", len(positions), len(faces))
    parameters = traverse(mesh)
    parameters["vertex_positions"] = mitsuba.Float(positions.reshape(-1))
    parameters["faces"] = mitsuba.UInt32(faces.reshape(-1))
    parameters.update()
    properties = Properties("scene")
    properties["embree_use_robust_intersections"] = robust
    properties["world"] = mesh
    return mitsuba.Scene(properties)


def own_mesh(world: World, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (v, 3) float32 and triangles (n, 3) uint32 of triangles `rows`, and no vertices that they do not use.

    Copies, for the world rewrites its own in place; and a vertex more is allocated, for Embree reads past the last one.
    """
    if len(rows) == len(world.triangles):
        corners, faces = np.arange(len(world.positions)), world.triangles
    else:
        corners, faces = np.unique(world.triangles[rows], return_inverse=True)
    padded = np.zeros((len(corners) + 1, 3), np.float32)
    padded[:-1] = world.positions[corners]
    return padded[:-1], faces.reshape(-1, 3).astype(np.uint32)
