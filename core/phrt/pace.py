"""Pace: what of a frame's time the ray phase may have, and how much is kept back so that frames are seldom late."""

from __future__ import annotations

LATE_SHARE = 0.005
"""The share of late frames that the headroom aims at."""

STEP = 0.03
"""Of the frame budget: what a late frame adds to the headroom. A frame in time takes STEP * LATE_SHARE away."""

FIRST_HEADROOM, LARGEST_HEADROOM = 0.04, 0.25
"""Of the frame budget."""

LEARN = 0.15
"""Weight of a new frame in the mean of what follows the ray phase."""


class Pace:
    """Keeps frames of `frame_ms` in time, in milliseconds of the renderer's clock.

    What follows the ray phase (fallbacks, composition) is predicted by its mean over recent frames. The headroom follows the
    quantile of lateness: h += STEP * (late - LATE_SHARE), late being 0 or 1. A late frame moves it up at once by a little,
    frames in time let it down slowly; it settles where LATE_SHARE of the frames are late, and a single slow frame cannot
    swing it (Gibbs and Candes 2021, eq. (2), who follow a quantile online in this way).
    """

    def __init__(self) -> None:
        self._tail_ms: float | None = None
        self._headroom = FIRST_HEADROOM
        self._warned = False

    def headroom_ms(self, frame_ms: float) -> float:
        """What is kept back of a frame budget of `frame_ms`."""
        return self._headroom * frame_ms

    @property
    def tail_ms(self) -> float:
        """What is expected to follow the ray phase; 0 before the first frame."""
        return self._tail_ms or 0.0

    def ray_budget_ms(self, frame_ms: float, spent_ms: float) -> float:
        """What the ray phase may take when it begins `spent_ms` into a frame; 0 when there is nothing left."""
        return max(frame_ms - spent_ms - self.tail_ms - self.headroom_ms(frame_ms), 0.0)

    def finished(self, frame_ms: float, total_ms: float, tail_ms: float, traced: bool) -> None:
        """A frame took `total_ms`, `tail_ms` of it after the ray phase. traced: its ray phase had time to give back; a frame
        whose other stages alone are over the budget teaches nothing about headroom."""
        self._tail_ms = tail_ms if self._tail_ms is None else self._tail_ms + LEARN * (tail_ms - self._tail_ms)
        late = total_ms > frame_ms
        if traced or not late:
            moved = self._headroom + STEP * (float(late) - LATE_SHARE)
            self._headroom = min(max(moved, 0.0), LARGEST_HEADROOM)
