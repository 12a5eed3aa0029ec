"""The faults of a run: who failed, who is switched off, and what is called in their place."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from phrt.errors import PhrtWarning
from phrt.faults.checks import check_applies, check_result, check_values
from phrt.faults.fault import CAUGHT, Fault, PluginFailure, culprit, fault_of, raised
from phrt.frame import Frame
from phrt.interfaces.effect import EffectResult, RayEffect
from phrt.interfaces.heuristic import Heuristic
from phrt.registry.origins import is_ours

R = TypeVar("R")

NO_RAYS = "no more rays are traced in this run, and all pixels take the fallbacks"
EFFECT_OFF = "it is switched off, and its pixels take the fallback"
HEURISTIC_OFF = "it is switched off, and what it did not choose takes the fallbacks"
BUILT_ANEW = "it is built anew"
LEFT_OPEN = "what it held may not have been given back"


class Faults:
    """Calls effects, and keeps which plugins failed in a run, and what was done about it. Thread-safe.

    An effect that raises, or returns what does not fit its layer, is switched off for the rest of the run: it traces nothing more,
    and its pixels take its fallback; where the fallback fails they take the layer's clear value. A heuristic that fails is not
    asked any more. When a tracer fails, no effect is traced any more. Each of these is told once, by a PhrtWarning that names the
    plugin, its package and the cause. With `strict` it is a PluginFailure instead, with the plugin's own error as its cause.

    log: the faults so far, as they were told
    """

    def __init__(self, *, strict: bool = False) -> None:
        self.strict = strict
        self.log: list[Fault] = []
        self._frame: int | None = None
        self._before_frame = 0
        self._told: set[tuple[str, str, str]] = set()
        self._off: set[str] = set()
        self._without_fallback: set[str] = set()
        self._tracer_failure: PluginFailure | None = None
        self._heuristic_off = False
        self._lock = threading.Lock()

    # Telling

    def begin_frame(self, number: int | None) -> None:
        """What fails from now on fails in frame `number`; None: outside of a frame."""
        self._frame, self._before_frame = number, len(self.log)

    @property
    def of_frame(self) -> tuple[Fault, ...]:
        """Those that were told since the frame began."""
        return tuple(self.log[self._before_frame :])

    def tell(self, fault: Fault, error: BaseException | None = None) -> None:
        """Keep `fault`, and warn of it; both only the first time. With `strict`, raise it; `error` is its cause."""
        if self.strict:
            fault = replace(fault, done="")
        if self._keep(fault) and not self.strict:
            warnings.warn(str(fault), PhrtWarning, stacklevel=4)
        if self.strict:
            # Of a failure that passed through another plugin, the cause is what began it.
            raise PluginFailure(fault) from (error.__cause__ if isinstance(error, PluginFailure) else error)

    def note(self, fault: Fault) -> None:
        """Keep `fault`, which ends the run."""
        self._keep(fault)

    def _keep(self, fault: Fault) -> bool:
        """Put `fault` into the log, unless it is there. Was it new?"""
        with self._lock:
            key = (fault.kind, fault.name, fault.done)
            new = key not in self._told
            self._told.add(key)
            if new:
                self.log.append(replace(fault, frame=self._frame))
            return new

    # Heuristics

    @property
    def heuristic_is_off(self) -> bool:
        """Did the heuristic fail? Then it is not asked any more."""
        return self._heuristic_off

    def lose_heuristic(self, heuristic: Heuristic, cause: str, error: BaseException | None = None) -> None:
        """The heuristic failed, as `cause` says: it is switched off for the rest of the run."""
        self._heuristic_off = True
        self.tell(fault_of("heuristic", heuristic, cause, HEURISTIC_OFF), error)

    def says(self, heuristic: Heuristic, attribute: str) -> bool:
        """A heuristic's attribute of this name, true or false; false when it failed, now or before."""
        if self._heuristic_off:
            return False
        try:
            return bool(getattr(heuristic, attribute))
        except CAUGHT as error:
            self.lose_heuristic(heuristic, raised(attribute, error), error)
            return False

    # Tracers and G-buffer producers

    @property
    def tracer_failure(self) -> PluginFailure | None:
        """How the tracer failed, if it did: then nothing is traced any more."""
        return self._tracer_failure

    def lose_tracer(self, lost: PluginFailure) -> None:
        """The tracer failed. It never raises: effects are about to be left by `lost`, and `trace` says the rest."""
        with self._lock:
            first = self._tracer_failure is None
            self._tracer_failure = self._tracer_failure or lost
        fault = replace(lost.fault, done="" if self.strict else NO_RAYS)
        if first and self._keep(fault) and not self.strict:
            warnings.warn(str(fault), PhrtWarning, stacklevel=4)

    def built_anew(self, kind: str, plugin: object, error: BaseException) -> None:
        """A tracer or a producer could not follow what moved, and is about to be built for the scene as it is."""
        self.tell(fault_of(kind, plugin, raised("update()", error), BUILT_ANEW), error)

    def not_closed(self, kind: str, plugin: object, error: BaseException) -> None:
        """A tracer or a producer failed when it was closed."""
        self.tell(fault_of(kind, plugin, raised("close()", error), LEFT_OPEN), error)

    # Effects

    @property
    def any_fallback_lost(self) -> bool:
        """Did an effect fail in preparing or giving its fallback?"""
        return bool(self._without_fallback)

    def is_off(self, effect: RayEffect) -> bool:
        """Did the effect, or the tracer, fail? Then it is not traced any more."""
        return self._tracer_failure is not None or whole(effect).name in self._off

    def trace(self, effect: RayEffect, frame: Frame, pixels: np.ndarray) -> EffectResult | None:
        """What `effect.trace` gives at `pixels`; None when it failed, now or before."""
        if self.is_off(effect):
            return None
        try:
            result = effect.trace(frame, pixels)
            check_result(effect, frame, result, len(pixels), self._looks_at(effect))
        except CAUGHT as error:
            self._lose_effect(effect, error)
            return None
        if self._tracer_failure is not None:
            # Another thread's rays failed; or this effect's, and it hid it.
            self._lose_effect(effect, self._tracer_failure)
            return None
        return result

    def begin_run(self, effect: RayEffect) -> None:
        """`effect.begin_run`; one that fails leaves the effect without a fallback."""
        self._fall_back(effect, "begin_run()", effect.begin_run)

    def prepare_fallback(self, effect: RayEffect, frame: Frame) -> None:
        """`effect.prepare_fallback`; one that fails leaves the effect without a fallback."""
        self._fall_back(effect, "prepare_fallback()", lambda: effect.prepare_fallback(frame))

    def fallback(self, effect: RayEffect, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        """What `effect.fallback` gives at `pixels`; None, which stands for the layer's clear value, when it failed."""

        def fallback() -> np.ndarray | None:
            values = effect.fallback(frame, pixels)
            if values is not None:
                check_values(effect, frame, values, len(pixels), self._looks_at(effect))
            return values

        return self._fall_back(effect, "fallback()", fallback)

    def applies_at(self, effect: RayEffect, frame: Frame, pixels: np.ndarray) -> np.ndarray | None:
        """What `effect.applies_at` gives; None, which stands for every pixel, when it failed, and then there is no fallback."""

        def applies_at() -> np.ndarray | None:
            applies = effect.applies_at(frame, pixels)
            check_applies(applies, len(pixels))
            return applies

        return self._fall_back(effect, "applies_at()", applies_at)

    def _fall_back(self, effect: RayEffect, call: str, function: Callable[[], R]) -> R | None:
        """What `function`, a call that fallbacks rest on, gives; None when it, or another of them, failed."""
        if whole(effect).name in self._without_fallback:
            return None
        try:
            return function()
        except CAUGHT as error:
            with self._lock:
                self._without_fallback.add(whole(effect).name)
                self._off.add(whole(effect).name)
            clear = f"the layer's clear value {effect.writes.clear:g}"
            self._tell(effect, call, error, f"it is switched off, and its pixels take {clear}")
            return None

    def _looks_at(self, effect: RayEffect) -> bool:
        """Are the numbers that the effect returns looked at, too? Not of our own, unless `strict`."""
        return self.strict or not is_ours(whole(effect))

    def _lose_effect(self, effect: RayEffect, error: BaseException) -> None:
        with self._lock:
            self._off.add(whole(effect).name)
        self._tell(effect, "trace()", error, EFFECT_OFF)

    def _tell(self, effect: RayEffect, call: str, error: BaseException, done: str) -> None:
        """Tell what `effect` did wrong; where its rays or its views failed it, what they did."""
        other = culprit(error)
        if other is None:
            self.tell(fault_of("effect", whole(effect), raised(call, error), done), error)
        elif (
            other.fault.kind == "tracer" and self._tracer_failure is not None and done == EFFECT_OFF and not self.strict
        ):
            # It was told when it happened, and concerns all effects.
            return
        else:
            about = done.replace("it is", f"effect '{whole(effect).name}' is", 1)
            self.tell(replace(other.fault, done=about), other)


def whole(effect: RayEffect) -> RayEffect:
    """The effect that `effect` is a part of, or itself."""
    part_of = getattr(effect, "whole", None)
    return part_of if isinstance(part_of, RayEffect) else effect
