"""Which photons there are: every light's share of them, and the directions they start in."""

from __future__ import annotations

import math
import threading
import weakref
from dataclasses import dataclass, replace

import numpy as np

from phrt.lights import DIRECTIONAL
from phrt.world import World
from phrt_caustics.casters import caster_triangles, throwing_lights
from phrt_caustics.kernels.emission import BITS, CELLS, emit, lattice, mark_cells

BATCH = 4096
"""Photons that are traced together."""
PILOTS = 512
"""Photons that say how much of a light's power meets casters."""
FIBONACCI = (
    1,
    1,
    2,
    3,
    5,
    8,
    13,
    21,
    34,
    55,
    89,
    144,
    233,
    377,
    610,
    987,
    1597,
    2584,
    4181,
    6765,
    10946,
    17711,
    28657,
    46368,
)
FEWEST = 8
"""Index of the smallest lattice that is even enough: 34 points."""
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
GAP = 1024
"""Numbers left out between the photons of two lights, so that none are neighbours."""


@dataclass(frozen=True)
class Beam:
    """The photons that one light sends to the casters: `count` of them, numbered from `first`.

    place (count, 2), share, reach (CELLS,), origin, axes, side, back: as the kernels have them.
    """

    light: int
    parallel: bool
    reach: np.ndarray
    origin: np.ndarray
    axes: np.ndarray
    side: float
    back: float
    place: np.ndarray
    share: float
    first: int = 0

    @property
    def count(self) -> int:
        return len(self.place)


@dataclass(frozen=True)
class Batch:
    """Photons start..stop of a beam."""

    beam: Beam
    start: int
    stop: int


def batches(world: World, photons: int, cutoff: float) -> list[Batch]:
    """About `photons` photons of all lights, shared out by the power that meets casters. Empty where there are no casters."""
    return shared_out(world, pilots(world, caster_triangles(world, cutoff)), photons)


class Aims:
    """`batches`, whose directions are found anew only where lights or casters moved. Thread-safe."""

    def __init__(self, cutoff: float) -> None:
        self._cutoff = cutoff
        self._lock = threading.Lock()
        self._world: weakref.ref[World] | None = None
        self._placed: tuple[bytes, bytes] = (b"", b"")
        self._pilots: list[Beam] = []

    def batches(self, world: World, photons: int) -> list[Batch]:
        """About `photons` photons of all lights of `world` as it is now."""
        with self._lock:
            triangles = caster_triangles(world, self._cutoff)
            casters = np.unique(world.triangle_object[triangles])
            placed = (world.lights.tobytes(), world.object_matrix[casters].tobytes())
            if self._world is None or self._world() is not world or placed != self._placed:
                self._pilots = pilots(world, triangles)
                self._world, self._placed = weakref.ref(world), placed
            return shared_out(world, self._pilots, photons)


def pilots(world: World, triangles: np.ndarray) -> list[Beam]:
    """A few photons of every light to the casters' triangles (t,) int64."""
    if not len(triangles):
        return []
    corners = world.positions[world.triangles[triangles]].astype(np.float64)
    return [spread(aimed(world, int(light), corners), PILOTS) for light in throwing_lights(world)]


def shared_out(world: World, beams: list[Beam], photons: int) -> list[Batch]:
    """About `photons` photons of `beams`, by the power of each."""
    power = [luminous_power(world, beam) for beam in beams]
    total = sum(power)
    made: list[Batch] = []
    number = 0
    for pilot, own in zip(beams, power, strict=True):
        if own > 0:
            sent = spread(replace(pilot, first=number, back=far_enough(world)), photons * own / total)
            made += [Batch(sent, start, min(start + BATCH, sent.count)) for start in range(0, sent.count, BATCH)]
            number += sent.count + GAP
    return made


def far_enough(world: World) -> float:
    """Metres from anything to where nothing is any more."""
    low, high = world.bounds()
    return float(np.linalg.norm(high - low)) + 1.0


def spread(beam: Beam, photons: float) -> Beam:
    """`beam` with about so many photons, evenly over its marked cells; a tenth more or less."""
    cells = np.flatnonzero(np.isfinite(beam.reach))
    if not len(cells):
        return beam
    tile_bits, number = tiling(photons / len(cells))
    points, step = FIBONACCI[number], FIBONACCI[number - 1]
    tiles = np.unique(cells >> (2 * tile_bits))
    place, code = np.empty((len(tiles) * points, 2)), np.empty(len(tiles) * points, np.int64)
    count = lattice(tiles, tile_bits, points, step, beam.reach, place, code)
    order = np.argsort(code[:count], kind="stable")
    return replace(beam, place=place[:count][order], share=4.0**tile_bits / (points * CELLS))


def tiling(density: float) -> tuple[int, int]:
    """How large tiles of a lattice are, in bits of cells along a side, and which of FIBONACCI each has, for `density` a cell."""
    choices = [(bits, number) for bits in range(BITS + 1) for number in range(FEWEST, len(FIBONACCI))]
    return min(choices, key=lambda c: abs(math.log(FIBONACCI[c[1]] / 4.0 ** c[0] / density)))


def aimed(world: World, light: int, corners: np.ndarray) -> Beam:
    """The beam of `light` to the triangles corners (t, 3, 3), without photons yet."""
    record, reach = world.lights[light], np.full(CELLS, np.inf, np.float32)
    parallel = bool(record["kind"] == DIRECTIONAL)
    if parallel:
        axes = frame_along(record["direction"].astype(np.float64))
        across = corners.reshape(-1, 3) @ axes.T
        least, most = across.min(axis=0), across.max(axis=0)
        # A cell to spare on every side; a square, as cells are.
        side = float((most - least)[:2].max()) * 1.02 + 1e-6
        middle = (least + most) / 2
        origin = np.array([middle[0] - side / 2, middle[1] - side / 2, least[2]]) @ axes
    else:
        axes, side = np.eye(3), 1.0
        origin = record["position"].astype(np.float64)
    mark_cells(corners, parallel, origin, axes, side, reach)
    return Beam(light, parallel, reach, origin, axes, side, far_enough(world), np.empty((0, 2)), 0.0)


def frame_along(direction: np.ndarray) -> np.ndarray:
    """(3, 3) float64 orthonormal rows, the last of them along `direction` (3,)."""
    w = direction / np.linalg.norm(direction)
    u = np.cross(np.eye(3)[int(np.argmin(np.abs(w)))], w)
    u /= np.linalg.norm(u)
    return np.stack([u, np.cross(w, u), w])


def luminous_power(world: World, beam: Beam) -> float:
    """Lumens that a beam takes to the casters, nearly."""
    _, _, power = started(world, beam, 0, beam.count)
    return float(power.sum(dtype=np.float64) * (world.lights["color"][beam.light] @ LUMINANCE))


def started(world: World, beam: Beam, start: int, stop: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Photons start..stop of a beam: origin, direction (n, 3), and power (n,) of a light of colour 1, float32."""
    count = stop - start
    origin, direction = np.empty((count, 3), np.float32), np.empty((count, 3), np.float32)
    power = np.empty(count, np.float32)
    emit(
        world.lights, beam.light, beam.parallel, start, beam.share, beam.place[start:stop], beam.reach, beam.origin,
        beam.axes, beam.side, beam.back, origin, direction, power,
    )  # fmt: skip
    return origin, direction, power
