"""random: any item that fits.

Items are taken in an order drawn anew in every frame; one that costs more than what is left is passed over. The floor
that a heuristic has to beat: it spends the same budget and looks at nothing.

An item's number in the draw is a hash of the seed, the frame and the item, so that a frame is reproducible on every machine,
and does not depend on which other items there are.

Options: seed.
Source: splitmix64 for the hash, Steele et al. 2014.

Example::

    phrt render scenes/atrium.yaml -o atrium.png --heuristic random -H seed=3 --budget 200000rays
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt_heuristics.options import RandomOptions
from phrt_heuristics.queue import Queue


class RandomOrder(Heuristic):
    """In the order of a hash of (seed, frame, item)."""

    def __init__(self, options: RandomOptions) -> None:
        self._options = options
        self._queue: Queue | None = None

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        start = splitmix64(splitmix64(np.array([self._options.seed], np.uint64)) ^ np.uint64(context.frame_index))
        self._queue = Queue(candidates, splitmix64(start ^ splitmix64(candidates.keys().astype(np.uint64))))

    def next(self, remaining: float) -> int | None:
        return self._queue.next(remaining) if self._queue else None

    def take(self, remaining: float, enough: float) -> np.ndarray | None:
        return self._queue.take(remaining, enough) if self._queue else None


def splitmix64(x: np.ndarray) -> np.ndarray:
    """A well mixed uint64 for each of `x` (n,) uint64."""
    x = x + np.uint64(0x9E3779B97F4A7C15)
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return np.asarray(x ^ (x >> np.uint64(31)))
