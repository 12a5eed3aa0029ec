"""Options of the built-in effects."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from phrt.registry import Options


class ShadowsOptions(Options):
    samples: int = Field(
        0,
        ge=0,
        le=256,
        json_schema_extra={"unit": "rays"},
        description="rays to each light with an extent; 0 aims one at its centre: hard shadows",
    )
    fallback: Literal["none", "shadow_map"] = Field(
        "shadow_map", description="what untraced pixels get: no shadow, or a shadow map"
    )
    map_size: int = Field(
        512,
        ge=16,
        le=4096,
        json_schema_extra={"unit": "texels"},
        description="texels along one side of a shadow map's face",
    )
    history: bool = Field(
        True, description="where it is not traced, values of earlier frames stand in as long as they hold"
    )


class ReflectionsOptions(Options):
    max_depth: int = Field(
        3, ge=0, le=16, json_schema_extra={"unit": "bounces"}, description="bounces after the first reflected hit"
    )
    samples: int = Field(
        4,
        ge=1,
        le=256,
        json_schema_extra={"unit": "rays"},
        description="rays per pixel of a glossy surface; mirrors take one",
    )
    roughness_cutoff: float = Field(0.3, ge=0.0, le=1.0, description="rougher surfaces are not traced")
    fallback: Literal["none", "environment", "probe"] = Field(
        "probe", description="what untraced pixels get: nothing, the dome, or a cube map captured at the object"
    )
    probe_size: int = Field(
        64, ge=8, le=512, json_schema_extra={"unit": "texels"}, description="texels along one side of a probe's face"
    )
    history: bool = Field(
        True, description="where it is not traced, values of earlier frames stand in as long as they hold"
    )


class RefractionsOptions(Options):
    max_depth: int = Field(
        6,
        ge=0,
        le=32,
        json_schema_extra={"unit": "bounces"},
        description="bounces after the first hit behind the surface",
    )
    fallback: Literal["none", "environment", "alpha", "probe"] = Field(
        "probe",
        description="what untraced pixels get: nothing, the dome, what lies straight behind, or a cube map where it is round and "
        "solid",
    )
    probe_size: int = Field(
        64, ge=8, le=512, json_schema_extra={"unit": "texels"}, description="texels along one side of a probe's face"
    )
    history: bool = Field(
        True, description="where it is not traced, values of earlier frames stand in as long as they hold"
    )


class AmbientOcclusionOptions(Options):
    samples: int = Field(4, ge=1, le=256, json_schema_extra={"unit": "rays"}, description="rays per pixel")
    radius: float = Field(
        1.0, gt=0.0, json_schema_extra={"unit": "metres"}, description="how far an occluder counts, metres"
    )
    fallback: Literal["constant", "screen_space"] = Field(
        "constant",
        description="what untraced pixels get: `fallback_value`, or what the picture itself knows of what is near",
    )
    fallback_value: float = Field(1.0, ge=0.0, le=1.0, description="of the fallback `constant`; 1 is unoccluded")
    history: bool = Field(
        True, description="where it is not traced, values of earlier frames stand in as long as they hold"
    )
