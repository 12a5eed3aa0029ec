"""The built-in heuristics: descriptors only."""

from __future__ import annotations

from phrt.registry import HeuristicPlugin, hookimpl
from phrt_heuristics.options import GainOptions, RandomOptions, SelectionGraphOptions


@hookimpl
def phrt_heuristics() -> list[HeuristicPlugin]:
    return [
        HeuristicPlugin(
            name="selection_graph",
            summary="The paper's: the most relevant that fits, found in a graph by falling cost.",
            factory="phrt_heuristics.selection_graph:SelectionGraph",
            options=SelectionGraphOptions,
        ),
        HeuristicPlugin(
            name="gain",
            summary="What tracing an item was measured to change in the picture, for its price.",
            factory="phrt_heuristics.gain:Gain",
            options=GainOptions,
        ),
        HeuristicPlugin(
            name="greedy_relevance",
            summary="The most relevant item that fits, whatever it costs.",
            factory="phrt_heuristics.greedy_relevance:GreedyRelevance",
        ),
        HeuristicPlugin(
            name="greedy_ratio",
            summary="The most relevance for the price: relevance / predicted cost.",
            factory="phrt_heuristics.greedy_ratio:GreedyRatio",
        ),
        HeuristicPlugin(
            name="uniform",
            summary="A little of everything: every item at the same lower density.",
            factory="phrt_heuristics.uniform:Uniform",
        ),
        HeuristicPlugin(
            name="round_robin",
            summary="Everybody in turn: the item that has waited longest.",
            factory="phrt_heuristics.round_robin:RoundRobin",
        ),
        HeuristicPlugin(
            name="random",
            summary="Any item that fits, in an order drawn anew in every frame.",
            factory="phrt_heuristics.random_order:RandomOrder",
            options=RandomOptions,
        ),
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
