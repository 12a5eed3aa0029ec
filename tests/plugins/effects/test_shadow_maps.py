"""Shadow maps, tile by tile: which tiles are found, which become stale, and when they are found again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scene_kit import LAMBERT, Stage, at, box, floor

import phrt
from phrt.camera import CameraView
from phrt.model import Track
from phrt_plugins.effects.cube_kernels import FRESH, TILE
from phrt_plugins.effects.cube_maps import face_views
from phrt_plugins.effects.shadow_maps import STALE, ShadowMaps, sun_view
from phrt_plugins.effects.shadows import Shadows
from phrt_plugins.effects.tiles import tile_texels, touched_tiles

SIZE = 100
"""Texels; no multiple of a tile."""
ACROSS = 4


def views() -> Iterator[object]:
    yield from face_views(np.array([0.3, -0.2, 0.1]), SIZE)
    yield sun_view(np.zeros(3), 4.0, np.array([0.0, -0.6, -0.8]), SIZE)[0]


def test_the_tiles_of_a_picture_have_every_texel_and_those_that_look_ups_between_four_need() -> None:
    found = np.zeros((SIZE, SIZE), int)
    for place in range(ACROSS**2):
        texels = tile_texels(place, ACROSS, SIZE)
        assert len(set(texels.tolist())) == len(texels)
        rows, columns = np.divmod(texels, SIZE)
        first, last = (place // ACROSS * TILE, place % ACROSS * TILE), (rows.max(), columns.max())
        assert (rows.min(), columns.min()) == first
        assert last == (min(first[0] + TILE, SIZE - 1), min(first[1] + TILE, SIZE - 1))
        found[rows, columns] += 1
    assert found.min() == 1
    assert (found == 1).mean() > 0.9


@pytest.mark.parametrize("view", list(views()))
def test_every_point_of_a_sphere_falls_into_tiles_that_it_touches(view: CameraView) -> None:
    rng, inside = np.random.default_rng(1), 0
    to_view, spheres = view.view_from_world(), []
    for _ in range(60):
        radius = rng.uniform(0.05, 1.0)
        spheres.append([*rng.uniform(-3, 3, 3), radius])
    for sphere in np.array(spheres):
        touched = np.zeros((ACROSS, ACROSS), bool)
        for _, top, bottom, left, right in touched_tiles(sphere[None], [view]):
            touched[top : bottom + 1, left : right + 1] = True
        directions = rng.normal(size=(500, 3))
        points = sphere[:3] + sphere[3] * directions / np.linalg.norm(directions, axis=1, keepdims=True)
        x, y, z = (points @ to_view[:3, :3].T + to_view[:3, 3]).T
        seen = -z > view.near
        scale = np.ones(len(z)) if view.orthographic else -z
        column = (x[seen] / scale[seen] / view.tan_half[0] * 0.5 + 0.5) * SIZE - 0.5
        row = (-y[seen] / scale[seen] / view.tan_half[1] * 0.5 + 0.5) * SIZE - 0.5
        ok = (column >= 0) & (row >= 0) & (column <= SIZE - 1) & (row <= SIZE - 1)
        # A look-up between texel n and the next one needs the tile of n.
        assert touched[row[ok].astype(int) // TILE, column[ok].astype(int) // TILE].all()
        inside += int(ok.sum())
        assert not touched.all() or sphere[3] > 0.3
    assert inside > 1000


def stage() -> Stage:
    """A box over a floor, and another one that moves to the right, a metre a second."""
    made = Stage(dome=(0.2, 0.2, 0.2)).add("/floor", floor(12))
    made.add("/still", box(0.5, 0.5, 0.5), LAMBERT, at(-1.5, 0.8, 0))
    made.add("/mover", box(0.5, 0.5, 0.5), LAMBERT, at(0.5, 0.8, 0))
    made.light("point", at(0, 3, 1), intensity=30.0).camera((0, 3, 5), (0, 0, 0), fov_y=0.8)
    node = made.scene.objects[2].node
    keys = np.array([[0.5, 0.8, 0.0], [2.5, 0.8, 0.0]], np.float32)
    made.scene.tracks.append(Track(node, "translation", np.array([0.0, 2.0]), keys))
    return made


def maps_of(renderer: phrt.Renderer) -> ShadowMaps:
    shadows = next(effect for effect in renderer.effects if isinstance(effect, Shadows))
    assert shadows._maps is not None
    return shadows._maps


def renderer(**options: object) -> phrt.Renderer:
    fixed = {"size": (96, 64), "gbuffer": "raycast", "threads": 2, "heuristic": "raster_only", "strict": True}
    return phrt.Renderer(stage().scene, **(fixed | options))


def fresh(time: float) -> np.ndarray:
    with renderer() as made:
        return made.render(time).layers["visibility"]


def test_only_tiles_that_are_looked_up_are_found() -> None:
    with renderer() as made:
        made.render(0.0)
        state = maps_of(made)._state.reshape(6, -1)
    assert (state == FRESH).any(axis=1).sum() < 6, "nothing visible is above the lamp"
    assert 0 < (state == FRESH).mean() < 0.5


def test_what_moved_makes_its_own_tiles_stale_and_they_are_found_again() -> None:
    with renderer() as made:
        made.render(0.0)
        maps = maps_of(made)
        maps._most_stale = 0
        before = (maps._state == FRESH).sum()
        held = made.render(0.1).layers["visibility"]
        stale = (maps._state == STALE).sum()
        maps._most_stale = 1000
        found = made.render(0.1).layers["visibility"]
    assert 0 < stale < before / 2
    assert np.abs(held - fresh(0.1)).max() > 0.5, "a frame that may find nothing shows what was there"
    np.testing.assert_array_equal(found, fresh(0.1))


def test_stale_tiles_are_found_a_few_at_a_time_the_oldest_first() -> None:
    with renderer() as made:
        made.render(0.0)
        maps = maps_of(made)
        maps._most_stale = 2
        made.render(0.1)
        left = [int((maps._state == STALE).sum())]
        oldest = maps._since[maps._state == STALE].min()
        for _ in range(40):
            made.render(0.1)
            left.append(int((maps._state == STALE).sum()))
        assert oldest == 1
    looked_at = left[-1]
    assert left[0] - left[1] == 2
    assert looked_at < left[0], "what nobody looks at may stay"
    assert left[-1] == left[-2]


def test_a_cut_in_time_forgets_everything() -> None:
    with renderer() as made:
        made.render(0.0)
        maps_of(made)._most_stale = 0
        after = made.render(1.5).layers["visibility"]
    np.testing.assert_array_equal(after, fresh(1.5))


def test_maps_are_the_same_for_one_thread_and_for_four() -> None:
    pictures = []
    for threads in (1, 4):
        with renderer(threads=threads) as made:
            pictures.append(made.render(0.3).layers["visibility"])
    np.testing.assert_array_equal(*pictures)


def test_shadows_in_maps_are_nearly_those_of_rays() -> None:
    """Beside what the filter blurs at edges: at most a pixel in twenty."""
    with renderer(heuristic="all_trace") as made:
        traced = made.render(0.0).layers["visibility"]
    assert (np.abs(traced - fresh(0.0)) > 0.3).mean() < 0.05
    assert 0.02 < (traced < 0.5).mean() < 0.5


def test_what_casts_no_shadow_is_not_in_a_map() -> None:
    made = stage()
    made.scene.objects[1] = replace(made.scene.objects[1], casts_shadow=False)
    made.scene.objects[2] = replace(made.scene.objects[2], casts_shadow=False)
    assert made.render((48, 32), heuristic="raster_only").layers["visibility"].min() == 1.0
