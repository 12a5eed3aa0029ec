"""all_trace: trace everything.

Every item is traced, mandatory ones first, the others in the order of the candidates. This is the picture that the
scene's effects can give at full price: the yardstick that every selecting heuristic is measured against.

Options: none.
Budget: it is not looked at; the scheduler stops the frame when its own budget is spent.
Source: the all-ray-traced side of the comparisons in Andrade et al. 2014, section 5.

Example::

    phrt render scenes/atrium.yaml -o atrium.png --heuristic all_trace
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.registry import Options


class AllTrace(Heuristic):
    """Yields every candidate once."""

    def __init__(self, options: Options) -> None:
        self._order: Iterator[int] = iter(())

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        # A stable sort keeps the order of the candidates among equals.
        order = np.argsort(~candidates.mandatory, kind="stable")
        self._order = iter(order.tolist())

    def next(self, remaining: float) -> int | None:
        return next(self._order, None)
