"""Places and paths: matrices of an `xform`, and keyframes as `phrt.model.Track`s."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Literal

import numpy as np

from phrt.animation import compose, quaternion_of
from phrt.camera import look_at
from phrt.description.prims import Animation, CameraPath, Interpolation, LookAt, Xform
from phrt.model import Track

SAMPLES_PER_SECOND = 60.0
"""Look directions and angles between keys become this many quaternions a second."""

MIN_SAMPLES, MAX_SAMPLES = 8, 1200
"""Quaternions between two keys."""


def euler_matrix(degrees: tuple[float, float, float]) -> np.ndarray:
    """(3, 3) rotation about X, then Y, then Z (USD rotateXYZ)."""
    (cx, sx), (cy, sy), (cz, sz) = ((math.cos(math.radians(a)), math.sin(math.radians(a))) for a in degrees)
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def matrix_of(xform: Xform | None) -> np.ndarray:
    """(4, 4) float64 parent_from_prim; an animated prim is where its first key puts it."""
    if xform is None:
        return np.eye(4)
    if xform.matrix is not None:
        return np.array(xform.matrix, dtype=np.float64)
    first = xform.animation.keys[0] if xform.animation else None
    rotate = first.rotate if first is not None and first.rotate is not None else xform.rotate
    quaternion = np.array([0.0, 0.0, 0.0, 1.0])
    if rotate is not None:
        quaternion = quaternion_of(euler_matrix(rotate))
    elif xform.quaternion is not None:
        quaternion = np.array(xform.quaternion) / np.linalg.norm(xform.quaternion)
    translate = first.translate if first is not None and first.translate is not None else xform.translate
    scale = first.scale if first is not None and first.scale is not None else xform.scale
    return compose(np.array(translate or (0.0, 0.0, 0.0)), quaternion, np.array(scale or (1.0, 1.0, 1.0)))


def look_at_matrix(place: LookAt) -> np.ndarray:
    """(4, 4) float64 parent_from_camera."""
    return look_at(place.eye, place.target, place.up)


def animation_tracks(animation: Animation, node: int) -> list[Track]:
    """Tracks of `node` for what the keys give: translation, rotation, scale."""
    times = np.array([key.time for key in animation.keys])
    tracks: list[Track] = []
    for name, target in (("translate", "translation"), ("scale", "scale")):
        values = [getattr(key, name) for key in animation.keys]
        if values[0] is not None:
            tracks.append(
                _vector_track(
                    node,
                    "translation" if target == "translation" else "scale",
                    times,
                    np.array(values),
                    animation.interpolation,
                )
            )
    if animation.keys[0].rotate is not None:
        angles = np.array([key.rotate for key in animation.keys])
        tracks.append(_angle_track(node, times, angles, animation.interpolation))
    return tracks


def camera_tracks(path: CameraPath, node: int) -> list[Track]:
    """Tracks of a camera's node. Eye and target both move along the path's curve; the view is sampled in between."""
    times = np.array([key.time for key in path.keys])
    if path.keys[0].eye is None:
        places = np.array([key.translate for key in path.keys])
        angles = np.array([key.rotate or (0.0, 0.0, 0.0) for key in path.keys])
        moving = _vector_track(node, "translation", times, places, path.interpolation)
        return [moving, _angle_track(node, times, angles, path.interpolation)]
    curve = {
        name: np.array([getattr(key, name) or (0.0, 1.0, 0.0) for key in path.keys]) for name in ("eye", "target", "up")
    }

    def view(time: np.ndarray) -> np.ndarray:
        eye, target, up = (
            interpolated(times, curve[name], time, path.interpolation) for name in ("eye", "target", "up")
        )
        rows = zip(eye.tolist(), target.tolist(), up.tolist(), strict=True)
        return np.array([quaternion_of(look_at(e, t, u)[:3, :3]) for e, t, u in rows])

    moving = _vector_track(node, "translation", times, curve["eye"], path.interpolation)
    return [moving, _sampled_rotation(node, times, view, path.interpolation)]


def camera_rest(path: CameraPath) -> np.ndarray:
    """(4, 4) float64, where the path starts."""
    first = path.keys[0]
    if first.eye is not None and first.target is not None:
        return look_at(first.eye, first.target, first.up or (0.0, 1.0, 0.0))
    return matrix_of(Xform(translate=first.translate, rotate=first.rotate))


def tangents(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(K, C) Catmull-Rom slopes per second for keys at uneven times; one-sided at the ends."""
    if len(times) < 2:
        return np.zeros_like(values, dtype=np.float64)
    slopes = np.empty(values.shape, dtype=np.float64)
    slopes[1:-1] = (values[2:] - values[:-2]) / (times[2:] - times[:-2])[:, None]
    slopes[0] = (values[1] - values[0]) / (times[1] - times[0])
    slopes[-1] = (values[-1] - values[-2]) / (times[-1] - times[-2])
    return slopes


def interpolated(times: np.ndarray, values: np.ndarray, at: np.ndarray, how: Interpolation) -> np.ndarray:
    """(n, C) values of the curve through keys (K,), (K, C) at times `at` (n,), held at the ends."""
    at = np.clip(at, times[0], times[-1])
    left = np.clip(np.searchsorted(times, at, side="right") - 1, 0, max(len(times) - 2, 0))
    if len(times) == 1 or how == "step":
        return np.asarray(
            values[np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 1)], dtype=np.float64
        )
    span = (times[left + 1] - times[left])[:, None]
    s = (at - times[left])[:, None] / span
    if how == "linear":
        return values[left] + (values[left + 1] - values[left]) * s
    slopes = tangents(times, values)
    s2, s3 = s * s, s * s * s
    start = (2 * s3 - 3 * s2 + 1) * values[left] + (s3 - 2 * s2 + s) * span * slopes[left]
    end = (3 * s2 - 2 * s3) * values[left + 1] + (s3 - s2) * span * slopes[left + 1]
    return start + end


def _vector_track(node: int, target: str, times: np.ndarray, values: np.ndarray, how: Interpolation) -> Track:
    values = values.astype(np.float64)
    kind: Literal["scale", "translation"] = "scale" if target == "scale" else "translation"
    if how == "smooth":
        slopes = tangents(times, values)
        return Track(node, kind, times, np.stack([slopes, values, slopes], axis=1), "cubic")
    return Track(node, kind, times, values, how)


def _angle_track(node: int, times: np.ndarray, degrees: np.ndarray, how: Interpolation) -> Track:
    """Angles are interpolated as numbers, so that whole turns are turned."""

    def rotation(time: np.ndarray) -> np.ndarray:
        rows = interpolated(times, degrees, time, how)
        return np.array([quaternion_of(euler_matrix((row[0], row[1], row[2]))) for row in rows])

    return _sampled_rotation(node, times, rotation, how)


def _sampled_rotation(
    node: int, times: np.ndarray, rotation: Callable[[np.ndarray], np.ndarray], how: Interpolation
) -> Track:
    """A linear track of quaternions along `rotation(times)`, neighbours in one hemisphere."""
    if how == "step" or len(times) == 1:
        return Track(node, "rotation", times, rotation(times), "step")
    at = sample_times(times)
    values = rotation(at)
    flips = np.cumprod(np.where(np.einsum("ij,ij->i", values[1:], values[:-1]) < 0, -1.0, 1.0))
    values[1:] *= flips[:, None]
    return Track(node, "rotation", at, values, "linear")


def sample_times(times: np.ndarray) -> np.ndarray:
    """Every key's time, and evenly spaced ones in between."""
    pieces = [
        np.linspace(
            before, after, int(np.clip(np.ceil((after - before) * SAMPLES_PER_SECOND), MIN_SAMPLES, MAX_SAMPLES)) + 1
        )[:-1]
        for before, after in pairwise(times.tolist())
    ]
    return np.concatenate([*pieces, times[-1:]])
