"""Options of the `mitsuba` tracer. Light: nothing here imports Mitsuba."""

from __future__ import annotations

from pydantic import Field

from phrt.registry import Options
from phrt_mitsuba.availability import Device


class MitsubaOptions(Options):
    """Options of the `mitsuba` tracer."""

    device: Device = Field(
        default="auto",
        description="What traces: llvm is the processor, cuda an NVIDIA GPU through OptiX; auto takes the GPU where "
        "there is one that works.",
    )
    robust: bool = Field(
        default=False,
        description="Watertight intersection (llvm only): no ray slips between two triangles that share an edge; slower.",
    )
    threads: int = Field(
        default=0,
        ge=0,
        description="Threads of a query (llvm only); 0 leaves Dr.Jit's own, one for every core. One number for the process.",
    )
