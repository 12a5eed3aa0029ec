"""Frames made by hand: a world seen by primary rays and lit, as effects get it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from phrt.camera import CameraView
from phrt.composite import light_surfaces
from phrt.frame import Frame
from phrt.interfaces.tracer import Tracer
from phrt.kernels.arrays import environment_arrays, geometry_arrays, material_arrays, surface_arrays
from phrt.rays import HitBatch, RayBatch
from phrt.registry.auto import FALLBACK_GBUFFER, choose_tracer
from phrt.registry.manager import get_registry
from phrt.workers import Workers
from phrt.world import Changes, World


class CountingTracer(Tracer):
    """Passes everything on to `tracer`, and counts the rays of both queries; from one thread."""

    def __init__(self, tracer: Tracer) -> None:
        self._tracer = tracer
        self.capabilities = tracer.capabilities
        self.rays = 0

    def build(self, world: World) -> None:
        self._tracer.build(world)

    def update(self, world: World, changes: Changes) -> None:
        self._tracer.update(world, changes)

    def closest_hit(self, rays: RayBatch) -> HitBatch:
        self.rays += len(rays)
        return self._tracer.closest_hit(rays)

    def occluded(self, rays: RayBatch) -> np.ndarray:
        self.rays += len(rays)
        return self._tracer.occluded(rays)

    def close(self) -> None:
        self._tracer.close()


@contextmanager
def frame_of(world: World, view: CameraView, *, seed: int = 0) -> Iterator[Frame]:
    """The frame of `world` seen in `view`, made with two threads; its tracer is a `CountingTracer`."""
    registry, workers = get_registry(), Workers(2)
    tracer = CountingTracer(registry.create("tracer", choose_tracer(registry).name))
    producer = registry.create("gbuffer", FALLBACK_GBUFFER, tracer=tracer, workers=workers)
    try:
        tracer.build(world)
        producer.build(world)
        gbuffer = producer.render(view)
        surfaces, materials = surface_arrays(gbuffer), material_arrays(world)
        direct = np.empty((view.width * view.height, len(world.lights), 3), np.float32)
        light_surfaces(surfaces, materials.materials, world.lights, view, direct, workers)
        tracer.rays = 0
        yield Frame(
            world=world, view=view, gbuffer=gbuffer, surfaces=surfaces, direct=direct, tracer=tracer, producer=producer,
            workers=workers, geometry=geometry_arrays(world), materials=materials, environment=environment_arrays(world),
            index=0, time=0.0, seed=seed,
        )  # fmt: skip
    finally:
        producer.close()
        tracer.close()
        workers.close()
