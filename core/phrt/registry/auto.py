"""What `auto` stands for. Fixed lists: installing a plugin never changes a default."""

from __future__ import annotations

from dataclasses import dataclass

from phrt.errors import PluginError
from phrt.registry.descriptors import Device, GBufferPlugin
from phrt.registry.manager import Registry, describe, get_registry

AUTO_TRACERS = ("embree", "open3d", "numpy")
"""Fastest first; the first that is available is taken."""

HARDWARE_GBUFFERS = ("moderngl",)
"""Taken when they draw on a GPU; on a processor, primary rays are as fast and need no OpenGL."""

FALLBACK_GBUFFER = "raycast"

DEFAULT_EFFECTS = ("shadows", "reflections", "refractions")
"""What is traced when nobody names effects."""

DEFAULT_HEURISTIC = "all_trace"


@dataclass(frozen=True)
class Choice:
    """What `auto` picks, and why in one sentence."""

    name: str
    reason: str


def choose_tracer(registry: Registry | None = None) -> Choice:
    """The tracer that `auto` stands for here. Raises PluginError naming every reason when none is available."""
    reasons: list[str] = []
    for name in AUTO_TRACERS:
        reason = (registry or get_registry()).find("tracer", name).unavailable_reason()
        if reason is None:
            return Choice(name, "; ".join([*reasons, f"{name} is available"]))
        reasons.append(f"{name} is not available: {reason}")
    raise PluginError("no tracer is available: " + "; ".join(reasons))


def choose_gbuffer(registry: Registry | None = None) -> Choice:
    """The G-buffer producer that `auto` stands for here."""
    reasons: list[str] = []
    for name in HARDWARE_GBUFFERS:
        entry = (registry or get_registry()).find("gbuffer", name)
        if reason := entry.unavailable_reason():
            reasons.append(f"{name} is not available: {reason}")
            continue
        device = gbuffer_device(entry.plugin)
        if isinstance(device, Device) and device.is_hardware:
            return Choice(name, f"{name} draws on a GPU ({device.description})")
        drawn_by = device.description if isinstance(device, Device) else device or "the processor"
        reasons.append(f"{name} would not draw on a GPU ({drawn_by})")
    return Choice(FALLBACK_GBUFFER, "; ".join(reasons))


def gbuffer_device(plugin: object) -> Device | str | None:
    """What a producer draws with, None when it has no device of its own, or why that cannot be told."""
    if not isinstance(plugin, GBufferPlugin):
        return None
    try:
        return plugin.device()
    except (Exception, SystemExit) as error:
        return describe(error)
