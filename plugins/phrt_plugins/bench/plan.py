"""What is run, and in which order: setups, cells, blocks and tasks, all plain data that another process can be given.

- A setup is what needs a renderer of its own. A cell is one contestant in one setup under one budget, once.
- A block is some consecutive frames of a path. It begins with a renderer that has forgotten everything and with frames that
  are not counted, so that blocks can be run in any order, anywhere.
- A task is one block of all cells of a setup and repeat (they take turns, so that a machine that drifts hits all alike), or
  of its reference, or of its oracle.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import Any, Literal

from phrt.budget import parse_budget
from phrt_plugins.bench.config import HALF

Stage = Literal["reference", "cells", "oracle"]
STAGES: tuple[Stage, ...] = ("reference", "cells", "oracle")
"""In this order: half budgets need the references, the oracle the times that cells had."""
ALL_TRACE_NAME = "all-trace"
"""What the usual reference is called in texts."""


@dataclass(frozen=True)
class Path:
    """The frames of a run: number k of `count`, from 0, is seen at `time(k)` seconds.

    first, length: the scene's frames that are walked; laps: how often, every second time backwards
    """

    first: int
    length: int
    fps: float
    laps: int = 1

    @property
    def count(self) -> int:
        """How many frames the walk has; its turning points come once."""
        return self.laps * (self.length - 1) + 1

    @property
    def numbers(self) -> range:
        """The numbers of its frames: the scene's own, counted on after the first lap."""
        return range(self.first, self.first + self.count)

    def time(self, number: int) -> float:
        """Seconds of frame `number`. A number out of range is reflected at the ends of the walk."""
        step = _reflected(number - self.first, self.count)
        return (self.first + _reflected(step, self.length)) / self.fps


@dataclass(frozen=True)
class Block:
    """Frames `first` to `stop` - 1, the `number`-th block of a path."""

    number: int
    first: int
    stop: int

    @property
    def name(self) -> str:
        return f"block-{self.number:03d}"

    @property
    def frames(self) -> range:
        return range(self.first, self.stop)

    def judged(self, every: int) -> list[int]:
        """The frames that are compared with their references: the last of every `every`, so that the one before is of the same
        block; the last of the block where it is shorter."""
        return list(self.frames[every - 1 :: every]) or [self.stop - 1]

    def pictured(self, every: int) -> list[int]:
        """The judged frames and the ones before them, as far as they are of this block, in order."""
        judged = self.judged(every)
        return sorted({*judged, *(number - 1 for number in judged if number > self.first)})

    def warm_up(self, frames: int) -> list[int]:
        """Numbers of the frames that come before and are not counted: towards the first one backwards, so that the view never
        jumps. At the end of a path they are reflected (`Path.time`)."""
        return list(range(self.first + frames, self.first, -1))


@dataclass(frozen=True)
class PathReference:
    """How a reference is path traced.

    samples  : paths a pixel
    max_depth: the most edges of a path from the eye to a light
    version  : what path traces, as the tracer says; another one's pictures are other pictures
    """

    tracer: str
    samples: int
    max_depth: int
    version: str

    @property
    def name(self) -> str:
        """For people."""
        return reference_name(asdict(self))


@dataclass(frozen=True)
class Setup:
    """What needs a renderer of its own.

    file      : the scene's, absolute; content: digest of what is in it and in all it names (`phrt_plugins.bench.content`)
    effects   : options by effect; base_effects: those of its reference, without what one contestant alone has
    clock     : nanoseconds a ray takes; None for real time
    tone_map  : curve from linear light to what is shown
    plugins   : the code of what does not ship with PHRT and its reference depends on (`phrt_plugins.bench.plugin_code`)
    reference : how what pictures are compared with is path traced; None where it is what tracing everything shows
    """

    id: str
    scene: str
    file: str
    content: str
    variant: str | None
    overrides: dict[str, Any]
    camera: int | str
    path: Path
    simplify: float | None
    size: tuple[int, int]
    tracer: str
    gbuffer: str
    effects: dict[str, dict[str, Any]]
    base_effects: dict[str, dict[str, Any]]
    clock: float | None
    threads: int | None
    tone_map: str
    block: int
    warm_up: int
    judge_every: int
    pictures: int
    plugins: dict[str, str] = field(default_factory=dict)
    reference: PathReference | None = None

    @property
    def timed(self) -> bool:
        """Does it measure time, so that nothing else may run beside it?"""
        return self.clock is None

    def blocks(self) -> list[Block]:
        """Of its path; a last one that is shorter than half a block is joined to the one before."""
        numbers = self.path.numbers
        edges = [*range(numbers.start, numbers.stop, self.block), numbers.stop]
        if len(edges) > 2 and edges[-1] - edges[-2] < self.block / 2:
            del edges[-2]
        return [Block(n, first, stop) for n, (first, stop) in enumerate(pairwise(edges))]

    def kept_pictures(self) -> set[int]:
        """The judged frames whose pictures are kept: `pictures` of them, spread over the path."""
        judged = [number for block in self.blocks() for number in block.judged(self.judge_every)]
        wanted = min(self.pictures, len(judged))
        return {judged[(2 * k + 1) * len(judged) // (2 * wanted)] for k in range(wanted)}


@dataclass(frozen=True)
class Cell:
    """One contestant in one setup under one budget, once.

    budget : "half" stands for what the references come to
    plugins: the code of its heuristic and of effects of its own, where they do not ship with PHRT
    """

    id: str
    setup: str
    scene: str
    label: str
    heuristic: str
    options: dict[str, Any]
    budget: str
    size: tuple[int, int]
    tracer: str
    gbuffer: str
    clock: float | None
    persistence: float | None
    cost_model: str
    group_by: str
    history: bool
    repeat: int
    plugins: dict[str, str] = field(default_factory=dict)

    def settings(self, half_rays: float | None = None) -> dict[str, Any]:
        """What cell.json says. half_rays: the rays that "half" comes to, where that is known."""
        said = asdict(self)
        if self.budget == HALF:
            amount = half_rays
            kind: str = "rays"
        else:
            budget = parse_budget(self.budget)
            kind, amount = budget.kind, None if budget.kind == "none" else budget.amount
        clock = "wall" if self.clock is None else {"rays": self.clock}
        return said | {"size": list(self.size), "clock": clock, "budget_kind": kind, "budget_amount": amount}


@dataclass(frozen=True)
class Task:
    """What one worker does at a time. cells: that take turns; of an oracle, those whose budgets it has."""

    stage: Stage
    setup: Setup
    block: Block
    cells: tuple[Cell, ...] = ()
    repeat: int = 0

    @property
    def key(self) -> str:
        """What a worker keeps from task to task: the renderer of the setup."""
        return self.setup.id

    @property
    def title(self) -> str:
        """For people."""
        by = "" if self.setup.reference is None else f", {self.setup.reference.name}"
        what = {"reference": f"reference{by}", "cells": f"repeat {self.repeat + 1}", "oracle": "oracle"}[self.stage]
        return f"{self.setup.scene} {self.setup.size[0]}x{self.setup.size[1]}, {what}, block {self.block.number}"


@dataclass(frozen=True)
class Plan:
    """Everything that is to be done."""

    setups: tuple[Setup, ...]
    cells: tuple[Cell, ...]
    oracle: bool = False

    def cells_of(self, setup: str, repeat: int | None = None) -> list[Cell]:
        return [cell for cell in self.cells if cell.setup == setup and repeat in (None, cell.repeat)]

    def tasks(self, stage: Stage) -> list[Task]:
        """All tasks of `stage`, setup by setup so that a worker can keep its renderer."""
        if stage == "cells":
            return [
                Task(stage, setup, block, rotated(cells, repeat + block.number), repeat)
                for setup in self.setups
                for repeat in sorted({cell.repeat for cell in self.cells})
                if (cells := self.cells_of(setup.id, repeat))
                for block in setup.blocks()
            ]
        if stage == "oracle" and not self.oracle:
            return []
        return [
            Task(stage, setup, block, tuple(self.cells_of(setup.id)) if stage == "oracle" else ())
            for setup in self.setups
            for block in setup.blocks()
        ]

    def as_json(self) -> dict[str, Any]:
        """As bench.json keeps it."""
        blocks = {setup.id: [[block.first, block.stop] for block in setup.blocks()] for setup in self.setups}
        return {
            "setups": [asdict(setup) for setup in self.setups],
            "cells": [cell.settings() for cell in self.cells],
            "blocks": blocks,
        }


def reference_name(said: Any) -> str:
    """A reference for people, as a config has it: "all-trace", or "path tracing (mitsuba, 64 paths a pixel)"."""
    if not isinstance(said, Mapping):
        return ALL_TRACE_NAME
    return f"path tracing ({said['tracer']}, {said['samples']} paths a pixel)"


def rotated(cells: Sequence[Cell], turns: int) -> tuple[Cell, ...]:
    """`cells`, `turns` of them moved to the end: so nobody is always first."""
    shift = turns % len(cells) if cells else 0
    return (*cells[shift:], *cells[:shift])


def short_hash(said: Mapping[str, Any], digits: int = 6) -> str:
    """Hexadecimal digits of what `said` says."""
    text = json.dumps(said, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:digits]


def slug(*parts: object) -> str:
    """Parts joined by "-", as a folder may be called."""
    words = (re.sub(r"[^a-z0-9]+", "-", str(part).lower()).strip("-")[:32] for part in parts)
    return "-".join(word for word in words if word)


def _reflected(step: int, count: int) -> int:
    """`step` folded into 0..count - 1 at both ends: 0 1 2 1 0 1 ..."""
    if count == 1:
        return 0
    step %= 2 * (count - 1)
    return min(step, 2 * (count - 1) - step)
