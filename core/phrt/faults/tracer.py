"""GuardedTracer: a tracer whose answers are checked batch by batch, so that nothing reads past the end of an array."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from phrt.camera import CameraView
from phrt.conventions import NO_PRIMITIVE
from phrt.errors import PhrtError
from phrt.faults.checks import check_array
from phrt.faults.fault import CAUGHT, Nonsense, failure
from phrt.faults.faults import Faults
from phrt.interfaces.tracer import Tracer
from phrt.kernels.checks import all_finite, hits_can_be
from phrt.rays import HitBatch, RayBatch
from phrt.registry.origins import is_ours
from phrt.world import Changes, World

R = TypeVar("R")
FLOAT, UINT, BOOL = np.dtype(np.float32), np.dtype(np.uint32), np.dtype(np.bool_)


class GuardedTracer(Tracer):
    """Passes rays on to `tracer`, which is built for `world`, and raises a PluginFailure that names it where it raises, or answers
    what cannot be. Shapes and dtypes are checked always, values of tracers that are not ours, and of all with `strict`.

    faults: of a run, which loses the tracer by the first failure: no effect is traced any more, but fallbacks that rest on rays may
    go on asking. None: whoever asks cannot go on without an answer, and says so itself.
    """

    def __init__(self, tracer: Tracer, world: World, faults: Faults | None = None) -> None:
        self.capabilities = tracer.capabilities
        self._tracer, self._faults = tracer, faults
        self._triangles = np.uint32(len(world.triangles))
        self._trusted = is_ours(tracer) and not (faults is not None and faults.strict)

    def build(self, world: World) -> None:
        self._tracer.build(world)

    def update(self, world: World, changes: Changes) -> None:
        self._tracer.update(world, changes)

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        return self._ask("closest_hit()", lambda: self._checked(self._tracer.closest_hit(rays), len(rays)))

    def occluded(self, rays: RayBatch) -> np.ndarray:
        def occluded() -> np.ndarray:
            blocked = self._tracer.occluded(rays)
            if not fits(blocked, BOOL, (len(rays),)):
                check_array("", blocked, (len(rays),), np.bool_)
                blocked = np.ascontiguousarray(blocked)
            return blocked

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
        if not is_ready(hits, count):
            hits = made_ready(hits, count)
        if self._trusted:
            return hits
        distance, primitive, barycentric = hits.distance, hits.primitive, hits.barycentric
        if not (hits_can_be(distance, primitive, self._triangles) and all_finite(np.ravel(barycentric))):
            # Weights of misses may be anything.
            hit = (primitive < self._triangles) & (distance >= 0) & np.isfinite(barycentric).all(axis=1)
            wrong = np.count_nonzero(~hit & ~((primitive == NO_PRIMITIVE) & np.isposinf(distance)))
            if wrong:
                raise Nonsense(
                    f"{wrong} of {count} hits that cannot be",
                    f"one of {self._triangles} triangles at a distance, or none at +inf",
                )
        return hits

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


def fits(array: object, dtype: np.dtype[Any], shape: tuple[int, ...]) -> bool:
    """Is it surely an array as kernels take it? In a few instructions: this runs for every batch, after tracing left no code in the
    cache."""
    return type(array) is np.ndarray and array.dtype is dtype and array.shape == shape and array.flags.carray


def is_ready(hits: HitBatch, count: int) -> bool:
    """Are the arrays of `hits` surely what those of `count` hits must be, and can be written to?"""
    one = (count,)
    return (
        fits(hits.distance, FLOAT, one)
        and fits(hits.primitive, UINT, one)
        and fits(hits.barycentric, FLOAT, (count, 2))
    )


def made_ready(hits: HitBatch, count: int) -> HitBatch:
    """The same with arrays that are contiguous and may be written to. Raises Nonsense where shapes or dtypes are wrong."""
    check_array("distance ", hits.distance, (count,), np.float32)
    check_array("primitive ", hits.primitive, (count,), np.uint32)
    check_array("barycentric ", hits.barycentric, (count, 2), np.float32)
    arrays = (hits.distance, hits.primitive, hits.barycentric)
    return HitBatch(*(np.require(array, requirements=("C", "W")) for array in arrays))


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
