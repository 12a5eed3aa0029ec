"""One frame: what effects and heuristics look at while it is made, and what the caller gets."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from phrt.camera import CameraView
from phrt.channels import GBuffer
from phrt.interfaces.gbuffer import GBufferProducer
from phrt.interfaces.heuristic import Candidates
from phrt.interfaces.tracer import Tracer
from phrt.kernels.arrays import EnvironmentArrays, GeometryArrays, MaterialArrays, SurfaceArrays
from phrt.workers import Workers
from phrt.world import World

MASK_NONE, MASK_FALLBACK, MASK_TRACED, MASK_FILLED = 0, 1, 2, 3
"""A layer's mask: the layer's clear value, the effect's fallback, traced, filled from traced neighbours."""


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

    def view_vectors(self, pixels: np.ndarray) -> tuple[np.ndarray, bool]:
        """What kernels call `view`: the eye (1, 3) and True, or the rays' directions (n, 3) and False when orthographic."""
        matrix = self.view.world_from_view.astype(np.float32)
        if self.view.orthographic:
            return np.ascontiguousarray(np.broadcast_to(-matrix[:3, 2], (len(pixels), 3))), False
        return matrix[None, :3, 3].copy(), True


@dataclass(frozen=True)
class Decisions:
    """What was decided for every candidate of a frame, row by row.

    candidates    : the items with all their letters and `predicted_cost`
    chosen        : (n,) bool, traced, at least in part
    passes        : (n,) int32, how many of an item's PASSES interleaved passes were traced
    traced_pixels : (n,) int64
    rays          : (n,) int64, really traced
    milliseconds  : (n,) float64, of thread time
    budget        : rays the sample's ray phase might take; +inf without a limit
    measured      : rays and milliseconds are each item's own; without a budget they are its share, by pixels, of its effect's
    """

    candidates: Candidates
    chosen: np.ndarray
    passes: np.ndarray
    traced_pixels: np.ndarray
    rays: np.ndarray
    milliseconds: np.ndarray
    budget: float = math.inf
    measured: bool = False


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

    @property
    def milliseconds(self) -> float:
        """Wall-clock time of the whole frame."""
        return sum(self.stages.values())
