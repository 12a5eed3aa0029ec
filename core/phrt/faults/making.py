"""Making plugins by name that are what their kind says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from phrt.faults.fault import CAUGHT, Fault, PluginFailure
from phrt.interfaces.effect import RayEffect
from phrt.interfaces.gbuffer import GBufferProducer
from phrt.interfaces.heuristic import Heuristic
from phrt.interfaces.loader import Loader
from phrt.interfaces.metric import Metric
from phrt.interfaces.tracer import Tracer, TracerCapabilities
from phrt.registry.manager import Registry, get_registry

INTERFACES: dict[str, type] = {
    "gbuffer": GBufferProducer,
    "tracer": Tracer,
    "effect": RayEffect,
    "heuristic": Heuristic,
    "loader": Loader,
    "metric": Metric,
}
"""What plugins of a kind are; a command is whatever typer takes."""


def make(
    kind: str,
    name: str,
    options: Mapping[str, object] | None = None,
    registry: Registry | None = None,
    **dependencies: object,
) -> Any:
    """The plugin of that kind and name. Raises OptionError and PluginError as `Registry.create`, and PluginFailure where what its
    factory makes is not of its kind."""
    made = (registry or get_registry()).create(kind, name, options, **dependencies)
    entry = (registry or get_registry()).find(kind, name)
    expected = INTERFACES[kind]
    problem, capabilities = None, _attribute(made, "capabilities")
    if not isinstance(made, expected):
        problem = f"is broken: its factory makes {made!r:.80}, no {expected.__module__}.{expected.__name__}"
    elif kind == "tracer" and not isinstance(capabilities, TracerCapabilities):
        problem = f"is broken: its `capabilities` are no TracerCapabilities but {capabilities!r:.80}"
    elif kind == "effect" and (own := _attribute(made, "name")) != name:
        problem = f"is broken: it calls itself {own!r:.80}"
    if problem is not None:
        raise PluginFailure(Fault(kind, name, entry.source, problem))
    return made


def _attribute(made: object, name: str) -> object:
    """An attribute of what was made; how that failed."""
    try:
        return getattr(made, name, None)
    except CAUGHT as error:
        return error
