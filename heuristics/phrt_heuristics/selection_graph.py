"""selection_graph: the heuristic of the paper.

Items are the nodes of a graph, in order of falling cost, and every node points to the N most relevant nodes that cost no more
and are more relevant. To select, the graph is walked from its head to the first node whose cost fits what is left (<=); every
dearer node passed on the way moves to the graph under construction for the next frame. From the node found, pointers to more
relevant nodes are followed until there is none; that node is traced. When nothing fits, all remaining nodes move.

The cost of a node is what its item is predicted to take, in the budget's unit, because it is held against the budget; the
paper's C = V Q has no unit. Mandatory items are no nodes: they are selected before the graph is walked, by falling relevance.

The paper does not say whether pointers are updated after a selection. With `refresh_pointers` they are ("the current selection
graph is updated for the next selection", Figure 3), and then the node selected is always the most relevant that still fits,
whatever N is. Without, nodes that were traced leave gaps that a walk cannot cross once all N pointers of a node are gone.

`moved` holds the items that moved to the next graph in this frame, in the order they moved.

Options: n_pointers, refresh_pointers.
Source: Andrade et al. 2014, section 4.2, phases 3 to 5, and section 4.3.

Example::

    phrt render scenes/atrium.yaml -o walk.mp4 --heuristic selection_graph -H refresh_pointers=false --budget 200000rays
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt_heuristics.graph import Graph
from phrt_heuristics.options import SelectionGraphOptions
from phrt_heuristics.queue import Queue


class SelectionGraph(Heuristic):
    """Mandatory items, then the graph of the others."""

    def __init__(self, options: SelectionGraphOptions) -> None:
        self._options = options
        self._mandatory: Queue | None = None
        self._graph: Graph | None = None

    @property
    def moved(self) -> list[int]:
        """Rows of the candidates that moved to the graph of the next frame so far."""
        return [] if self._graph is None else self._graph.moved

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self._mandatory = Queue(candidates, -candidates.predicted_cost, -candidates.relevance, mandatory_only=True)
        pointers = None if self._options.refresh_pointers else self._options.n_pointers
        self._graph = Graph(candidates, pointers)

    def next(self, remaining: float) -> int | None:
        if self._mandatory is not None:
            if (item := self._mandatory.next(remaining)) is not None:
                return item
            self._mandatory = None
        return None if self._graph is None else self._graph.select(remaining)

    def take(self, remaining: float, enough: float) -> np.ndarray | None:
        if self._mandatory is not None:
            if len(items := self._mandatory.take(remaining, enough)):
                return items
            self._mandatory = None
        return None if self._graph is None else self._graph.take(remaining, enough)

    def end_frame(self) -> None:
        if self._graph is not None:
            self._graph.move_all()
