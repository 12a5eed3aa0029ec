"""A small scene to record, frames of it with decisions written by hand, and runs made of them, for tests."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import needs
import numpy as np
from scene_kit import GLASS, LAMBERT, MIRROR, Stage, at, ball, floor

import phrt
from phrt.frame import REASONS, FrameResult
from phrt.scene import Scene

needs.package("pyarrow")
SIZE = (64, 36)


def three_things(**switches: Any) -> Scene:
    """A floor, a mirror ball and a glass ball; `switches` are those of the mirror ball."""
    made = Stage(dome=(0.3, 0.4, 0.6)).add("/World/Floor", floor(), LAMBERT, at(0, -0.5, 0))
    made.add("/World/Balls/Mirror", ball(0.5, 3), MIRROR, at(-0.8, 0, 0), **switches)
    made.add("/World/Balls/Glass", ball(0.5, 3), GLASS, at(0.8, 0, 0))
    return made.light("point", at(1, 3, 2), intensity=40.0).camera((0, 1.0, 4), (0, 0, 0), fov_y=0.7).scene


@contextmanager
def renderer_of(scene: Scene | None = None, **options: Any) -> Iterator[phrt.Renderer]:
    options = {"size": SIZE, "gbuffer": "raycast", "threads": 2} | options
    with phrt.Renderer(scene or three_things(), **options) as renderer:
        yield renderer


def record(folder: Path, frames: int = 3, scene: Scene | None = None, **options: Any) -> list[FrameResult]:
    """Render `frames` frames into the run folder `folder`."""
    from phrt.recording import Recorder

    with renderer_of(scene, **options) as renderer, Recorder(folder, renderer) as recorder:
        made = []
        for number in range(frames):
            made.append(renderer.render(number / 30))
            recorder.add(made[-1])
    return made


def row_of(frame: FrameResult, path: str, effect: str) -> int:
    """The candidate of an object and effect."""
    candidates = frame.decisions.candidates
    object_id = 1 + [entry.path for entry in frame.world.scene.objects].index(path)
    number = candidates.effect_names.index(effect)
    return int(np.flatnonzero((candidates.object_id == object_id) & (candidates.effect == number))[0])


def decided(frame: FrameResult, rows: dict[int, dict[str, Any]], **scalars: Any) -> FrameResult:
    """`frame` with other decisions: nothing was asked for but `rows`, whose values are given by column; columns of
    candidates too. scalars: of Decisions."""
    decisions, candidates = frame.decisions, frame.decisions.candidates
    count = len(candidates)
    arrays: dict[str, np.ndarray] = {
        "chosen": np.zeros(count, bool),
        "reason": np.zeros(count, np.uint8),
        "order": np.full(count, -1, np.int32),
        "passes": np.zeros(count, np.int32),
        "traced_pixels": np.zeros(count, np.int64),
        "rays": np.zeros(count, np.int64),
        "milliseconds": np.zeros(count),
    }
    letters = {name: getattr(candidates, name).copy() for name in ("predicted_cost", "relevance", "mandatory")}
    letters |= {name: getattr(candidates, name).copy() for name in ("history_share", "history_age", "pixel_count")}
    for row, values in rows.items():
        for name, value in values.items():
            target = arrays if name in arrays else letters
            target[name][row] = REASONS.index(value) if name == "reason" else value
    made = replace(decisions, candidates=replace(candidates, **letters), **arrays, **scalars)
    return replace(frame, decisions=made, samples=(made,))


def quietly(function: Any, *arguments: Any, **options: Any) -> Any:
    """The answer of a call whose warnings do not matter."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return function(*arguments, **options)
