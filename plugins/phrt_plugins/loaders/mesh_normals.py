"""Normals per corner: the file's own, else area-weighted over the faces that meet within the crease angle."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from phrt_plugins.loaders.options import MeshOptions

if TYPE_CHECKING:
    from phrt_plugins.loaders.mesh_soup import Soup

MAX_FAN = 512
"""Faces around one vertex up to which every pair is compared; above, the vertex is smooth."""


def corner_normals(soup: Soup, options: MeshOptions, warn: Callable[[str], None]) -> tuple[np.ndarray, np.ndarray]:
    """(M, 3) float64 unit normals and (T, 3) int64 which one a corner has."""
    count = len(soup.triangles)
    if options.normals == "flat":
        return flat_normals(soup)[0], np.repeat(np.arange(count)[:, None], 3, axis=1)
    given = soup.normals if options.normals == "auto" and soup.normals is not None and len(soup.normals) else None
    if given is None or soup.normal_index is None:
        return smooth_normals(soup, options)
    length = np.linalg.norm(given, axis=1)
    usable = np.isfinite(length) & (length > 1e-20)
    missing = (soup.normal_index < 0) | ~usable[soup.normal_index]
    unit = np.where(usable[:, None], given, 0.0) / np.where(usable, length, 1.0)[:, None]
    if not missing.any():
        return unit, soup.normal_index
    broken = int((missing & (soup.normal_index >= 0)).sum())
    if broken:
        warn(f"{broken} of {3 * count} normals are zero or not finite and were computed")
    made, made_index = smooth_normals(soup, options)
    return np.vstack([unit, made]), np.where(missing, made_index + len(unit), soup.normal_index)


def flat_normals(soup: Soup) -> tuple[np.ndarray, np.ndarray]:
    """(T, 3) unit normals of the triangles, and (T, 3) the same times twice their area."""
    a, b, c = (soup.positions[soup.triangles[:, k]] for k in range(3))
    weighted = np.cross(b - a, c - a)
    return weighted / np.maximum(np.linalg.norm(weighted, axis=1), 1e-300)[:, None], weighted


def smooth_normals(soup: Soup, options: MeshOptions) -> tuple[np.ndarray, np.ndarray]:
    """Area-weighted normals across every vertex where all faces agree within the crease angle, and per corner where
    they do not. Vertices at one place count as one when `weld` is set; smoothing groups stay apart; group 0 is flat."""
    face, weighted = flat_normals(soup)
    place = weld(soup.positions) if options.weld else np.arange(len(soup.positions))
    spot = place[soup.triangles]
    low, high = int(soup.smoothing.min()), int(soup.smoothing.max())
    if low != high:
        group = np.unique(soup.smoothing, return_inverse=True)[1].reshape(-1)
        spot = np.unique(spot * (int(group.max()) + 1) + group[:, None], return_inverse=True)[1].reshape(-1, 3)
    corner_spot = spot.reshape(-1)
    spots = int(corner_spot.max()) + 1
    corner_face = np.repeat(np.arange(len(face)), 3)
    sums = np.stack(
        [np.bincount(corner_spot, weights=weighted[corner_face, k], minlength=spots) for k in range(3)], axis=1
    )
    mean = _unit(sums)

    # Every pair is within the crease angle when every face is within half of it from the mean: most vertices.
    agreement = np.einsum("ij,ij->i", face[corner_face], mean[corner_spot])
    half, whole = np.cos(np.radians(options.crease_angle) / 2), np.cos(np.radians(options.crease_angle))
    creased: np.ndarray = np.zeros(spots, dtype=bool)
    creased[corner_spot[agreement < half]] = True
    creased &= np.bincount(corner_spot, minlength=spots) <= MAX_FAN
    if options.crease_angle >= 180.0:
        creased[:] = False
    flat_corner = np.repeat(soup.smoothing == 0, 3)
    creased_corner = np.flatnonzero(creased.take(corner_spot) & ~flat_corner)
    index = corner_spot.astype(np.int64)
    if len(creased_corner):
        made, which = _creased(corner_spot, corner_face, creased_corner, face, weighted, whole)
        index[creased_corner] = len(mean) + which
        mean = np.vstack([mean, made])
    if flat_corner.any():
        index[flat_corner] = len(mean) + corner_face[flat_corner]
        mean = np.vstack([mean, face])
    # A vertex whose faces cancel out (a two-sided sheet) keeps each face's own normal.
    lost = (mean == 0.0).all(axis=1)[index]
    if lost.any():
        index[lost] = len(mean) + corner_face[lost]
        mean = np.vstack([mean, face])
    return mean, index.reshape(-1, 3)


def _creased(
    corner_spot: np.ndarray,
    corner_face: np.ndarray,
    corners: np.ndarray,
    face: np.ndarray,
    weighted: np.ndarray,
    least_cosine: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Normals at `corners` (n,): for each the sum over the faces at its spot that lie within the crease angle of its
    own. Returns distinct normals (m, 3) and (n,) which one each corner has."""
    order = corners[np.argsort(corner_spot[corners], kind="stable")]
    _, start, size = np.unique(corner_spot[order], return_index=True, return_counts=True)
    # Every ordered pair (left, right) of corners at one spot.
    start, size = np.repeat(start, size), np.repeat(size, size)
    left = np.repeat(np.arange(len(order)), size)
    right = np.arange(len(left)) - np.repeat(np.cumsum(size) - size, size) + np.repeat(start, size)
    left_face, right_face = corner_face[order[left]], corner_face[order[right]]
    together = np.einsum("ij,ij->i", face[left_face], face[right_face]) >= least_cosine
    together |= left_face == right_face
    left, right_face = left[together], right_face[together]
    sums = np.stack(
        [np.bincount(left, weights=weighted[right_face, k], minlength=len(order)) for k in range(3)], axis=1
    )
    # Corners that saw the same faces have bit-equal sums: they share one vertex.
    normals = _unit(sums)
    distinct, which = np.unique(np.column_stack([corner_spot[order], normals]), axis=0, return_inverse=True)
    result = np.empty(len(order), dtype=np.int64)
    result[np.searchsorted(corners, order)] = which.reshape(-1)
    return distinct[:, 1:], result


def _unit(vectors: np.ndarray) -> np.ndarray:
    """`vectors` (n, 3) at unit length; zero where they have (nearly) none."""
    length = np.linalg.norm(vectors, axis=1)
    return np.where(length[:, None] > 1e-300, vectors / np.maximum(length, 1e-300)[:, None], 0.0)


def weld(positions: np.ndarray) -> np.ndarray:
    """(V,) int64: vertices at exactly one place (as float32) get one number."""
    # Unused vertices may be anything, infinite as float32 included.
    with np.errstate(over="ignore", invalid="ignore"):
        exact = np.ascontiguousarray(positions + 0.0, dtype=np.float32)
    order = np.lexsort(exact.T)
    ordered = exact[order]
    new = np.empty(len(ordered), dtype=bool)
    new[:1] = False
    new[1:] = (ordered[1:] != ordered[:-1]).any(axis=1)
    place = np.empty(len(ordered), dtype=np.int64)
    place[order] = np.cumsum(new)
    return place
