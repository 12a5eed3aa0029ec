"""A camera at one moment: matrices, size and sub-pixel jitter of one picture."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from phrt.conventions import DEFAULT_NEAR
from phrt.model import CameraLens


@dataclass(frozen=True)
class CameraView:
    """What a picture is taken with.

    world_from_view : (4, 4) float64, rigid: the camera's axes and place in the world
    tan_half        : (x, y) tangents of the half fields of view; half width and height in metres when orthographic
    jitter          : (x, y) in pixels, 0 at the pixel centre, within -0.5..0.5
    near, far       : metres along -Z; surfaces outside are not there
    """

    width: int
    height: int
    world_from_view: np.ndarray
    tan_half: tuple[float, float]
    orthographic: bool = False
    near: float = DEFAULT_NEAR
    far: float = math.inf
    jitter: tuple[float, float] = (0.0, 0.0)
    exposure: float = 1.0

    @classmethod
    def from_lens(cls, lens: CameraLens, world_from_node: np.ndarray, width: int, height: int) -> CameraView:
        """The view of `lens` at a node. The vertical field of view is kept; a lens that states its aspect never shows less
        than it stated, so a narrower picture widens the vertical field instead. Scale in the node is ignored."""
        aspect = width / height
        half_y = lens.ortho_height / 2 if lens.ortho_height is not None else math.tan(lens.fov_y / 2)
        if lens.aspect is not None and aspect < lens.aspect:
            half_y *= lens.aspect / aspect
        return cls(
            width=width,
            height=height,
            world_from_view=rigid(world_from_node),
            tan_half=(half_y * aspect, half_y),
            orthographic=lens.ortho_height is not None,
            near=lens.near,
            far=lens.far,
            exposure=lens.exposure,
        )

    @property
    def position(self) -> np.ndarray:
        """(3,) float64, the eye in world space."""
        return self.world_from_view[:3, 3]

    @property
    def pixel_spread(self) -> float:
        """Width of a pixel at one metre (radians, nearly), or in metres when orthographic: the ray cone's opening."""
        return 2.0 * self.tan_half[1] / self.height

    def with_jitter(self, x: float, y: float) -> CameraView:
        return replace(self, jitter=(x, y))

    def view_from_world(self) -> np.ndarray:
        """(4, 4) float64."""
        inverse = np.eye(4)
        rotation = self.world_from_view[:3, :3]
        inverse[:3, :3] = rotation.T
        inverse[:3, 3] = -rotation.T @ self.world_from_view[:3, 3]
        return inverse

    def clip_from_view(self) -> np.ndarray:
        """(4, 4) float64, OpenGL clip space (-w..w, y up), jitter included; an infinite far plane is allowed."""
        half_x, half_y = self.tan_half
        near, far = self.near, self.far
        # A sample at +jitter (pixels, y down) sees what lies there, so the image moves the other way.
        shift_x = -2.0 * self.jitter[0] / self.width
        shift_y = 2.0 * self.jitter[1] / self.height
        clip = np.zeros((4, 4))
        if self.orthographic:
            reach = far if math.isfinite(far) else near + 1e5
            clip[0, 0], clip[1, 1] = 1.0 / half_x, 1.0 / half_y
            clip[2, 2] = -2.0 / (reach - near)
            clip[2, 3] = -(reach + near) / (reach - near)
            clip[3, 3] = 1.0
            clip[0, 3], clip[1, 3] = shift_x, shift_y
            return clip
        clip[0, 0], clip[1, 1] = 1.0 / half_x, 1.0 / half_y
        clip[0, 2], clip[1, 2] = -shift_x, -shift_y
        clip[3, 2] = -1.0
        if math.isfinite(far):
            clip[2, 2] = -(far + near) / (far - near)
            clip[2, 3] = -2.0 * far * near / (far - near)
        else:
            clip[2, 2], clip[2, 3] = -1.0, -2.0 * near
        return clip

    def clip_from_world(self) -> np.ndarray:
        """(4, 4) float64: projection of world points, jitter included."""
        return self.clip_from_view() @ self.view_from_world()


def rigid(matrix: np.ndarray) -> np.ndarray:
    """`matrix` (4, 4) without scale and shear: its axes orthonormalised, its place kept. Axes that are scaled to nothing
    are lost: the parent's stand in for them."""
    result = np.eye(4)
    result[:3, 3] = matrix[:3, 3]
    lengths = np.linalg.norm(matrix[:3, :3], axis=0)
    if lengths[1:].min() < 1e-30:
        return result
    z = matrix[:3, 2] / lengths[2]
    y = matrix[:3, 1] / lengths[1]
    y = y - z * (y @ z)
    height = float(np.linalg.norm(y))
    if height > 1e-9:
        y = y / height
        result[:3, 0], result[:3, 1], result[:3, 2] = np.cross(y, z), y, z
    return result


def look_at(
    eye: tuple[float, float, float],
    target: tuple[float, float, float],
    up: tuple[float, float, float] = (0.0, 1.0, 0.0),
) -> np.ndarray:
    """(4, 4) float64 world_from_view of a camera at `eye` looking at `target`. Any up serves, even one along the view."""
    matrix = np.eye(4)
    back = np.subtract(eye, target).astype(np.float64)
    length = float(np.linalg.norm(back))
    back = back / length if length > 0 else np.array([0.0, 0.0, 1.0])
    right = np.cross(np.asarray(up, dtype=np.float64), back)
    if np.linalg.norm(right) < 1e-6:
        right = np.cross(np.array([0.0, 0.0, -1.0]) if abs(back[2]) < 0.9 else np.array([1.0, 0.0, 0.0]), back)
    right = right / np.linalg.norm(right)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = right, np.cross(back, right), back
    matrix[:3, 3] = eye
    return matrix
