"""check_metric: the rules of `phrt.interfaces.metric.Metric`, on pictures and runs of all sorts."""

from __future__ import annotations

import math
import pickle
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import fields, replace
from functools import partial
from numbers import Real
from typing import Any, get_args

import numpy as np
from pydantic import BaseModel

from phrt.interfaces.metric import RESERVED_COLUMNS, Better, Column, Metric, RunFrames, Scope, Shot, Statistic
from phrt.output.tonemap import linear_from_srgb
from phrt.testing.contract import BROKEN_BY_THE_PLUGIN, Contract, Given, Maker

__tracebackhide__ = BROKEN_BY_THE_PLUGIN

NAME = re.compile(r"[a-z][a-z0-9_]*")
CLOSE = 1e-6
FRAMES = 12


def check_metric(
    metric: Given, options: Mapping[str, object] | BaseModel | None = None, *, beyond: Collection[str] = ()
) -> None:
    """Put a metric through its contract. Raises BrokenContract naming the rule and the case.

    metric: the name of a registered one, a descriptor, or a class that takes `options`
    beyond: columns by which a picture may be better than its reference: steadier, say

    Runs are tables as a recording has them, with pyarrow; where it is not installed, of_run is not looked at.
    """
    make = Maker("metric", metric, options)
    contract = make.contract
    made = make()
    contract.holds(isinstance(made, Metric), "it is a phrt.interfaces.metric.Metric")
    columns = contract.call("columns", lambda: tuple(made.columns))
    _check_columns(contract, columns)
    copy = contract.call("pickling it", lambda: pickle.loads(pickle.dumps(made)))
    shots = example_shots()
    _Check(contract, made, copy, columns, "shot").each(made.of_shot, copy.of_shot, shots)
    _check_equal_pictures(contract, made, columns, shots, beyond)
    if (runs := example_runs()) is not None:
        _Check(contract, made, copy, columns, "run").each(made.of_run, copy.of_run, runs)


# Examples


def shot_of(display: np.ndarray, reference: np.ndarray, /, **changes: Any) -> Shot:
    """A frame of these displays (H, W, 3) uint8; the linear pictures are what they decode to, all pixels are changeable."""
    made: dict[str, Any] = {
        "index": 5,
        "image": linear_from_srgb(display / 255.0).astype(np.float32),
        "display": display,
        "reference": linear_from_srgb(reference / 255.0).astype(np.float32),
        "reference_display": reference,
        "changeable": np.ones(display.shape[:2], bool),
    }
    return Shot(**(made | changes))


def example_shots() -> dict[str, Shot]:
    """By what is special about them; no two pictures of one are equal."""
    random = np.random.default_rng(2)

    def noise(shape: tuple[int, int]) -> np.ndarray:
        return random.integers(0, 256, (*shape, 3)).astype(np.uint8)

    def flat(value: int) -> np.ndarray:
        return np.full((9, 16, 3), value, np.uint8)

    motion = random.uniform(-20, 20, (9, 16, 2)).astype(np.float32)
    motion[::2] = np.nan
    before = shot_of(noise((9, 16)), noise((9, 16)), index=4)
    plain = shot_of(noise((9, 16)), noise((9, 16)))
    return {
        "noise": plain,
        "the smallest pictures": shot_of(noise((7, 7)), noise((7, 7))),
        "black against white": shot_of(flat(0), flat(255)),
        "white against black": shot_of(flat(255), flat(0)),
        "one step of one channel": shot_of(flat(9), flat(9) + np.array([1, 0, 0], np.uint8)),
        "no pixel changeable": replace(plain, changeable=np.zeros((9, 16), bool)),
        "one pixel changeable": replace(plain, changeable=np.arange(9 * 16).reshape(9, 16) == 40),
        "very bright": replace(plain, image=plain.image * np.float32(1e4), reference=plain.reference * np.float32(1e4)),
        "with the frame before": replace(plain, previous=before),
        "with motion": replace(plain, previous=before, motion=motion),
        "with no known motion": replace(plain, previous=before, motion=np.full_like(motion, np.nan)),
    }


def example_runs() -> dict[str, RunFrames] | None:
    """By what is special about them; None without pyarrow."""
    try:
        import pyarrow
    except ImportError:
        return None
    random = np.random.default_rng(3)

    def run(steps: Sequence[int], budget_ms: float, items: int) -> RunFrames:
        n, first = len(steps), 100
        clock = random.uniform(5, 40, n)
        columns = {
            "step": np.array(steps, np.int64),
            "frame": np.arange(first, first + n),
            "time": np.arange(n) / 30.0,
            "milliseconds": clock,
            "clock_ms": clock,
            "deadline_ms": np.full(n, budget_ms),
            "budget": np.full(n, budget_ms),
            "late": clock > budget_ms,
            "overrun_ms": np.maximum(clock - budget_ms, 0.0),
            "ray_ms": clock / 2,
            "budget_unit": np.full(n, "ms" if math.isfinite(budget_ms) else "none", object),
            "stage_gbuffer_ms": clock / 4,
            "stage_rays_ms": clock / 2,
            "rays_shadows": random.integers(0, 10_000, n),
        }
        count = n * items
        chosen = random.random(count) < 0.5
        pixels = random.integers(1, 500, count)
        ms = random.uniform(0.01, 5, (3, count))
        table = pyarrow.table(
            {
                "step": np.repeat(columns["step"], items),
                "frame": np.repeat(columns["frame"], items),
                "sample": np.zeros(count, np.int16),
                "object_id": np.tile(np.arange(items) // 2 + 1, n),
                "effect": np.tile(np.array(["shadows", "reflections"] * items)[:items], n),
                "chosen": chosen,
                "pixel_count": pixels,
                "traced_pixels": np.where(chosen, pixels, 0),
                "rays": np.where(chosen, 2 * pixels, 0),
                "milliseconds": np.where(chosen, ms[0], 0.0),
                "predicted_rays": 2.0 * pixels,
                "predicted_cost": 2.0 * pixels,
                "predicted_ms_measured": ms[1],
                "predicted_ms_paper": ms[2],
                "relevance": random.random(count),
            }
        )
        return RunFrames(columns, lambda names: table.select([name for name in names if name in table.column_names]))

    return {
        "twelve frames with a deadline": run(range(FRAMES), 20.0, 6),
        "no budget": run(range(FRAMES), math.inf, 6),
        "two blocks": run([0, 1, 2, 0, 1, 2], 20.0, 5),
        "one frame": run([0], 20.0, 6),
        "no candidates": run(range(3), 20.0, 0),
    }


# The rules


def _check_columns(contract: Contract, columns: Sequence[object]) -> None:
    contract.holds(columns, "it has at least one column")
    for column in columns:
        contract.holds(isinstance(column, Column), f"columns are Column objects, not {column!r}")
        assert isinstance(column, Column)
        named = NAME.fullmatch(column.name) and column.name not in RESERVED_COLUMNS
        rule = f"columns are named in lower case with underscores, and not {', '.join(RESERVED_COLUMNS)}"
        contract.holds(named, rule, column.name)
        for field, allowed in (("better", Better), ("statistic", Statistic), ("scope", Scope)):
            value, choices = getattr(column, field), get_args(allowed)
            contract.holds(value in choices, f"`{field}` is one of {', '.join(choices)}, not {value!r}", column.name)
        contract.holds(column.summary, "a column says what it means", column.name)
    names = [column.name for column in columns if isinstance(column, Column)]
    contract.holds(len(set(names)) == len(names), f"no two columns have one name: {', '.join(names)}")


class _Check:
    """What holds of both methods: `scope` says of which."""

    def __init__(
        self, contract: Contract, metric: Metric, copy: Metric, columns: Sequence[Column], scope: Scope
    ) -> None:
        self._contract, self._scope = contract, scope
        self._names = [column.name for column in columns if column.scope == scope]

    def each(
        self, measure: Callable[[Any], object], of_copy: Callable[[Any], object], examples: Mapping[str, Any]
    ) -> None:
        """Every example, in one order and in the other."""
        method = f"of_{self._scope}"
        found = {}
        for case, example in examples.items():
            before = _copies(example)
            found[case] = self.measures(self._contract.call(method, partial(measure, example), case), case)
            same = all(
                np.array_equal(a, b, equal_nan=a.dtype.kind == "f")
                for a, b in zip(before, _arrays(example), strict=True)
            )
            self._contract.holds(same, f"{method} does not change what it is given", case)
        for case, example in reversed(list(examples.items())):
            for who, again in (("called again", measure), ("pickled", of_copy)):
                values = self.measures(self._contract.call(method, partial(again, example), case), case)
                same = values.keys() == found[case].keys() and all(
                    math.isclose(value, found[case][name], rel_tol=CLOSE, abs_tol=CLOSE)
                    or (math.isnan(value) and math.isnan(found[case][name]))
                    for name, value in values.items()
                )
                rule = f"{method} keeps nothing from one call to the next: {who}, it finds {values}, not {found[case]}"
                self._contract.holds(same, rule, case)

    def measures(self, found: object, case: str) -> dict[str, float]:
        """Finite numbers, or NaN, by the columns of this scope."""
        method, holds = f"of_{self._scope}", self._contract.holds
        holds(isinstance(found, Mapping), f"{method} returns a mapping by column, not {found!r:.80}", case)
        assert isinstance(found, Mapping)
        unknown = sorted(set(map(str, found)) - set(self._names))
        holds(not unknown, f"{method} returns columns of scope '{self._scope}' only, not {', '.join(unknown)}", case)
        for name, value in found.items():
            holds(isinstance(value, Real), f"column '{name}' is a number, not {value!r:.80}", case)
            holds(
                not math.isinf(value), f"column '{name}' is finite, or NaN where it does not apply; not {value}", case
            )
        return {str(name): float(value) for name, value in found.items()}


def _check_equal_pictures(
    contract: Contract, metric: Metric, columns: Sequence[Column], shots: Mapping[str, Shot], beyond: Collection[str]
) -> None:
    """A picture that is the reference is as good as it can be, and its columns apply wherever those of another do."""
    direction = {column.name: {"lower": 1.0, "higher": -1.0, "neither": 0.0}[column.better] for column in columns}
    for case, shot in shots.items():
        worse, best = metric.of_shot(shot), metric.of_shot(_perfect(shot))
        for name, value in worse.items():
            if math.isnan(value):
                continue
            equal = best.get(name, math.nan)
            contract.holds(
                math.isfinite(equal), f"column '{name}' of a picture that equals its reference is {equal}", case
            )
            right = name in beyond or direction[name] * equal <= direction[name] * value + CLOSE
            rule = f"column '{name}' of a picture that equals its reference, {equal:g}, is not worse than {value:g}"
            contract.holds(right, rule, case)


def _perfect(shot: Shot) -> Shot:
    previous = None if shot.previous is None else _perfect(shot.previous)
    return replace(shot, image=shot.reference, display=shot.reference_display, previous=previous)


def _arrays(example: Shot | RunFrames) -> list[np.ndarray]:
    """The arrays of an example, also those of the frame before."""
    if isinstance(example, RunFrames):
        return [np.asarray(array) for array in example.columns.values()]
    own = [value for f in fields(example) if isinstance(value := getattr(example, f.name), np.ndarray)]
    return own + ([] if example.previous is None else _arrays(example.previous))


def _copies(example: Shot | RunFrames) -> list[np.ndarray]:
    return [array.copy() for array in _arrays(example)]
