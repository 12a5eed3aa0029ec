"""Experience: what earlier frames taught about every object and effect - was it selected, how many rays does a pixel take."""

from __future__ import annotations

import numpy as np

from phrt.exploration import Exploration
from phrt.frame import Decisions
from phrt.kernels.booking import mean_rays

MEMORY_FRAMES = 8
"""Measurements that the mean of rays per pixel is made of, nearly: a new one counts at least 1 / MEMORY_FRAMES."""


class Experience:
    """Kept by (object, effect); arrays (N + 1, effects).

    was_selected   : bool, S, traced in the previous frame
    ray_estimate   : float64, Q, what was expected before the run
    rays_per_pixel : float64, mean of what was measured; the estimate Q where nothing was
    measurements   : int32, how often it was measured
    exploration    : how long it was seen, when it was traced, what that changed and took
    """

    def __init__(self, object_count: int, ray_estimates: list[float]) -> None:
        shape = (object_count + 1, len(ray_estimates))
        self.was_selected = np.zeros(shape, bool)
        self.rays_per_pixel = np.broadcast_to(np.array(ray_estimates, np.float64), shape).copy()
        self.ray_estimate = self.rays_per_pixel.copy()
        self.measurements = np.zeros(shape, np.int32)
        self.exploration = Exploration(object_count, len(ray_estimates))

    def expect(self, rays_per_pixel: np.ndarray) -> None:
        """Take over estimates (N + 1, effects) of a profile; those that are NaN stay as they are."""
        known = ~np.isnan(rays_per_pixel)
        self.ray_estimate[known] = rays_per_pixel[known]
        self.rays_per_pixel[known] = rays_per_pixel[known]

    def predict_rays(self, object_id: np.ndarray, effect: np.ndarray, pixel_count: np.ndarray) -> np.ndarray:
        """(n,) float32, rays that tracing the items will take; whole numbers, at least 1: no item is free."""
        rays = pixel_count * self.rays_per_pixel[object_id, effect]
        return np.maximum(np.ceil(rays), 1.0).astype(np.float32)

    def learn_rays(self, object_id: np.ndarray, effect: np.ndarray, pixels: np.ndarray, rays: np.ndarray) -> None:
        """Take what was measured into the mean: the first measurement replaces the estimate, later ones move it.

        object_id, effect (k,): what was traced, each pair once; pixels (k,), at least 1, and rays (k,): how much.
        """
        mean_rays(object_id, effect, pixels, rays, MEMORY_FRAMES, self.measurements, self.rays_per_pixel)

    def note_selected(self, frame: list[Decisions]) -> None:
        """A frame is finished: `frame` are the decisions of its sub-pixel samples."""
        self.exploration.end_frame()
        self.was_selected[:] = False
        for decisions in frame:
            objects, effects = decisions.candidates.object_id[decisions.chosen], decisions.candidates.effect
            # Where an item is an object with all effects, each of them was selected.
            whole = len(decisions.candidates.effect_names) < self.was_selected.shape[1]
            self.was_selected[objects, slice(None) if whole else effects[decisions.chosen]] = True
