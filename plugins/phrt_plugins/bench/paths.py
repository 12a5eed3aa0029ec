"""Path-traced references: which tracer can make them, and the pictures it makes. docs/bench.md says what is compared with them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from phrt.camera import CameraView
from phrt.errors import PluginError
from phrt.interfaces.tracer import Tracer
from phrt.registry import get_registry
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
            image = tracer.render_paths(world, view, samples=paths, max_depth=reference.max_depth)
            return _checked(image, reference.tracer, view)

        yield picture


@contextmanager
def _opened(name: str) -> Iterator[Tracer]:
    """The tracer, which can path trace."""
    tracer: Tracer = get_registry().create("tracer", name)
    try:
        if not tracer.capabilities.path_tracer:
            raise PluginError(
                f"tracer '{name}' cannot path trace. The package phrt-mitsuba has one that can: {{tracer: mitsuba}}"
            )
        yield tracer
    finally:
        tracer.close()


def _checked(image: np.ndarray, tracer: str, view: CameraView) -> np.ndarray:
    """`image` as float32. Raises PluginError where it is no picture of `view`."""
    wanted = (view.height, view.width, 3)
    if np.shape(image) != wanted or not np.isfinite(image).all():
        what = f"of shape {np.shape(image)}" if np.shape(image) != wanted else "with NaN or infinity in it"
        raise PluginError(f"tracer '{tracer}' path traced a picture {what}; wanted {wanted}, finite")
    return np.asarray(image, np.float32)
