"""The built-in heuristics: descriptors only."""

from __future__ import annotations

from phrt.registry import HeuristicPlugin, hookimpl


@hookimpl
def phrt_heuristics() -> list[HeuristicPlugin]:
    return [
        HeuristicPlugin(
            name="all_trace",
            summary="Traces every item: the best picture the effects can give, at full price.",
            factory="phrt_heuristics.all_trace:AllTrace",
        ),
        HeuristicPlugin(
            name="raster_only",
            summary="Traces nothing: every effect shows its fallback, as a plain rasterizer would.",
            factory="phrt_heuristics.raster_only:RasterOnly",
        ),
    ]
