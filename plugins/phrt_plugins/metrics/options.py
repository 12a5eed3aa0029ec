"""Options of the built-in metrics."""

from __future__ import annotations

from pydantic import Field

from phrt.registry import Options


class FlipOptions(Options):
    pixels_per_degree: float = Field(
        67.020643,
        ge=5.0,
        le=500.0,
        json_schema_extra={"unit": "pixels per degree"},
        description="of the viewer's visual field: 0.7 m from a display of 0.7 m with 3840 pixels",
    )


class RelMseOptions(Options):
    epsilon: float = Field(
        0.01, gt=0.0, le=100.0, description="added to the reference squared, so that black pixels do not decide alone"
    )
