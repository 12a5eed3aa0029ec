"""Solids made of formulas: boxes, lathes, sweeps, extrusions, spheres, as `Part`s that `meshing.build_mesh` joins.

Every part has counter-clockwise front faces that look outward. Angles are radians, lengths metres, Y is up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

Array = np.ndarray
TAU = 2.0 * np.pi


@dataclass(frozen=True)
class Part:
    """Triangles of one material.

    positions (V, 3) float64; triangles (T, 3) int64; corner_uv (T, 3, 2) float64 metres, None for box projection;
    normals (V, 3) float64 where they are known exactly; crease_degrees: edges sharper than this stay hard.
    """

    material: str
    positions: Array
    triangles: Array
    corner_uv: Array | None = None
    normals: Array | None = None
    crease_degrees: float = 40.0

    def placed(self, matrix: Array) -> Part:
        """The part moved by `matrix` (4, 4), which must not mirror."""
        linear = matrix[:3, :3]
        normals = None
        if self.normals is not None:
            normals = self.normals @ np.linalg.inv(linear)
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        return replace(self, positions=self.positions @ linear.T + matrix[:3, 3], normals=normals)


def translation(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Array:
    """(4, 4) float64."""
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def turn_y(angle: float) -> Array:
    """(4, 4) float64, a turn about +Y that takes +Z towards +X."""
    matrix = np.eye(4)
    cosine, sine = np.cos(angle), np.sin(angle)
    matrix[0, 0], matrix[0, 2], matrix[2, 0], matrix[2, 2] = cosine, sine, -sine, cosine
    return matrix


def scaling(x: float, y: float, z: float) -> Array:
    """(4, 4) float64."""
    return np.diag([x, y, z, 1.0])


def placed(parts: Sequence[Part], matrix: Array) -> list[Part]:
    return [part.placed(matrix) for part in parts]


def circle(segments: int, closed: bool = True) -> tuple[Array, Array]:
    """Cosines and sines of `segments` + 1 angles round the circle; the last repeats the first exactly when closed."""
    angle = TAU * np.arange(segments + 1) / segments
    if closed:
        angle[-1] = 0.0
    return np.cos(angle), np.sin(angle)


def grid(
    points: Array,
    material: str,
    *,
    uv: Array | None = None,
    crease_degrees: float = 40.0,
    flip_diagonal: Array | None = None,
) -> Part:
    """A surface through `points` (n, m, 3), whose front is along d/dn x d/dm; `build_mesh` drops empty triangles.

    uv : (n, m, 2) metres; None measures lengths along the grid. flip_diagonal : (n - 1, m - 1) bool.
    """
    n, m = points.shape[:2]
    index = np.arange(n * m).reshape(n, m)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    first, second = np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)
    if flip_diagonal is not None:
        flip = flip_diagonal[..., None]
        first, second = np.where(flip, np.stack([a, b, d], -1), first), np.where(flip, np.stack([b, c, d], -1), second)
    triangles = np.stack([first, second], axis=2).reshape(-1, 3)
    flat_uv = (grid_lengths(points) if uv is None else uv).reshape(-1, 2)
    return Part(material, points.reshape(-1, 3), triangles, flat_uv[triangles], crease_degrees=crease_degrees)


def grid_lengths(points: Array) -> Array:
    """(n, m, 2): the longest lengths of the grid lines up to each point, so that a texture is nowhere magnified."""
    along_n = np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1)
    along_m = np.linalg.norm(np.diff(points, axis=1), axis=2).max(axis=0)
    u = np.concatenate([[0.0], np.cumsum(along_n)])
    v = np.concatenate([[0.0], np.cumsum(along_m)])
    return np.stack(np.broadcast_arrays(u[:, None], -v[None, :]), axis=-1)


def lathe(
    profile: Sequence[tuple[float, float]] | Array, segments: int, material: str, crease_degrees: float = 50.0
) -> Part:
    """`profile` (k, 2) of (radius, y), upwards on the outside, turned about Y; closed when both ends have radius 0."""
    line = np.asarray(profile, dtype=np.float64)
    return turned(np.broadcast_to(line[None, :, 0], (segments + 1, len(line))), line[:, 1], material, crease_degrees)


def turned(radius: Array, height: Array, material: str, crease_degrees: float = 50.0) -> Part:
    """A lathe whose `radius` (n + 1, k) depends on the angle too, at `height` (k,). Row n must repeat row 0."""
    cosine, sine = circle(len(radius) - 1)
    y = np.broadcast_to(height, radius.shape)
    return grid(
        np.stack([radius * cosine[:, None], y, -radius * sine[:, None]], axis=-1),
        material,
        crease_degrees=crease_degrees,
    )


def box(material: str, size: tuple[float, float, float], center: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Part:
    """An axis-aligned box."""
    corner = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return Part(material, corner * size + center, fan(quads))


def fan(quads: Sequence[tuple[int, int, int, int]]) -> Array:
    """(2 * quads, 3) int64."""
    return np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))], dtype=np.int64)


def extrude(outline: Array, triangles: Array, depth: float, material: str) -> Part:
    """The flat mesh `outline` (V, 2), `triangles` (T, 3) counter-clockwise in the XY plane, `depth` thick."""
    count = len(outline)
    front = np.column_stack([outline, np.full(count, depth / 2)])
    back = np.column_stack([outline, np.full(count, -depth / 2)])
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    rim = edges[~np.isin(edges[:, 0] * count + edges[:, 1], edges[:, 1] * count + edges[:, 0])]
    start, end = rim[:, 0], rim[:, 1]
    sides = np.concatenate(
        [np.column_stack([start, start + count, end]), np.column_stack([end, start + count, end + count])]
    )
    return Part(material, np.concatenate([front, back]), np.concatenate([triangles, triangles[:, ::-1] + count, sides]))


def sphere(radius: float, segments: int, material: str, stretch: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Part:
    """A ball round the origin, or with `stretch` an ellipsoid, with exact normals."""
    rings = segments // 2
    latitude = np.linspace(-np.pi / 2, np.pi / 2, rings + 1)
    ring = np.cos(latitude)
    ring[[0, -1]] = 0.0
    cosine, sine = circle(segments)
    unit = np.stack(
        [cosine[:, None] * ring, np.broadcast_to(np.sin(latitude), (segments + 1, rings + 1)), -sine[:, None] * ring],
        axis=-1,
    )
    part = replace(grid(unit * radius, material), normals=unit.reshape(-1, 3))
    return part.placed(scaling(*stretch)) if stretch != (1.0, 1.0, 1.0) else part


def tube(path: Array, radius: Array | float, segments: int, material: str, closed: bool = False) -> Part:
    """A round tube along `path` (k, 3) with `radius` () or (k,); its ends are capped unless the path is closed."""
    tangent = np.gradient(path, axis=0) if not closed else np.roll(path, -1, 0) - np.roll(path, 1, 0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side, up = transported_frame(tangent)
    radii = np.broadcast_to(radius, (len(path),))
    if closed:
        side, up = untwisted(side, up, tangent)
        order = np.arange(len(path) + 1) % len(path)
        path, side, up, radii = path[order], side[order], up[order], radii[order]
    else:
        path, side, up = (np.concatenate([a[:1], a, a[-1:]]) for a in (path, side, up))
        radii = np.concatenate([[0.0], radii, [0.0]])
    cosine, sine = circle(segments)
    offset = side[None] * cosine[:, None, None] + up[None] * sine[:, None, None]
    return grid(path[None] + radii[None, :, None] * offset, material, crease_degrees=60.0)


def transported_frame(tangent: Array) -> tuple[Array, Array]:
    """Two unit vectors (k, 3) square to each unit `tangent` (k, 3), carried along without needless twist."""
    side = np.empty_like(tangent)
    helper = np.eye(3)[np.argmin(np.abs(tangent[0]))]
    previous = np.cross(tangent[0], helper)
    for row, direction in enumerate(tangent):
        previous = previous - direction * (previous @ direction)
        previous = previous / np.linalg.norm(previous)
        side[row] = previous
    return side, np.cross(tangent, side)


def untwisted(side: Array, up: Array, tangent: Array) -> tuple[Array, Array]:
    """The frames of a closed path, turned gradually so that the last one meets the first."""
    last = side[-1] - tangent[0] * (side[-1] @ tangent[0])
    gap = np.arctan2(last @ up[0], last @ side[0])
    angle = -gap * np.arange(len(side)) / len(side)
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return side * cosine + up * sine, up * cosine - side * sine


def arc_sweep(profile: Array, segments: int, material: str, start: float = np.pi, end: float = 0.0) -> Part:
    """`profile` (k, 2) of (radius, z), swept in the XY plane from angle `start` down to `end`.

    The profile is a closed loop, counter-clockwise with z to the right and radius up. The ends stay open: they stand on
    something.
    """
    angle = np.linspace(start, end, segments + 1)
    radius, z = profile[:, 0], profile[:, 1]
    shape = (segments + 1, len(profile))
    points = np.stack(
        [np.cos(angle)[:, None] * radius, np.sin(angle)[:, None] * radius, np.broadcast_to(z, shape)], axis=-1
    )
    return grid(points, material, crease_degrees=30.0)


def arched_outline(
    width: float, height: float, radius: float, spring: float, segments: int, sill: float = 0.0
) -> tuple[Array, Array]:
    """A flat wall with a round-arched opening: points (V, 2) and counter-clockwise triangles (T, 3).

    x from -width/2 to width/2, y from 0 to `height`; the opening is 2 `radius` wide from `sill` to `spring` and a half
    circle above. `sill` 0 opens it downwards.
    """
    angle = np.linspace(np.pi, 0.0, segments + 1)
    arc = np.column_stack([radius * np.cos(angle), spring + radius * np.sin(angle)])
    arc[0, 0], arc[-1, 0] = -radius, radius
    arc[[0, -1], 1] = spring
    strips = [np.stack([arc, np.column_stack([arc[:, 0], np.full(segments + 1, height)])], axis=1)]
    levels = sorted({0.0, sill, spring, height})
    for left, right in ((-width / 2, -radius), (radius, width / 2)):
        strips.append(np.array([[(left, y), (right, y)] for y in levels])[::-1])
    if sill > 0:
        strips.append(np.array([[(-radius, 0.0), (-radius, sill)], [(radius, 0.0), (radius, sill)]]))
    return weld_strips(strips)


def weld_strips(strips: Sequence[Array]) -> tuple[Array, Array]:
    """Ladders (k, 2, 2), rung after rung counter-clockwise, joined into points and triangles without doubles."""
    points: list[Array] = []
    triangles: list[Array] = []
    base = 0
    for strip in strips:
        count = len(strip)
        index = base + np.arange(2 * count).reshape(count, 2)
        a, b, c, d = index[:-1, 0], index[1:, 0], index[1:, 1], index[:-1, 1]
        triangles += [np.column_stack([a, b, c]), np.column_stack([a, c, d])]
        points.append(strip.reshape(-1, 2))
        base += 2 * count
    every = np.concatenate(points)
    kept, inverse = np.unique(np.round(every, 6), axis=0, return_inverse=True)
    merged = inverse.reshape(-1)[np.concatenate(triangles)]
    solid = (merged[:, 0] != merged[:, 1]) & (merged[:, 1] != merged[:, 2]) & (merged[:, 2] != merged[:, 0])
    return kept, merged[solid]


def prism(profile: Sequence[tuple[float, float]] | Array, length: float, material: str) -> Part:
    """A convex `profile` (k, 2) of (z, y), counter-clockwise with z to the right and y up, drawn out along X."""
    line = np.asarray(profile, dtype=np.float64)
    count = len(line)
    triangles = np.array([(0, i, i + 1) for i in range(1, count - 1)], dtype=np.int64)
    flat = extrude(line, triangles, length, material)
    return replace(
        flat, positions=np.column_stack([flat.positions[:, 2] * -1.0, flat.positions[:, 1], flat.positions[:, 0]])
    )


def smooth_path(points: Array, count: int) -> Array:
    """(count, 3): a Catmull-Rom curve through `points` (k, 3)."""
    padded = np.concatenate([2 * points[:1] - points[1:2], points, 2 * points[-1:] - points[-2:-1]])
    where = np.linspace(0, len(points) - 1, count)
    segment = np.minimum(where.astype(int), len(points) - 2)
    t = (where - segment)[:, None]
    a, b, c, d = (padded[segment + i] for i in range(4))
    return 0.5 * (2 * b + (c - a) * t + (2 * a - 5 * b + 4 * c - d) * t**2 + (3 * b - a - 3 * c + d) * t**3)
