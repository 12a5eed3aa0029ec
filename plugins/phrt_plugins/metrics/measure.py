"""Measuring with metrics, whoever wrote them: making them by name, and containing what they do wrong.

metrics = make_metrics(["flip", "pacing"])
values = measure_shots(metrics, shots)      # {"flip": (n,) float64, ...}, a row a shot
totals = measure_run(metrics, frames)       # {"fps": 19.8, ...}
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from numbers import Real
from typing import get_args

import numpy as np

from phrt.errors import OptionError, PhrtWarning, PluginError, did_you_mean
from phrt.faults.fault import CAUGHT, PluginFailure, fault_of, raised
from phrt.faults.making import make
from phrt.interfaces.metric import RESERVED_COLUMNS, Better, Column, Metric, RunFrames, Scope, Shot, Statistic
from phrt.registry.manager import describe, get_registry
from phrt_plugins.metrics.pictures import SMALLEST_SIDE

COLUMN_NAME = re.compile(r"[a-z][a-z0-9_]*")


def make_metrics(
    names: Sequence[str] | None = None,
    options: Mapping[str, Mapping[str, object]] | None = None,
    *,
    strict: bool = False,
) -> list[Metric]:
    """Metrics by name; None makes every default one that can be used here, with a PhrtWarning for each that cannot. options: by
    metric, then by option. strict: what is broken is an error, asked for or not.

    Raises PluginError where one is unknown, unavailable or no metric, or two claim a column; OptionError for a wrong
    option, options of a metric that is not asked for, and a name that is there twice.
    """
    wanted = available_metrics() if names is None else list(names)
    given = dict(options or {})
    if twice := sorted({name for name in wanted if wanted.count(name) > 1}):
        raise OptionError(f"metrics are named twice: {', '.join(twice)}")
    for name in given:
        if name not in wanted:
            raise OptionError(
                f"there are options for metric '{name}', which is not among those asked for: "
                f"{', '.join(wanted) or 'none'}.{did_you_mean(name, wanted)}"
            )
    if names is None and not strict:
        return whatever_works(wanted, given)
    metrics = [make_metric(name, given.get(name, {})) for name in wanted]
    all_columns(metrics)
    return metrics


def whatever_works(names: Sequence[str], options: Mapping[str, Mapping[str, object]]) -> list[Metric]:
    """Metrics that nobody asked for by name: one that is broken, or wants a column that is taken, costs a PhrtWarning."""
    made: dict[str, Metric] = {}
    built_in = {name for name in names if get_registry().find("metric", name).origin == "built-in"}
    for name in sorted(names, key=lambda name: name not in built_in):
        try:
            metric = make_metric(name, options.get(name, {}))
            all_columns([*made.values(), metric])
        except PluginError as error:
            warnings.warn(PhrtWarning(f"metric '{name}' is left out: {error}"), stacklevel=3)
        else:
            made[name] = metric
    return [made[name] for name in names if name in made]


def default_metrics() -> list[str]:
    """Those that ship with PHRT, and those that were registered for this run. What is merely installed must be named: installing a
    package changes no comparison."""
    return [entry.name for entry in get_registry().plugins("metric") if entry.origin != "installed"]


def available_metrics() -> list[str]:
    """Names of the default metrics that can be made here; a PhrtWarning says which cannot, and what to install."""
    registry = get_registry()
    reasons = {name: registry.find("metric", name).unavailable_reason() for name in default_metrics()}
    for name, reason in reasons.items():
        if reason:
            warnings.warn(PhrtWarning(f"metric '{name}' is left out: {reason}"), stacklevel=3)
    return [name for name, reason in reasons.items() if not reason]


def make_metric(name: str, options: Mapping[str, object]) -> Metric:
    """One metric, its columns checked. Raises PluginError and OptionError."""
    made: Metric = make("metric", name, options)
    try:
        made.name = name
    except CAUGHT as error:
        raise PluginFailure(fault_of("metric", made, f"cannot be named: {error}")) from error
    for column in columns_of(made):
        if problem := column_problem(column):
            raise PluginFailure(fault_of("metric", made, f"is broken: {problem}"))
    return made


def columns_of(metric: Metric) -> tuple[Column, ...]:
    """`metric.columns`. Raises PluginFailure where it fails."""
    try:
        return tuple(metric.columns)
    except CAUGHT as error:
        raise PluginFailure(fault_of("metric", metric, raised("columns", error))) from error


def column_problem(column: object) -> str | None:
    """None, or what is wrong with what a metric calls a column."""
    if not isinstance(column, Column):
        return f"its column {column!r} is no phrt.interfaces.metric.Column"
    if not COLUMN_NAME.fullmatch(column.name) or column.name in RESERVED_COLUMNS:
        return (
            f"a column cannot be called '{column.name}'; names are lower case letters, digits and underscores, "
            f"and not {', '.join(RESERVED_COLUMNS)}"
        )
    for field, allowed in (("better", Better), ("statistic", Statistic), ("scope", Scope)):
        if getattr(column, field) not in get_args(allowed):
            given = getattr(column, field)
            return f"column '{column.name}' has {field} {given!r}; allowed: {', '.join(get_args(allowed))}"
    return None


def all_columns(metrics: Iterable[Metric], scope: Scope | None = None) -> list[Column]:
    """The columns of all metrics in order, of one scope or of both. Raises PluginError where two have the same name."""
    owners: dict[str, str] = {}
    found = []
    for metric in metrics:
        for column in columns_of(metric):
            if column.name in owners:
                both = f"metric '{owners[column.name]}' and metric '{metric.name}'"
                raise PluginError(f"column '{column.name}' is there twice: of {both}. Leave one of them out")
            owners[column.name] = metric.name
            found.append(column)
    return [column for column in found if scope is None or column.scope == scope]


def measure_shots(metrics: Sequence[Metric], shots: Iterable[Shot], *, strict: bool = False) -> dict[str, np.ndarray]:
    """(n,) float64 by column of scope "shot", a row a shot; NaN where a column does not apply, or its metric failed.

    A metric that raises, or returns what is no measure, costs one PhrtWarning that names it; with `strict` it is a PluginFailure.
    Raises PluginError for a column that is there twice, ValueError for a shot that is none.
    """
    columns: dict[str, list[float]] = {column.name: [] for column in all_columns(metrics, "shot")}
    judges = [(metric, names) for metric in metrics if (names := names_of(metric, "shot"))]
    failures: dict[str, list[str]] = {}
    count = 0
    for shot in shots:
        check_shot(shot)
        count += 1
        for metric, names in judges:
            found, reason = contained(metric, names, "of_shot()", partial(metric.of_shot, shot), strict)
            if reason:
                title = fault_of("metric", metric, "").title
                failures.setdefault(title, []).append(f"frame {shot.index}: {reason}")
            for name, value in found.items():
                columns[name].append(value)
    for title, reasons in failures.items():
        warnings.warn(
            PhrtWarning(
                f"{title} failed in {len(reasons)} of {count} judged frames and is left out there; {reasons[0]}"
            ),
            stacklevel=2,
        )
    return {name: np.array(values, np.float64) for name, values in columns.items()}


def measure_run(metrics: Sequence[Metric], frames: RunFrames, *, strict: bool = False) -> dict[str, float]:
    """Every column of scope "run"; NaN where it does not apply, or its metric failed, with one PhrtWarning that names it; with
    `strict` it is a PluginFailure.

    Raises PluginError for a column that is there twice.
    """
    all_columns(metrics, "run")
    values: dict[str, float] = {}
    for metric in metrics:
        if not (names := names_of(metric, "run")):
            continue
        found, reason = contained(metric, names, "of_run()", partial(metric.of_run, frames), strict)
        values |= found
        if reason:
            title = fault_of("metric", metric, "").title
            warnings.warn(PhrtWarning(f"{title} failed and is left out: {reason}"), stacklevel=2)
    return values


def names_of(metric: Metric, scope: Scope) -> list[str]:
    """The columns of a metric that have this scope."""
    return [column.name for column in columns_of(metric) if column.scope == scope]


def contained(
    metric: Metric, names: Sequence[str], call: str, measure: Callable[[], object], strict: bool
) -> tuple[dict[str, float], str | None]:
    """What `measure` says of the columns `names` of a metric, NaN where it says nothing; and None, or why it failed. With `strict`
    that is a PluginFailure."""
    empty = dict.fromkeys(names, math.nan)
    try:
        return empty | checked_measures(measure(), names), None
    except CAUGHT as error:
        if strict:
            raise PluginFailure(fault_of("metric", metric, raised(call, error))) from error
        return empty, describe(error)


def checked_measures(found: object, names: Sequence[str]) -> dict[str, float]:
    """What a metric returned as finite numbers or NaN. Raises ValueError for anything else."""
    if not isinstance(found, Mapping):
        raise ValueError(f"it returned {type(found).__name__}, no mapping of columns")
    for name, value in found.items():
        if name not in names:
            raise ValueError(f"it returned the column {name!r}, which is none of {', '.join(names)}")
        if not isinstance(value, Real):
            raise ValueError(f"its column '{name}' is {value!r}, no number")
        if math.isinf(value):
            raise ValueError(f"its column '{name}' is infinite")
    return {name: float(value) for name, value in found.items()}


def check_size(size: tuple[int, int]) -> None:
    """Raises OptionError where pictures of `size` (width, height) are too small to be judged."""
    if min(size) < SMALLEST_SIDE:
        raise OptionError(
            f"size is {size[0]}x{size[1]}; pictures are judged from {SMALLEST_SIDE}x{SMALLEST_SIDE} pixels on"
        )


def check_shot(shot: Shot) -> None:
    """Raises ValueError where the arrays of a shot, or of the one before, are not what `Shot` says."""
    if min(shot.display.shape[:2]) < SMALLEST_SIDE:
        raise ValueError(
            f"the pictures of frame {shot.index} have shape {shot.display.shape}; "
            f"they are judged from {SMALLEST_SIDE}x{SMALLEST_SIDE} pixels on"
        )
    shape = (*shot.display.shape[:2], 3)
    for each in (shot, shot.previous):
        if each is None:
            continue
        for name, kinds in (
            ("image", (np.float32, np.float64)), ("display", (np.uint8,)),
            ("reference", (np.float32, np.float64)), ("reference_display", (np.uint8,)),
        ):  # fmt: skip
            check_array(f"{name} of frame {each.index}", getattr(each, name), shape, kinds)
    check_array(f"changeable of frame {shot.index}", shot.changeable, shape[:2], (np.bool_,))
    if shot.motion is not None:
        check_array(f"motion of frame {shot.index}", shot.motion, (*shape[:2], 2), (np.float16, np.float32, np.float64))


def check_array(name: str, array: np.ndarray, shape: tuple[int, ...], kinds: Sequence[type]) -> None:
    """Raises ValueError where `array` has another shape, or none of these dtypes."""
    if array.shape != shape or array.dtype not in kinds:
        allowed = " or ".join(np.dtype(kind).name for kind in kinds)
        raise ValueError(f"{name} is {array.shape} {array.dtype}; expected {shape} {allowed}")
