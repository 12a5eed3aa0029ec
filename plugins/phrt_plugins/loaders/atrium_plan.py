"""Measures and places of the atrium: which bay stands where. Metres; the courtyard's centre is the origin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from phrt_plugins.loaders.shapes import translation, turn_y

Array = np.ndarray

BAY = 3.0
"""Distance of columns, and depth of the galleries."""
WALL = 0.5
"""Thickness of walls and arcades."""
STEP = 0.16
"""Height of the gallery floor above the courtyard."""
LOWER_COLUMN = 3.4
LOWER_STOREY = 5.34
"""From the gallery floor to the floor above."""
UPPER_COLUMN = 2.45
UPPER_STOREY = 4.05
OPENING = 1.22
"""Radius of the arcade's arches."""
VAULT = 1.5
"""Radius of the groin vaults."""

SIDES = ("north", "east", "south", "west")


@dataclass(frozen=True)
class Storey:
    """One level of the gallery: its floor's height, and the heights of columns and of the whole storey above it."""

    index: int
    floor: float
    column: float
    height: float

    @property
    def spring(self) -> float:
        return self.floor + self.column

    @property
    def top(self) -> float:
        return self.floor + self.height


@dataclass(frozen=True)
class Plan:
    """`bays_x` by `bays_z` bays of open courtyard with one bay of gallery round it, `storeys` high."""

    bays_x: int
    bays_z: int
    storeys: int

    @property
    def half_x(self) -> float:
        return self.bays_x * BAY / 2

    @property
    def half_z(self) -> float:
        return self.bays_z * BAY / 2

    def levels(self) -> list[Storey]:
        """Ground floor first; only it has the tall order."""
        lower = Storey(0, STEP, LOWER_COLUMN, LOWER_STOREY)
        upper = [
            Storey(i, STEP + LOWER_STOREY + (i - 1) * UPPER_STOREY, UPPER_COLUMN, UPPER_STOREY)
            for i in range(1, self.storeys)
        ]
        return [lower, *upper]

    def bays(self, side: int) -> int:
        """Open bays along side 0 north, 1 east, 2 south, 3 west."""
        return self.bays_x if side % 2 == 0 else self.bays_z

    def length(self, side: int) -> float:
        return self.bays(side) * BAY

    def side_frame(self, side: int) -> Array:
        """(4, 4): origin in the middle of the side's column line, +Z into the courtyard, +X to the next side."""
        away = (self.half_z, self.half_x)[side % 2]
        return turn_y(-side * np.pi / 2) @ translation(0, 0, -away)

    def bay_frame(self, side: int, bay: int, height: float = 0.0) -> Array:
        """(4, 4): the middle of bay `bay` on the column line; -1 and `bays(side)` are the corners."""
        return self.side_frame(side) @ translation((bay - (self.bays(side) - 1) / 2) * BAY, height, 0)

    def column_frames(self, height: float = 0.0) -> list[Array]:
        """(4, 4) of every column, once round from the north-west corner."""
        return [
            self.bay_frame(side, bay, height) @ translation(-BAY / 2)
            for side in range(4)
            for bay in range(self.bays(side))
        ]
