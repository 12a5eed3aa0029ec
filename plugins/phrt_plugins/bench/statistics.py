"""Intervals for what a run of frames says, and for differences between two runs of the same frames.

Neighbouring frames are alike, so they are not resampled one by one but in moving blocks of consecutive frames: the circular
block bootstrap of Politis and Romano 1992, percentile intervals, the levels widened for few blocks (Hesterberg 2015).

    found = interval(flip, segments=block)           # mean FLIP of judged frames, 95 %
    found = paired_interval(a, b, segments=block)    # how much a is above b on the same frames
    judged(found, "lower")                           # "better" | "worse" | "no difference shown"

Values are (n,) or (n, repeats) float64: a row is a frame of the path, and its repeats are always drawn together. They
show the same picture; as frames of their own they would make any difference look certain. docs/statistics.md explains the choices.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from phrt.interfaces.metric import Better

Statistic = Literal["mean", "share", "p50", "p95", "p99", "max", "sum", "rate"]
"""What frames come to. share: the mean of 0 and 1; rate: 1000 / mean, frames a second of milliseconds a frame."""

Verdict = Literal["better", "worse", "no difference shown"]

FEWEST_FRAMES = 6
"""Of fewer independent frames not even the range of all holds the truth in 95 % of the cases: 1 - 2^(1 - n) of them, roughly."""

FEWEST_BLOCKS = 4
"""Blocks are not made so long that fewer than these cover the frames."""

_AT_A_TIME = 4_000_000
"""Numbers that are drawn before they are summarised: 32 MB."""


@dataclass(frozen=True)
class Interval:
    """A value, and between what it may well be, had other frames of the kind been rendered (95 %).

    low and high are NaN where there is no interval: fewer than FEWEST_FRAMES, or a maximum. frames: how many were counted.
    """

    value: float
    low: float
    high: float
    frames: int

    @property
    def known(self) -> bool:
        return not (math.isnan(self.low) or math.isnan(self.high))


NOTHING = Interval(math.nan, math.nan, math.nan, 0)


@dataclass(frozen=True)
class Resampling:
    """How frames are drawn.

    block_length: frames of a moving block (None: `default_block_length`)
    level       : how often such an interval is to hold the truth
    resamples   : how many times as many frames are drawn as there are
    widen       : take quantiles further out where few moving blocks cover the frames (Hesterberg 2015, expanded percentile)
    seed        : the same frames give the same interval
    """

    block_length: int | None = None
    level: float = 0.95
    resamples: int = 2000
    widen: bool = True
    seed: int = 2014


USUAL = Resampling()


def interval(
    values: np.ndarray,
    segments: np.ndarray | None = None,
    statistic: Statistic = "mean",
    resampling: Resampling = USUAL,
) -> Interval:
    """`intervals` for one statistic."""
    return intervals(values, segments, [statistic], resampling)[0]


def intervals(
    values: np.ndarray,
    segments: np.ndarray | None,
    statistics: Sequence[Statistic],
    resampling: Resampling = USUAL,
) -> list[Interval]:
    """`statistics` of `values` (n,) or (n, repeats), each with its interval. Frames that are NaN in all repeats are left out.

    segments: (n,) equal numbers where frames follow each other; a moving block never reaches from one into another. None: all
    """
    values, segments = _of_frames(values, segments)
    kept = ~np.isnan(values).all(axis=1)
    values, segments = values[kept], segments[kept]
    if not len(values):
        return [NOTHING] * len(statistics)
    found = [statistic_of(values, statistic) for statistic in statistics]
    if len(values) < FEWEST_FRAMES:
        return [Interval(value, math.nan, math.nan, len(values)) for value in found]
    draws = _draws(values, segments, statistics, resampling)
    made = [_between(value, drawn, segments, resampling) for value, drawn in zip(found, draws, strict=True)]
    return [_share_of_none(i, resampling) if s == "share" else i for s, i in zip(statistics, made, strict=True)]


def paired_interval(
    a: np.ndarray,
    b: np.ndarray,
    segments: np.ndarray | None = None,
    statistic: Statistic = "mean",
    resampling: Resampling = USUAL,
) -> Interval:
    """Statistic of `a` less that of `b`, both (n,) or (n, repeats) of the same frames, which are drawn together. A frame's repeat
    that is NaN in one is left out of both. Raises ValueError for different shapes."""
    a, segments_ = _of_frames(a, segments)
    b, _ = _of_frames(b, segments)
    if a.shape != b.shape:
        raise ValueError(f"paired values differ in shape: {a.shape} and {b.shape}")
    hidden = np.isnan(a) | np.isnan(b)
    kept = ~hidden.all(axis=1)
    a, b = (np.where(hidden, np.nan, values)[kept] for values in (a, b))
    segments_ = segments_[kept]
    if not len(a):
        return NOTHING
    value = statistic_of(a, statistic) - statistic_of(b, statistic)
    if len(a) < FEWEST_FRAMES:
        return Interval(value, math.nan, math.nan, len(a))
    # The same seed draws the same frames of both.
    drawn = [_draws(values, segments_, [statistic], resampling)[0] for values in (a, b)]
    return _between(value, drawn[0] - drawn[1], segments_, resampling)


def ratio_interval(
    numerator: np.ndarray,
    denominator: np.ndarray,
    segments: np.ndarray | None = None,
    resampling: Resampling = USUAL,
) -> Interval:
    """Sum of `numerator` by sum of `denominator`, (n,) or (n, repeats) of the same frames, drawn together; NaN in one is left out
    of both. Raises ValueError for different shapes."""
    above, segments_ = _of_frames(numerator, segments)
    below, _ = _of_frames(denominator, segments)
    if above.shape != below.shape:
        raise ValueError(f"numerator and denominator differ in shape: {above.shape} and {below.shape}")
    hidden = np.isnan(above) | np.isnan(below)
    kept = ~hidden.all(axis=1)
    sums = [np.where(hidden, 0.0, values)[kept].sum(axis=1) for values in (above, below)]
    segments_ = segments_[kept]
    if not len(sums[0]) or sums[1].sum() == 0.0:
        return NOTHING
    value = float(sums[0].sum() / sums[1].sum())
    if len(sums[0]) < FEWEST_FRAMES:
        return Interval(value, math.nan, math.nan, len(sums[0]))
    return _between(value, _drawn_ratios(sums[0], sums[1], segments_, resampling), segments_, resampling)


def statistic_of(values: np.ndarray, statistic: Statistic) -> float:
    """`statistic` of `values` (n,) or (n, repeats) without an interval; NaN where there is no value."""
    values, _ = _of_frames(values, None)
    if np.isnan(values).all():
        return math.nan
    match statistic:
        case "max":
            return float(np.nanmax(values))
        case "p50" | "p95" | "p99":
            return float(np.nanpercentile(values, float(statistic[1:])))
        case _:
            above, below = _sums(values, statistic)
            return float(above.sum() / below.sum()) if below.sum() else math.nan


def judged(difference: Interval, better: Better) -> Verdict:
    """What `difference` = a - b says of a, where `better` values are lower or higher. Only an interval that leaves 0 out says
    anything; neither does one of a column that has no better direction."""
    if not difference.known or difference.low <= 0.0 <= difference.high or better == "neither":
        return "no difference shown"
    return "better" if (difference.low < 0.0) == (better == "lower") else "worse"


def default_block_length(segments: np.ndarray) -> int:
    """Frames of a moving block: 1.5 times the square root of their number, at most the longest segment and a quarter of all.

    The usual n^(1/3) has the least error for many frames, but is short of what 50 to 500 frames of a camera path need: what is
    hard to render stays in view for seconds. How often intervals hold the truth is in docs/statistics.md.
    """
    frames = len(segments)
    longest = int(np.bincount(_numbered(segments)).max())
    return max(1, min(math.ceil(1.5 * math.sqrt(frames)), longest, frames // FEWEST_BLOCKS))


def _of_frames(values: np.ndarray, segments: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Values (n, repeats) float64, and the segment of each row."""
    values = np.asarray(values, np.float64)
    values = values[:, None] if values.ndim == 1 else values
    return values, np.zeros(len(values), np.int64) if segments is None else np.asarray(segments)


def _numbered(segments: np.ndarray) -> np.ndarray:
    """(n,) number of the segment of each row, 0 first; a new one wherever the value changes."""
    return np.concatenate([[0], np.cumsum(segments[1:] != segments[:-1])])


def _length(segments: np.ndarray, resampling: Resampling) -> int:
    return min(resampling.block_length or default_block_length(segments), len(segments))


def _sums(values: np.ndarray, statistic: Statistic) -> tuple[np.ndarray, np.ndarray]:
    """Two columns (n,) whose sums' ratio is `statistic`; so that of drawn frames is found from sums over moving blocks."""
    total = np.nansum(values, axis=1)
    count = (~np.isnan(values)).sum(axis=1).astype(np.float64)
    match statistic:
        case "rate":
            return 1e3 * count, total
        case "sum":
            return total * len(values), count
        case _:
            return total, count


def _draws(
    values: np.ndarray, segments: np.ndarray, statistics: Sequence[Statistic], resampling: Resampling
) -> list[np.ndarray]:
    """(resamples,) of each statistic of (n, repeats); NaN for a maximum, of which resampling says nothing."""
    percents = [float(name[1:]) for name in statistics if name.startswith("p")]
    percentiles = iter(_drawn_percentiles(values, segments, percents, resampling) if percents else ())
    found = []
    for name in statistics:
        if name.startswith("p"):
            found.append(next(percentiles))
        elif name == "max":
            found.append(np.full(resampling.resamples, math.nan))
        else:
            found.append(_drawn_ratios(*_sums(values, name), segments, resampling))
    return found


def _drawn_ratios(above: np.ndarray, below: np.ndarray, segments: np.ndarray, resampling: Resampling) -> np.ndarray:
    """(resamples,) ratios of sums of (n,) over drawn frames."""
    length = _length(segments, resampling)
    blocks = _moving_blocks(segments, length)
    starts, rest = _starts(len(segments), length, resampling)
    sums = []
    for column in (above, below):
        whole, cut = column[blocks].sum(axis=1), column[blocks[:, :rest]].sum(axis=1)
        sums.append(whole[starts[:, :-1]].sum(axis=1) + cut[starts[:, -1]])
    known = sums[1] != 0.0
    return np.where(known, sums[0], math.nan) / np.where(known, sums[1], 1.0)


def _drawn_percentiles(
    values: np.ndarray, segments: np.ndarray, percents: Sequence[float], resampling: Resampling
) -> np.ndarray:
    """(percents, resamples) percentiles of (n, repeats) over drawn frames."""
    length = _length(segments, resampling)
    blocks = _moving_blocks(segments, length)
    starts, _ = _starts(len(segments), length, resampling)
    of = np.nanpercentile if np.isnan(values).any() else np.percentile
    some = max(1, _AT_A_TIME // values.size)
    parts = []
    for first in range(0, len(starts), some):
        part = starts[first : first + some]
        rows = blocks[part].reshape(len(part), -1)[:, : len(values)]
        parts.append(of(values[rows].reshape(len(part), -1), percents, axis=1))
    return np.concatenate(parts, axis=1)


def _moving_blocks(segments: np.ndarray, length: int) -> np.ndarray:
    """(n, length) rows of the moving block that begins at each row; at the end of its segment it goes on at the beginning."""
    number = _numbered(segments)
    sizes = np.bincount(number)
    first = (np.cumsum(sizes) - sizes)[number][:, None]
    place = np.arange(len(segments))[:, None] - first + np.arange(length)
    return first + place % sizes[number][:, None]


def _starts(frames: int, length: int, resampling: Resampling) -> tuple[np.ndarray, int]:
    """(resamples, blocks) rows at which the drawn moving blocks begin, and how many frames of the last one count."""
    count = -(-frames // length)
    random = np.random.default_rng(resampling.seed)
    return random.integers(frames, size=(resampling.resamples, count)), frames - (count - 1) * length


def _between(value: float, drawn: np.ndarray, segments: np.ndarray, resampling: Resampling) -> Interval:
    """`value` with the quantiles of what was `drawn`. Few moving blocks vary too little: a Student t with as many takes the
    normal's place, and its spread is made up for."""
    frames = len(segments)
    drawn = drawn[~np.isnan(drawn)]
    if not len(drawn):
        return Interval(value, math.nan, math.nan, frames)
    tail = (1.0 - resampling.level) / 2
    blocks = frames / _length(segments, resampling)
    if resampling.widen and blocks > 1:
        from scipy.special import ndtr, stdtrit  # a tenth of the time that importing scipy.stats takes

        tail = float(ndtr(math.sqrt(blocks / (blocks - 1)) * stdtrit(blocks - 1, tail)))
    low, high = np.quantile(drawn, (tail, 1.0 - tail)).tolist()
    return Interval(value, low, high, frames)


def _share_of_none(found: Interval, resampling: Resampling) -> Interval:
    """Where it is none of the frames, or all, resampling sees no doubt. Then the limits are those of Clopper and Pearson 1934,
    which take frames for independent: nothing is known of how such frames would come together."""
    if found.value not in (0.0, 1.0) or not found.known:
        return found
    reach = 1.0 - ((1.0 - resampling.level) / 2) ** (1.0 / found.frames)
    low, high = (0.0, reach) if found.value == 0.0 else (1.0 - reach, 1.0)
    return Interval(found.value, low, high, found.frames)
