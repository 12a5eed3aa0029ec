"""Who throws caustics, who shows them, and what of both a world holds."""

from __future__ import annotations

import numpy as np

from phrt.materials import ALPHA_BLEND, NO_TEXTURE
from phrt.world import World


def caster_materials(world: World, cutoff: float) -> np.ndarray:
    """(materials,) bool: smooth glass and smooth metal. What a texture alone makes smooth is not aimed at."""
    materials = world.materials
    shiny = (materials["transmission"] > 0) | (materials["metallic"] >= 0.5)
    even = materials["metallic_roughness_texture"] == NO_TEXTURE
    solid = (materials["unlit"] == 0) & (materials["alpha_mode"] != ALPHA_BLEND)
    return np.asarray(shiny & even & solid & (materials["roughness"] <= cutoff))


def receiver_materials(world: World) -> np.ndarray:
    """(materials,) bool: those with a diffuse body, everywhere or, by a texture, in places."""
    materials = world.materials
    body = (materials["metallic"] < 1) | (materials["metallic_roughness_texture"] != NO_TEXTURE)
    opaque = (materials["transmission"] < 1) | (materials["transmission_texture"] != NO_TEXTURE)
    return np.asarray((materials["unlit"] == 0) & body & opaque)


def throwing_lights(world: World) -> np.ndarray:
    """(k,) int64: lights that cast shadows. The others go through glass as if it were not there, and need no caustics."""
    lights = world.lights
    bright = (lights["color"] > 0).any(axis=1)
    return np.flatnonzero((lights["casts_shadow"] != 0) & bright)


def caster_triangles(world: World, cutoff: float) -> np.ndarray:
    """(t,) int64: triangles of glass and mirrors of objects that cast shadows."""
    thrown = caster_materials(world, cutoff)[world.triangle_material]
    return np.flatnonzero(thrown & world.object_casts_shadow[world.triangle_object])


def has_casters(world: World, cutoff: float) -> bool:
    """Is there anything to throw caustics, and a light to throw?"""
    objects = world.object_has(caster_materials(world, cutoff)) & world.object_casts_shadow
    return bool(objects.any()) and len(throwing_lights(world)) > 0


def object_radii(world: World) -> np.ndarray:
    """(N + 1,) float32: half the diagonal of every object's box, metres."""
    low, high = world.object_bounds()
    return np.asarray(np.linalg.norm(high - low, axis=1) / 2, np.float32)
