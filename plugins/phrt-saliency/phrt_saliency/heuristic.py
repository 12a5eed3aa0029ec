"""saliency: what stands out to the eye is traced first.

The picture that was rasterized is looked at before anything is traced, and a map is made of what stands out in it: in brightness,
colour or direction, against its surround (Itti et al. 1998). In the paper's equations the saliency takes the place of
the area: with the share A' of the picture's saliency that lies on an object's pixels,

    V' = A' P / D        in place of V = A P / D, eq. (1) of Andrade et al. 2014
    R' = (S I + V') K    in place of R = (S I + V) K, eq. (3)

With `weight` below 1 it is a mean of both areas: A' weight + A (1 - weight). Where nothing stands out, A' is A and R' is R.
Without `place` V' is the area alone. Mandatory items come first. The others are taken, by `choose`,

- `levels`: in parts. Each pass (one pixel of each 2x2 block) is worth R' times the error that it takes away from the gaps that are
  filled, and passes are taken by falling worth / predicted cost, so that what stands out gets more rays a pixel, as in selective
  rendering (Yee et al. 2001);
- `ratio`: whole, by falling R' / predicted cost, the classic rule of a knapsack (Funkhouser and Sequin 1993);
- `relevance`: whole, by falling R', which is what the paper's selection graph with refreshed pointers comes to.

What does not fit is passed over.

A'/A of an object follows the map slowly (`settle_frames`), so that choices do not flicker with it. It is one value an object,
whichever effect it is for: the map is of the picture without rays, and cannot know what an effect will add.

Options: weight, place, choose, settle_frames, map_width, intensity, color, orientation.
Source: Itti et al. 1998 for the map; its use for rendering after Yee et al. 2001 and Longhurst et al. 2006; R of Andrade et al.
2014. Ours: A'.

Example::

    phrt render scenes/atrium.yaml -o atrium.png --heuristic saliency -H weight=0.5 --budget 200000rays
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic, Request
from phrt.output.tonemap import to_8bit
from phrt_heuristics.queue import Queue
from phrt_saliency.levels import Levels
from phrt_saliency.model import saliency
from phrt_saliency.options import SaliencyOptions


class Saliency(Heuristic):
    """In parts, see `Levels`; or whole, by falling R' / predicted cost or by falling R', of equals the dearer one."""

    def __init__(self, options: SaliencyOptions) -> None:
        self._options = options
        self._line: Queue | Levels | None = None
        self._map = np.zeros((1, 1), np.float32)
        self._ratio = np.zeros(0, np.float32)
        self._visible = np.zeros(0, bool)
        # Kernels are compiled, or read from their cache, before the first frame and not in its time.
        saliency(np.zeros((9, 16, 3), np.float32))

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        ratio = self._follow(self._look(context), candidates, first=context.sample == 0)
        relevance = weighed(candidates, ratio, self._options.weight, place=self._options.place)
        price = candidates.predicted_cost.astype(np.float64)
        worth = relevance if self._options.choose == "relevance" else relevance / price
        self.scores = worth.astype(np.float32)
        if self._options.choose == "levels":
            self._line = Levels(candidates, relevance.astype(np.float64))
            return
        self._line = Queue(candidates, -price, -worth)

    def next(self, remaining: float) -> int | Request | None:
        return self._line.next(remaining) if self._line else None

    def take(self, remaining: float, enough: float) -> np.ndarray | None:
        return self._line.take(remaining, enough) if self._line else None

    def _look(self, context: FrameContext) -> np.ndarray:
        """(N + 1,) float32: A'/A of every object in this frame, the saliency of its pixels over that of the picture; 1 where
        nothing stands out. Sub-pixel samples share the map of the first."""
        if context.sample == 0:
            display = to_8bit(context.picture(self._options.map_width))
            self._map = saliency(display, self._options.weights).saliency
        means, of_picture = context.object_means(self._map), float(self._map.mean())
        return means / np.float32(of_picture) if of_picture > 0 else np.ones_like(means)

    def _follow(self, now: np.ndarray, candidates: Candidates, *, first: bool) -> np.ndarray:
        """(N + 1,) float32: A'/A that has moved towards `now`; of objects that were not visible in the frame before, `now` itself.

        first: of the frame's sub-pixel samples; those that follow change nothing but for what only they see.
        """
        if len(self._ratio) != len(now):
            self._ratio, self._visible = now, np.zeros(len(now), bool)
        step = settling(self._options.settle_frames) if first else np.float32(0.0)
        self._ratio = np.where(self._visible, self._ratio + step * (now - self._ratio), now)
        visible = np.zeros(len(now), bool)
        visible[candidates.object_id] = True
        self._visible = visible if first else self._visible | visible
        return self._ratio


def weighed(candidates: Candidates, ratio: np.ndarray, weight: float, *, place: bool = True) -> np.ndarray:
    """R' (n,) float32 of candidates whose objects have A'/A `ratio` (N + 1,): R with V' in the place of V.

    Andrade et al. 2014, eqs. (1) and (3); ours: the area is A' weight + A (1 - weight), and without `place` V' is that alone.
    """
    counted = np.float32(1.0) + np.float32(weight) * (ratio[candidates.object_id] - np.float32(1.0))
    visible = (candidates.visibility if place else candidates.area) * counted
    return candidates.relevance + (visible - candidates.visibility) * candidates.importance_factor


def settling(half_frames: float) -> np.float32:
    """The share of a change that is followed in a frame, so that half of it is in `half_frames` frames."""
    return np.float32(1.0 - 0.5 ** (1.0 / half_frames)) if half_frames > 0 else np.float32(1.0)
