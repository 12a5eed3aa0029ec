"""ssim: how much of the structure of the reference is there.

Within a window of 7x7 pixels around each pixel the two displays are compared by mean, variance and correlation, channel by channel.

Columns: ssim, the mean over the pixels whose window is whole, 1 (equal) down to -1. ssim_changeable, the same over those of
them that a decision could change; left out where there is none.
Options: none.
Needs: scikit-image.
Source: Wang et al. 2004, eq. (13), with a window of equal weights and unbiased variances, as scikit-image's default.

Example, in a configuration of `phrt bench`::

    metrics: [ssim, psnr]
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.metric import Column, Metric, Shot
from phrt.registry import Options
from phrt_plugins.metrics.pictures import SMALLEST_SIDE, both, checked_pair

WINDOW = SMALLEST_SIDE
BORDER = WINDOW // 2
"""Pixels along the edge of the picture whose window is not whole."""


def ssim_map(reference: np.ndarray, picture: np.ndarray) -> np.ndarray:
    """(H, W) float32, SSIM of every pixel, 1 (equal) down to -1, mean over the channels, of two displays (H, W, 3) as
    `pictures.checked` takes them. Within BORDER of the edge the picture is mirrored.

    Raises ValueError for what is no such pair.
    """
    from skimage.metrics import structural_similarity

    wanted, got = checked_pair(reference, picture)
    _, similarity = structural_similarity(wanted, got, win_size=WINDOW, channel_axis=2, data_range=1.0, full=True)
    return np.asarray(similarity.mean(axis=2), np.float32)


def inside(pixels: np.ndarray) -> np.ndarray:
    """`pixels` (H, W, ...) without BORDER at each edge: those whose window is whole."""
    return pixels[BORDER:-BORDER, BORDER:-BORDER]


class Ssim(Metric):
    """Of the displays."""

    columns = (
        Column("ssim", "structural similarity, mean over the pixels, 1 is equal", "", "higher"),
        Column("ssim_changeable", "the same over the pixels that a decision could change", "", "higher"),
    )

    def __init__(self, options: Options) -> None:
        pass

    def of_shot(self, shot: Shot) -> dict[str, float]:
        return both("ssim", inside(ssim_map(shot.reference_display, shot.display)), inside(shot.changeable))
