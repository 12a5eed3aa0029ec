"""Triangles in a binary PLY file, the least that Mitsuba reads. All its variants read it, and none needs Dr.Jit's arrays for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np


def write_ply(
    path: Path,
    positions: np.ndarray,
    triangles: np.ndarray,
    normals: np.ndarray | None = None,
    uv: np.ndarray | None = None,
) -> None:
    """positions, normals (n, 3); uv (n, 2); triangles (m, 3), rows of these."""
    columns, names = [positions], ["x", "y", "z"]
    if normals is not None:
        columns, names = [*columns, normals], [*names, "nx", "ny", "nz"]
    if uv is not None:
        columns, names = [*columns, uv], [*names, "u", "v"]
    vertices = np.concatenate(columns, axis=1).astype("<f4")
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    head += [f"property float {name}" for name in names]
    head += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header", ""]
    faces = np.empty(len(triangles), [("count", "u1"), ("corner", "<i4", 3)])
    faces["count"], faces["corner"] = 3, triangles
    path.write_bytes("\n".join(head).encode() + vertices.tobytes() + faces.tobytes())
