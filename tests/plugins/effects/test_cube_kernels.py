"""Look-ups in cube maps, against plain numpy twins."""

from __future__ import annotations

import numpy as np
import pytest
from kernel_kit import random_lights, random_materials, random_surfaces

from phrt.lights import DIRECTIONAL
from phrt_plugins.effects.cube_kernels import FRESH, shadow_map_lookup
from phrt_plugins.effects.cube_maps import face_views

SIZE = 16


def projected(point: np.ndarray) -> tuple[int, float, float, float]:
    """Face, picture coordinates -1..1 (right, down) and depth of a point as a light at the origin sees it, by the faces' views."""
    for face, view in enumerate(face_views(np.zeros(3), SIZE)):
        x, y, z, _ = view.view_from_world() @ np.append(point, 1.0)
        if -z >= np.abs(point).max() - 1e-9:
            return face, x / -z, -y / -z, -z
    raise AssertionError(point)


def share_twin(picture: np.ndarray, u: float, v: float, reference: float) -> float:
    """Of the four texels around u, v, bilinearly, those that are no nearer than `reference`."""
    column, row = (np.clip((c * 0.5 + 0.5) * SIZE - 0.5, 0, SIZE - 1) for c in (u, v))
    x, y = min(int(column), SIZE - 2), min(int(row), SIZE - 2)
    far = picture[y : y + 2, x : x + 2] >= reference
    across, down = np.array([1 - (column - x), column - x]), np.array([1 - (row - y), row - y])
    return float(down @ far @ across)


def lookup_twin(
    position: np.ndarray, normal: np.ndarray, light: np.ndarray, pictures: np.ndarray, m: np.ndarray
) -> float:
    if not light["casts_shadow"]:
        return 1.0
    if light["kind"] == DIRECTIONAL:
        texel = 2.0 / SIZE / np.linalg.norm(m[0, :3])
        u, v, depth, _ = m @ np.append(position + normal * texel, 1.0)
        return share_twin(pictures[0], u, -v, depth - texel / 2) if abs(u) < 1 and abs(v) < 1 else 1.0
    away = position - light["position"]
    texel = 2.0 * np.abs(away).max() / SIZE
    face, u, v, depth = projected(away + normal * texel * 1.5)
    return share_twin(pictures[face], u, v, depth - texel / 2)


@pytest.mark.parametrize("count", [1, 64, 777])
def test_shadow_maps_are_looked_up_as_the_twin_says(count: int) -> None:
    rng = np.random.default_rng(count)
    table, lights = random_materials(rng), random_lights(rng)
    points = random_surfaces(rng, count, table)
    maps = rng.uniform(0.0, 6.0, (len(lights), 6, SIZE, SIZE)).astype(np.float32)
    frames = rng.normal(0.0, 0.3, (len(lights), 4, 4)).astype(np.float32)
    frames[:, 3] = 0, 0, 0, 1
    direct = np.ones((count, len(lights), 3), np.float32)
    direct[rng.random((count, len(lights))) < 0.2] = 0
    rows = rng.permutation(count).astype(np.int32)
    out = np.full((count, len(lights)), np.nan, np.float32)
    state, wanted = np.full((len(lights), 6), FRESH, np.uint8), np.zeros((len(lights), 6), np.uint8)
    assert shadow_map_lookup(rows, points, direct, lights, maps, frames, state, wanted, out) == 0
    assert not wanted.any()
    wrong = 0
    for i, row in enumerate(rows):
        for k, light in enumerate(lights):
            dark = not direct[row, k].any()
            normal = points.geometric_normal[row].astype(float)
            expected = lookup_twin(points.position[row].astype(float), normal, light, maps[k], frames[k].astype(float))
            wrong += abs(out[i, k] - (1.0 if dark else expected)) > 2e-3
    # A point at the edge of a texel, or as far away as one, may fall on its other side in single precision.
    assert wrong <= 0.005 * count * len(lights)
    if count > 100:
        assert {DIRECTIONAL} < set(lights["kind"].tolist())
        assert 0.2 < out.mean() < 0.95


def test_tiles_that_are_not_fresh_are_asked_for_and_give_what_moved_the_benefit_of_the_doubt() -> None:
    rng = np.random.default_rng(3)
    table, lights = random_materials(rng), random_lights(rng)
    points = random_surfaces(rng, 500, table)
    maps = rng.uniform(0.0, 6.0, (len(lights), 6, SIZE, SIZE)).astype(np.float32)
    frames = np.tile(np.eye(4, dtype=np.float32) * 0.2, (len(lights), 1, 1))
    direct, rows = np.ones((500, len(lights), 3), np.float32), np.arange(500, dtype=np.int32)
    shares = []
    for state in (FRESH, 2):
        wanted, out = np.zeros((len(lights), 6), np.uint8), np.empty((500, len(lights)), np.float32)
        unfound = shadow_map_lookup(
            rows, points, direct, lights, maps, frames, np.full((len(lights), 6), state, np.uint8), wanted, out
        )
        casting = lights["casts_shadow"] != 0
        assert unfound == (0 if state == FRESH else 500 * casting.sum())
        assert (wanted.any(axis=1) == (casting & (state != FRESH))).all()
        shares.append(out)
    assert (shares[1] >= shares[0]).all()
    assert (shares[1] > shares[0]).any()
