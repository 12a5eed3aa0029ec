"""psnr: peak signal-to-noise ratio of the displays.

10 log10(1 / MSE) with the mean squared error of the 8-bit sRGB pictures, taken as 0 to 1, over pixels and channels. Equal pictures
have no noise and an infinite ratio: they get the cap of 100 dB, and so does what is nearer than that (one code off in one
channel of more than 51,000 pixels).

Columns: psnr, in dB. psnr_changeable, the same over the pixels that a decision could change; left out where there is none.
Options: none.
Source: the usual definition.

Example, in a configuration of `phrt bench`::

    metrics: [ssim, psnr]
"""

from __future__ import annotations

import math

import numpy as np

from phrt.interfaces.metric import Column, Metric, Shot
from phrt.registry import Options
from phrt_plugins.metrics.pictures import both, checked_pair

CAP_DB = 100.0
"""What equal pictures get."""


def decibels(mean_squared_error: float) -> float:
    """PSNR of values from 0 to 1, at most CAP_DB; NaN of NaN."""
    if mean_squared_error <= 0.0:
        return CAP_DB
    return min(-10.0 * math.log10(mean_squared_error), CAP_DB)


class Psnr(Metric):
    """Of the displays."""

    columns = (
        Column("psnr", "peak signal-to-noise ratio, 100 dB where equal", "dB", "higher"),
        Column("psnr_changeable", "the same over the pixels that a decision could change", "dB", "higher"),
    )

    def __init__(self, options: Options) -> None:
        pass

    def of_shot(self, shot: Shot) -> dict[str, float]:
        wanted, got = checked_pair(shot.reference_display, shot.display)
        errors = both("psnr", np.square(wanted.astype(np.float64) - got), shot.changeable)
        return {name: decibels(error) for name, error in errors.items()}
