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
def phrt_gbuffers() -> list[GBufferPlugin]:  # type: ignore[empty-body]
    """G-buffer producers."""


@hookspec
def phrt_tracers() -> list[TracerPlugin]:  # type: ignore[empty-body]
    """Tracers."""


@hookspec
def phrt_effects() -> list[EffectPlugin]:  # type: ignore[empty-body]
    """Ray effects."""


@hookspec
def phrt_heuristics() -> list[HeuristicPlugin]:  # type: ignore[empty-body]
    """Heuristics."""


@hookspec
def phrt_loaders() -> list[LoaderPlugin]:  # type: ignore[empty-body]
    """Scene loaders."""


@hookspec
def phrt_metrics() -> list[MetricPlugin]:  # type: ignore[empty-body]
    """Image metrics, for the harness that compares heuristics; nothing asks for one yet."""


@hookspec
def phrt_commands() -> list[CommandPlugin]:  # type: ignore[empty-body]
    """Commands of the `phrt` command line."""
