"""flips: how often decisions change from one frame to the next.

A decision flips when an item, an effect of an object, is a candidate in two frames in a row, and is traced (at least in part) in
one and not in the other. Such an item may pop in the picture. Pairs of frames across a block's start do not count, as the
renderer has forgotten everything there.

Columns: decision_flips, items that flip, mean over the pairs of frames. flips_area, their pixels' share of those of all items
that are in both frames, mean over the pairs.
Options: none.
Source: ours.

Example, in a configuration of `phrt bench`::

    metrics: [flip, temporal, flips]
"""

from __future__ import annotations

import numpy as np

from phrt.interfaces.metric import Column, Metric, RunFrames
from phrt.registry import Options
from phrt_plugins.metrics.tables import candidates_by_frame


class Flips(Metric):
    """Of all frames that follow another."""

    columns = (
        Column(
            "decision_flips",
            "items traced in one of two frames in a row and not in the other",
            "1/frame",
            "lower",
            scope="run",
        ),
        Column("flips_area", "their share of the pixels of items in both frames", "", "lower", scope="run"),
    )

    def __init__(self, options: Options) -> None:
        pass

    def of_run(self, frames: RunFrames) -> dict[str, float]:
        flips, areas = flips_by_frame(frames)[frames.follows()].T
        return {"decision_flips": float(flips.mean()), "flips_area": float(areas.mean())} if len(flips) else {}


def flips_by_frame(frames: RunFrames) -> np.ndarray:
    """(n, 2) float64: items that flipped since the frame before, and their share of the pixels; NaN where there is none before."""
    wanted = ("sample", "object_id", "effect", "chosen", "pixel_count")
    rows, table = candidates_by_frame(frames, wanted)
    keys = item_keys(table["sample"], table["object_id"], table["effect"])
    ends = np.searchsorted(rows, np.arange(len(frames) + 1))
    found = np.full((len(frames), 2), np.nan)
    for frame in np.flatnonzero(frames.follows()):
        before, now = slice(ends[frame - 1], ends[frame]), slice(ends[frame], ends[frame + 1])
        found[frame] = flips_between(
            keys[before], table["chosen"][before], keys[now], table["chosen"][now], table["pixel_count"][now]
        )
    return found


def item_keys(sample: np.ndarray, object_id: np.ndarray, effect: np.ndarray) -> np.ndarray:
    """(m,) int64, one number per sub-pixel sample, object and effect, the same in every frame of a run."""
    objects = int(object_id.max(initial=0)) + 1
    samples = int(sample.max(initial=0)) + 1
    return (effect.astype(np.int64) * objects + object_id) * samples + sample


def flips_between(
    keys_before: np.ndarray, chosen_before: np.ndarray, keys: np.ndarray, chosen: np.ndarray, pixels: np.ndarray
) -> tuple[float, float]:
    """How many items that both frames see were traced in one and not in the other, and their share of such items' pixels.

    keys: one number per item, each once a frame. chosen: bool, was it traced. pixels: how many it has in the later frame.
    """
    _, before, after = np.intersect1d(keys_before, keys, assume_unique=True, return_indices=True)
    changed = chosen_before[before] != chosen[after]
    seen = pixels[after].astype(np.float64)
    return float(changed.sum()), float(seen[changed].sum() / seen.sum()) if seen.sum() > 0 else 0.0
