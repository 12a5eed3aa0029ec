"""GuardedProducer: a G-buffer producer whose pictures are checked, so that nothing fails far from its cause."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

import numpy as np

from phrt.camera import CameraView
from phrt.channels import CHANNELS, Channel, GBuffer
from phrt.conventions import NO_PRIMITIVE
from phrt.errors import PhrtError
from phrt.faults.checks import check_array
from phrt.faults.fault import CAUGHT, Nonsense, failure
from phrt.interfaces.gbuffer import GBufferProducer
from phrt.kernels.arrays import CHANNEL_OF, SurfaceArrays
from phrt.kernels.checks import all_finite, ids_within
from phrt.registry.origins import is_ours
from phrt.world import Changes, World

R = TypeVar("R")

LOOKED_AT = 4096
"""Pixels of a picture that are looked at for numbers that are none: others in every picture, so that all are in a few seconds."""


class GuardedProducer(GBufferProducer):
    """Passes everything on to `producer`, and raises a PluginFailure that names it, or the tracer that it uses, where it raises, or
    gives what cannot be: there is no picture without it.

    Shapes and dtypes are checked always. Of producers that are not ours also ids, everywhere, and floats, at `LOOKED_AT` pixels;
    when `thorough`, both of all producers, everywhere.
    """

    def __init__(self, producer: GBufferProducer) -> None:
        self.thorough = False
        self._producer = producer
        self._turn = 0
        self._trusted = is_ours(producer)
        self._limits: dict[str, int] = {}
        self.few_are_cheap = self._ask("few_are_cheap", lambda: bool(producer.few_are_cheap))

    def build(self, world: World) -> None:
        self._limits = {
            "object_id": world.object_count,
            "material_id": len(world.materials) - 1,
            "primitive_id": len(world.triangles) - 1,
        }
        self._ask("build()", lambda: self._producer.build(world))

    def update(self, world: World, changes: Changes) -> None:
        self._ask("update()", lambda: self._producer.update(world, changes))

    def render(
        self,
        view: CameraView,
        *,
        channels: Iterable[str] = tuple(CHANNELS),
        hidden: np.ndarray | None = None,
        pixels: np.ndarray | None = None,
    ) -> GBuffer:
        wanted = tuple(channels)

        def render() -> GBuffer:
            gbuffer = self._producer.render(view, channels=wanted, hidden=hidden, pixels=pixels)
            self._check_picture(gbuffer, view, wanted, pixels)
            return gbuffer

        return self._ask("render()", render)

    def points(self, view: CameraView, pixels: np.ndarray, *, hidden: np.ndarray | None = None) -> SurfaceArrays:
        def points() -> SurfaceArrays:
            found = self._producer.points(view, pixels, hidden=hidden)
            if not isinstance(found, SurfaceArrays):
                raise Nonsense(type(found).__name__, "SurfaceArrays")
            for name, array in zip(SurfaceArrays._fields, found, strict=True):
                channel = CHANNELS[CHANNEL_OF.get(name, name)]
                shape = (len(pixels),) if channel.components == 1 else (len(pixels), channel.components)
                check_array(f"{name} as ", array, shape, channel.dtype)
                if not self._trusted or self.thorough:
                    self._check_ids(channel.name, array)
            return found

        return self._ask("points()", points)

    def close(self) -> None:
        self._producer.close()

    def _check_picture(
        self, gbuffer: GBuffer, view: CameraView, wanted: tuple[str, ...], pixels: np.ndarray | None
    ) -> None:
        """Raises Nonsense unless all that is `wanted` of `view` is there and can be."""
        if not isinstance(gbuffer, GBuffer):
            raise Nonsense(type(gbuffer).__name__, "a GBuffer")
        size, given = (view.width, view.height), (gbuffer.width, gbuffer.height)
        if given != size:
            raise Nonsense(f"a picture of {given[0]}x{given[1]} pixels", f"{size[0]}x{size[1]}")
        band = self._band(view.width * view.height)
        for name in wanted:
            channel, array = CHANNELS[name], gbuffer.arrays.get(name)
            if array is None:
                raise Nonsense(f"no channel '{name}'", "every one that was asked for")
            check_array(f"channel '{name}' as ", array, channel.shape(view.height, view.width), channel.dtype)
            if self._trusted and not self.thorough:
                continue
            flat = gbuffer.flat(name)
            # What was not asked for may hold anything.
            self._check_ids(name, flat if pixels is None else flat[pixels])
            if pixels is None:
                check_numbers(channel, flat[band])

    def _band(self, count: int) -> slice:
        """Which of `count` pixels are looked at this time."""
        if self.thorough or count <= LOOKED_AT:
            return slice(0, count)
        self._turn += 1
        first = self._turn * LOOKED_AT % count
        return slice(first, first + LOOKED_AT)

    def _check_ids(self, name: str, array: np.ndarray) -> None:
        """Raises Nonsense where ids of the scene's things point at nothing."""
        limit = self._limits.get(name)
        if limit is None or not len(array):
            return
        # No triangle at all is the largest number there is.
        none = NO_PRIMITIVE if name == "primitive_id" else np.uint32(0)
        if not ids_within(np.ravel(array), np.uint32(max(limit, 0)), none):
            wrong = array[(array > limit) & (array != none)]
            raise Nonsense(f"{name} {int(wrong.max())}", f"{limit} at most")

    def _ask(self, call: str, question: Callable[[], R]) -> R:
        try:
            return question()
        except (PhrtError, MemoryError):
            raise
        except CAUGHT as error:
            failed = failure("gbuffer", self._producer, call, error)
            raise failed from error


def check_numbers(channel: Channel, values: np.ndarray) -> None:
    """Raises Nonsense where a channel of floats holds NaN, or infinity where only a depth may."""
    if channel.dtype != np.float32:
        return
    wrong = bool(np.isnan(values).any()) if channel.name == "depth" else not all_finite(np.ravel(values))
    if wrong:
        raise Nonsense(f"channel '{channel.name}' with NaN or infinity in it", "numbers")
