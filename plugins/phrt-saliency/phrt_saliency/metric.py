"""saliency_error: how far the displays are apart where the reference stands out to the eye.

The mean over pixels and channels of |I - R| of the 8-bit sRGB pictures, taken as 0 to 1, with the saliency of the reference at
every pixel as its weight: an error where nothing stands out counts little. Where nothing stands out anywhere, all pixels count
the same. Since the heuristic `saliency` chooses by the same model, it says whether that does what it means to, and not whether
anybody looks there.

Columns: saliency_error, 0 (equal) to 1.
Options: map_width, intensity, color, orientation, as of the heuristic.
Source: Itti et al. 1998; errors weighted by saliency after Longhurst et al. 2006.

Example, in a configuration of `phrt bench`::

    metrics: [flip, saliency_error]
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.metric import Column, Metric, Shot
from phrt_saliency.model import saliency
from phrt_saliency.options import SaliencyErrorOptions


class SaliencyError(Metric):
    """Of the displays."""

    columns = (
        Column(
            "saliency_error", "difference of the displays, weighted by what stands out in the reference", "", "lower"
        ),
    )

    def __init__(self, options: SaliencyErrorOptions) -> None:
        self._options = options

    def of_shot(self, shot: Shot) -> dict[str, float]:
        small, row, column = shrunk(shot.reference_display, self._options.map_width)
        weights = saliency(small, self._options.weights).saliency[row][:, column].astype(np.float64)
        error = np.abs(shot.display.astype(np.float64) - shot.reference_display).mean(axis=2) / 255.0
        total = weights.sum()
        return {"saliency_error": float((error * weights).sum() / total if total > 0 else error.mean())}


def shrunk(display: np.ndarray, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """display (H, W, 3) uint8 as the means (h, w, 3) float32, 0 to 1, of its parts, w at most `width`; and in which row and column
    of them every row (H,) and column (W,) of pixels is."""
    height, frame_width = display.shape[:2]
    width = min(width, frame_width)
    rows = max(1, round(height * width / frame_width))
    row, column = np.arange(height) * rows // height, np.arange(frame_width) * width // frame_width
    sums = np.add.reduceat(display.astype(np.float32), np.searchsorted(row, np.arange(rows)), axis=0)
    sums = np.add.reduceat(sums, np.searchsorted(column, np.arange(width)), axis=1)
    counts = np.bincount(row)[:, None] * np.bincount(column)[None, :]
    return (sums / (255.0 * counts[..., None])).astype(np.float32), row, column
