"""What this package brings to PHRT: descriptors only, Mitsuba is not imported."""

from __future__ import annotations

from phrt.registry import TracerPlugin, hookimpl
from phrt_mitsuba.availability import unavailable_reason
from phrt_mitsuba.options import MitsubaOptions


@hookimpl
def phrt_tracers() -> list[TracerPlugin]:
    return [
        TracerPlugin(
            name="mitsuba",
            summary="Mitsuba 3: Embree driven by LLVM code on the processor, OptiX on an NVIDIA GPU.",
            factory="phrt_mitsuba.tracer:MitsubaTracer",
            options=MitsubaOptions,
            unavailable_reason=unavailable_reason,
        )
    ]
