"""The hooks a plugin module can implement. Each returns descriptors; see phrt.registry.descriptors."""

from __future__ import annotations

import pluggy

from phrt.registry.descriptors import (
    CommandPlugin,
    EffectPlugin,
    GBufferPlugin,
    HeuristicPlugin,
    LoaderPlugin,
    MetricPlugin,
    TracerPlugin,
)

PROJECT = "phrt"
hookspec = pluggy.HookspecMarker(PROJECT)
hookimpl = pluggy.HookimplMarker(PROJECT)


@hookspec
def phrt_gbuffers() -> list[GBufferPlugin]:
    """G-buffer producers."""


@hookspec
def phrt_tracers() -> list[TracerPlugin]:
    """Tracers."""


@hookspec
def phrt_effects() -> list[EffectPlugin]:
    """Ray effects."""


@hookspec
def phrt_heuristics() -> list[HeuristicPlugin]:
    """Heuristics."""


@hookspec
def phrt_loaders() -> list[LoaderPlugin]:
    """Scene loaders."""


@hookspec
def phrt_metrics() -> list[MetricPlugin]:
    """Image metrics, for the harness that compares heuristics; nothing asks for one yet."""


@hookspec
def phrt_commands() -> list[CommandPlugin]:
    """Commands of the `phrt` command line."""
