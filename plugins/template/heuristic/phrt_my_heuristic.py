"""my_heuristic: what is large and near is traced first.

Items are taken by falling area / distance ** power, mandatory ones before all others; one that does not fit is passed over.

Options: power. Example: phrt render SCENE -o out.png --heuristic my_heuristic -H power=2 --budget 200000rays
"""

import numpy as np
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.registry import HeuristicPlugin, Options, hookimpl
from pydantic import Field


class MyHeuristicOptions(Options):
    power: float = Field(default=1.0, ge=0.0, le=8.0, description="How much distance counts against the visible area.")


class MyHeuristic(Heuristic):
    """By falling area / distance ** power; what does not fit is passed over."""

    def __init__(self, options: MyHeuristicOptions) -> None:
        self.options = options

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        score = candidates.area / candidates.distance**self.options.power
        order = np.lexsort((candidates.keys(), -score, ~candidates.mandatory))
        self.costs, self.queue = candidates.predicted_cost, iter(order.tolist())

    def next(self, remaining: float) -> int | None:
        return next((item for item in self.queue if self.costs[item] <= remaining), None)


@hookimpl
def phrt_heuristics() -> list[HeuristicPlugin]:
    factory = f"{__name__}:MyHeuristic"
    return [HeuristicPlugin("my_heuristic", "What is large and near first.", factory, MyHeuristicOptions)]
