"""Lights as one structured array in world space."""

from __future__ import annotations

import numpy as np

from phrt.scene import SceneLight

POINT, SPOT, DIRECTIONAL, SPHERE, RECT = 0, 1, 2, 3, 4
KINDS = {"point": POINT, "spot": SPOT, "directional": DIRECTIONAL, "sphere": SPHERE, "rect": RECT}

LIGHT_DTYPE = np.dtype(
    [
        ("kind", np.int32),
        ("casts_shadow", np.int32),
        ("position", np.float32, 3),
        ("direction", np.float32, 3),
        ("color", np.float32, 3),
        ("radius", np.float32),
        ("tan_half_angle", np.float32),
        ("half_u", np.float32, 3),
        ("half_v", np.float32, 3),
        ("cos_inner", np.float32),
        ("cos_outer", np.float32),
        ("inverse_range", np.float32),
    ]
)
"""direction: where the light shines to, unit. color: colour times intensity (candela, lux or nits by kind).
half_u, half_v: half the sides of a rect light, metres. radius: of sphere lights; tan_half_angle: of directional ones."""


def light_table(lights: list[SceneLight], world_from_node: np.ndarray) -> np.ndarray:
    """The table of `lights` at node matrices `world_from_node` (N, 4, 4)."""
    table = np.zeros(len(lights), dtype=LIGHT_DTYPE)
    for row, entry in enumerate(lights):
        light, matrix, record = entry.light, world_from_node[entry.node], table[row]
        axes = matrix[:3, :3] / np.maximum(np.linalg.norm(matrix[:3, :3], axis=0), 1e-12)
        scale = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))
        record["kind"] = KINDS[light.kind]
        record["casts_shadow"] = light.casts_shadow
        record["position"] = matrix[:3, 3]
        record["direction"] = -axes[:, 2]
        record["color"] = np.multiply(light.color, light.intensity)
        record["radius"] = light.radius * scale
        record["tan_half_angle"] = np.tan(light.angle / 2)
        record["half_u"] = matrix[:3, 0] * light.size[0] / 2
        record["half_v"] = matrix[:3, 1] * light.size[1] / 2
        record["cos_inner"] = np.cos(light.inner_angle)
        record["cos_outer"] = np.cos(light.outer_angle)
        record["inverse_range"] = 0.0 if not np.isfinite(light.range) else 1.0 / light.range
    return table
