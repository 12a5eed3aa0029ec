"""What a run was made with: the resolved configuration, versions, and the machine."""

from __future__ import annotations

import os
import platform
from dataclasses import fields
from functools import lru_cache
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from phrt.clock import beneath
from phrt.interfaces.effect import RayEffect
from phrt.interfaces.heuristic import Heuristic
from phrt.machine import cpu_model
from phrt.registry import get_registry
from phrt.workers import usable_cores

if TYPE_CHECKING:
    from phrt.renderer import Renderer

PACKAGES = ("phrt", "numpy", "numba", "llvmlite", "embreex", "open3d", "moderngl", "pydantic", "pyarrow", "av")


def resolved_config(renderer: Renderer) -> dict[str, Any]:
    """Everything about `renderer` that decides what its frames are, defaults filled in."""
    config: dict[str, Any] = {"scene": scene_config(renderer), "size": list(renderer.size)}
    config["heuristic"] = heuristic_config(renderer.heuristic)
    # An effect that is chosen light by light is there once per light, with the same options.
    config["effects"] = {base(e.name): {"layer": base(e.writes.name), **options_of(e)} for e in renderer.effects}
    config["tracer"] = {"name": renderer.tracer_name, "description": renderer.tracer.capabilities.description}
    config["gbuffer"] = {"name": renderer.gbuffer_name}
    config["seed"] = "frame number * aa + sample; a heuristic's own is among its options"
    config["threads"] = renderer.workers.threads
    config["clock"] = type(beneath(renderer.clock)).__name__
    config["controls"] = {field.name: getattr(renderer.controls, field.name) for field in fields(renderer.controls)}
    config["track"] = [
        {"time": key.time}
        | {f.name: v for f in fields(key.controls) if (v := getattr(key.controls, f.name)) is not None}
        for key in renderer.scene.settings.track
    ]
    config |= {"aa": renderer.aa, "tracer_name": renderer.tracer_name, "gbuffer_name": renderer.gbuffer_name}
    config |= {"budget": renderer.budget, "persistence": renderer.persistence}
    config |= {name: getattr(renderer.run.terms, name) for name in ("cost_model", "group_by", "history", "reserve_ms")}
    config |= {"measure_each": renderer.measure_each, "measure_change": renderer.measure_change}
    return config


def scene_config(renderer: Renderer) -> dict[str, Any]:
    """Which scene, in which situation, and its objects: number 1 first, with the effects that apply to each."""
    scene, world = renderer.scene, renderer.world
    effects = zip(renderer.effects, renderer.run.scopes, strict=True)
    applies = {base(effect.name): world.object_has(scope.applies) for effect, scope in effects}
    objects = [
        {
            "path": entry.path,
            "effects": dict(entry.effects),
            "applies": [name for name, mask in applies.items() if mask[number]],
            "importance": dict(entry.importance),
            "tags": list(entry.tags),
        }
        for number, entry in enumerate(scene.objects, start=1)
    ]
    return {
        "name": scene.name,
        "source": None if scene.source is None else str(scene.source),
        "situation": scene.situation,
        "fps": scene.settings.fps,
        "exposure": scene.settings.exposure,
        "lights": [light.path for light in scene.lights],
        "objects": objects,
    }


def heuristic_config(heuristic: Heuristic) -> dict[str, Any]:
    """Its plugin's name (None for one that is no plugin), class and options."""
    home = f"{type(heuristic).__module__}:{type(heuristic).__qualname__}"
    named = [entry.name for entry in get_registry().plugins("heuristic") if entry.plugin.factory == home]
    return {
        "name": named[0] if named else None,
        "class": home,
        "options": options_of(heuristic),
        "traces_everything": _says(heuristic, "traces_everything"),
    }


def options_of(plugin: object) -> dict[str, Any]:
    """The options that a plugin was made with, as it keeps them: an attribute that is a pydantic model, its own or that of the
    effect it stands for."""
    for value in vars(plugin).values() if hasattr(plugin, "__dict__") else ():
        if isinstance(value, BaseModel):
            return value.model_dump(mode="json")
        if isinstance(value, RayEffect):
            return options_of(value)
    return {}


def base(name: str) -> str:
    """ "shadows" of "shadows@/Lights/West"."""
    return name.partition("@")[0]


def heuristic_name(heuristic: Heuristic) -> str:
    """As the command line calls it, else its class."""
    found = heuristic_config(heuristic)
    return str(found["name"] or type(heuristic).__name__)


def versions() -> dict[str, str | None]:
    """Of Python and of the packages that a picture depends on; None where one is not installed."""
    return {"python": platform.python_version()} | {package: installed(package) for package in PACKAGES}


@lru_cache
def installed(package: str) -> str | None:
    """The version of `package`; None where it is not installed. Looking it up reads files, so once is enough."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def machine() -> dict[str, Any]:
    """Processor, cores that may be used, memory, system."""
    return {"cpu": cpu_model(), "cores": usable_cores(), "memory_gb": memory_gb(), "system": platform.platform()}


def memory_gb() -> float | None:
    """Physical memory in GB; None where the system does not tell."""
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9, 1)
    except (AttributeError, OSError, ValueError):
        return None


def _says(heuristic: Heuristic, attribute: str) -> bool:
    """An attribute of a heuristic; false where it cannot be read, which the run tells (phrt.faults)."""
    try:
        return bool(getattr(heuristic, attribute))
    except Exception:
        return False
