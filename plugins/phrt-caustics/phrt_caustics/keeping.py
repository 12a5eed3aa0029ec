"""One photon map for all pixels of a frame, made by whoever asks first, and kept until something moves.

Threads that ask while it is made help: photons come in batches, each thread takes the next one until there is none, and waits for
the others' last. What a call reports is the rays of the batches it traced itself, so that every ray is counted once.
"""

from __future__ import annotations

import threading
import weakref
from dataclasses import dataclass

import numpy as np

from phrt.frame import Frame
from phrt.world import World
from phrt_caustics.casters import object_radii
from phrt_caustics.emission import Aims, Batch
from phrt_caustics.kernels.photons import Landed
from phrt_caustics.kernels.splat import Splats
from phrt_caustics.options import CausticsOptions
from phrt_caustics.photons import joined, trace_photons
from phrt_caustics.splat import radii, splats_of


def photon_count(options: CausticsOptions, frame: Frame, share: float = 1.0) -> int:
    """Photons for a picture of the frame's size."""
    return max(round(options.photons_per_pixel * frame.view.width * frame.view.height * share), 1)


def finished(parts: list[Landed], world: World, options: CausticsOptions) -> Splats | None:
    """The splats of what landed, batch by batch."""
    landed = joined(parts)
    radius = radii(landed, object_radii(world), options.smoothing, options.max_radius)
    return splats_of(landed, radius)


@dataclass(frozen=True)
class _State:
    """What the photons of a frame depend on. matrices: (N + 1, 4, 4), which `World` replaces and does not rewrite."""

    world: weakref.ref[World]
    matrices: np.ndarray
    lights: bytes
    photons: int

    @classmethod
    def of(cls, frame: Frame, photons: int) -> _State:
        world = frame.world
        return cls(weakref.ref(world), world.object_matrix, world.lights.tobytes(), photons)

    def same_as(self, other: _State) -> bool:
        if self.world() is not other.world() or self.photons != other.photons or self.lights != other.lights:
            return False
        return self.matrices is other.matrices or np.array_equal(self.matrices, other.matrices)


class _Making:
    """A photon map in the making, by several threads; then its splats."""

    def __init__(self, frame: Frame, photons: int, options: CausticsOptions, aims: Aims) -> None:
        self._options, self._aims = options, aims
        self._frame: Frame | None = frame
        self._photons = photons
        self._batches: list[Batch] | None = None
        self._parts: list[Landed | None] = []
        self._next = self._left = 0
        self._changed = threading.Condition()
        self._error: BaseException | None = None
        self._ready = False
        self._splats: Splats | None = None

    @property
    def failed(self) -> bool:
        return self._error is not None

    def splats(self) -> tuple[Splats | None, int]:
        """The finished splats, and the rays this call traced for them. Raises what any helper's tracing raised."""
        rays = 0
        if not self._ready:
            try:
                rays = self._help()
            except BaseException as error:  # whatever it is, nobody may wait for ever
                self._end(error)
                raise
            with self._changed:
                self._changed.wait_for(lambda: self._ready)
        if self._error is not None:
            raise self._error
        return self._splats, rays

    def _help(self) -> int:
        """Trace batches until there is none left; whoever finishes the last one puts them together."""
        rays = 0
        while (taken := self._take()) is not None:
            number, batch, frame = taken
            part, own = trace_photons(frame, batch, self._options.max_depth, self._options.roughness_cutoff)
            rays += own
            with self._changed:
                if self._ready:
                    break  # another thread's batch failed
                self._parts[number] = part
                self._left -= 1
                last = self._left == 0
            if last:
                self._put_together()
        return rays

    def _take(self) -> tuple[int, Batch, Frame] | None:
        """The next batch, with its number; None when there is none left."""
        with self._changed:
            frame = self._frame
            if self._ready or frame is None:
                return None
            if self._batches is None:
                self._batches = self._aims.batches(frame.world, self._photons)
                self._parts = [None] * len(self._batches)
                self._left = len(self._batches)
                if not self._batches:
                    self._end(None)
            if self._next >= len(self._batches):
                return None
            self._next += 1
            return self._next - 1, self._batches[self._next - 1], frame

    def _put_together(self) -> None:
        frame = self._frame
        if frame is not None:
            parts = [part for part in self._parts if part is not None]
            self._splats = finished(parts, frame.world, self._options)
            self._end(None)

    def _end(self, error: BaseException | None) -> None:
        """Ready, or failed: everybody may go on. The frame, whose arrays are large, is let go."""
        with self._changed:
            self._error = self._error or error
            self._ready, self._frame, self._batches, self._parts = True, None, [], []
            self._changed.notify_all()


class PhotonKeeper:
    """Keeps the latest photon map. Thread-safe.

    It is made anew where lights or objects moved or the picture has another size, and after `forget`: a run takes the same rays
    whatever was rendered before it.
    """

    def __init__(self, options: CausticsOptions, aims: Aims) -> None:
        self._options, self._aims = options, aims
        self._lock = threading.Lock()
        self._latest: weakref.ref[Frame] | None = None
        self._state: _State | None = None
        self._making: _Making | None = None

    def splats(self, frame: Frame) -> tuple[Splats | None, int]:
        """The splats of the world as it is in `frame`, None for none, and the rays this call traced for them."""
        return self._of(frame).splats()

    def forget(self) -> None:
        """Another run begins."""
        with self._lock:
            self._making = None

    def _of(self, frame: Frame) -> _Making:
        with self._lock:
            if self._making is not None and self._latest is not None and self._latest() is frame:
                return self._making
            photons = photon_count(self._options, frame)
            state = _State.of(frame, photons)
            kept = self._state is not None and self._state.same_as(state)
            if self._making is None or self._making.failed or not kept:
                self._making = _Making(frame, photons, self._options, self._aims)
            self._latest, self._state = weakref.ref(frame), state
            return self._making
