"""How far a picture is from the one with everything traced: mean FLIP (0 is equal) and SSIM (1 is equal), as the metrics
`flip` and `ssim` define them.

FLIP takes about 0.3 s for 640x360 and holds on to the interpreter, so that many pictures go to processes.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np

from phrt_plugins.metrics.flip import flip_map
from phrt_plugins.metrics.pictures import mean_over
from phrt_plugins.metrics.ssim import inside, ssim_map

NEEDED = ("flip_evaluator", "skimage")
"""Modules that judge pictures."""


@dataclass(frozen=True)
class Quality:
    """Of one picture against its reference. flip: 0 (equal) to 1, mean over the pixels. ssim: 1 (equal) down to -1."""

    flip: float
    ssim: float


def compare(reference: np.ndarray, picture: np.ndarray) -> Quality:
    """Both measures of `picture` against `reference`, (H, W, 3) each: uint8 sRGB, or floats in 0..1.

    Raises ValueError for what they cannot use.
    """
    return Quality(mean_over(flip_map(reference, picture)), mean_over(inside(ssim_map(reference, picture))))


def _compare_pair(pair: tuple[np.ndarray, np.ndarray]) -> Quality:
    return compare(*pair)


def compare_all(pairs: Sequence[tuple[np.ndarray, np.ndarray]], processes: int = 1) -> list[Quality]:
    """`compare` of every (reference, picture), in order, on so many processes."""
    if processes < 2:
        return [compare(*pair) for pair in pairs]
    # Not forked: a renderer's threads may hold locks.
    with ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        return list(pool.map(_compare_pair, pairs, chunksize=4))
