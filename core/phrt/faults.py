"""Where plugins' faults end: an effect or a heuristic that fails is named and switched off, and the frame goes on."""

from __future__ import annotations

import threading
import warnings

import numpy as np

from phrt.errors import PhrtWarning, PluginError
from phrt.frame import Frame
from phrt.interfaces.effect import EffectResult, RayEffect


class Faults:
    """Calls effects, and keeps which of them, and whether the heuristic, failed. Thread-safe.

    An effect that raises, or returns what does not fit its layer, is switched off for the rest of the run with one warning
    that names it: it traces nothing more, and its pixels take its fallback. Where the fallback fails they take the layer's
    clear value; this, too, is told once. A heuristic that fails is not asked any more. With `strict` the error is raised.
    """

    def __init__(self, *, strict: bool = False) -> None:
        self._strict = strict
        self._off: set[str] = set()
        self._without_fallback: set[str] = set()
        self._heuristic_off = False
        self._lock = threading.Lock()

    @property
    def heuristic_is_off(self) -> bool:
        """Did the heuristic fail? Then it is not asked any more."""
        return self._heuristic_off

    def lose_heuristic(self, error: PluginError) -> None:
        """The heuristic failed, as `error` says: it is switched off for the rest of the run."""
        self._heuristic_off = True
        if self._strict:
            raise error
        warnings.warn(
            f"{error}; it is switched off, and what it did not choose takes the fallbacks", PhrtWarning, stacklevel=3
        )

    @property
    def any_fallback_lost(self) -> bool:
        """Did an effect fail in preparing or giving its fallback?"""
        return bool(self._without_fallback)

    def is_off(self, effect: RayEffect) -> bool:
        """Did the effect fail? Then it is not traced any more."""
        return effect.name in self._off

    def trace(self, effect: RayEffect, frame: Frame, pixels: np.ndarray) -> EffectResult | None:
        """What `effect.trace` gives at `pixels`; None when it failed, now or before."""
        if self.is_off(effect):
            return None
        try:
            result = effect.trace(frame, pixels)
            _check_values(effect, frame, result.values, len(pixels))
            _check_traced(result.traced, len(pixels))
        except Exception as error:
            with self._lock:
                first = not self.is_off(effect)
                self._off.add(effect.name)
            self._tell(effect, "its pixels take the fallback", error, first)
            return None
        return result

    def prepare_fallback(self, effect: RayEffect, frame: Frame) -> None:
        """`effect.prepare_fallback`; one that fails leaves the effect without a fallback."""
        if effect.name not in self._without_fallback:
            try:
                effect.prepare_fallback(frame)
            except Exception as error:
                self._lose_fallback(effect, error)

    def fallback(self, effect: RayEffect, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        """What `effect.fallback` gives at `pixels`; None, which stands for the layer's clear value, when it failed."""
        if effect.name in self._without_fallback:
            return None
        try:
            values = effect.fallback(frame, pixels)
            if values is not None:
                _check_values(effect, frame, values, len(pixels))
        except Exception as error:
            self._lose_fallback(effect, error)
            return None
        return values

    def applies_at(self, effect: RayEffect, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        """What `effect.applies_at` gives; None, which stands for every pixel, when it failed, and then there is no fallback."""
        if effect.name in self._without_fallback:
            return None
        try:
            applies = effect.applies_at(frame, pixels)
            if applies is not None and (applies.shape != pixels.shape or applies.dtype != np.bool_):
                raise ValueError(f"applies_at returned {applies.dtype}{applies.shape}, expected bool{pixels.shape}")
        except Exception as error:
            self._lose_fallback(effect, error)
            return None
        return applies

    def _lose_fallback(self, effect: RayEffect, error: Exception) -> None:
        with self._lock:
            first = effect.name not in self._without_fallback
            self._without_fallback.add(effect.name)
            self._off.add(effect.name)
        self._tell(effect, f"its pixels take the layer's clear value {effect.writes.clear:g}", error, first)

    def _tell(self, effect: RayEffect, instead: str, error: Exception, first: bool) -> None:
        if self._strict:
            raise error
        if first:
            warnings.warn(
                f"effect '{effect.name}' failed and is switched off, {instead}: {type(error).__name__}: {error}",
                PhrtWarning,
                stacklevel=3,
            )


def _check_values(effect: RayEffect, frame: Frame, values: np.ndarray, count: int) -> None:
    expected = (count, effect.writes.width(frame.world))
    if values.shape != expected or values.dtype != np.float32:
        raise ValueError(f"returned {values.dtype}{values.shape}, its layer needs float32{expected}")


def _check_traced(traced: np.ndarray | None, count: int) -> None:
    if traced is not None and (traced.shape != (count,) or traced.dtype != np.uint8):
        raise ValueError(f"returned traced as {traced.dtype}{traced.shape}, expected uint8{(count,)}")
