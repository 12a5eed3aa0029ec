"""Frames as rows of tables.

The columns are found by walking the dataclasses: what `Candidates`, `Decisions`, `FrameResult` and `CameraView` gain is
recorded without a change here.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from phrt.camera import CameraView
from phrt.controls import Conditions
from phrt.frame import REASONS, Decisions, FrameResult
from phrt.recording.arrow import import_arrow
from phrt.recording.folder import plain

SCALARS = (bool, int, float, str)


def arrays_of(table: Any, count: int) -> dict[str, np.ndarray]:
    """The (count,) arrays among the fields of a dataclass, by name."""
    values = {field.name: getattr(table, field.name) for field in fields(table)}
    return {name: v for name, v in values.items() if isinstance(v, np.ndarray) and v.shape == (count,)}


def scalars_of(record: Any) -> dict[str, Any]:
    """The numbers, switches and texts among the fields of a dataclass, by name."""
    found = {}
    for field in fields(record):
        value = getattr(record, field.name)
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, SCALARS):
            found[field.name] = value
    return found


def view_numbers(view: CameraView) -> list[float]:
    """A view without its size and jitter: world_from_view by rows, tan_half, orthographic, near, far, exposure."""
    rest = (*view.tan_half, float(view.orthographic), view.near, view.far, view.exposure)
    return [*view.world_from_view.reshape(-1).tolist(), *(float(number) for number in rest)]


def view_of(numbers: Sequence[float], size: tuple[int, int]) -> CameraView:
    """The view that `view_numbers` wrote, bit for bit."""
    x, y, orthographic, near, far, exposure = numbers[16:]
    matrix = np.array(numbers[:16], np.float64).reshape(4, 4)
    return CameraView(*size, matrix, (x, y), bool(orthographic), near, far, exposure=exposure)


class CandidateRows:
    """Makes one record batch a frame: a row per candidate and sub-pixel sample.

    object_paths: of the scene, object 1 first.
    """

    def __init__(self, object_paths: Sequence[str]) -> None:
        self._arrow = import_arrow()
        # Object 0 is the background; no candidate is.
        self._objects = self._arrow.array(["", *object_paths])
        self._reasons = self._arrow.array(list(REASONS))
        self._effects: tuple[tuple[str, ...], Any] | None = None

    def batch(self, step: int, frame: FrameResult) -> Any:
        """The candidates of `frame`, the `step`-th that was rendered, of all its samples."""
        samples = [self._sample(step, frame.index, number, d) for number, d in enumerate(frame.samples)]
        if len(samples) == 1:
            return samples[0]
        table = self._arrow.Table.from_batches(samples).combine_chunks()
        return table.to_batches()[0] if table.num_rows else samples[0]

    def _sample(self, step: int, frame: int, sample: int, decisions: Decisions) -> Any:
        arrow, candidates = self._arrow, decisions.candidates
        count = len(candidates)
        columns: dict[str, Any] = {
            "step": np.full(count, step, np.int32),
            "frame": np.full(count, frame, np.int64),
            "sample": np.full(count, sample, np.int16),
            "object": self._named(candidates.object_id, self._objects),
        }
        columns |= arrays_of(candidates, count) | arrays_of(decisions, count)
        columns |= {name: np.full(count, value) for name, value in scalars_of(candidates).items()}
        columns["effect"] = self._named(candidates.effect, self._effect_names(candidates.effect_names))
        columns["reason"] = self._named(decisions.reason, self._reasons)
        arrays = [arrow.array(values) if isinstance(values, np.ndarray) else values for values in columns.values()]
        return arrow.RecordBatch.from_arrays(arrays, names=list(columns))

    def _named(self, codes: np.ndarray, names: Any) -> Any:
        return self._arrow.DictionaryArray.from_arrays(self._arrow.array(codes.astype(np.int32)), names)

    def _effect_names(self, names: tuple[str, ...]) -> Any:
        """The dictionary of effects: the same object while the names are, so that it is written once."""
        if self._effects is None or self._effects[0] != names:
            self._effects = names, self._arrow.array(list(names), self._arrow.string())
        return self._effects[1]


class FrameRows:
    """Makes the row of a frame."""

    def __init__(self) -> None:
        self._arrow = import_arrow()
        self._schema: Any = None

    def batch(
        self,
        step: int,
        frame: FrameResult,
        heuristic: str,
        conditions: Conditions,
        warnings: list[str],
        clock: list[float],
    ) -> Any:
        """The row of `frame`. conditions: what held in it; warnings: what was warned of while it was made; clock: readings of a
        RecordingClock."""
        row: dict[str, Any] = {
            "step": step,
            "frame": frame.index,
            "time": frame.time,
            "milliseconds": frame.milliseconds,
            "candidates": sum(len(decisions.candidates) for decisions in frame.samples),
            "traced": sum(int(decisions.chosen.sum()) for decisions in frame.samples),
        }
        row |= scalars_of(frame.decisions) | scalars_of(frame) | scalars_of(conditions)
        del row["index"]
        row |= {
            "overrun_ms": frame.decisions.overrun_ms,
            "frame_budget": str(frame.budget),
            "deadline_ms": frame.budget.amount if frame.budget.kind == "frame_ms" else math.inf,
            "late": frame.late,
            "heuristic": heuristic,
            "attention": json.dumps(plain(conditions.attention), sort_keys=True),
            "parameters": json.dumps(plain(conditions.parameters), sort_keys=True),
            "warnings": warnings,
            "clock": clock,
            "view": view_numbers(frame.view),
            "stages": list(frame.stages.items()),
            "rays": list(frame.rays.items()),
        }
        if self._schema is None:
            self._schema = self._schema_of(row)
        return self._arrow.RecordBatch.from_pylist([row], self._schema)

    def _schema_of(self, row: dict[str, Any]) -> Any:
        """Types by the values of the first row; stages and kinds of rays may come later and are maps."""
        arrow = self._arrow
        types = {bool: arrow.bool_(), int: arrow.int64(), float: arrow.float64(), str: arrow.string()}
        special = {
            "warnings": arrow.list_(arrow.string()),
            "clock": arrow.list_(arrow.float64()),
            "view": arrow.list_(arrow.float64()),
            "stages": arrow.map_(arrow.string(), arrow.float64()),
            "rays": arrow.map_(arrow.string(), arrow.int64()),
        }
        return arrow.schema([(name, special.get(name) or types[type(value)]) for name, value in row.items()])


def widened(table: Any) -> Any:
    """`table` of frames with a column per stage (`stage_gbuffer_ms`) and per kind of rays (`rays_shadows`)."""
    for column, pattern, default in (("stages", "stage_{}_ms", 0.0), ("rays", "rays_{}", 0)):
        index = table.schema.get_field_index(column)
        if index < 0:
            continue
        kind = table.schema.field(column).type.item_type
        rows = [dict(pairs or ()) for pairs in table.column(column).to_pylist()]
        names = list(dict.fromkeys(name for row in rows for name in row))
        table = table.remove_column(index)
        for name in names:
            values = import_arrow().array([row.get(name, default) for row in rows], kind)
            table = table.append_column(pattern.format(name), values)
    return table
