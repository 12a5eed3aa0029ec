"""What this package has: descriptors only."""

from __future__ import annotations

from phrt.registry import HeuristicPlugin, MetricPlugin, hookimpl
from phrt_saliency.options import SaliencyErrorOptions, SaliencyOptions


@hookimpl
def phrt_heuristics() -> list[HeuristicPlugin]:
    return [
        HeuristicPlugin(
            name="saliency",
            summary="What stands out to the eye: the paper's relevance, with the area counted in saliency.",
            factory="phrt_saliency.heuristic:Saliency",
            options=SaliencyOptions,
        )
    ]


@hookimpl
def phrt_metrics() -> list[MetricPlugin]:
    return [
        MetricPlugin(
            name="saliency_error",
            summary="Error of the display where the reference stands out to the eye.",
            factory="phrt_saliency.metric:SaliencyError",
            options=SaliencyErrorOptions,
        )
    ]
