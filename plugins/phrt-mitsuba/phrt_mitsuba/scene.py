"""A world as Mitsuba scenes to path trace: one mesh a material, in world space, as the world is now.

What is not expressible is left out, and named in one warning. What is different in Mitsuba is in `phrt_mitsuba.materials` and
`phrt_mitsuba.lights`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from phrt.model import Material
from phrt_mitsuba.lights import emitters
from phrt_mitsuba.materials import Materials, absorbed_inside, lets_light_pass
from phrt_mitsuba.ply import write_ply
from phrt_mitsuba.surfaces import surface_class
from phrt_mitsuba.textures import Textures

if TYPE_CHECKING:
    from phrt.world import World

SHOWN_SLOTS = (
    "base_color_texture",
    "metallic_roughness_texture",
    "normal_texture",
    "emissive_texture",
    "transmission_texture",
)
"""Textures that path tracing has a use for; baked occlusion it finds by itself."""


@dataclass(frozen=True)
class PathScenes:
    """lit     : by its lights and the dome; what surfaces emit is not in it
    glowing    : what surfaces emit alone, seen as it is, in mirrors and through glass; None where nothing emits
    passing    : are there surfaces that light passes on a straight way, in part at least?
    notes      : what the scene has and these have not
    """

    lit: Any
    glowing: Any | None
    passing: bool
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Part:
    """The triangles of one material that do, or do not, cast shadows; their mesh in a file."""

    material: Material
    casts_shadow: bool
    normal_mapped: bool
    file: str


def make_scenes(mitsuba: Any, world: World) -> PathScenes:
    """The scenes of `world`. mitsuba: the package, its variant set."""
    notes: set[str] = set()
    textures = Textures(mitsuba, world.scene.images, notes)
    with tempfile.TemporaryDirectory(prefix="phrt-mitsuba-") as folder:
        parts = list(world_parts(world, Path(folder), notes))
        lit = mitsuba.load_dict(
            {"type": "scene", **shapes(mitsuba, parts, Materials(textures)), **emitters(mitsuba, world)}
        )
        glowing = None
        black = Materials(textures, glowing=True)
        if any(black.emission(part.material) is not None for part in parts):
            glowing = mitsuba.load_dict({"type": "scene", **shapes(mitsuba, parts, black)})
    passing = any(lets_light_pass(part.material) or not part.casts_shadow for part in parts)
    return PathScenes(lit, glowing, passing, tuple(sorted(notes)))


def shapes(mitsuba: Any, parts: list[Part], materials: Materials) -> dict[str, Any]:
    """`parts` by name, for `load_dict`."""
    found = {}
    for number, part in enumerate(parts):
        bsdf: Any = materials.bsdf(part.material, normal_mapped=part.normal_mapped)
        shape: dict[str, Any] = {"type": "ply", "filename": part.file}
        absorbed = absorbed_inside(part.material)
        if any(absorbed) or not part.casts_shadow:
            bsdf = surface_class(mitsuba.variant())(mitsuba.load_dict(bsdf), absorbed, part.casts_shadow)
        if materials.glowing and (radiance := materials.emission(part.material)) is not None:
            if part.material.double_sided:
                materials.textures.notes.add("the backs of surfaces that glow on both sides")
            shape["emitter"] = {"type": "area", "radiance": radiance}
        found[f"part{number}"] = {**shape, "bsdf": bsdf}
    return found


def world_parts(world: World, folder: Path, notes: set[str]) -> Iterator[Part]:
    """The parts of `world`, their meshes written into `folder`."""
    defined = [Material(), *world.scene.materials]
    casts = world.object_casts_shadow[world.triangle_object]
    group = world.triangle_material * 2 + casts
    for key in np.unique(group):
        row, casting = divmod(int(key), 2)
        faces = world.triangles[group == key]
        used = np.zeros(len(world.positions), bool)
        used[faces] = True
        corners = np.flatnonzero(used)
        renumbered = (np.cumsum(used) - 1)[faces]
        if len(world.colors) and (world.colors[corners] != 1).any():
            notes.add("colours of vertices")
        path = folder / f"part{int(key)}.ply"
        uv = texture_coordinates(world, defined[row], corners, notes)
        write_ply(path, world.positions[corners], renumbered, world.normals[corners], uv)
        normal_mapped = bool(len(world.tangents)) and bool(world.tangents[corners, :3].any())
        yield Part(defined[row], bool(casting), normal_mapped, str(path))


def texture_coordinates(world: World, material: Material, corners: np.ndarray, notes: set[str]) -> np.ndarray | None:
    """(n, 2) of the vertices `corners` (n,), of the set that the material's textures use; None where it has none."""
    sets = [ref.uv_set for slot in SHOWN_SLOTS if (ref := getattr(material, slot)) is not None]
    if not sets:
        return None
    if len(set(sets)) > 1 and len(world.uv1):
        notes.add("second texture coordinates of a material that uses both")
    return np.asarray((world.uv1 if sets[0] and len(world.uv1) else world.uv0)[corners])
