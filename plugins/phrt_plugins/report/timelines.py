"""When which object's effect was traced: rows of items, columns of frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from phrt.recording.reasons import coded
from phrt_plugins.report.drawing import (
    INK,
    Plot,
    draw,
    legend,
    legend_height,
    margins,
    name_text,
    path_text,
    table_csv,
    text_width,
)
from phrt_plugins.report.thinning import bin_size

COLUMNS = ("frame", "object", "effect", "pixel_count", "traced_pixels", "history_share")
ROWS = 12
WIDTH, ROW_HEIGHT, GAP_ROWS = 9.6, 0.15, 2

STATES = ("not in view", "fallback", "earlier frame's value", "traced, up to ¼", "up to ½", "up to ¾", "whole")
STATE_COLOURS = ("#ffffff00", "#d9d2c5", "#a9c6de", "#9bd0a5", "#5bb27b", "#228b5b", "#0b5233")
ABSENT, FALLBACK, HELD = 0, 1, 2

Item = tuple[str, str]
"""(object path, effect)."""


@dataclass(frozen=True)
class Strip:
    """A contestant's time line. state (items, bins) uint8: index into STATES; frame (bins,): the first of every bin."""

    label: str
    state: np.ndarray
    frame: np.ndarray
    size: int


class StripMaker:
    """Adds up candidates, block by block. items: the rows, top first; frames (n,): all of the contestant's, in order."""

    def __init__(self, label: str, items: Sequence[Item], frames: np.ndarray) -> None:
        self._label, self._frames = label, np.unique(frames)
        self._row = {item: row for row, item in enumerate(items)}
        self._size = bin_size(len(self._frames))
        shape = (len(items), -(-len(self._frames) // self._size))
        self._pixels, self._traced, self._held = (np.zeros(shape) for _ in range(3))

    def add(self, table: Any) -> None:
        """table: pyarrow, with COLUMNS."""
        row = rows_of(table, self._row)
        kept = np.flatnonzero(row >= 0)
        if not len(kept):
            return
        frame, pixels, traced, held = (
            np.asarray(table.column(name).to_numpy())[kept]
            for name in ("frame", "pixel_count", "traced_pixels", "history_share")
        )
        column = np.searchsorted(self._frames, frame) // self._size
        place = (row[kept], np.minimum(column, self._pixels.shape[1] - 1))
        np.add.at(self._pixels, place, pixels)
        np.add.at(self._traced, place, np.minimum(traced, pixels))
        np.add.at(self._held, place, held * pixels)

    def strip(self) -> Strip:
        return Strip(
            self._label, states(self._pixels, self._traced, self._held), self._frames[:: self._size], self._size
        )


def rows_of(table: Any, row: Mapping[Item, int]) -> np.ndarray:
    """(n,) int64: the row of every candidate of a pyarrow table with `object` and `effect`; -1 for one that has none. An effect
    that was chosen light by light, as shadows@/Lights/Key, is in the row of the whole effect, where that has one."""
    objects, object_code = coded(table, "object")
    effects, effect_code = coded(table, "effect")
    of_pair = np.full((len(objects), len(effects)), -1, np.int64)
    for number, path in enumerate(objects):
        for other, effect in enumerate(effects):
            of_pair[number, other] = row.get((path, effect), row.get((path, effect.partition("@")[0]), -1))
    return of_pair[object_code, effect_code]


def states(pixels: np.ndarray, traced: np.ndarray, held: np.ndarray) -> np.ndarray:
    """uint8, index into STATES, of sums over a bin. pixels: of the item; traced: of them; held: with an earlier frame's value."""
    share = np.divide(traced, pixels, out=np.zeros_like(pixels), where=pixels > 0)
    state = 2 + np.clip(np.ceil(share * 4 - 0.02), 1, 4)
    state[share <= 0.002] = FALLBACK
    state[(share <= 0.002) & (held > pixels / 2)] = HELD
    state[pixels <= 0] = ABSENT
    return state.astype(np.uint8)


def most_important(tables: Iterable[Any], weight: str, most: int = ROWS) -> list[Item]:
    """The items with the largest sum of column `weight` over pyarrow tables with `object`, `effect` and it, the largest first."""
    sums: dict[Item, float] = {}
    for table in tables:
        objects, object_code = coded(table, "object")
        effects, effect_code = coded(table, "effect")
        values = np.nan_to_num(np.asarray(table.column(weight).to_numpy(), np.float64))
        total = np.bincount(
            object_code.astype(np.int64) * len(effects) + effect_code, values, minlength=len(objects) * len(effects)
        )
        for place in np.flatnonzero(total):
            item = objects[place // len(effects)], effects[place % len(effects)]
            sums[item] = sums.get(item, 0.0) + float(total[place])
    return sorted(sums, key=lambda item: (-sums[item], item))[:most]


def time_lines(key: str, budget: str, order: str, items: Sequence[Item], strips: Sequence[Strip]) -> Plot | None:
    """A strip per contestant, one below the other. order: by what the items are sorted. None where no item was ever in view."""
    others = [strip.label for strip in strips if not strip.state.any()]
    strips = [strip for strip in strips if strip.state.any()]
    if not strips:
        return None
    names = [path_text(f"{path} · {effect}") for path, effect in items]

    picture = stacked([strip.state for strip in strips])
    height = ROW_HEIGHT * len(picture)
    last = max(int(strip.frame[-1]) + strip.size for strip in strips)

    def paint(figure: Any) -> None:
        from matplotlib.colors import BoundaryNorm, ListedColormap

        colours = ListedColormap(STATE_COLOURS)
        bounds = BoundaryNorm(np.arange(len(STATES) + 1) - 0.5, len(STATES))
        axes = figure.add_subplot()
        across = (float(strips[0].frame[0]), float(last), len(picture) - 0.5, -0.5)
        axes.imshow(picture, cmap=colours, norm=bounds, aspect="auto", interpolation="nearest", extent=across)
        rows = len(items) + GAP_ROWS
        places = [number * rows + GAP_ROWS + row for number in range(len(strips)) for row in range(len(items))]
        axes.set_yticks(places, names * len(strips), fontsize=7)
        axes.tick_params(axis="y", length=0, pad=3)
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
        for number, strip in enumerate(strips):
            axes.text(
                across[0], number * rows + 0.8, name_text(strip.label), fontsize=9, fontweight="bold", va="center"
            )
        axes.set_xlabel("frame")
        axes.xaxis.get_major_locator().set_params(integer=True)
        margins(figure, 0.2 + text_width(names, 7), 0.52 + legend_height(WIDTH, STATES), top=0.05)
        legend(figure, [_patch(colour) for colour in STATE_COLOURS], STATES)

    size = strips[0].size
    return Plot(
        key,
        f"What was traced when, under {budget}",
        f"The {len(items)} most important items {order}, top down."
        + (f" A column is {size} frames: the share of the item's pixels that was traced in them." if size > 1 else "")
        + (f" None of them is an item of {', '.join(others)}." if others else ""),
        "Time lines: "
        + "; ".join(
            f"{strip.label} traced these items in {100 * traced(strip):.0f} % of their frames" for strip in strips
        ),
        draw(key, (WIDTH, height + 0.57 + legend_height(WIDTH, STATES)), paint),
        table_csv(("label", "object", "effect", "first_frame", "frames", "state"), runs(items, strips)),
        wide=True,
    )


def stacked(states_of: Sequence[np.ndarray]) -> np.ndarray:
    """Strips (items, bins) one below the other, GAP_ROWS empty rows above each; one that ends early is empty from there."""
    bins = max(state.shape[1] for state in states_of)
    return np.concatenate([np.pad(state, ((GAP_ROWS, 0), (0, bins - state.shape[1]))) for state in states_of])


def _patch(colour: str) -> Any:
    from matplotlib.patches import Patch

    return Patch(facecolor=colour, edgecolor=INK, linewidth=0.4)


def traced(strip: Strip) -> float:
    """In which share of the items' frames they were traced, at least in part."""
    seen = strip.state != ABSENT
    return float((strip.state[seen] > HELD).mean()) if seen.any() else 0.0


def runs(items: Sequence[Item], strips: Sequence[Strip]) -> Iterable[tuple[Any, ...]]:
    """Rows of a table: stretches of frames in which an item's state stays the same."""
    for strip in strips:
        for (path, effect), states_of_item in zip(items, strip.state, strict=True):
            starts = np.r_[0, 1 + np.flatnonzero(np.diff(states_of_item))]
            lengths = np.diff(np.r_[starts, len(states_of_item)]) * strip.size
            for start, length in zip(starts.tolist(), lengths.tolist(), strict=True):
                name = STATES[states_of_item[start]]
                yield strip.label, path, effect, int(strip.frame[start]), length, name
