"""Pace: what of a frame's time the ray phase may have, and how much is kept back so that frames are seldom late."""

from __future__ import annotations

from collections import deque
from statistics import median

LATE_SHARE = 0.005
"""The share of late frames that the headroom aims at."""

STEP = 0.02
"""Of the frame budget: what a late frame adds to the headroom. A frame in time takes STEP * LATE_SHARE away."""

FIRST_HEADROOM, LARGEST_HEADROOM = 0.04, 0.25
"""Of the frame budget."""

RECENT_FRAMES = 9
"""What follows the ray phase is expected to take the median of so many frames: capturing probes once is no habit."""

LEAST_SHARE, LEAST_MS = 0.08, 4.0
"""A frame that is late whatever is traced gives rays this share of its budget, but no more than so many ms: earlier values, which
take the place of dear fallbacks, must come from somewhere."""


class Pace:
    """Keeps frames of `frame_ms` in time, in milliseconds of the renderer's clock.

    What follows the ray phase (fallbacks, composition) is predicted by its median over recent frames. The headroom follows the
    quantile of lateness: h += STEP * (late - LATE_SHARE), late being 0 or 1. A late frame moves it up at once by a little,
    frames in time let it down slowly; it settles where LATE_SHARE of the frames are late, and a single slow frame cannot
    swing it (Gibbs and Candes 2021, eq. (2), who follow a quantile online in this way).
    """

    def __init__(self) -> None:
        self._tails: deque[float] = deque(maxlen=RECENT_FRAMES)
        self._headroom = FIRST_HEADROOM
        self._hopeless = False

    def headroom_ms(self, frame_ms: float) -> float:
        """What is kept back of a frame budget of `frame_ms`."""
        return self._headroom * frame_ms

    @property
    def tail_ms(self) -> float:
        """What is expected to follow the ray phase; 0 before the first frame."""
        return median(self._tails) if self._tails else 0.0

    def ray_budget_ms(self, frame_ms: float, spent_ms: float) -> float:
        """What the ray phase may take when it begins `spent_ms` into a frame; a little when there is nothing left."""
        left = frame_ms - spent_ms - self.tail_ms - self.headroom_ms(frame_ms)
        self._hopeless = left <= 0
        return min(LEAST_SHARE * frame_ms, LEAST_MS) if self._hopeless else left

    @property
    def hopeless(self) -> bool:
        """Did nothing of the latest frame belong to rays?"""
        return self._hopeless

    def finished(self, frame_ms: float, total_ms: float, tail_ms: float, *, learn: bool = True) -> None:
        """A frame took `total_ms`, `tail_ms` of it after the ray phase. A late frame that had no time to give back teaches
        nothing about headroom, nor does one without `learn`."""
        self._tails.append(tail_ms)
        late = total_ms > frame_ms
        if learn and not (late and self._hopeless):
            moved = self._headroom + STEP * (float(late) - LATE_SHARE)
            self._headroom = min(max(moved, 0.0), LARGEST_HEADROOM)
