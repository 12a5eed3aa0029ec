"""One frame: what effects and heuristics look at while it is made, and what the caller gets."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from phrt.budget import UNLIMITED, Budget
from phrt.camera import CameraView
from phrt.channels import GBuffer
from phrt.interfaces.effect import Adds
from phrt.interfaces.gbuffer import GBufferProducer
from phrt.interfaces.heuristic import BudgetUnit, Candidates
from phrt.interfaces.tracer import Tracer
from phrt.kernels.arrays import EnvironmentArrays, GeometryArrays, MaterialArrays, SurfaceArrays
from phrt.workers import Workers
from phrt.world import World

if TYPE_CHECKING:
    from phrt.faults.fault import Fault

MASK_NONE, MASK_FALLBACK, MASK_TRACED, MASK_FILLED, MASK_HISTORY = 0, 1, 2, 3, 4
"""A layer's mask: the layer's clear value, the effect's fallback, traced, filled from traced neighbours, a value of an
earlier frame."""

REASONS = ("not_asked", "selected", "reduced", "cut", "no_fit", "no_time", "effect_off")
"""Why an item was traced or not, by `Decisions.reason`."""
NOT_ASKED, SELECTED, REDUCED, CUT, NO_FIT, NO_TIME, EFFECT_OFF = range(len(REASONS))
"""The heuristic did not name it; traced whole; traced as far as was asked for, at a lower density; begun, but the budget
ended; named, but predicted to take more than was left; named, but the budget ended before it; its effect is switched off."""


@dataclass(frozen=True)
class Frame:
    """The frame in the making. Read-only for effects; P pixels in one row, L lights.

    surfaces: the G-buffer's pixels; direct: (P, L, 3) unshadowed reflected light; seed: of this frame and sub-pixel sample.
    """

    world: World
    view: CameraView
    gbuffer: GBuffer
    surfaces: SurfaceArrays
    direct: np.ndarray
    tracer: Tracer
    producer: GBufferProducer
    workers: Workers
    geometry: GeometryArrays
    materials: MaterialArrays
    environment: EnvironmentArrays
    index: int
    time: float
    seed: int
    only_light: int | None = None
    """Effects with a component per light may trace this one alone."""

    def view_vectors(self, pixels: np.ndarray) -> tuple[np.ndarray, bool]:
        """What kernels call `view`: the eye (1, 3) and True, or the rays' directions (n, 3) and False when orthographic."""
        matrix = self.view.world_from_view.astype(np.float32)
        if self.view.orthographic:
            return np.ascontiguousarray(np.broadcast_to(-matrix[:3, 2], (len(pixels), 3))), False
        return matrix[None, :3, 3].copy(), True


@dataclass(frozen=True)
class Decisions:
    """What was decided for every candidate of a frame, row by row.

    candidates    : the items with all their letters and predicted costs
    chosen        : (n,) bool, traced, at least in part
    reason        : (n,) uint8, why or why not, index into REASONS
    order         : (n,) int32, the how-manieth item the heuristic named; -1 for one it did not
    passes        : (n,) int32, how many of its PASSES interleaved passes are traced, the last perhaps not whole
    traced_pixels : (n,) int64
    rays          : (n,) int64, really traced
    milliseconds  : (n,) float64, of the renderer's clock; they sum to the waves' times
    budget, budget_unit: what the sample's ray phase might take, "rays", "ms" or "none" (+inf)
    left          : what was left of it at the end; +inf without one
    ray_ms        : how long the ray phase took by the renderer's clock
    waves         : in how many waves
    score         : (n,) float32, what the heuristic ranked items by (`Heuristic.scores`); NaN for one that does not say

    Rays and milliseconds of small items are their share, by prediction, of what items of their effect took together.
    """

    candidates: Candidates
    chosen: np.ndarray
    reason: np.ndarray
    order: np.ndarray
    passes: np.ndarray
    traced_pixels: np.ndarray
    rays: np.ndarray
    milliseconds: np.ndarray
    budget: float = math.inf
    budget_unit: BudgetUnit = "none"
    left: float = math.inf
    ray_ms: float = 0.0
    waves: int = 0
    score: np.ndarray = field(default_factory=lambda: np.zeros(0, np.float32))

    @property
    def overrun_ms(self) -> float:
        """By how much the ray phase passed a budget of time; 0 when it did not, or had none."""
        return max(self.ray_ms - self.budget, 0.0) if self.budget_unit == "ms" else 0.0


@dataclass(frozen=True)
class FrameResult:
    """A finished frame.

    image: (H, W, 3) float32, linear Rec.709, exposure applied. gbuffer: of the last sub-pixel sample.
    layers: (H, W, C) float32 by layer name, averaged over samples, exposure not applied.
    light_layers: names of those with one component per light of the scene, in its order.
    direct: (H, W, L, 3), unshadowed, of the last sample. masks: (H, W) uint8 by layer name, of the last sample, see MASK_*.
    decisions: of the last sample; their rays and milliseconds are sums over the samples.
    stages: milliseconds by stage, summing to `milliseconds`. rays: how many by kind ("primary" and each effect).
    exposure: what the image was multiplied with, the camera's times the scene's. view: camera of the last sample.
    world: the scene as it is; rendering the next frame moves it on. time: seconds.
    samples: the decisions of every sub-pixel sample, each its own. effect_layers: name of the layer that an effect writes.
    added_layers: what layers bring that the composition does not know by name, see `LayerSpec`.
    budget: the frame's. headroom_ms: what was kept back of a frame budget. clock_ms: what the frame took by the renderer's clock.
    faults: what plugins did wrong in it, as far as it was not told in an earlier frame.
    """

    image: np.ndarray
    gbuffer: GBuffer
    layers: dict[str, np.ndarray]
    direct: np.ndarray
    masks: dict[str, np.ndarray]
    decisions: Decisions
    stages: dict[str, float]
    rays: dict[str, int]
    index: int
    time: float
    exposure: float
    light_layers: frozenset[str]
    world: World
    view: CameraView
    budget: Budget = UNLIMITED
    headroom_ms: float = 0.0
    clock_ms: float = 0.0
    samples: tuple[Decisions, ...] = ()
    effect_layers: dict[str, str] = field(default_factory=dict)
    added_layers: dict[str, Adds] = field(default_factory=dict)
    faults: tuple[Fault, ...] = ()

    @property
    def late(self) -> bool:
        """Did the frame pass a budget for the whole frame?"""
        return self.budget.kind == "frame_ms" and self.clock_ms > self.budget.amount

    @property
    def milliseconds(self) -> float:
        """Wall-clock time of the whole frame."""
        return sum(self.stages.values())
