"""A profile at work in a renderer: the scene as it has it, and what predictions start from."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from os import PathLike, fspath

import numpy as np

from phrt.interfaces.effect import RayEffect
from phrt.machine import machine_name
from phrt.profile import Profile, applied, read_profile, warn_of_unknown
from phrt.registry.manager import get_registry
from phrt.scene import Scene


def profiled(given: Profile | str | PathLike[str] | None, scene: Scene) -> tuple[Profile | None, Scene]:
    """The profile that is meant, if any, and `scene` as it has it. Raises ProfileError where it cannot be used."""
    if given is None:
        return None, scene
    name = "the profile" if isinstance(given, Profile) else fspath(given)
    profile = given if isinstance(given, Profile) else read_profile(fspath(given))
    result = applied(profile, scene, name)
    warn_of_unknown(profile, scene, get_registry().names("effect"), name)
    return profile, result


def known_rays(
    profile: Profile, scene: Scene, effects: Sequence[RayEffect], changed: Collection[str] = ()
) -> np.ndarray:
    """(N + 1, effects) float64: Q of every object of `scene`, NaN where `profile` does not know it. An effect that is one
    light's part of one that the profile knows has its share of that.

    changed: effects with other options than the scene's, which the profile was made with; what it says of them does not hold.
    """
    names = [effect.switch for effect in effects]
    shares = np.array([names.count(name) for name in names], np.float64)
    found = profile.rays_per_pixel(scene, names) / shares
    found[:, [name in changed for name in names]] = np.nan
    return found


def known_costs(profile: Profile | None, effects: Sequence[RayEffect]) -> dict[str, dict[str, float]]:
    """By effect, what `phrt.costs.CostModels.warm` takes; nothing on another machine than the one of the profile."""
    if profile is None or profile.probes.machine != machine_name():
        return {}
    known = profile.coefficients()
    return {effect.name: known[effect.switch] for effect in effects if effect.switch in known}
