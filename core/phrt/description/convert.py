"""Prims as the plain data of `phrt.model` and `phrt.scene`."""

from __future__ import annotations

import math
from dataclasses import replace

from phrt.budget import parse_budget
from phrt.controls import ControlKey, Controls
from phrt.description.prims import (
    CameraOver,
    CameraPrim,
    DistantLightPrim,
    LightOver,
    MaterialPrim,
    RectLightPrim,
    RenderSettingsPrim,
    SphereLightPrim,
    TrackKey,
)
from phrt.materials import TEXTURE_SLOTS
from phrt.model import CameraLens, Light, Material
from phrt.scene import RenderSettings

SAME_NAMED = (
    "metallic",
    "roughness",
    "specular",
    "ior",
    "transmission",
    "thickness",
    "attenuation_color",
    "attenuation_distance",
    "emissive",
    "alpha_mode",
    "alpha_cutoff",
    "double_sided",
    "unlit",
    "normal_scale",
    "occlusion_strength",
)
"""Material attributes that are called the same in the description and in `phrt.model.Material`."""

LightPrim = SphereLightPrim | DistantLightPrim | RectLightPrim


def changed_material(material: Material, prim: MaterialPrim) -> Material:
    """`material` with every attribute that `prim` gives, textures aside."""
    given = prim.model_fields_set
    changes = {name: getattr(prim, name) for name in SAME_NAMED if name in given}
    color = prim.base_color if "base_color" in given else material.base_color[:3]
    alpha = prim.opacity if "opacity" in given else material.base_color[3]
    return replace(material, base_color=(color[0], color[1], color[2], alpha), **changes)


def texture_slots(prim: MaterialPrim) -> list[str]:
    """Texture attributes that `prim` gives."""
    return [slot for slot in TEXTURE_SLOTS if slot in prim.model_fields_set]


def light_of(prim: LightPrim, name: str, casts_shadow: bool) -> Light:
    common = Light("point", name, prim.color, prim.intensity, casts_shadow=casts_shadow)
    if isinstance(prim, DistantLightPrim):
        return replace(common, kind="directional", angle=math.radians(prim.angle))
    if isinstance(prim, RectLightPrim):
        return replace(common, kind="rect", size=(prim.width, prim.height))
    if prim.cone is not None:
        inner, outer = math.radians(prim.cone.inner), math.radians(prim.cone.outer)
        return replace(common, kind="spot", radius=prim.radius, range=prim.range, inner_angle=inner, outer_angle=outer)
    return replace(common, kind="sphere" if prim.radius > 0 else "point", radius=prim.radius, range=prim.range)


def changed_light(light: Light, over: LightOver, casts_shadow: bool) -> Light:
    changes = {name: value for name in ("color", "intensity", "radius") if (value := getattr(over, name)) is not None}
    return replace(light, casts_shadow=light.casts_shadow and casts_shadow, **changes)


def lens_of(prim: CameraPrim, name: str) -> CameraLens:
    return CameraLens(
        name=name,
        fov_y=math.radians(prim.fov),
        near=prim.near,
        far=prim.far,
        ortho_height=prim.orthographic,
        exposure=prim.exposure,
    )


def changed_lens(lens: CameraLens, over: CameraOver) -> CameraLens:
    changes = {name: value for name in ("near", "far", "exposure") if (value := getattr(over, name)) is not None}
    if over.fov is not None:
        changes["fov_y"] = math.radians(over.fov)
    return replace(lens, **changes)


def settings_of(prim: RenderSettingsPrim) -> RenderSettings:
    return RenderSettings(
        size=prim.size,
        heuristic=prim.heuristic,
        tone_map=prim.tone_map,
        exposure=prim.exposure,
        fps=prim.fps,
        frames=prim.frames,
        effects={name: dict(options) for name, options in prim.effects.items()},
        track=[ControlKey(key.time, controls_of(key)) for key in prim.track],
    )


def controls_of(key: TrackKey) -> Controls:
    return Controls(
        budget=None if key.budget is None else parse_budget(key.budget),
        persistence=key.persistence,
        situation=key.situation,
        attention=key.attention,
        view_speed=key.view_speed,
        parameters=key.parameters,
    )
