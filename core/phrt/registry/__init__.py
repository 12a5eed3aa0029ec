"""How plugins are found and made: hooks hand over descriptors, never instances; listing imports nothing heavy."""

from phrt.registry.descriptors import (
    OLDEST_API_VERSION,
    PLUGIN_API_VERSION,
    CommandPlugin,
    Device,
    EffectPlugin,
    GBufferPlugin,
    HeuristicPlugin,
    LoaderPlugin,
    MetricPlugin,
    Options,
    Plugin,
    TracerPlugin,
)
from phrt.registry.hookspecs import hookimpl
from phrt.registry.manager import RegisteredPlugin, Registry, get_registry, register

__all__ = [
    "OLDEST_API_VERSION",
    "PLUGIN_API_VERSION",
    "CommandPlugin",
    "Device",
    "EffectPlugin",
    "GBufferPlugin",
    "HeuristicPlugin",
    "LoaderPlugin",
    "MetricPlugin",
    "Options",
    "Plugin",
    "RegisteredPlugin",
    "Registry",
    "TracerPlugin",
    "get_registry",
    "hookimpl",
    "register",
]
