"""What a designer decided in a profile, told from what was measured, and kept when the scene is analysed again.

A value under `objects` is decided where it differs from the one under `measured`, or where `edited` names it. The second is how
a decision outlives an analysis that happens to come to the same value. A value that is not there is not decided. An object's
importance is one value with all its situations; each effect's switch is one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

from phrt.description.prims import Switch
from phrt.profile import Given, Measured, Profile

SAME = 1e-9
"""Relative; numbers nearer than that are one number, written twice."""


@dataclass(frozen=True)
class Decision:
    """One value of one object that somebody decided."""

    path: str
    value: str
    """Its name, as `importance` or `effects.shadows`."""
    given: Mapping[str, float] | str


def decisions_of(profile: Profile) -> list[Decision]:
    """Every decided value of `profile`, object by object."""
    return [
        decision for path, given in profile.objects.items() for decision in _of(path, given, profile.measured.get(path))
    ]


def _of(path: str, given: Given, measured: Measured | None) -> list[Decision]:
    numbers = measured.importance if measured else {}
    switches = measured.effects if measured else {}
    found = []
    if given.importance is not None and ("importance" in given.edited or not _same(given.importance, numbers)):
        found.append(Decision(path, "importance", given.importance))
    found += [
        Decision(path, name, switch)
        for effect, switch in given.effects.items()
        if (name := f"effects.{effect}") in given.edited or switch != switches.get(effect, "auto")
    ]
    return found


def _same(one: Mapping[str, float], other: Mapping[str, float]) -> bool:
    return one.keys() == other.keys() and all(math.isclose(one[key], other[key], rel_tol=SAME) for key in one)


def with_decisions(fresh: Profile, old: Profile) -> tuple[Profile, list[Decision]]:
    """`fresh` with every decision and note of `old`, and which decisions those were.

    Decisions about objects that are gone are kept too: objects come back.
    """
    decisions = decisions_of(old)
    by_path: dict[str, list[Decision]] = {}
    for decision in decisions:
        by_path.setdefault(decision.path, []).append(decision)
    objects = dict(fresh.objects)
    for path, before in old.objects.items():
        if path in by_path or before.note is not None:
            objects[path] = _decided(objects.get(path, Given()), by_path.get(path, []), before.note)
    return fresh.model_copy(update={"objects": objects}), decisions


def _decided(fresh: Given, decisions: list[Decision], note: str | None) -> Given:
    importance, effects = fresh.importance, dict(fresh.effects)
    for decision in decisions:
        if isinstance(decision.given, str):
            effects[decision.value.removeprefix("effects.")] = cast(Switch, decision.given)
        else:
            importance = dict(decision.given)
    return Given(importance=importance, effects=effects, note=note, edited=[decision.value for decision in decisions])
