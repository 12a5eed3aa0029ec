"""Profile: what `phrt analyze` found out about a scene and a designer decided, read and put to use. Plain data, one YAML file.

It holds twice what may be changed by hand: under `objects` the values that are used, under `measured` what the analysis came to.
Where the two differ, somebody decided otherwise (phrt.profile_edits). What is left out under `objects` is as measured.
"""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import Field, field_validator

from phrt.controls import known_situations
from phrt.description.fields import Described, Importance, NotNegative, Real, Text, Whole
from phrt.description.prims import Switch
from phrt.description.problems import Problems
from phrt.description.validation import validated
from phrt.description.values import MAX_TEXT_BYTES, Value, read_text
from phrt.errors import PhrtWarning, ProfileError, SceneError, did_you_mean
from phrt.scene import Scene, SceneObject

PROFILE_VERSION = 1
_NAMED = 3
"""Objects that a message names; the others are counted."""


class ProfiledScene(Described):
    """Which scene it was."""

    name: Text = Field(description="Its name.")
    objects: dict[Text, Text] = Field(description="Hash of its objects, as `objects_hash` makes it, by situation.")


class Probes(Described):
    """How the measured values came about."""

    frames: Whole = Field(ge=1, description="Frames looked at in each situation, spread over the scene's.")
    size: tuple[Whole, Whole] = Field(description="Width and height of a probe, pixels.")
    situations: list[Text] = Field(description="Situations probed, each as the scene's variant of that name.")
    tone_map: Text = Field(description="Curve that changes were measured after.")
    machine: Text = Field(description="Where costs were measured; elsewhere they are not used.")


class EffectCost(Described):
    """What an effect takes, and does, on the whole scene."""

    ms_per_item: NotNegative = Field(description="Milliseconds that tracing an item takes whatever its size.")
    ms_per_ray: NotNegative = Field(description="Milliseconds that each ray adds.")
    change: NotNegative = Field(description="What it changes at a pixel it applies to, 0 to 1 after the tone map.")


class Given(Described):
    """What holds for an object: the part of a profile that is there to be edited."""

    importance: Importance | None = Field(
        None, description="How much the object matters: a number, or one per situation."
    )
    effects: dict[Text, Switch] = Field(default_factory=dict, description="Per effect auto, always or never.")
    note: str | None = Field(None, description="For people; kept.")
    edited: list[Text] = Field(
        default_factory=list, description="Values that stay as they are, as importance or effects.shadows."
    )


class Measured(Described):
    """What the analysis found for an object."""

    kind: Text = Field(description="What its materials are: mirror, glass, glossy, rough, unlit.")
    seen: Whole = Field(0, ge=0, description="Probes that show it.")
    area: NotNegative = Field(0.0, description="A, mean over the probes that show it.")
    visibility: NotNegative = Field(0.0, description="V, mean over all probes: the paper's initial visibility.")
    importance: Importance = Field(description="By rule and measurement, with what the scene says taken in.")
    effects: dict[Text, Switch] = Field(default_factory=dict, description="`never` where an effect changes nothing.")
    rays_per_pixel: dict[Text, dict[Text, NotNegative]] = Field(
        default_factory=dict, description="Q by effect and situation."
    )
    change: dict[Text, dict[Text, Real]] = Field(
        default_factory=dict, description="By effect and situation: change at a pixel, 0 to 1 after the tone map."
    )


class Profile(Described):
    """A profile file."""

    phrt_profile: int = Field(description="Version of the format.")
    scene: ProfiledScene
    probes: Probes
    effects: dict[Text, EffectCost] = Field(default_factory=dict)
    objects: dict[Text, Given] = Field(default_factory=dict)
    measured: dict[Text, Measured] = Field(default_factory=dict)

    @field_validator("effects", "objects", "measured", mode="before")
    @classmethod
    def _emptied(cls, section: object) -> object:
        """Headings, of a section or of an entry in it, below which everything was deleted."""
        if isinstance(section, dict):
            return {key: {} if entry is None else entry for key, entry in section.items()}
        return {} if section is None else section

    def coefficients(self) -> dict[str, dict[str, float]]:
        """By effect: ms_per_item and ms_per_ray, as `phrt.costs.CostModels.warm` takes them."""
        return {
            name: {"ms_per_item": cost.ms_per_item, "ms_per_ray": cost.ms_per_ray}
            for name, cost in self.effects.items()
        }

    def rays_per_pixel(self, scene: Scene, effect_names: Sequence[str]) -> np.ndarray:
        """(N + 1, effects) float64 of Q for the objects of `scene`, as loaded. Where an object was not measured it is the
        effect's median over those that were, and NaN where there are none."""
        table = np.full((len(scene.objects) + 1, len(effect_names)), np.nan)
        for row, entry in enumerate(scene.objects, start=1):
            known = self.measured[entry.path].rays_per_pixel if entry.path in self.measured else {}
            for column, name in enumerate(effect_names):
                table[row, column] = known.get(name, {}).get(scene.situation, np.nan)
        for column in range(len(effect_names)):
            known_rows = ~np.isnan(table[:, column])
            if known_rows.any():
                table[~known_rows, column] = np.median(table[known_rows, column])
        return table


def objects_hash(scene: Scene) -> str:
    """16 hexadecimal digits of what the scene says about its objects; two scenes with the same objects have the same."""
    said = [
        [entry.path, len(scene.meshes[entry.mesh].triangles), entry.importance, entry.effects, list(entry.tags)]
        for entry in scene.objects
    ]
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()[:16]


def read_profile(path: str | Path) -> Profile:
    """The profile in file `path`. Raises ProfileError: what is wrong, in which line, and what would help."""
    file = Path(path)
    value = _read(file)
    given = value.data.get("phrt_profile") if isinstance(value.data, dict) else None
    if given is None:
        raise ProfileError(f"{file}: is not a profile, which begins with `phrt_profile: {PROFILE_VERSION}`")
    if given.data != PROFILE_VERSION:
        raise ProfileError(
            f"{given.mark}: phrt_profile: given {given.kind}; this program reads version {PROFILE_VERSION}. "
            "`phrt analyze` writes a new one"
        )
    problems = Problems("profile")
    profile = validated(Profile, value, "", problems)
    try:
        problems.raise_if_any()
    except SceneError as error:
        raise ProfileError(str(error)) from None
    assert profile is not None
    return profile


def _read(file: Path) -> Value:
    """The text of `file` as plain values: nothing in it can make code run, and its size is bounded."""
    try:
        size = file.stat().st_size
        if size > MAX_TEXT_BYTES:
            raise ProfileError(f"{file}: {size} bytes; a profile may have at most {MAX_TEXT_BYTES}")
        text = file.read_bytes().decode("utf-8-sig")
    except (OSError, ValueError) as error:
        if isinstance(error, UnicodeDecodeError):
            raise ProfileError(f"{file}: is not UTF-8 text (byte {error.start})") from None
        raise ProfileError(f"{file}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not text.strip():
        raise ProfileError(f"{file}: the file is empty; `phrt analyze` writes a profile")
    try:
        return read_text(text, str(file), file)
    except SceneError as error:
        raise ProfileError(str(error).replace("a scene file", "a profile").replace("scene files", "profiles")) from None


def applied(profile: Profile, scene: Scene, name: str = "the profile") -> Scene:
    """`scene` with the importance and the effects' switches that `profile` gives its objects; `scene` itself stays as it is.

    A switch that the scene says itself is stronger than the profile's. Raises ProfileError where the profile is of
    another scene; a PhrtWarning says what does not fit. `name` is how messages call the profile.
    """
    check_fits(profile, scene, name)
    result = copy(scene)
    ignored: list[str] = []
    result.objects = [_with(profile, entry, scene, ignored) for entry in scene.objects]
    if ignored:
        _warn(f"{name}: the scene's own switch is stronger than the profile's for {_listed(ignored)}")
    return result


def _with(profile: Profile, entry: SceneObject, scene: Scene, ignored: list[str]) -> SceneObject:
    """One object as the profile has it."""
    given, measured = profile.objects.get(entry.path), profile.measured.get(entry.path)
    importance, effects = entry.importance, dict(entry.effects)
    as_measured = measured.effects if measured else {}
    for source in (measured, given):
        if source is not None and source.importance is not None:
            importance = source.importance
        for effect, switch in source.effects.items() if source is not None else ():
            if effect not in entry.effects:
                effects[effect] = switch
            elif source is given and switch not in (entry.effects[effect], as_measured.get(effect)):
                ignored.append(f"{entry.path} {effect}")
    return replace(entry, importance=dict(importance), effects=effects)


def check_fits(profile: Profile, scene: Scene, name: str) -> None:
    """Raises ProfileError where `profile` knows no object of `scene`; warns of what it does not know or knows otherwise."""
    if profile.scene.objects.get(scene.situation) == objects_hash(scene):
        return
    here, there = [entry.path for entry in scene.objects], {*profile.measured, *profile.objects}
    if here and not there & set(here):
        raise ProfileError(
            f"{name}: is the profile of scene '{profile.scene.name}'; scene '{scene.name}' has none of its objects. "
            "`phrt analyze` writes one"
        )
    new = [path for path in here if path not in there]
    if new:
        what = f"it does not know {_listed(new)}"
    elif scene.situation in profile.scene.objects:
        what = "its objects are not what they were"
    else:
        return
    _warn(f"{name}: the scene has changed since it was analysed: {what}; `phrt analyze` brings it up to date")


def warn_of_unknown(profile: Profile, scene: Scene, effects: Sequence[str], name: str) -> None:
    """Warns of what somebody wrote into `profile` that the scene, or this program with its `effects`, does not know."""
    paths = [entry.path for entry in scene.objects]
    said: tuple[tuple[str, set[str], list[str]], ...] = (
        ("object", set(profile.objects) - set(profile.measured), paths),
        ("effect", {effect for entry in profile.objects.values() for effect in entry.effects}, list(effects)),
        (
            "situation",
            {situation for entry in profile.objects.values() for situation in entry.importance or {}},
            [*known_situations(scene), *profile.scene.objects],
        ),
    )
    for what, given, known in said:
        unknown = sorted(given - set(known))
        if unknown:
            _warn(f"{name}: there is no {what} {_listed(unknown)} here.{did_you_mean(unknown[0], known)}")


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


def _warn(message: str) -> None:
    warnings.warn(message, PhrtWarning, stacklevel=3)
