"""How plugins are found and made: hooks hand over descriptors, never instances; listing imports nothing heavy."""

from phrt.registry.descriptors import (
    PLUGIN_API_VERSION,
    CommandPlugin,
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

__all__ = [
    "PLUGIN_API_VERSION",
    "CommandPlugin",
    "EffectPlugin",
    "GBufferPlugin",
    "HeuristicPlugin",
    "LoaderPlugin",
    "MetricPlugin",
    "Options",
    "Plugin",
    "TracerPlugin",
    "hookimpl",
]
