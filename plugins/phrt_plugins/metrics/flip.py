"""flip: the difference that a viewer sees when two pictures are shown in turns.

FLIP filters both pictures as the eye does at a viewing distance, compares colours in a perceptually uniform space, and adds
differences of edges and points. It looks at 8-bit sRGB pictures, as they are shown, through its authors' own program. This is the
metric that heuristics are ranked by.

Columns: flip, the mean over the pixels, 0 (equal) to 1. flip_changeable, the same over the pixels that a decision could
change. flip_p95, the 95th percentile over the pixels: how bad the bad places are.
Options: pixels_per_degree, the viewing distance.
Needs: flip-evaluator. Takes about 0.3 s for 640x360 and holds on to the interpreter.
Source: Andersson et al. 2020.

Example, in a configuration of `phrt bench`::

    metrics: [flip, ssim]
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.metric import Column, Metric, Shot
from phrt_plugins.metrics.options import FlipOptions
from phrt_plugins.metrics.pictures import both, checked_pair

DEFAULT_PIXELS_PER_DEGREE: float = FlipOptions().pixels_per_degree


def flip_map(
    reference: np.ndarray, picture: np.ndarray, pixels_per_degree: float = DEFAULT_PIXELS_PER_DEGREE
) -> np.ndarray:
    """(H, W) float32, FLIP of every pixel, 0 (equal) to 1, of two displays (H, W, 3) as `pictures.checked` takes them.

    Raises ValueError for what FLIP cannot use.
    """
    import flip_evaluator

    wanted, got = checked_pair(reference, picture)
    settings = {"ppd": pixels_per_degree}
    errors, _, _ = flip_evaluator.evaluate(
        wanted, got, "LDR", applyMagma=False, computeMeanError=False, parameters=settings
    )
    return np.asarray(errors, np.float32)[:, :, 0]


class Flip(Metric):
    """Of the displays."""

    columns = (
        Column("flip", "visible difference, mean over the pixels, 0 to 1", "", "lower"),
        Column("flip_changeable", "the same over the pixels that a decision could change", "", "lower"),
        Column("flip_p95", "visible difference, 95th percentile over the pixels", "", "lower"),
    )

    def __init__(self, options: FlipOptions) -> None:
        self._pixels_per_degree = options.pixels_per_degree

    def of_shot(self, shot: Shot) -> dict[str, float]:
        errors = flip_map(shot.reference_display, shot.display, self._pixels_per_degree)
        return both("flip", errors, shot.changeable) | {"flip_p95": float(np.percentile(errors, 95))}
