"""The `embree` tracer: Intel's Embree 4 on the CPU, the default tracer of PHRT.

It calls Embree's C interface in packets of 16 rays (`embree_packets`). Where the shared library of the embreex wheel
is not found or is not version 4, it calls embreex's own binding instead (`embreex_run`): same hits, half the speed.
`capabilities.description` says which one runs and why; so does `phrt doctor`.

Options: `phrt_backends.options.EmbreeOptions`. Packets are as good as the order of the rays: neighbours in the batch
should be neighbours in space (4x4 tiles of pixels). `RayBatch.coherent` makes Embree keep a packet together. Measured
on Sponza, rays in tiles, two threads: with it primary rays are 2 to 3 times as fast, mirror rays 1.3 to 1.4, shadow
rays to a point light 1.1 to 1.4, to a small area light 1.1 to 1.2, glossy rays 0.9 to 1.2, ambient occlusion 0.4 to
0.7.

Example: `tracer = EmbreeTracer(EmbreeOptions()); tracer.build(world); hits = tracer.closest_hit(rays)`
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from phrt.interfaces.tracer import Tracer
from phrt.rays import HitBatch, RayBatch
from phrt_backends.options import EmbreeOptions
from phrt_backends.tracers.embree_abi import EmbreeError
from phrt_backends.tracers.embree_packets import EmbreePackets
from phrt_backends.tracers.embreex_run import EmbreexTracer

if TYPE_CHECKING:
    from phrt.world import Changes, World


def choose_binding(options: EmbreeOptions) -> Tracer:
    """The tracer behind `options.binding`. Raises `EmbreeError` when packets were asked for and cannot be had."""
    if options.binding == "embreex":
        return EmbreexTracer(options)
    try:
        return EmbreePackets(options)
    except EmbreeError as error:
        if options.binding == "packets":
            raise
        return EmbreexTracer(options, reason=str(error))


class EmbreeTracer(Tracer):
    """Embree by the best way there is on this machine."""

    def __init__(self, options: EmbreeOptions) -> None:
        self._tracer = choose_binding(options)
        self.capabilities = self._tracer.capabilities

    def build(self, world: World) -> None:
        self._tracer.build(world)

    def update(self, world: World, changes: Changes) -> None:
        self._tracer.update(world, changes)

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        return self._tracer.closest_hit(rays)

    def occluded(self, rays: RayBatch) -> np.ndarray:
        return self._tracer.occluded(rays)

    def close(self) -> None:
        self._tracer.close()
