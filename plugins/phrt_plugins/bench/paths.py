"""Path-traced references: which tracer can make them, and the pictures it makes. docs/bench.md says what is compared with them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from phrt.camera import CameraView
from phrt.errors import PluginError
from phrt.faults.making import make
from phrt.faults.tracer import path_traced
from phrt.interfaces.tracer import Tracer
from phrt.world import World
from phrt_plugins.bench.config import PathTraced
from phrt_plugins.bench.plan import PathReference

Picture = Callable[[World, CameraView], np.ndarray]
"""(H, W, 3) float32 of a world as it is now, linear, exposure applied."""


def path_reference(entry: PathTraced) -> PathReference:
    """`entry` with the version of its tracer, which is made for that. Raises PluginError where it is unknown, is not available
    here, or cannot path trace."""
    with _opened(entry.tracer) as tracer:
        return PathReference(entry.tracer, entry.samples, entry.max_depth, tracer.capabilities.path_tracer)


@contextmanager
def path_tracing(reference: PathReference | None, samples: int | None = None) -> Iterator[Picture | None]:
    """What makes pictures as `reference` says, None where that is None; samples: in place of its own.

    Raises PluginError as `path_reference`, and where the tracer is another version here.
    """
    if reference is None:
        yield None
        return
    with _opened(reference.tracer) as tracer:
        if tracer.capabilities.path_tracer != reference.version:
            raise PluginError(
                f"tracer '{reference.tracer}' is not what the benchmark was planned with: here it is "
                f"'{tracer.capabilities.path_tracer}', there '{reference.version}'"
            )
        paths = reference.samples if samples is None else samples

        def picture(world: World, view: CameraView) -> np.ndarray:
            return path_traced(tracer, world, view, samples=paths, max_depth=reference.max_depth)

        yield picture


@contextmanager
def _opened(name: str) -> Iterator[Tracer]:
    """The tracer, which can path trace."""
    tracer: Tracer = make("tracer", name)
    try:
        if not tracer.capabilities.path_tracer:
            raise PluginError(
                f"tracer '{name}' cannot path trace. The package phrt-mitsuba has one that can: {{tracer: mitsuba}}"
            )
        yield tracer
    finally:
        tracer.close()
