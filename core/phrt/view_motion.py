"""How fast things move in the picture: every object, and the view as a whole.

Funkhouser and Sequin 1993, section 4.2: what moves quickly across the screen "appears blurred or can be seen for only a short
amount of time", so that its detail counts for less. Andrade et al. 2014, section 4.1, say the same of a drive or a game.
"""

from __future__ import annotations

import numpy as np

from phrt.camera import CameraView

CUT = 1.0
"""Picture widths. What moves further from one frame to the next has nothing in common with what was there: a cut, or a jump."""

FAR = 1e6
"""Metres; stands for infinitely far away."""

_NEAREST = 1e-12
"""Metres; nearer to the plane of the eye than that is no place that can be told."""

_SAMPLES = np.array([(x, y) for y in (-0.5, 0.0, 0.5) for x in (-0.5, 0.0, 0.5)])
"""Where in the picture the movement of the view is taken, in half widths and half heights from its centre."""


def picture_place(points_world: np.ndarray, view: CameraView) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2) float64 places of points (n, 3) in the picture, and (n,) bool whether they are ahead of the observer.

    From the picture's centre in half widths and half heights, so that the border is at 1; x to the right, y up. What is not
    ahead has a place that means nothing.
    """
    at = (points_world - view.position) @ view.world_from_view[:3, :3]
    ahead = -at[:, 2] > 0
    plane = np.ones(len(at)) if view.orthographic else np.where(ahead, np.maximum(-at[:, 2], _NEAREST), 1.0)
    return at[:, :2] / plane[:, None] / np.array(view.tan_half), ahead


class ViewMotion:
    """Speeds between the previous frame and this one, in picture widths a second.

    They are 0 in the first frame, after a cut, and where time stands still or goes back: nothing was seen to move.
    """

    def __init__(self) -> None:
        self._before: tuple[CameraView, np.ndarray, float] | None = None

    def advance(
        self, center_world: np.ndarray, view: CameraView, time: float, distance: float
    ) -> tuple[np.ndarray, float]:
        """Speeds (n,) float32 of objects with centres (n, 3), their own movement included, and of the view.

        The view's speed is the mean over nine points that stand still in the world at `distance` metres, where the picture is
        divided into quarters: it counts turning, walking and rolling, and no object's own movement.
        """
        before, self._before = self._before, (view, center_world.copy(), time)
        still = np.zeros(len(center_world), np.float32)
        if before is None or not time > before[2] or view.orthographic != before[0].orthographic:
            return still, 0.0
        seconds = time - before[2]
        marks = _points_at(view, min(distance, FAR))
        view_path = _path_length(marks, before[0], marks, view)
        if not np.isfinite(view_path).all() or view_path.mean() > CUT:
            return still, 0.0
        paths = _path_length(before[1], before[0], center_world, view)
        paths = np.where(paths <= CUT, paths, 0.0)
        return (paths / seconds).astype(np.float32), float(view_path.mean() / seconds)


def _points_at(view: CameraView, distance: float) -> np.ndarray:
    """(9, 3) world points at `_SAMPLES` of the picture, `distance` metres ahead."""
    across = _SAMPLES * np.array(view.tan_half) * (1.0 if view.orthographic else distance)
    local = np.column_stack([across, np.full(len(across), -distance)])
    return local @ view.world_from_view[:3, :3].T + view.position


def _path_length(before_world: np.ndarray, before: CameraView, now_world: np.ndarray, now: CameraView) -> np.ndarray:
    """(n,) float64 picture widths between the places of points then and now; +inf where they were not ahead both times."""
    was, was_ahead = picture_place(before_world, before)
    here, is_ahead = picture_place(now_world, now)
    moved = (here - was) * np.array([0.5, 0.5 * now.height / now.width])
    return np.where(was_ahead & is_ahead, np.linalg.norm(moved, axis=1), np.inf)
