"""temporal: does the picture change from frame to frame as the reference does?

I and R are the displays of the picture and the reference as 0 to 1, t a frame and t - 1 the one before, |.| the mean over the
channels.

Columns: difference_error, the mean over the pixels of |(I_t - I_t-1) - (R_t - R_t-1)|: what flickers, pops or lags; an error that
stays where it is does not count. compensated_difference: how much a surface point changes between two frames, |I_t(x) -
I_t-1(x + motion)|, mean over the pixels whose motion is known and stays in the picture, less the same of the reference;
bilinear. Above 0 the picture is less steady than the reference, below 0 steadier, as one without moving highlights is. popping, the
99th percentile over the pixels of difference_error's: how much the worst places jump.
All are left out for a frame without a known previous one, compensated_difference also without motion.
Options: none.
Source: motion compensation after Lai et al. 2018, with motion from the geometry, absolute differences, and, in place of
a mask of occlusions, the reference's own difference taken off.

Example, in a configuration of `phrt bench`::

    metrics: [flip, temporal]
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.metric import Column, Metric, Shot
from phrt.registry import Options
from phrt_plugins.metrics.pictures import checked_pair

POPPING_PERCENTILE = 99


class Temporal(Metric):
    """Of the displays of two frames in a row."""

    columns = (
        Column(
            "difference_error",
            "change from frame to frame that is not the reference's, mean over the pixels",
            "",
            "lower",
        ),
        Column("compensated_difference", "how much less steady surface points are than in the reference", "", "lower"),
        Column("popping", "change that is not the reference's, 99th percentile over the pixels", "", "lower"),
    )

    def __init__(self, options: Options) -> None:
        pass

    def of_shot(self, shot: Shot) -> dict[str, float]:
        if shot.previous is None:
            return {}
        wanted, got = checked_pair(shot.reference_display, shot.display)
        wanted_before, got_before = checked_pair(shot.previous.reference_display, shot.previous.display)
        if got.shape != got_before.shape:
            raise ValueError(f"the picture is {got.shape}, the one before {got_before.shape}")
        jumps = np.abs((got - got_before) - (wanted - wanted_before)).mean(axis=2)
        found = {
            "difference_error": float(jumps.mean(dtype=np.float64)),
            "popping": float(np.percentile(jumps, POPPING_PERCENTILE)),
        }
        if shot.motion is not None:
            own = compensated_difference(got, got_before, shot.motion)
            found["compensated_difference"] = own - compensated_difference(wanted, wanted_before, shot.motion)
        return found


def compensated_difference(picture: np.ndarray, before: np.ndarray, motion: np.ndarray) -> float:
    """Mean of |picture(x) - before(x + motion)| over the channels and the pixels whose motion is known and stays in the
    picture; NaN where there is none.

    picture, before: (H, W, 3) float32. motion: (H, W, 2) pixels, x right and y down; NaN where it is not known.
    """
    height, width = picture.shape[:2]
    if motion.shape != (height, width, 2):
        raise ValueError(f"motion has shape {motion.shape}; expected {(height, width, 2)}")
    y, x = np.mgrid[:height, :width]
    at_x, at_y = x + motion[..., 0].astype(np.float64), y + motion[..., 1].astype(np.float64)
    # A pixel reaches half of its width past its centre. Comparisons with NaN are false.
    known = (at_x >= -0.5) & (at_x <= width - 0.5) & (at_y >= -0.5) & (at_y <= height - 0.5)
    if not known.any():
        return float("nan")
    moved = bilinear(before, at_x[known], at_y[known])
    return float(np.abs(picture[known] - moved).mean(dtype=np.float64))


def bilinear(picture: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """(n, C) of `picture` (H, W, C) at pixel positions x, y (n,), 0 at the first pixel's centre; at the edge its pixels go on."""
    height, width = picture.shape[:2]
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    left, top = np.minimum(x.astype(np.intp), width - 2), np.minimum(y.astype(np.intp), height - 2)
    right_share, low_share = (x - left)[:, None], (y - top)[:, None]
    upper = picture[top, left] * (1 - right_share) + picture[top, left + 1] * right_share
    lower = picture[top + 1, left] * (1 - right_share) + picture[top + 1, left + 1] * right_share
    return np.asarray(upper * (1 - low_share) + lower * low_share)
