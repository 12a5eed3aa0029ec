"""Stages: where the milliseconds of a frame go."""

from __future__ import annotations

import time


class Stages:
    """Wall-clock milliseconds by stage. Every moment belongs to one stage, so that the parts sum to the frame."""

    def __init__(self) -> None:
        self.milliseconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def done(self, stage: str) -> None:
        """The time since the last call belongs to `stage`."""
        now = time.perf_counter()
        self.milliseconds[stage] = self.milliseconds.get(stage, 0.0) + (now - self._last) * 1e3
        self._last = now
