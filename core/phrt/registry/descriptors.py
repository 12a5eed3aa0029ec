"""Descriptors: what a plugin says about itself before anything of it is imported."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict

PLUGIN_API_VERSION = 1
"""What plugins are written against: the hooks, the descriptors, `phrt.interfaces`, and the plain data that these hand over.

It grows by one when a plugin that follows the documentation could break: a name goes away, an argument or its meaning changes, a
method has to be written that had not to be. What is only added (an optional method with a default, a field at the end of a
dataclass, a hook) changes nothing. See docs/plugins.md."""

OLDEST_API_VERSION = 1
"""The oldest one that is still accepted. Each is, for at least a year after the next one came out."""

FIRST_API_VERSION = 1
"""What a descriptor that says nothing was written for: it must not claim what came later."""


class Options(BaseModel):
    """Base of every plugin's options: one `Field` holds an option's default, range, unit and meaning."""

    model_config = ConfigDict(extra="forbid", frozen=True)


def always_available() -> str | None:
    """The `unavailable_reason` of plugins that need nothing special."""
    return None


@dataclass(frozen=True)
class Plugin:
    """name: what configs say. summary: one line. factory: "module:Class", imported when first used and called with the options.
    options: their model; a unit goes into `Field(..., json_schema_extra={"unit": "metres"})`.
    unavailable_reason: None, or why it cannot run here and what to install; it imports nothing heavy.
    api_version: the plugin API that it was written for; one newer than `PLUGIN_API_VERSION` is refused, and so is one older than
    `OLDEST_API_VERSION`.
    """

    name: str
    summary: str
    factory: str
    options: type[Options] = Options
    unavailable_reason: Callable[[], str | None] = always_available
    api_version: int = FIRST_API_VERSION


@dataclass(frozen=True)
class Device:
    """What a G-buffer producer draws with. description: vendor, renderer and version, for people."""

    description: str
    is_hardware: bool


def no_device() -> Device | None:
    """The `device` of producers that run on the processor without a driver."""
    return None


@dataclass(frozen=True)
class GBufferPlugin(Plugin):
    """Makes a `phrt.interfaces.gbuffer.GBufferProducer`.

    needs_tracer: the factory also takes `tracer=`, built for the same world, and `workers=`, a `phrt.workers.Workers` to
    run on; both stay the caller's to close.
    device: what it draws with, asked only when it is available; `auto` wants a hardware one."""

    needs_tracer: bool = False
    device: Callable[[], Device | None] = no_device


@dataclass(frozen=True)
class TracerPlugin(Plugin):
    """Makes a `phrt.interfaces.tracer.Tracer`."""


@dataclass(frozen=True)
class EffectPlugin(Plugin):
    """Makes a `phrt.interfaces.effect.RayEffect`. `order` is its place in the list of default effects."""

    order: int = 100


@dataclass(frozen=True)
class HeuristicPlugin(Plugin):
    """Makes a `phrt.interfaces.heuristic.Heuristic`."""


@dataclass(frozen=True)
class LoaderPlugin(Plugin):
    """Makes a `phrt.interfaces.loader.Loader`. suffixes: file name endings it reads, with the dot, lower case;
    a procedural loader has none and is asked for by name."""

    suffixes: tuple[str, ...] = ()


@dataclass(frozen=True)
class MetricPlugin(Plugin):
    """Makes a `phrt.interfaces.metric.Metric`, for the harness that compares heuristics. Its manual page names its columns."""


@dataclass(frozen=True)
class CommandPlugin(Plugin):
    """Makes a typer application that becomes `phrt NAME`."""
