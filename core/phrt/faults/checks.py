"""What plugins return in a frame, checked: shapes, dtypes, and numbers that are none. A few microseconds a call."""

from __future__ import annotations

import operator
from typing import SupportsIndex, cast

import numpy as np

from phrt.faults.fault import Nonsense
from phrt.frame import Frame
from phrt.interfaces.effect import EffectResult, RayEffect
from phrt.kernels.checks import all_finite


def check_result(effect: RayEffect, frame: Frame, result: EffectResult, count: int, numbers: bool) -> None:
    """Raises Nonsense unless `result` is what `effect.trace` may return for `count` pixels. numbers: are values looked at, too?"""
    if not isinstance(result, EffectResult):
        raise Nonsense(type(result).__name__, "an EffectResult")
    check_traced(result.traced, count)
    check_values(effect, frame, result.values, count, numbers, result.traced)
    rays, shared = _whole(result.rays, "rays"), _whole(result.shared_rays, "shared rays")
    if not 0 <= shared <= rays:
        raise Nonsense(f"{rays} rays, {shared} of them shared", "0 or more, and of these no more than all")


def check_values(
    effect: RayEffect,
    frame: Frame,
    values: np.ndarray,
    count: int,
    numbers: bool,
    traced: np.ndarray | None = None,
) -> None:
    """Raises Nonsense unless `values` are `count` values of the effect's layer; with `numbers` finite where they are `traced`."""
    check_array("", values, (count, effect.writes.width(frame.world)), np.float32)
    if numbers and not all_finite(np.ravel(values)):
        wrong = ~np.isfinite(values).all(axis=1)
        wrong &= True if traced is None else traced != 0
        if wrong.any():
            raise Nonsense(
                f"{values[wrong][0].tolist()} at {np.count_nonzero(wrong)} of {count} pixels", "finite numbers"
            )


def check_traced(traced: np.ndarray | None, count: int) -> None:
    """Raises Nonsense unless `traced` is None, or (count,) uint8."""
    if traced is not None:
        check_array("traced as ", traced, (count,), np.uint8)


def check_applies(applies: np.ndarray | None, count: int) -> None:
    """Raises Nonsense unless `applies` is None, or (count,) bool."""
    if applies is not None:
        check_array("", applies, (count,), np.bool_)


def check_array(what: str, array: object, shape: tuple[int, ...], dtype: type[np.generic]) -> None:
    """Raises Nonsense unless `array` is an array of this shape and dtype. what: said before it."""
    if not isinstance(array, np.ndarray):
        raise Nonsense(f"{what}{type(array).__name__}", f"{np.dtype(dtype)}{shape}")
    if array.shape != shape or array.dtype != dtype:
        raise Nonsense(f"{what}{array.dtype}{array.shape}", f"{np.dtype(dtype)}{shape}")


def _whole(value: object, what: str) -> int:
    try:
        return operator.index(cast(SupportsIndex, value))
    except TypeError:
        raise Nonsense(f"{value!r:.80} {what}", "a whole number") from None
