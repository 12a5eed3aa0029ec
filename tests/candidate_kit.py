"""Candidates built by hand, and heuristics run on them, for tests: those of the conformance kit, and units."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from phrt.candidates import Units
from phrt.interfaces.heuristic import Candidates
from phrt.testing.candidates import candidates, context, items_of, one_frame, rows

__all__ = ["candidates", "context", "items_of", "one_frame", "rows", "units_of"]


def units_of(work: Candidates, first: Sequence[int] | np.ndarray) -> Units:
    """One unit for each of the candidates, whose pixels begin at `first`."""
    return Units(
        item=np.arange(len(work), dtype=np.int32),
        object_id=work.object_id,
        effect=work.effect,
        first=np.asarray(first, np.int64),
        count=work.pixel_count,
        rays=work.predicted_rays.astype(np.float64),
        ms=work.predicted_ms_measured.astype(np.float64),
        held=np.zeros(len(work), np.int32),
        age_sum=np.zeros(len(work)),
    )
