"""error: how far the displays are apart, pixel by pixel.

The mean over pixels and channels of |I - R| of the 8-bit sRGB pictures, taken as 0 to 1. It adds up over pixels, so that the
oracle's choice of items, and a heuristic's share of it, are measured in it.

Columns: display_error, 0 (equal) to 1. display_error_changeable, the same over the pixels that a decision could change; left
out where there is none.
Options: none.
Source: the mean absolute error, as it is.

Example, in a configuration of `phrt bench`::

    metrics: [error, flip]
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.metric import Column, Metric, Shot
from phrt.registry import Options
from phrt_plugins.metrics.pictures import both, checked_pair


class DisplayError(Metric):
    """Of the displays."""

    columns = (
        Column("display_error", "mean absolute difference of the displays, 0 to 1", "", "lower"),
        Column("display_error_changeable", "the same over the pixels that a decision could change", "", "lower"),
    )

    def __init__(self, options: Options) -> None:
        pass

    def of_shot(self, shot: Shot) -> dict[str, float]:
        wanted, got = checked_pair(shot.reference_display, shot.display)
        return both("display_error", np.abs(got - wanted), shot.changeable)
