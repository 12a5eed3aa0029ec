"""What stands out in a picture: the saliency model of Itti et al. 1998.

A place is salient where it differs from its surround, in brightness, colour or direction, in a way that little else in the
picture does. The model has no parameter that was fitted to where people look, and knows no objects, faces or tasks. Equation
numbers are those of the paper; c and s are levels of Gaussian pyramids, (-) a difference of levels, (+) a sum over them:

    I(c, s) = |I(c) (-) I(s)|                                                                        eq. (1)
    RG(c, s), BY(c, s)   the same of the colour opponencies                                          eqs. (2), (3)
    O(c, s, theta) = |O(c, theta) (-) O(s, theta)|                                                   eq. (4)
    intensity   = (+) N(I(c, s))                                                                     eq. (5)
    color       = (+) [N(RG(c, s)) + N(BY(c, s))]                                                    eq. (6)
    orientation = sum over theta of N((+) N(O(c, s, theta)))                                         eq. (7)
    saliency    = (N(intensity) + N(color) + N(orientation)) / 3                                     eq. (8)

N(.) makes the largest value of a map M = 1 and multiplies it with (M - m)^2, m being the mean of its other local maxima: what
is everywhere stands out nowhere.

Ours, or other authors':
- The paper's centers are levels 2 to 4 of a picture 640 wide. A picture of a quarter of that width begins at level 2, so here the
  centers are 0 to 2 of the small picture, with surrounds 3 and 4 levels coarser as in the paper.
- Maps are summed at the finest center and not at the coarsest, because they are summed over small objects later.
- Colour opponencies are (R - G) / max(R, G, B) and (B - min(R, G)) / max(R, G, B) (Walther and Koch 2006): with eqs. (2) and (3)
  as printed an even red picture would stand out everywhere. Where it is dark they fade, as there are no colours at night; the
  papers cut them off, which draws a line that is not there.
- Gabor filters have a wave of 4 pixels, a round envelope, and no answer to even light; the paper leaves that open. Pyramids are
  those of Burt and Adelson 1983. Local maxima below M / 10 do not count (Walther and Koch 2006).
- Contrasts below 1e-4 are none, and a map whose largest value is below `LEAST` is not raised to 1, or the model would look for
  what stands out in the rounding of an even picture.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phrt_saliency.kernels import add_contrasts, filter_oriented, halve, split_features, uniqueness

CENTERS = 3
SURROUNDS = (3, 4)
LEVELS = CENTERS + SURROUNDS[-1]
MAPS = CENTERS * len(SURROUNDS)
"""Pairs of a center and a surround: how many maps a feature has."""

DARKEST = np.float32(0.25)
"""Of a display that shows less than this, colours fade with it."""
FAINTEST = np.float32(1e-4)
LEAST = np.float32(0.02)
"""About five steps of an 8-bit display."""

WAVE_PIXELS, ENVELOPE_PIXELS, REACH_PIXELS = 4.0, 4.0 / 3.0, 4
"""Of the Gabor filters: wavelength, standard deviation, and half width."""


@dataclass(frozen=True)
class SaliencyMap:
    """What stands out in a picture; arrays (h, w) float32, 0 and more.

    intensity, color, orientation: each channel's conspicuity after N(.); saliency: their weighted mean
    """

    intensity: np.ndarray
    color: np.ndarray
    orientation: np.ndarray
    saliency: np.ndarray


def saliency(display: np.ndarray, weights: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> SaliencyMap:
    """What stands out in `display`.

    display: (h, w, 3), what is shown: uint8 sRGB, or float, 0 to 1
    weights: of intensity, colour and orientation, 0 or more, not all 0

    Raises ValueError for a picture of another shape and weights that are none.
    """
    if display.ndim != 3 or display.shape[2] != 3 or not display.size:
        raise ValueError(f"expected a picture (h, w, 3), got {display.shape}")
    if min(weights) < 0 or not any(weights):
        raise ValueError(f"weights are {weights}; they must be 0 or more, and one above 0")
    picture = (
        display.astype(np.float32) / np.float32(255.0) if display.dtype == np.uint8 else display.astype(np.float32)
    )
    intensity, red_green, blue_yellow = (np.empty(picture.shape[:2], np.float32) for _ in range(3))
    split_features(picture, DARKEST, intensity, red_green, blue_yellow)
    brightness = pyramid(intensity)
    channels = (
        normalised(across_scales(brightness), LEAST * MAPS),
        normalised(across_scales(pyramid(red_green), pyramid(blue_yellow)), LEAST * MAPS),
        normalised(of_directions(brightness), LEAST * MAPS),
    )
    shares = np.array(weights, np.float32) / np.float32(sum(weights))
    total = sum((share * channel for share, channel in zip(shares, channels, strict=True)), np.zeros_like(intensity))
    return SaliencyMap(*channels, total)


Pyramid = tuple[np.ndarray, ...]


def pyramid(finest: np.ndarray) -> Pyramid:
    """LEVELS arrays, each half as wide and high as the one before, a last pixel rounded up."""
    levels = [finest]
    for _ in range(LEVELS - 1):
        height, width = levels[-1].shape
        levels.append(np.empty(((height + 1) // 2, (width + 1) // 2), np.float32))
        halve(levels[-2], levels[-1])
    return tuple(levels)


def across_scales(*pyramids: Pyramid) -> np.ndarray:
    """(h, w) float32: the sum of N(|center (-) surround|), eqs. (1) to (4) inside (5) to (7)."""
    total = np.zeros_like(pyramids[0][0])
    for levels in pyramids:
        add_contrasts(levels, CENTERS, SURROUNDS[0], SURROUNDS[-1], FAINTEST, LEAST, total)
    return total


def of_directions(brightness: Pyramid) -> np.ndarray:
    """(h, w) float32: eq. (7)."""
    energies = [np.empty((4, *level.shape), np.float32) for level in brightness]
    for level, energy in zip(brightness, energies, strict=True):
        filter_oriented(level, _TAPS, _STRAIGHT_MEAN, _SLANTED_MEAN, energy)
    total = np.zeros_like(brightness[0])
    for theta in range(4):
        total += normalised(across_scales(tuple(energy[theta] for energy in energies)), LEAST * MAPS)
    return total


def normalised(values: np.ndarray, least: np.float32) -> np.ndarray:
    """N(.) of a map (h, w)."""
    return values * np.float32(uniqueness(values, np.float32(least)))


def _gabor_taps() -> np.ndarray:
    """(5, n) float32, see `filter_oriented`."""
    x = np.arange(-REACH_PIXELS, REACH_PIXELS + 1)
    envelope = np.exp(-0.5 * (x / ENVELOPE_PIXELS) ** 2)
    envelope /= envelope.sum()
    phase = 2 * np.pi * x / WAVE_PIXELS
    slanted = phase / np.sqrt(2)
    waves = (np.ones_like(envelope), np.cos(phase), np.sin(phase), np.cos(slanted), np.sin(slanted))
    return np.array([envelope * wave for wave in waves]).astype(np.float32)


_TAPS = _gabor_taps()
_SUMS = _TAPS.astype(np.float64).sum(axis=1)
_STRAIGHT_MEAN, _SLANTED_MEAN = np.float32(_SUMS[1] / _SUMS[0]), np.float32((_SUMS[3] / _SUMS[0]) ** 2)
