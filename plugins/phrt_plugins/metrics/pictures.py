"""What metrics of pictures share: what a picture must be, and means over some of its pixels."""

from __future__ import annotations

import numpy as np

SMALLEST_SIDE = 7
"""Pixels: the window of SSIM. FLIP's filters are cut off at the border; they have no smallest size."""


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


def checked_pair(reference: np.ndarray, picture: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Both as `checked` gives them. Raises ValueError as it does, and where their shapes differ."""
    wanted, got = checked(reference, "reference"), checked(picture, "picture")
    if wanted.shape != got.shape:
        raise ValueError(f"the reference is {wanted.shape}, the picture {got.shape}")
    return wanted, got


def mean_over(values: np.ndarray, pixels: np.ndarray | None = None) -> float:
    """Mean of `values`, (H, W) or (H, W, C), over those of `pixels` (H, W) bool; NaN where there is none."""
    chosen = values if pixels is None else values[pixels]
    return float(chosen.mean(dtype=np.float64)) if chosen.size else float("nan")


def both(name: str, values: np.ndarray, changeable: np.ndarray) -> dict[str, float]:
    """Columns NAME and NAME_changeable: the mean of `values` over all pixels, and over those that a decision could change."""
    return {name: mean_over(values), f"{name}_changeable": mean_over(values, changeable)}
