"""The hooks a plugin module can implement, all optional, each marked with `@hookimpl`.

A hook is called once, when the plugin is loaded, and returns descriptors (phrt.registry.descriptors): plain data that says what
there is. It imports nothing heavy, opens nothing and draws nothing: what takes long is in the module that a descriptor's `factory`
names, which is imported when somebody asks for that plugin by name. A hook that raises leaves its package out, with one warning.
The contract of what the factories make is in phrt.interfaces, and with an example each under docs/extending.
"""

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
    """G-buffer producers: which surface is behind every pixel. A factory is called with the options, and with `tracer=` and
    `workers=` where the descriptor says `needs_tracer`, and makes a `phrt.interfaces.gbuffer.GBufferProducer`. Asked for by
    `--gbuffer NAME`; one of them draws a run."""


@hookspec
def phrt_tracers() -> list[TracerPlugin]:
    """Tracers: what a ray meets first, and whether anything is in the way. A factory is called with the options and makes a
    `phrt.interfaces.tracer.Tracer`, whose queries several threads use at once. Asked for by `--tracer NAME`; one of them serves a
    run."""


@hookspec
def phrt_effects() -> list[EffectPlugin]:
    """Ray effects: what rays bring to a pixel, and what stands in where they are not traced. A factory is called with the options
    and makes a `phrt.interfaces.effect.RayEffect`. Asked for by `--effect NAME.OPTION=VALUE` or by a scene's `effects`."""


@hookspec
def phrt_heuristics() -> list[HeuristicPlugin]:
    """Heuristics: which object is traced, for which effect, in a frame. A factory is called with the options and makes a
    `phrt.interfaces.heuristic.Heuristic`. Asked for by `--heuristic NAME`, by a scene or by a benchmark's config; one of them
    decides a run."""


@hookspec
def phrt_loaders() -> list[LoaderPlugin]:
    """Loaders: model files, or procedural models, as plain data. A factory is called with the options and makes a
    `phrt.interfaces.loader.Loader`. Found by a file's suffix, or asked for by `loader: NAME` in a scene."""


@hookspec
def phrt_metrics() -> list[MetricPlugin]:
    """Metrics: how good a picture or a run is. A factory is called with the options and makes a `phrt.interfaces.metric.Metric`.
    `phrt bench` asks for those that its config names; `metrics: all` are those that ship with PHRT and those of the config's own
    `plugins`."""


@hookspec
def phrt_commands() -> list[CommandPlugin]:
    """Commands: a factory is called with the options and makes a `typer.Typer` with one command or several, which becomes
    `phrt NAME`."""
