"""The oracle: the best that can be done with a frame's budget, when everything is known beforehand. docs/oracle.md explains it.

    truth = oracle_frame(renderer, time=1.2, index=36)
    choice = oracle_choice(truth.sets, capacity=200_000, unit="rays")
    truth.choice_of(choice.sets), choice.benefit, choice.cost

`write_oracle` does this for the judged frames of a block and writes three tables. `relevance_share` judges what a run chose by
the paper's own objective, the sum of R.
"""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from phrt.camera import CameraView
from phrt.interfaces.heuristic import PASSES
from phrt.output.files import temporary_beside
from phrt.renderer import Renderer
from phrt_plugins.bench.benefits import EffectSets, ItemTruth, Judged, counts_rays, judge
from phrt_plugins.bench.knapsack import solve, warned

BLOCK_COLUMNS = {
    "frame": "int64", "budget": "string", "unit": "string", "capacity": "double", "error_floor": "double",
    "error_oracle": "double", "benefit_oracle": "double", "items": "int64", "cost": "double", "gap": "double",
    "error_parts": "double", "error_items": "double", "benefit_items": "double", "pixels": "int64",
}  # fmt: skip
ITEMS_COLUMNS = {
    "frame": "int64", "object": "string", "effect": "string", "pixels": "int64", "benefit": "double", "rays": "int64",
    "ms": "double", "relevance": "double",
}  # fmt: skip
SETS_COLUMNS = {
    "frame": "int64", "object": "string", "object_id": "int32", "effects": "string", "benefit": "double",
    "rays": "int64", "ms": "double",
}  # fmt: skip
"""The columns of the three files and their types; docs/oracle.md says what they mean."""

UNITS = ("none", "rays", "ms")
TOLERANCE = 1e-4
"""Relative: how near to the largest sum of R is near enough. There is one to be found for every frame of every run."""


@dataclass(frozen=True)
class Choice:
    """What the oracle chose: sets, at most one of an object; their benefit (sum over pixels) and cost in the budget's unit; gap:
    the best choice may bring more by at most this share, 0 when this is it."""

    sets: EffectSets
    benefit: float
    cost: float
    gap: float


@dataclass(frozen=True)
class RelevanceShare:
    """By frame, (f,) each: frame, its number; sum_chosen, what of R was chosen; sum_best, the most that could be by prediction;
    share, their ratio, NaN where nothing could be had."""

    frame: np.ndarray
    sum_chosen: np.ndarray
    sum_best: np.ndarray
    share: np.ndarray


def oracle_frame(
    renderer: Renderer, time: float, index: int, camera: int | str | CameraView = 0, *, tone_map: str = "neutral"
) -> ItemTruth:
    """What every item of frame `index` at `time` seconds is worth and takes. `renderer` is used as `benefits.judge` says."""
    return judge(renderer, time, index, camera, tone_map=tone_map).truth


def oracle_choice(sets: EffectSets, capacity: float, unit: str) -> Choice:
    """The sets of effects, at most one of an object, that bring the most and take no more than `capacity`: rays, or milliseconds,
    as `unit` says; "none" for no limit. A PhrtWarning where it is not proven to be the best. Raises ValueError for another unit
    and a capacity that is NaN."""
    if unit not in UNITS:
        raise ValueError(f"unit is {unit!r}; it must be one of {', '.join(UNITS)}")
    cost = sets.ms if unit == "ms" else sets.rays
    solution = warned(solve(sets.benefit, cost, math.inf if unit == "none" else capacity, sets.object_id))
    chosen = solution.chosen
    return Choice(sets.rows(chosen), float(sets.benefit[chosen].sum()), float(cost[chosen].sum()), solution.gap)


def write_oracle(
    folder: str | Path,
    setup_id: str,
    block: int,
    renderer: Renderer,
    frames: Sequence[tuple[int, float]],
    budgets: Sequence[tuple[str, str, float]],
    *,
    camera: int | str | CameraView = 0,
    tone_map: str = "neutral",
) -> Path:
    """Find the oracle of some frames, and write `folder`/oracle/`setup_id`/block-NNN.parquet, after sets-NNN and items-NNN.

    renderer : of the setup; it is restarted, and must be again before it renders anything else
    frames   : (number, time in seconds) of each
    budgets  : (text, unit, amount) of each: "rays", "ms" of the ray phase, or "none"; an amount that is NaN is not known, and
               what was chosen is then NaN too. `read_sets` and `oracle_choice` tell it later.

    Returns the path. Raises OptionError where pyarrow is missing, as `judge` does, and OSError where the system refuses to write.
    """
    target = Path(folder) / "oracle" / setup_id
    target.mkdir(parents=True, exist_ok=True)
    found, items, sets = _Rows(), _Rows(), _Rows()
    for number, (index, time) in enumerate(frames):
        if number == 0 and not counts_rays(renderer):
            # Kernels are loaded and caches filled by the first frame; its times are not to count.
            judge(renderer, time, index, camera, tone_map=tone_map)
        judged = judge(renderer, time, index, camera, tone_map=tone_map)
        truth = judged.truth
        objects = ["", *(entry.path for entry in renderer.scene.objects)]
        items.add(_item_rows(truth, objects))
        sets.add(_set_rows(truth, objects))
        for text, unit, amount in budgets:
            found.add({name: [value] for name, value in _chosen_row(judged, text, unit, amount).items()})
    name = f"{block:03d}.parquet"
    write_table(target / f"sets-{name}", sets.columns, SETS_COLUMNS)
    write_table(target / f"items-{name}", items.columns, ITEMS_COLUMNS)
    # Last: where it is, the others are.
    write_table(target / f"block-{name}", found.columns, BLOCK_COLUMNS)
    return target / f"block-{name}"


class _Rows:
    """Columns that grow."""

    def __init__(self) -> None:
        self.columns: dict[str, list[Any]] = {}

    def add(self, columns: Mapping[str, Sequence[Any]]) -> None:
        for name, values in columns.items():
            self.columns.setdefault(name, []).extend(values)


def _chosen_row(judged: Judged, text: str, unit: str, amount: float) -> dict[str, Any]:
    """The oracle's row of one frame and budget. Errors are means over the picture, measured on pictures composed of the choices."""
    truth, pixels = judged.truth, judged.truth.picture_pixels
    row: dict[str, Any] = {
        "frame": truth.frame,
        "budget": text,
        "unit": unit,
        "capacity": math.inf if unit == "none" else float(amount),
        "error_floor": truth.error_floor / pixels,
        "pixels": pixels,
    }
    if math.isnan(row["capacity"]):
        unknown = ("error_oracle", "benefit_oracle", "cost", "gap", "error_items", "benefit_items", "error_parts")
        return row | {"items": 0} | dict.fromkeys(unknown, math.nan)
    choice, parts = (oracle_choice(sets, amount, unit) for sets in (truth.sets, truth.parts))
    chosen = truth.choice_of(choice.sets)
    # The plain knapsack over items, which takes what effects bring at a pixel for a sum.
    cost = truth.ms if unit == "ms" else truth.rays
    plain = warned(solve(truth.benefit, cost, row["capacity"])).chosen
    return row | {
        "items": int((chosen > 0).sum()),
        "cost": choice.cost,
        "benefit_oracle": choice.benefit / pixels,
        "error_oracle": judged.error(judged.picture(chosen)),
        "gap": max(choice.gap, parts.gap),
        "error_parts": judged.error(judged.picture(truth.choice_of(parts.sets))),
        "benefit_items": float(truth.benefit[plain].sum()) / pixels,
        "error_items": judged.error(judged.picture(plain)),
    }


def _item_rows(truth: ItemTruth, objects: Sequence[str]) -> dict[str, list[Any]]:
    return {
        "frame": [truth.frame] * len(truth),
        "object": [objects[number] for number in truth.object_id.tolist()],
        "effect": [truth.effect_names[number] for number in truth.effect.tolist()],
        "pixels": truth.pixels.tolist(),
        "benefit": truth.benefit.tolist(),
        "rays": truth.rays.tolist(),
        "ms": truth.ms.tolist(),
        "relevance": truth.relevance.astype(np.float64).tolist(),
    }


def _set_rows(truth: ItemTruth, objects: Sequence[str]) -> dict[str, list[Any]]:
    sets = truth.sets
    return {
        "frame": [truth.frame] * len(sets),
        "object": [objects[number] for number in sets.object_id.tolist()],
        "object_id": sets.object_id.tolist(),
        "effects": ["+".join(name for name, n in zip(sets.effect_names, row, strict=True) if n) for row in sets.passes],
        "benefit": sets.benefit.tolist(),
        "rays": sets.rays.tolist(),
        "ms": sets.ms.tolist(),
    }


def write_table(path: Path, columns: Mapping[str, Sequence[Any]], types: Mapping[str, str]) -> None:
    """Write a Parquet file, whole or not at all: the columns of `types`, which are Arrow's names. Raises OSError."""
    from phrt.recording.arrow import import_arrow

    arrow = import_arrow()
    table = arrow.table(
        {name: arrow.array(columns.get(name, []), arrow.type_for_alias(kind)) for name, kind in types.items()}
    )
    temporary = temporary_beside(path)
    try:
        with open(temporary, "wb") as file:
            arrow.parquet.write_table(table, file, compression="zstd")
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def read_sets(path: str | Path) -> dict[int, EffectSets]:
    """By frame, what sets-NNN.parquet holds."""
    from phrt.recording.arrow import import_arrow

    table = import_arrow().parquet.read_table(path)
    texts = table["effects"].to_pylist()
    names = tuple(sorted({name for text in texts for name in text.split("+")}))
    passes = np.array([[PASSES * (name in text.split("+")) for name in names] for text in texts], np.uint8)
    passes = passes.reshape(len(texts), len(names))
    frame, object_id, benefit, rays, ms = (
        table[name].to_numpy() for name in ("frame", "object_id", "benefit", "rays", "ms")
    )
    found = {}
    for number in np.unique(frame):
        rows = np.flatnonzero(frame == number)
        found[int(number)] = EffectSets(names, object_id[rows], passes[rows], benefit[rows], rays[rows], ms[rows])
    return found


def relevance_share(candidates: Any, frames: Any, only: Collection[int] | None = None) -> RelevanceShare:
    """By frame, which share of the largest sum of R that the budget could buy, by predicted costs, a run chose.

    candidates, frames: tables of a run folder (pyarrow tables, or anything that gives columns by name). only: frames to look at, by
    number; None for all. An item that was traced in part counts in part.
    """
    columns = ("frame", "relevance", "predicted_cost", "traced_pixels", "pixel_count")
    frame, relevance, price, traced, pixels = (np.asarray(candidates[name]) for name in columns)
    numbers, budgets = np.asarray(frames["frame"]), np.asarray(frames["budget"], np.float64)
    if only is not None:
        kept = np.isin(numbers, list(only))
        numbers, budgets = numbers[kept], budgets[kept]
    got = relevance * (traced / np.maximum(pixels, 1))
    order = np.argsort(frame, kind="stable")
    first = np.searchsorted(frame[order], numbers, side="left")
    last = np.searchsorted(frame[order], numbers, side="right")
    sums = np.zeros((2, len(numbers)))
    for row, budget in enumerate(budgets.tolist()):
        mine = order[first[row] : last[row]]
        best = warned(solve(relevance[mine], price[mine], budget, tolerance=TOLERANCE)).chosen
        sums[:, row] = got[mine].sum(dtype=np.float64), relevance[mine][best].sum(dtype=np.float64)
    share = np.divide(sums[0], sums[1], out=np.full(len(numbers), np.nan), where=sums[1] > 0)
    return RelevanceShare(numbers.astype(np.int64), sums[0], sums[1], share)
