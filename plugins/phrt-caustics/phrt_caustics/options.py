"""Options of the effect `caustics`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from phrt.registry import Options


class CausticsOptions(Options):
    photons_per_pixel: float = Field(
        0.25, gt=0.0, le=1024.0, description="photons sent to glass and mirrors, for every pixel of the picture"
    )
    max_depth: int = Field(8, ge=1, le=64, description="mirror and glass surfaces that a photon may meet on its way")
    roughness_cutoff: float = Field(
        0.3, ge=0.0, le=1.0, description="rougher glass and metal gathers no light worth following"
    )
    smoothing: float = Field(
        2.8,
        ge=0.5,
        le=16.0,
        description="radius of a photon's splat, in distances between photons where it lies",
        json_schema_extra={"unit": "distances"},
    )
    max_radius: float | None = Field(
        None,
        gt=0.0,
        description="no splat is larger; by default half as large as what threw the photon",
        json_schema_extra={"unit": "metres"},
    )
    fallback: Literal["none", "coarse"] = Field(
        "coarse", description="what untraced pixels get: nothing, or the splats of a sixteenth of the photons"
    )
    history: bool = Field(
        True, description="where it is not traced, values of earlier frames stand in as long as they hold"
    )
