"""GuardedTracer: a tracer whose answers are checked batch by batch, so that nothing reads past the end of an array."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from phrt.camera import CameraView
from phrt.errors import PhrtError
from phrt.faults.checks import check_array
from phrt.faults.fault import CAUGHT, Nonsense, failure
from phrt.faults.faults import Faults
from phrt.interfaces.tracer import Tracer
from phrt.kernels.checks import all_finite, impossible_hits
from phrt.rays import HitBatch, RayBatch
from phrt.world import Changes, World

R = TypeVar("R")


class GuardedTracer(Tracer):
    """Passes rays on to `tracer`, which is built for `world`, and raises a PluginFailure that names it where it raises, or answers
    what cannot be.

    faults: of a run, which loses the tracer by the first failure: no effect is traced any more, but fallbacks that rest on rays may
    go on asking. None: whoever asks cannot go on without an answer, and says so itself.
    """

    def __init__(self, tracer: Tracer, world: World, faults: Faults | None = None) -> None:
        self.capabilities = tracer.capabilities
        self._tracer, self._faults = tracer, faults
        self._triangles = np.uint32(len(world.triangles))

    def build(self, world: World) -> None:
        self._tracer.build(world)

    def update(self, world: World, changes: Changes) -> None:
        self._tracer.update(world, changes)

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        return self._ask("closest_hit()", lambda: self._checked(self._tracer.closest_hit(rays), len(rays)))

    def occluded(self, rays: RayBatch) -> np.ndarray:
        def occluded() -> np.ndarray:
            blocked = self._tracer.occluded(rays)
            check_array("", blocked, (len(rays),), np.bool_)
            return np.require(blocked, requirements="C")

        return self._ask("occluded()", occluded)

    def render_paths(
        self, world: World, view: CameraView, *, samples: int, max_depth: int, seed: int = 0
    ) -> np.ndarray:
        return path_traced(self._tracer, world, view, samples=samples, max_depth=max_depth, seed=seed)

    def close(self) -> None:
        self._tracer.close()

    def _checked(self, hits: HitBatch, count: int) -> HitBatch:
        """`hits`, when they are `count` hits of the scene's triangles, and misses; their arrays may be written to."""
        if not isinstance(hits, HitBatch):
            raise Nonsense(type(hits).__name__, "a HitBatch")
        check_array("distance ", hits.distance, (count,), np.float32)
        check_array("primitive ", hits.primitive, (count,), np.uint32)
        check_array("barycentric ", hits.barycentric, (count, 2), np.float32)
        arrays = (hits.distance, hits.primitive, hits.barycentric)
        checked = HitBatch(*(np.require(array, requirements=("C", "W")) for array in arrays))
        if wrong := impossible_hits(checked.distance, checked.primitive, checked.barycentric, self._triangles):
            raise Nonsense(
                f"{wrong} of {count} hits that cannot be",
                f"one of {self._triangles} triangles at a distance, or none at +inf",
            )
        return checked

    def _ask(self, call: str, question: Callable[[], R]) -> R:
        try:
            return question()
        except MemoryError:
            raise
        except CAUGHT as error:
            failed = failure("tracer", self._tracer, call, error)
            failed.__cause__ = error
            if self._faults is not None:
                self._faults.lose_tracer(failed)
            raise failed from error


def path_traced(
    tracer: Tracer, world: World, view: CameraView, *, samples: int, max_depth: int, seed: int = 0
) -> np.ndarray:
    """`tracer.render_paths`, checked. Raises PluginFailure that names the tracer where it raises, or gives no such picture."""
    try:
        image = tracer.render_paths(world, view, samples=samples, max_depth=max_depth, seed=seed)
        check_array("", image, (view.height, view.width, 3), np.float32)
        if not all_finite(np.ravel(image)):
            raise Nonsense("a picture with NaN or infinity in it", "numbers")
    except (PhrtError, MemoryError):
        raise
    except CAUGHT as error:
        raise failure("tracer", tracer, "render_paths()", error) from error
    return image
