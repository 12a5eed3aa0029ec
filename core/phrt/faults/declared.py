"""What an effect says of itself, checked before the first frame: its name, channels, layer, rule of history, and where it acts."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar, get_args, get_type_hints

import numpy as np

from phrt.channels import CHANNELS
from phrt.errors import did_you_mean
from phrt.faults.checks import check_array
from phrt.faults.fault import CAUGHT, Nonsense, PluginFailure, fault_of
from phrt.interfaces.effect import Adds, HistoryRule, LayerSpec, RayEffect
from phrt.world import World

MOVERS: tuple[str, ...] = get_args(get_type_hints(HistoryRule)["movers"])
ADDS: tuple[str, ...] = get_args(Adds)
LAYERS = {"visibility": (0, 1.0), "ambient_occlusion": (1, 1.0), "reflection": (3, 0.0), "refraction": (3, 0.0)}
"""Components and clear value of the layers that the composition reads."""

R = TypeVar("R")


def check_declared(effects: Sequence[RayEffect]) -> None:
    """Raises PluginFailure where an effect says of itself what cannot be, or two of them do not go together."""
    writers: dict[str, RayEffect] = {}
    for effect in effects:
        for attribute, check in CHECKS.items():
            _call(effect, f"has a wrong `{attribute}`", partial(check, effect))
        other = writers.setdefault(effect.writes.name, effect)
        mine, theirs = effect.writes, other.writes
        if (mine.components, mine.clear) != (theirs.components, theirs.clear):
            raise PluginFailure(
                fault_of(
                    "effect",
                    effect,
                    f"writes layer '{mine.name}' with {mine.components} components and clear value {mine.clear:g}, effect "
                    f"'{other.name}' with {theirs.components} and {theirs.clear:g}: they cannot both be used",
                )
            )


def checked_applies(effect: RayEffect, world: World) -> np.ndarray:
    """(materials,) bool, what `applies_to` says. Raises PluginFailure where it fails, or says what cannot be."""

    def applies() -> np.ndarray:
        answer = effect.applies_to(world)
        check_array("", answer, (len(world.materials),), np.bool_)
        return answer

    return _call(effect, "cannot say where it applies", applies)


def checked_rays(effect: RayEffect, world: World) -> float:
    """What `rays_per_pixel` says. Raises PluginFailure where it fails, or says what cannot be."""

    def rays() -> float:
        answer = float(effect.rays_per_pixel(world))
        if not 0 <= answer < math.inf:
            raise Nonsense(f"{answer:g}", "a finite number, 0 or more")
        return answer

    return _call(effect, "cannot say how many rays it takes", rays)


def _call(effect: RayEffect, what: str, function: Callable[[], R]) -> R:
    try:
        return function()
    except CAUGHT as error:
        reason = str(error) if isinstance(error, Nonsense) else f"{type(error).__name__}: {error}".rstrip(": ")
        raise PluginFailure(fault_of("effect", getattr(effect, "whole", effect), f"{what}: {reason}")) from error


def _need(condition: bool, given: object, wanted: str) -> None:
    if not condition:
        raise ValueError(f"given {given!r:.80}; wanted {wanted}")


def _name(effect: RayEffect) -> None:
    _need(isinstance(effect.name, str) and bool(effect.name), effect.name, "a text")
    _need("@" not in effect.name, effect.name, "a name without @, which stands before a light's path")


def _switch(effect: RayEffect) -> None:
    _need(isinstance(effect.switch, str), effect.switch, "the name that objects switch it by")


def _reads(effect: RayEffect) -> None:
    _need(isinstance(effect.reads, tuple), effect.reads, "a tuple of channels")
    for name in effect.reads:
        near = did_you_mean(str(name), list(CHANNELS))
        _need(name in CHANNELS, name, f"channels of the G-buffer.{near}")


def _writes(effect: RayEffect) -> None:
    spec = effect.writes
    _need(isinstance(spec, LayerSpec), spec, "a LayerSpec")
    _need(isinstance(spec.name, str) and bool(spec.name), spec.name, "a layer's name")
    whole_number = isinstance(spec.components, int) and not isinstance(spec.components, bool)
    _need(whole_number and spec.components >= 0, spec.components, "components, 0 (one a light) or more")
    _need(math.isfinite(spec.clear), spec.clear, "a finite clear value")
    _need(spec.adds in ADDS, spec.adds, "adds, one of " + ", ".join(map(repr, ADDS)))
    expected = LAYERS.get(spec.name, (spec.components, spec.clear))
    wanted = f"what layer '{spec.name}' is composed of: {expected[0]} components, clear value {expected[1]:g}"
    _need((spec.components, spec.clear) == expected, (spec.components, spec.clear), wanted)


def _history(effect: RayEffect) -> None:
    rule = effect.history
    if rule is None:
        return
    _need(isinstance(rule, HistoryRule), rule, "a HistoryRule or None")
    _need(rule.movers in MOVERS, rule.movers, f"movers, one of {', '.join(MOVERS)}")
    _need(rule.parallax >= 0, rule.parallax, "parallax, 0 or more")
    _need(isinstance(rule.max_age, int) and rule.max_age >= 0, rule.max_age, "max_age, a whole number of frames")
    _need(0 <= rule.radius < math.inf, rule.radius, "radius, 0 or more and finite")


CHECKS: dict[str, Callable[[RayEffect], None]] = {
    "name": _name,
    "reads": _reads,
    "writes": _writes,
    "history": _history,
    "switch": _switch,
}
