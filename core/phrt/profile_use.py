"""A profile at work in a renderer: the scene as it has it, and what predictions start from."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike, fspath

import numpy as np

from phrt.costs import CostModels
from phrt.experience import Experience
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


def warm_start(
    profile: Profile, scene: Scene, effects: Sequence[RayEffect], experience: Experience, costs: CostModels
) -> None:
    """Begin with what `profile` knows: Q of every object, and, on the machine where they were measured, times. Effects that
    are one light's share each of an effect the profile knows take their share of its Q."""
    names = [effect.switch for effect in effects]
    shares = np.array([names.count(name) for name in names], np.float64)
    experience.expect(profile.rays_per_pixel(scene, names) / shares)
    if profile.probes.machine == machine_name():
        known = profile.coefficients()
        costs.warm({effect.name: known[effect.switch] for effect in effects if effect.switch in known})
