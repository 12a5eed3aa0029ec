"""Backends of a renderer: tracer and G-buffer producer, made by name, built, kept up to date and closed, with their faults."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from phrt.errors import PhrtError
from phrt.faults.fault import CAUGHT, PluginFailure, failure
from phrt.faults.faults import BUILT_ANEW, Faults
from phrt.faults.gbuffer import GuardedProducer
from phrt.faults.making import make
from phrt.faults.tracer import GuardedTracer
from phrt.interfaces.gbuffer import GBufferProducer
from phrt.interfaces.tracer import Tracer
from phrt.registry.manager import get_registry
from phrt.workers import Workers
from phrt.world import Changes, World


class Backends:
    """tracer  : as it was made; effects ask it through `phrt.faults.tracer.GuardedTracer`
    producer: checks what it gives, and names whom an error is of
    traces_primary: does the producer trace eye rays?

    Raises PluginError naming one that cannot be made or built; then both are closed.
    """

    def __init__(self, tracer: str, gbuffer: str, world: World, workers: Workers) -> None:
        self._world = world
        self._open: list[tuple[str, Tracer | GBufferProducer]] = []
        try:
            needs_tracer = getattr(get_registry().get("gbuffer", gbuffer), "needs_tracer", False)
            self.traces_primary = bool(needs_tracer)
            self.tracer: Tracer = make("tracer", tracer)
            self._open.append(("tracer", self.tracer))
            given: dict[str, Any] = {}
            if needs_tracer:
                given = {"tracer": GuardedTracer(self.tracer, world), "workers": workers}
            made: GBufferProducer = make("gbuffer", gbuffer, **given)
            # It may hold on to the tracer, so it is closed first.
            self._open.insert(0, ("gbuffer", made))
            self.producer = GuardedProducer(made)
            self.build()
        except BaseException:
            self.close()
            raise

    def build(self) -> None:
        """Hand the world to both as it is now. Raises PluginFailure."""
        self._build_tracer()
        self.producer.build(self._world)

    def follow(self, changes: Changes, faults: Faults) -> None:
        """Both take over what moved; one that cannot is built anew. Raises PluginFailure where that fails, too, and there is no
        picture without it."""
        try:
            self.tracer.update(self._world, changes)
        except CAUGHT as error:
            faults.built_anew("tracer", self.tracer, error)
            self._rebuild_tracer(faults)
        try:
            self.producer.update(self._world, changes)
        except PluginFailure as error:
            faults.tell(replace(error.fault, done=BUILT_ANEW), error)
            self.producer.build(self._world)

    def close(self) -> list[tuple[str, Tracer | GBufferProducer, BaseException]]:
        """Close both; those that failed in it, with the error."""
        failed: list[tuple[str, Tracer | GBufferProducer, BaseException]] = []
        for kind, plugin in self._open:
            try:
                plugin.close()
            except CAUGHT as error:
                failed.append((kind, plugin, error))
        self._open.clear()
        return failed

    def _build_tracer(self) -> None:
        try:
            self.tracer.build(self._world)
        except (PhrtError, MemoryError):
            raise
        except CAUGHT as error:
            raise failure("tracer", self.tracer, "build()", error) from error

    def _rebuild_tracer(self, faults: Faults) -> None:
        """Where it cannot be built there are no rays any more, and without eye rays there is no picture."""
        try:
            self._build_tracer()
        except PluginFailure as lost:
            if self.traces_primary:
                raise
            faults.lose_tracer(lost)
