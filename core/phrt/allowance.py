"""Allowance: what of a budget the ray phase of a frame may take."""

from __future__ import annotations

import warnings

from phrt.budget import Budget
from phrt.clock import Clock, RayClock, beneath
from phrt.errors import PhrtWarning
from phrt.interfaces.heuristic import BudgetUnit
from phrt.pace import Pace

PATIENT_FRAMES = 5
"""Frames of a run that teach nothing, and of which nothing is said: they compile kernels, fill buffers and capture probes."""


def unit_of(budget: Budget) -> BudgetUnit:
    """What a ray phase under `budget` counts."""
    match budget.kind:
        case "none":
            return "none"
        case "rays":
            return "rays"
        case _:
            return "ms"


class Allowance:
    """Keeps the pace of frames under a budget for the whole frame, by `clock`.

    reserve_ms: what the host needs of such a budget for itself; samples: that share the other budgets, equally.
    """

    def __init__(self, clock: Clock, reserve_ms: float, samples: int) -> None:
        self._clock, self._reserve, self._samples = clock, reserve_ms, samples
        self._pace = Pace()
        self._frames = 0
        self._hopeless_frames = 0
        self._told = False

    def of(self, budget: Budget, began_ms: float) -> float:
        """What the ray phase of a sample may take that begins now, in a frame that began at `began_ms`."""
        if budget.kind != "frame_ms":
            return budget.amount / self._samples
        if isinstance(beneath(self._clock), RayClock):
            # Nothing but rays takes time.
            return budget.amount
        spent = self._clock.now_ms() - began_ms + self._reserve
        left = self._pace.ray_budget_ms(budget.amount, spent)
        if self._pace.hopeless:
            self._tell(budget, spent + self._pace.tail_ms)
        return left

    def headroom_ms(self, budget: Budget) -> float:
        """What is kept back of `budget`."""
        return self._pace.headroom_ms(budget.amount) if budget.kind == "frame_ms" else 0.0

    def finished(self, budget: Budget, total_ms: float, tail_ms: float) -> None:
        """A frame under `budget` took `total_ms`, `tail_ms` of it after the ray phase."""
        self._frames += 1
        if budget.kind == "frame_ms":
            self._pace.finished(budget.amount, total_ms, tail_ms, learn=self._frames > PATIENT_FRAMES)

    def _tell(self, budget: Budget, rest_ms: float) -> None:
        """Say once that there is no time for rays, when that lasts."""
        self._hopeless_frames += 1
        if self._told or self._frames < PATIENT_FRAMES or self._hopeless_frames < PATIENT_FRAMES:
            return
        self._told = True
        warnings.warn(
            f"the frame budget of {budget} leaves nothing for rays: the rest of the frame takes {rest_ms:.0f} ms here; "
            "frames are late, little is traced, and the rest shows its fallback",
            PhrtWarning,
            stacklevel=5,
        )
