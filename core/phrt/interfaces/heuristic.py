"""Heuristic: decides, item by item, what is ray traced in this frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from phrt.errors import PluginError

if TYPE_CHECKING:
    from phrt.world import World

BudgetUnit = Literal["none", "rays", "ms"]
"""What a budget counts: nothing, rays, or milliseconds of the renderer's clock."""

NEVER_TRACED = 2**30
"""`Candidates.frames_since_traced` of an item that never was."""


@dataclass(frozen=True)
class Candidates:
    """The work items of one frame, as a struct of arrays; item i is row i of every array. n items.

    object_id         : (n,) int32, 1-based scene object
    effect            : (n,) int32, index into `effect_names`
    pixel_count       : (n,) int32, visible pixels the effect applies to
    mandatory         : (n,) bool, the scene says "always"
    predicted_cost    : (n,) float32, what tracing the whole item is predicted to take, in the budget's unit, by the renderer's
                        cost model; above 0, whole numbers where rays are counted
    predicted_rays    : (n,) float32, rays, by what was measured for this object and effect; >= 1
    predicted_ms_paper, predicted_ms_measured: (n,) float32, milliseconds, by both cost models (phrt.costs)

    The paper's letters (phrt.relevance has the equations):
    ray_estimate      : (n,) float32, Q, expected rays per pixel, estimated before the run
    area              : (n,) float32, A, the object's visible pixels / all pixels
    center_closeness  : (n,) float32, P, 1 at the view centre, 0 outside the view
    distance          : (n,) float32, D, observer to object centre, metres, at least the near plane
    visibility        : (n,) float32, V = A P / D
    cost              : (n,) float32, C = V Q; it has no unit, so budgets are held by `predicted_cost`
    importance_factor : (n,) float32, K, the object's importance relative to the others; 1 on average over the scene
    was_selected      : (n,) bool, S, traced in the previous frame
    relevance         : (n,) float32, R = (S I + V) K
    persistence       : I, the same for all: how much having been selected counts

    What earlier frames taught, by object and effect (phrt.experience, phrt.history):
    history_share     : (n,) float32, 0 to 1, share of the item's pixels where a valid value of an earlier frame stands in
    history_age       : (n,) float32, frames since those values were traced, on average; 0 where there are none
    seen_frames       : (n,) int32, in how many earlier frames it was a candidate
    frames_since_traced: (n,) int32, 1 when traced, at least in part, in the previous frame; NEVER_TRACED if never
    measured_change   : (n,) float32, what tracing changes at a pixel against the effect's fallback, in the tone-mapped picture
                        (0 to 1), on average; NaN where it was never measured
    measured_strength : (n,) float32, how large that change is where there is one: mean of its square / its mean
    measured_detail   : (n,) float32, the same against what gaps are filled with, the mean of traced neighbours two pixels away with
                        the fallback's detail; NaN where it was never measured
    measured_drift    : (n,) float32, the same against the history value, per frame of its age; NaN where never measured
    measured_ms_per_pixel: (n,) float32, milliseconds; NaN where never measured
    """

    effect_names: tuple[str, ...]
    object_id: np.ndarray
    effect: np.ndarray
    pixel_count: np.ndarray
    mandatory: np.ndarray
    predicted_cost: np.ndarray
    ray_estimate: np.ndarray
    area: np.ndarray
    center_closeness: np.ndarray
    distance: np.ndarray
    visibility: np.ndarray
    cost: np.ndarray
    importance_factor: np.ndarray
    was_selected: np.ndarray
    relevance: np.ndarray
    persistence: float
    predicted_rays: np.ndarray
    predicted_ms_paper: np.ndarray
    predicted_ms_measured: np.ndarray
    history_share: np.ndarray
    history_age: np.ndarray
    seen_frames: np.ndarray
    frames_since_traced: np.ndarray
    measured_change: np.ndarray
    measured_strength: np.ndarray
    measured_detail: np.ndarray
    measured_drift: np.ndarray
    measured_ms_per_pixel: np.ndarray

    def __len__(self) -> int:
        return len(self.object_id)

    def pass_shares(self) -> np.ndarray:
        """(n, PASSES) float32, which share of its pixels, and so of its predicted cost, each pass of an item has, nearly: a
        quarter; where it holds values of earlier frames, the first pass is all that is missing, the others are a third each of
        what could be traced anew."""
        shares = np.full((len(self), PASSES), 1 / PASSES, np.float32)
        held = np.flatnonzero(self.history_share > 0)
        shares[held] = self.history_share[held, None] / np.float32(PASSES - 1)
        shares[held, 0] = 1 - self.history_share[held]
        return shares

    def keys(self) -> np.ndarray:
        """(n,) int64, one number per (object, effect): the same in every frame, and whatever the order of candidates and
        effects is. What ties are broken with, and what memory between frames is kept by."""
        rank = np.argsort(np.argsort(np.array(self.effect_names, dtype=str))).astype(np.int64)
        if not len(self):
            return np.zeros(0, np.int64)
        return self.object_id.astype(np.int64) * len(rank) + rank[self.effect]


class RasterPicture(ABC):
    """Contract: the picture of what was rasterized in a frame, before any ray, and sums of maps of it by object.

    Everything is lit, without shadows; mirrors show the dome, and glass the dome straight behind it.
    """

    @abstractmethod
    def picture(self, width: int) -> np.ndarray:
        """(h, w, 3) float32, linear Rec.709, exposure applied, read-only: w is `width`, or the frame's own where that is less, and
        h keeps its shape. Pixels are means of samples of their part of the frame. Raises OptionError for a width below 1."""

    @abstractmethod
    def object_means(self, values: np.ndarray) -> np.ndarray:
        """(N + 1,) float32: the mean of `values` (h, w) over the pixels of every object, at its id; the background at 0. 0 for
        what is not visible.

        The map may be of any size: it is laid over the frame, and every pixel takes the value at its place. Raises OptionError
        for another shape.
        """


@dataclass(frozen=True)
class FrameContext:
    """What the paper lets a heuristic look at besides the candidates: scene, time, and external parameters.

    time        : seconds of the scene's animation
    budget      : what tracing may take in this call sequence, in `budget_unit`; +inf without one
    budget_unit : "ms" of the ray phase, "rays", or "none"
    sample      : sub-pixel sample of the frame, 0 to samples - 1; each has its own G-buffer, candidates and call sequence
    samples     : sub-pixel samples of the frame, `aa` of the renderer
    situation   : which values of the importance maps K was made of
    attention   : factor by tag: what the user is looking for; it is in K already
    view_speed  : how fast the picture moves, picture widths a second
    history     : do values of earlier frames stand in where nothing is traced?
    parameters  : external parameters by name, what a host program wants a heuristic to know
    raster      : what `picture` and `object_means` are made by; contexts of a renderer have one

    `picture` and `object_means` are of what was rasterized. They take time (of the ray phase) when they are asked for, and none
    when they are not. A frame that is replayed, or rendered again, gives the same picture, whatever is traced in it. Ask in
    `begin_frame`, and do not keep the context: it holds on to the frame.
    """

    world: World
    frame_index: int
    time: float
    budget: float
    budget_unit: BudgetUnit = "none"
    sample: int = 0
    samples: int = 1
    situation: str = "default"
    attention: Mapping[str, float] = field(default_factory=dict)
    view_speed: float = 0.0
    history: bool = False
    parameters: Mapping[str, object] = field(default_factory=dict)
    raster: RasterPicture | None = field(default=None, repr=False, compare=False)

    def picture(self, width: int = 160) -> np.ndarray:
        """(h, w, 3) float32, linear Rec.709, exposure applied, read-only: a small picture of the frame without rays, see
        `RasterPicture.picture`. Raises PluginError in a context that was made by hand without one."""
        return self._raster().picture(width)

    def object_means(self, values: np.ndarray) -> np.ndarray:
        """(N + 1,) float32: the mean over every object's pixels of a map of the picture, see `RasterPicture.object_means`; that of
        item i is at `candidates.object_id[i]`. Raises PluginError as `picture`."""
        return self._raster().object_means(values)

    def _raster(self) -> RasterPicture:
        if self.raster is None:
            raise PluginError(
                "this FrameContext was made by hand and has no raster picture; give it raster=, a RasterPicture, as "
                "phrt.testing.candidates.context does"
            )
        return self.raster


@dataclass(frozen=True)
class Outcome:
    """What tracing an item really took: pixels traced, rays, milliseconds; `complete` when no pixel is left. Rays and
    milliseconds of small items are their share of what items of the effect took together."""

    pixels: int
    rays: int
    milliseconds: float
    complete: bool


PASSES = 4
"""An item's pixels come in this many passes. They are interleaved, one pixel of each 2x2 block in each; but where the item
holds values of earlier frames the first pass is all that is missing, and the others are what could be traced anew."""


@dataclass(frozen=True)
class Request:
    """Part of an item: the next `passes` of its passes that are not traced yet, 1 to PASSES.

    One pass is a coarser effect: gaps between traced pixels are filled from their neighbours of the same object. The same
    item may be asked for again while passes are left (levels of detail, Funkhouser and Sequin 1993).
    pixels: at most so many of them, 1 or more; None for all.
    """

    item: int
    passes: int = PASSES
    pixels: int | None = None


class Heuristic(ABC):
    """Contract: one call sequence per sub-pixel sample of a frame (one per frame unless antialiased), from one thread:
    `begin_frame`, then `take` or `next`, and `report`, in any interleaving (an item may be reported after later ones were
    asked for), then `end_frame`. What is kept from one sequence to the next must allow for candidates that come and go.

    Mandatory items come first. No item comes twice, none whose `predicted_cost` is more than what remains; what nevertheless
    does is not traced. Decisions may depend on the candidates' values and `keys`, but not on their order.

    A heuristic that raises, or whose answer is no item of the frame, is switched off for the run with one warning that names
    it; what is not traced by then takes the fallbacks.
    """

    wants_change: bool = False
    """Does it look at `measured_change` and `measured_drift`? They are measured only then, as it takes time."""

    traces_everything: bool = False
    """Without a budget, does it trace every item in every frame? Then nothing has to stand in, and values of earlier frames are
    not looked for, as that takes time."""

    scores: np.ndarray | None = None
    """(n,) float32: what this frame's items are ranked by, the largest first; set in `begin_frame`. It decides nothing: it is
    recorded, and `phrt explain` names it. None where that is R, or nothing that a number says."""

    @abstractmethod
    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        """A new frame, or the next sub-pixel sample of one (`context.sample`): look at the candidates."""

    @abstractmethod
    def next(self, remaining: float) -> int | Request | None:
        """The next item to trace (a row of the candidates, each at most once, or a `Request` for part of one), or None
        when nothing should follow.

        remaining: what is left of `context.budget`, in `context.budget_unit`, less what is predicted for items handed out and
        not reported yet; +inf without a budget. It rises again when items took less than predicted.
        """

    def take(self, remaining: float, enough: float) -> np.ndarray | None:
        """Many items at once, for heuristics that can say so without a loop in Python: (k,) int32 items, or (k, 2) int32
        items and passes, in order, none twice in one answer; empty when nothing should follow. Those before the last one
        are predicted to cost less than `enough` together, all of them no more than `remaining`.

        None, the default, stands for "ask `next`".
        """
        return None

    def report(self, item: int, outcome: Outcome) -> None:
        """Item `item` was traced, at least in part; this is what is known of it by now."""
        return

    def end_frame(self) -> None:
        """No more items in this frame, or in this sub-pixel sample of it."""
        return
