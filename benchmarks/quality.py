"""How far a picture is from the one with everything traced: mean FLIP (0 is equal) and SSIM (1 is equal).

Both look at 8-bit sRGB pictures, as they would be shown: FLIP is made for that (Andersson et al. 2020), with the viewing
distance of its authors (67 pixels per degree). FLIP takes about 0.3 s for 640x360 and holds on to the interpreter, so that many
pictures go to processes.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from importlib.util import find_spec

import numpy as np

PACKAGES = {"flip_evaluator": "flip-evaluator", "skimage": "scikit-image"}
"""What is needed, by the name that it is imported by."""

SMALLEST_SIDE = 7
"""Pixels: the window of SSIM."""


@dataclass(frozen=True)
class Quality:
    """Of one picture against its reference. flip: 0 (equal) to 1, mean over the pixels. ssim: 1 (equal) down to -1."""

    flip: float
    ssim: float


def missing_packages() -> list[str]:
    """Those of PACKAGES that are not installed, to be known before an hour of frames and not after it."""
    return [package for module, package in PACKAGES.items() if find_spec(module) is None]


def checked(picture: np.ndarray, name: str) -> np.ndarray:
    """(H, W, 3) float32 in 0..1 of `picture` (H, W, 3): uint8 sRGB, or floats that are in 0..1 already.

    Raises ValueError for another shape or dtype, values outside 0..1 and NaN: flip_evaluator ends the process on what
    it cannot use, and calculates with the rest.
    """
    if picture.ndim != 3 or picture.shape[2] != 3 or min(picture.shape[:2]) < SMALLEST_SIDE:
        raise ValueError(f"{name} has shape {picture.shape}; expected (H, W, 3) with sides of at least {SMALLEST_SIDE}")
    if picture.dtype == np.uint8:
        return picture.astype(np.float32) / np.float32(255.0)
    if picture.dtype not in (np.float32, np.float64):
        raise ValueError(f"{name} is {picture.dtype}; expected uint8, or floats in 0..1")
    if not (np.isfinite(picture).all() and picture.min() >= 0.0 and picture.max() <= 1.0):
        raise ValueError(f"{name} holds NaN or values outside 0..1, from {np.min(picture):g} to {np.max(picture):g}")
    return np.ascontiguousarray(picture, np.float32)


def compare(reference: np.ndarray, picture: np.ndarray) -> Quality:
    """Both measures of `picture` against `reference`, (H, W, 3) each, as `checked` takes them.

    FLIP: Andersson et al. 2020, its authors' own program. SSIM: Wang et al. 2004 on each channel, their mean.
    """
    import flip_evaluator
    from skimage.metrics import structural_similarity

    wanted, got = checked(reference, "reference"), checked(picture, "picture")
    if wanted.shape != got.shape:
        raise ValueError(f"the reference is {wanted.shape}, the picture {got.shape}")
    _, flip, _ = flip_evaluator.evaluate(wanted, got, "LDR", applyMagma=False)
    ssim = structural_similarity(wanted, got, channel_axis=2, data_range=1.0)
    return Quality(float(flip), float(ssim))


def _compare_pair(pair: tuple[np.ndarray, np.ndarray]) -> Quality:
    return compare(*pair)


def compare_all(pairs: Sequence[tuple[np.ndarray, np.ndarray]], processes: int = 1) -> list[Quality]:
    """`compare` of every (reference, picture), in order, on so many processes."""
    if processes < 2:
        return [compare(*pair) for pair in pairs]
    # Not forked: a renderer's threads may hold locks.
    with ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        return list(pool.map(_compare_pair, pairs, chunksize=4))
