"""Options of the built-in G-buffer producers and tracers. Light: nothing here imports a backend."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from phrt.registry import Options


class EmbreeOptions(Options):
    """Options of the `embree` tracer."""

    binding: Literal["auto", "packets", "embreex"] = Field(
        default="auto",
        description="How Embree is called: packets of 16 rays through its C interface, or embreex's own `run`; "
        "auto takes packets where the library allows.",
    )
    build_quality: Literal["low", "medium", "high"] = Field(
        default="high",
        description="Work spent on the BVH (packets only): high takes twice as long to build as medium, and rays that "
        "are not coherent are up to a fifth faster.",
    )
    robust: bool = Field(
        default=False,
        description="Watertight intersection: no ray slips between two triangles that share an edge; slower.",
    )


class Open3dOptions(Options):
    """Options of the `open3d` tracer."""

    threads: int = Field(
        default=0,
        ge=0,
        json_schema_extra={"unit": "threads"},
        description="Threads of one query; 0 lets Open3D use all cores.",
    )


class NumpyOptions(Options):
    """Options of the `numpy` tracer."""

    leaf_size: int = Field(
        default=8,
        ge=1,
        le=1024,
        json_schema_extra={"unit": "triangles"},
        description="Most triangles in a leaf of the BVH.",
    )
