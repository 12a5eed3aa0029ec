"""`analyze`: a scene in all its situations becomes a profile (Andrade et al. 2014, section 4.2, phases one and two)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from phrt.analysis.probes import Findings, probe
from phrt.analysis.rules import changes_nothing, factors, kinds_of, measured_factors, rule_factors
from phrt.controls import known_situations
from phrt.machine import machine_name
from phrt.profile import (
    PROFILE_VERSION,
    EffectCost,
    Given,
    Measured,
    Probes,
    Profile,
    ProfiledScene,
    objects_hash,
)
from phrt.scene import Scene, SceneObject
from phrt.world import World

ALIKE = 0.1
"""Relative; situations whose importance differs by no more are one."""


@dataclass(frozen=True)
class ProbeOptions:
    """How closely to look. frames: probes a situation; size: of a probe, pixels; strict: a plugin that fails is an error."""

    frames: int = 12
    size: tuple[int, int] = (160, 90)
    tone_map: str = "neutral"
    camera: int | str = 0
    threads: int | None = None
    strict: bool = False


@dataclass(frozen=True)
class _Looked:
    """A scene in one situation, and what its probes found; the scene itself is let go. factor (N + 1,): importance by rule and
    measurement. rows: by path, object numbers, 1-based. situations: all that the scene knows."""

    name: str
    objects: list[SceneObject]
    objects_hash: str
    situations: list[str]
    findings: Findings
    kinds: list[str]
    factor: np.ndarray
    rows: dict[str, int]


def analyze(
    load: Callable[[str], Scene],
    situations: Sequence[str],
    options: ProbeOptions = ProbeOptions(),
    done: Callable[[str], None] = lambda situation: None,
) -> Profile:
    """The profile of the scene that `load` gives in each of `situations`, the first of which is the plain one.

    done: called after each probe, with its situation.
    """
    looked = {situation: _look(load(situation), options, partial(done, situation)) for situation in situations}
    plain = looked[situations[0]]
    entries = {entry.path: entry for look in reversed(looked.values()) for entry in look.objects}
    measured = {path: _measured(path, entry, looked, plain.situations) for path, entry in entries.items()}
    gain = {path: _gain(path, looked) for path in entries}
    order = sorted(entries, key=lambda path: (-gain[path], not measured[path].seen, path))
    return Profile(
        phrt_profile=PROFILE_VERSION,
        scene=ProfiledScene(name=plain.name, objects={name: look.objects_hash for name, look in looked.items()}),
        probes=Probes(
            frames=max(look.findings.frames for look in looked.values()),
            size=options.size,
            situations=list(situations),
            tone_map=options.tone_map,
            machine=machine_name(),
        ),
        effects=_effects(looked.values()),
        objects={path: Given(importance=measured[path].importance, effects=measured[path].effects) for path in order},
        measured={path: measured[path] for path in order},
    )


def _look(scene: Scene, options: ProbeOptions, done: Callable[[], None]) -> _Looked:
    findings = probe(
        scene,
        options.size,
        options.frames,
        options.tone_map,
        camera=options.camera,
        threads=options.threads,
        strict=options.strict,
        done=done,
    )
    world = World(scene)
    kinds = kinds_of(world)
    measured = measured_factors(findings.total_change, findings.pixels)
    factor = factors(measured, findings.pixels, rule_factors(world, kinds), kinds, scene)
    rows = {entry.path: row for row, entry in enumerate(scene.objects, start=1)}
    return _Looked(
        scene.name, scene.objects, objects_hash(scene), known_situations(scene), findings, kinds, factor, rows
    )


def _measured(path: str, entry: SceneObject, looked: dict[str, _Looked], situations: list[str]) -> Measured:
    """All about one object."""
    mine = {name: (look, look.rows[path]) for name, look in looked.items() if path in look.rows}
    first, row = next(iter(mine.values()))
    frames = sum(look.findings.frames for look, _ in mine.values())
    seen = sum(int(look.findings.seen[row]) for look, row in mine.values())
    area = sum(float(look.findings.area[row]) for look, row in mine.values())
    visible = sum(float(look.findings.visibility[row]) for look, row in mine.values())
    return Measured(
        kind=first.kinds[row],
        seen=seen,
        area=area / seen if seen else 0.0,
        visibility=visible / frames if frames else 0.0,
        importance=_importance(entry, mine, situations),
        effects=dict.fromkeys(_idle(entry, mine), "never"),
        rays_per_pixel=_by_situation(mine, lambda find: find.rays, lambda find: find.traced),
        change=_by_situation(mine, lambda find: find.change, lambda find: find.effect_pixels),
    )


def _importance(entry: SceneObject, mine: dict[str, tuple[_Looked, int]], situations: list[str]) -> dict[str, float]:
    """By situation: what the scene says (1 where it says nothing) times the factor; one that has no probes of its own, and is
    only named by importance maps, takes the first one's."""
    first, row = next(iter(mine.values()))
    found: dict[str, float] = {}
    for situation in dict.fromkeys((*situations, *mine)):
        look, at = mine.get(situation, (first, row))
        said = look.objects[at - 1].importance if situation in mine else entry.importance
        found[situation] = _short(said.get(situation, said.get("default", 1.0)) * float(look.factor[at]))
    # What is left out is as `default`; a tenth more or less is that, too.
    usual = found["default"]
    return {name: value for name, value in found.items() if name == "default" or abs(value - usual) > ALIKE * usual}


def _short(value: float) -> float:
    """Two digits that count: more would say more than is known."""
    return float(f"{value:.2g}")


def _idle(entry: SceneObject, mine: dict[str, tuple[_Looked, int]]) -> list[str]:
    """Effects that change nothing about the object in any situation, those apart that the scene says something about."""
    idle: set[str] | None = None
    for look, row in mine.values():
        find = look.findings
        nothing = changes_nothing(find.seen, find.effect_pixels, find.change, find.peak, find.marked)[row]
        here = {name for name, ruled_out in zip(find.effect_names, nothing, strict=True) if ruled_out}
        idle = here if idle is None else idle & here
    return sorted((idle or set()) - set(entry.effects))


def _by_situation(
    mine: dict[str, tuple[_Looked, int]],
    value: Callable[[Findings], np.ndarray],
    pixels: Callable[[Findings], np.ndarray],
) -> dict[str, dict[str, float]]:
    """By effect and situation: a sum over the object's pixels, per pixel. value, pixels: (N + 1, E) of findings."""
    found: dict[str, dict[str, float]] = {}
    for situation, (look, row) in mine.items():
        find = look.findings
        for column, name in enumerate(find.effect_names):
            count = float(pixels(find)[row, column])
            if count > 0:
                each = float(value(find)[row, column]) / count
                found.setdefault(name, {})[situation] = float(f"{each:.3g}")
    return found


def _gain(path: str, looked: dict[str, _Looked]) -> float:
    """What tracing the object changes in the picture, summed over probes: what the profile is sorted by."""
    return sum(float(look.findings.total_change[look.rows[path]]) for look in looked.values() if path in look.rows)


def _effects(looked: Iterable[_Looked]) -> dict[str, EffectCost]:
    """The effects on the whole scene, each in the first situation that has it."""
    found: dict[str, EffectCost] = {}
    for look in looked:
        find = look.findings
        for column, name in enumerate(find.effect_names):
            pixels = float(find.effect_pixels[:, column].sum())
            if name not in found and pixels > 0 and name in find.coefficients:
                found[name] = EffectCost(change=float(find.change[:, column].sum()) / pixels, **find.coefficients[name])
    return found
