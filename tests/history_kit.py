"""A yard with things that can move, a heuristic that traces only in some frames, and what counts as a ghost."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from scene_kit import LAMBERT, MIRROR, Stage, at, ball, box, floor

import phrt
from phrt.camera import CameraView, look_at
from phrt.frame import MASK_HISTORY, FrameResult
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.scene import Scene

SIZE = (120, 80)
EFFECTS: dict[str, dict[str, Any]] = {"ambient_occlusion": {"samples": 64, "radius": 0.8}}


class TraceIn(Heuristic):
    """Traces everything in some frames, nothing in the others."""

    def __init__(self, frames: Iterable[int]) -> None:
        self._frames = set(frames)
        self.candidates: list[Candidates] = []
        """Of every frame so far."""

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self.candidates.append(candidates)
        self._left = list(range(len(candidates))) if context.frame_index in self._frames else []

    def next(self, remaining: float) -> int | None:
        return self._left.pop() if self._left else None


def yard(dome: tuple[float, float, float] = (0.2, 0.25, 0.3), **mover: Any) -> Scene:
    """A floor, a wall, a pillar, a mirror ball, and a box "/mover" of which `mover` are switches; a lamp, a sun, a large lamp."""
    made = (
        Stage(dome=dome)
        .add("/floor", floor(14), LAMBERT, at(0, 0, 0))
        .add("/wall", box(8, 3, 0.2), LAMBERT, at(0, 1.5, -3))
    )
    made.add("/mover", box(0.7, 0.7, 0.7), LAMBERT, at(-0.8, 0.9, 0.0), **mover)
    made.add("/pillar", box(0.3, 1.6, 0.3), LAMBERT, at(1.1, 0.8, -0.6)).add(
        "/ball", ball(0.4, 4), MIRROR, at(0.2, 0.4, 0.9)
    )
    made.light("point", at(1.5, 3.0, 2.0), intensity=30.0)
    slanted = look_at((0.0, 0.0, 0.0), (0.5, -1.0, -0.3))
    made.light("directional", slanted, intensity=1.0).light("sphere", at(-2.5, 2.5, 1.5), intensity=15.0, radius=0.3)
    return made.camera((0.0, 1.6, 4.5), (0.0, 0.6, 0.0), fov_y=0.8).scene


def walking(step: float = 0.03) -> Callable[[int], CameraView]:
    """The view of frame k: a walk to the right and ahead, always looking at the yard's middle."""

    def view(k: int) -> CameraView:
        eye = (step * k, 1.6, 4.5 - 0.7 * step * k)
        return CameraView(*SIZE, look_at(eye, (0.3 * step * k, 0.6, 0.0)), (0.42 * SIZE[0] / SIZE[1], 0.42))

    return view


Move = Callable[[phrt.Renderer, int], None]


def run(
    scene: Scene,
    frames: int,
    traced: Iterable[int] = (0,),
    move: Move | None = None,
    view: Callable[[int], CameraView] | None = None,
    fps: float = 10.0,
    **options: Any,
) -> list[tuple[FrameResult, FrameResult]]:
    """Frames in which everything is traced in `traced` alone, each with the same frame traced in full."""
    options = {"size": SIZE, "gbuffer": "raycast", "threads": 2, "strict": True, "effects": EFFECTS} | options
    kept: list[tuple[FrameResult, FrameResult]] = []
    with (
        phrt.Renderer(scene, heuristic=options.pop("heuristic", None) or TraceIn(traced), **options) as some,
        phrt.Renderer(scene, heuristic="all_trace", **options) as all_,
    ):
        for k in range(frames):
            pair = []
            for renderer in (some, all_):
                if move is not None:
                    move(renderer, k)
                pair.append(renderer.render(k / fps, frame_index=k, camera=view(k) if view else 0))
            kept.append((pair[0], pair[1]))
    return kept


def around(values: np.ndarray, reach: int, best: Any) -> np.ndarray:
    """Smallest or largest (`best` np.minimum or np.maximum) of `values` (H, W, C) within `reach` pixels."""
    out = values.copy()
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            rows = np.clip(np.arange(values.shape[0]) + dy, 0, values.shape[0] - 1)
            columns = np.clip(np.arange(values.shape[1]) + dx, 0, values.shape[1] - 1)
            out = best(out, values[rows][:, columns])
    return np.asarray(out)


def ghosts(frame: FrameResult, truth: FrameResult, layer: str, reach: int = 2, tolerance: float = 0.02) -> np.ndarray:
    """(H, W) bool: earlier values that full tracing has nowhere within `reach` pixels; lights only where they arrive."""
    value, real = frame.layers[layer], truth.layers[layer]
    low, high = around(real, reach, np.minimum) - tolerance, around(real, reach, np.maximum) + tolerance
    wrong = (value < low) | (value > high)
    if layer == "visibility":
        wrong &= frame.direct.sum(axis=-1) > 0
    return wrong.any(axis=-1) & (frame.masks[layer] == MASK_HISTORY)


def kept_share(frame: FrameResult, layer: str) -> float:
    """Of the pixels that show something, how many hold an earlier value."""
    return float((frame.masks[layer] == MASK_HISTORY)[frame.gbuffer.object_id > 0].mean())
