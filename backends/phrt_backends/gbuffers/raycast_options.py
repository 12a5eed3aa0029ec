"""Options of the raycast producer."""

from __future__ import annotations

from pydantic import Field

from phrt.registry import Options


class RaycastOptions(Options):
    chunk_pixels: int = Field(
        16384,
        ge=64,
        le=1 << 20,
        json_schema_extra={"unit": "pixels"},
        description="pixels a thread takes at a time, at most",
    )
