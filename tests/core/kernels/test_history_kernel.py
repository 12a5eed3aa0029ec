"""Finding earlier values, taking them over and forgetting them, against plain Python twins."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from kernel_kit import unit

from phrt.camera import CameraView, look_at
from phrt.kernels.history import (
    NORMALS_AGREE,
    OFF_PLANE,
    REACH,
    STEP,
    carry,
    choose_values,
    forget_crossed,
    history_of_units,
    match_pixels,
)

WIDTH, HEIGHT = 48, 32
COUNT = WIDTH * HEIGHT
TRACED, HISTORY, NONE = 2, 4, 0


def view_from(x: float, y: float = 1.5, z: float = 4.0, *, orthographic: bool = False) -> CameraView:
    return CameraView(WIDTH, HEIGHT, look_at((x, y, z), (x * 0.8, 0.0, 0.0)), (1.2, 0.8), orthographic)


def picture(view: CameraView) -> dict[str, np.ndarray]:
    """A floor (object 1, two materials) and a ball (object 2) above it, as G-buffer arrays; the sky is object 0."""
    row, column = np.divmod(np.arange(COUNT), WIDTH)
    x = ((column + 0.5) / WIDTH * 2 - 1) * view.tan_half[0]
    y = (1 - (row + 0.5) / HEIGHT * 2) * view.tan_half[1]
    turn, place = view.world_from_view[:3, :3], view.world_from_view[:3, 3]
    if view.orthographic:
        origin = np.stack([x, y, np.zeros(COUNT)], 1) @ turn.T + place
        direction = np.broadcast_to(-turn[:, 2], (COUNT, 3))
    else:
        origin = np.broadcast_to(place, (COUNT, 3))
        direction = unit(np.stack([x, y, -np.ones(COUNT)], 1) @ turn.T)
    centre, radius = np.array([0.2, 0.6, 0.5]), 0.5
    to = origin - centre
    half = (to * direction).sum(1)
    inside = half**2 - (to * to).sum(1) + radius**2
    with np.errstate(divide="ignore", invalid="ignore"):
        ball = np.where(inside > 0, -half - np.sqrt(np.maximum(inside, 0)), np.inf)
        floor = np.where(direction[:, 1] < 0, -origin[:, 1] / direction[:, 1], np.inf)
    t = np.minimum(ball, floor)
    seen = np.isfinite(t) & (t < 12)
    position = origin + direction * np.where(seen, t, 0)[:, None]
    on_ball = seen & (ball < floor)
    normal = np.where(on_ball[:, None], (position - centre) / radius, [0.0, 1.0, 0.0])
    depth = -((position - place) @ turn)[:, 2]
    return {
        "object_id": np.where(on_ball, 2, np.where(seen, 1, 0)).astype(np.uint32),
        "material_id": np.where(~on_ball & (position[:, 0] > 1.0), 2, 1).astype(np.uint32),
        "position": position.astype(np.float32),
        "normal": normal.astype(np.float32),
        "depth": np.where(seen, depth, np.inf).astype(np.float32),
    }


def footprint_of(view: CameraView) -> np.ndarray:
    return np.array([view.pixel_spread, 0] if view.orthographic else [0, view.pixel_spread], np.float32)


def eye_of(view: CameraView) -> np.ndarray:
    matrix = view.world_from_view
    return np.array([*matrix[:3, 2], 0] if view.orthographic else [*matrix[:3, 3], 1], np.float32)


def matched(now: CameraView, then: CameraView, moved: tuple[int, ...] = ()) -> tuple[np.ndarray, np.ndarray]:
    """source and slip of the picture `now`, seen `then` before."""
    here, past = picture(now), picture(then)
    source, slip = np.full(COUNT, 99, np.int32), np.full((COUNT, 2), np.nan, np.float32)
    flags = np.zeros(3, np.uint8)
    flags[list(moved)] = 1
    match_pixels(
        0, COUNT, here["object_id"], here["material_id"], here["position"], here["normal"], here["depth"],
        past["object_id"], past["material_id"], past["position"], past["normal"],
        then.clip_from_world().astype(np.float32), WIDTH, HEIGHT, footprint_of(now), eye_of(now), flags, source, slip,
    )  # fmt: skip
    return source, slip


def agrees(i: int, j: int, here: dict[str, Any], past: dict[str, Any], view: CameraView) -> bool:
    """Is pixel j of the picture before on the surface at pixel i?"""
    for name in ("object_id", "material_id"):
        if here[name][i] != past[name][j]:
            return False
    normal = here["normal"][i].astype(float)
    width = footprint_of(view) @ [1, here["depth"][i]]
    off = abs(normal @ (past["position"][j].astype(float) - here["position"][i]))
    return bool(normal @ past["normal"][j] >= NORMALS_AGREE and off <= OFF_PLANE * width + 1e-5)


@pytest.mark.parametrize("orthographic", [False, True])
def test_points_are_found_where_they_were_seen_before(orthographic: bool) -> None:
    now, then = view_from(0.5, orthographic=orthographic), view_from(0.3, 1.4, 4.3, orthographic=orthographic)
    source, slip = matched(now, then)
    here, past = picture(now), picture(then)
    found = np.flatnonzero(source >= 0)
    assert len(found) > COUNT / 3
    clip = np.concatenate([here["position"].astype(float), np.ones((COUNT, 1))], 1) @ then.clip_from_world().T
    u = (clip[:, 0] / clip[:, 3] + 1) / 2 * WIDTH
    v = (1 - clip[:, 1] / clip[:, 3]) / 2 * HEIGHT
    expected = np.stack([u - source % WIDTH - 0.5, v - source // WIDTH - 0.5], 1)
    np.testing.assert_allclose(slip[found], expected[found], atol=1e-3)
    # In the pixel that it fell into, unless that shows something else.
    assert np.abs(slip[found]).max() <= 1.0
    inside = (u > 0) & (v > 0) & (u < WIDTH) & (v < HEIGHT)
    beside = found[(np.abs(slip[found]).max(axis=1) > 0.501) & inside[found]]
    fell = (v[beside].astype(int) * WIDTH + u[beside].astype(int)).astype(int)
    assert not any(agrees(i, j, here, past, now) for i, j in zip(beside, fell, strict=True))
    assert all(agrees(i, source[i], here, past, now) for i in found)
    # And those not found could not be.
    for i in np.flatnonzero((source < 0) & (here["object_id"] > 0)):
        if 0.1 < u[i] < WIDTH - 0.1 and 0.1 < v[i] < HEIGHT - 0.1:
            assert not agrees(i, int(v[i]) * WIDTH + int(u[i]), here, past, now)


def test_nothing_is_found_of_the_sky_of_moved_objects_and_behind_the_earlier_eye() -> None:
    view = view_from(0.0)
    source, slip = matched(view, view)
    ids = picture(view)["object_id"]
    np.testing.assert_array_equal(source, np.where(ids > 0, np.arange(COUNT), -1))
    np.testing.assert_allclose(slip[ids > 0], 0.0, atol=2e-3)
    source, _ = matched(view, view, moved=(2,))
    np.testing.assert_array_equal(source >= 0, ids == 1)
    away = CameraView(WIDTH, HEIGHT, look_at((0, 1.5, 4), (0, 3, 8)), (1.2, 0.8))
    assert (matched(view, away)[0] == -1).all()


def chosen_twin(i: int, source: np.ndarray, slip: np.ndarray, mask: np.ndarray, offset: np.ndarray, same: Any) -> float:
    """Distance in pixels of the nearest value among the four pixels around the point; inf when there is none."""
    best = np.inf
    for dy in (0, 1 if slip[i, 1] >= 0 else -1):
        for dx in (0, 1 if slip[i, 0] >= 0 else -1):
            x, y = source[i] % WIDTH + dx, source[i] // WIDTH + dy
            j = y * WIDTH + x
            if not (0 <= x < WIDTH and 0 <= y < HEIGHT) or mask[j] not in (TRACED, HISTORY) or not same(i, j):
                continue
            aside = np.array([dx, dy]) - slip[i] + (offset[j] * float(STEP) if mask[j] == HISTORY else 0)
            best = min(best, float(np.hypot(*aside)))
    return best


def choose(now: CameraView, then: CameraView, mask: np.ndarray, offset: np.ndarray, applies: Any = (1, 1, 1)) -> Any:
    here, past = picture(now), picture(then)
    source, slip = matched(now, then)
    chosen, aside = np.full(COUNT, 99, np.int32), np.zeros((COUNT, 2), np.int8)
    choose_values(
        0, COUNT, source, slip, here["object_id"], here["material_id"], here["position"], here["normal"], here["depth"],
        past["object_id"], past["material_id"], past["position"], past["normal"], WIDTH, footprint_of(now),
        np.array(applies, bool), TRACED, HISTORY, mask, offset, chosen, aside,
    )  # fmt: skip
    return source, slip, chosen, aside


@pytest.mark.parametrize("density", [1.0, 0.6, 0.1])
def test_the_value_traced_nearest_is_chosen(density: float) -> None:
    rng = np.random.default_rng(4)
    now, then = view_from(0.5), view_from(0.45, 1.5, 4.05)
    mask = np.where(rng.random(COUNT) < density, rng.choice([TRACED, HISTORY], COUNT), rng.choice([0, 1, 3], COUNT))
    offset = rng.integers(-40, 41, (COUNT, 2)).astype(np.int8)
    source, slip, chosen, aside = choose(now, then, mask.astype(np.uint8), offset)
    here, past = picture(now), picture(then)
    gap = 0
    for i in np.flatnonzero(source >= 0):
        nearest = chosen_twin(i, source, slip, mask, offset, lambda i, j: agrees(i, j, here, past, now))
        if chosen[i] < 0:
            gap += 1
            assert nearest > REACH - 1e-3
            continue
        j, distance = chosen[i], np.hypot(*(aside[i] * float(STEP)))
        assert agrees(i, j, here, past, now)
        own = np.array([j % WIDTH - source[i] % WIDTH, j // WIDTH - source[i] // WIDTH]) - slip[i]
        own = own + (offset[j] * float(STEP) if mask[j] == HISTORY else 0)
        np.testing.assert_allclose(aside[i] * float(STEP), own, atol=float(STEP) * 0.51)
        # The very nearest, or one that is near enough.
        assert distance <= max(nearest, float(REACH)) + 2 * float(STEP)
    assert (gap < 0.01 * COUNT) == (density == 1.0)
    assert (chosen[source < 0] == -1).all()


def test_nothing_is_chosen_where_the_effect_does_not_apply() -> None:
    view = view_from(0.5)
    mask, offset = np.full(COUNT, TRACED, np.uint8), np.zeros((COUNT, 2), np.int8)
    _, _, chosen, _ = choose(view, view, mask, offset, applies=(1, 0, 1))
    here = picture(view)
    np.testing.assert_array_equal(chosen >= 0, (here["material_id"] == 2) & (here["object_id"] > 0))


def carried(**changes: Any) -> dict[str, Any]:
    """`carry` of four pixels from pixels 3, 2, -1 and 0, of two lights; `changes` replace arguments."""
    rng = np.random.default_rng(6)
    values: dict[str, Any] = {
        "chosen": np.array([3, 2, -1, 0], np.int32),
        "position": np.zeros((4, 3), np.float32),
        "roughness": np.zeros(4, np.float32),
        "first_light": -1,
        "direct": np.ones((4, 2, 3), np.float32),
        "past_direct": np.ones((4, 2, 3), np.float32),
        "eyes": np.array([[0, 0, 1, 1]] * 9, np.float32),
        "parallax": np.float32(np.inf),
        "max_age": 255,
        "traced": TRACED,
        "history": HISTORY,
        "past_layer": rng.random((4, 2)).astype(np.float32),
        "past_mask": np.array([TRACED, NONE, HISTORY, HISTORY], np.uint8),
        "past_age": np.array([77, 0, 5, 255], np.uint8),
        "layer": np.full((4, 2), -1.0, np.float32),
        "mask": np.zeros(4, np.uint8),
        "age": np.zeros(4, np.uint8),
    } | changes
    values["taken"] = carry(0, 4, *values.values())
    return values


def test_values_are_copied_and_their_age_counts_up() -> None:
    out = carried()
    assert out["taken"] == 3
    np.testing.assert_array_equal(out["mask"], [HISTORY, HISTORY, NONE, HISTORY])
    np.testing.assert_array_equal(out["layer"][[0, 1, 3]], out["past_layer"][[3, 2, 0]])
    np.testing.assert_array_equal(out["layer"][2], -1.0)
    np.testing.assert_array_equal(out["age"][[0, 1, 3]], [255, 6, 1])


def test_values_that_are_too_old_are_dropped() -> None:
    np.testing.assert_array_equal(carried(max_age=5)["mask"], [NONE, NONE, NONE, HISTORY])
    np.testing.assert_array_equal(carried(max_age=6)["mask"], [NONE, HISTORY, NONE, HISTORY])


@pytest.mark.parametrize("kind", [1.0, 0.0])
def test_values_are_dropped_when_the_eye_has_gone_round_too_far(kind: float) -> None:
    """6 frames ago the eye was 0.1 rad to the side, 1 frame ago 0.02."""
    eyes = np.zeros((9, 4), np.float32)
    angle = np.array([0.0, 0.02, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0])
    eyes[:, 0], eyes[:, 2], eyes[:, 3] = np.sin(angle), np.cos(angle), kind
    for limit, expected in ((0.019, [0, 0]), (0.021, [0, 1]), (0.099, [0, 1]), (0.101, [1, 1])):
        out = carried(eyes=eyes, parallax=np.float32(limit), max_age=250)
        np.testing.assert_array_equal(out["mask"][[1, 3]] == HISTORY, expected)
    # A glossy surface is granted the width of its lobe: roughness 0.3 is alpha 0.09.
    out = carried(eyes=eyes, parallax=np.float32(0.02), max_age=250, roughness=np.full(4, 0.3, np.float32))
    np.testing.assert_array_equal(out["mask"][[1, 3]] == HISTORY, [1, 1])


def test_a_shadow_that_was_never_traced_is_not_taken_over() -> None:
    """Light 1 did not arrive at pixel 0 before: its 1 there says nothing. It does arrive at pixel 3 now, and not at others."""
    past_direct, past_layer = np.ones((4, 2, 3), np.float32), np.ones((4, 2), np.float32)
    past_direct[0, 1] = 0
    changes: dict[str, Any] = {"past_direct": past_direct, "past_layer": past_layer, "first_light": 0}
    np.testing.assert_array_equal(carried(**changes)["mask"], [HISTORY, HISTORY, NONE, NONE])
    direct = np.ones((4, 2, 3), np.float32)
    direct[3, 1] = 0
    np.testing.assert_array_equal(carried(direct=direct, **changes)["mask"], [HISTORY, HISTORY, NONE, HISTORY])


# --- what moved -----------------------------------------------------------------------------------------------------


def forget(ends: Any, spheres: Any, view: CameraView | None = None) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Which pixels of the picture lose their value, (COUNT,) bool, when everything had one."""
    view = view or view_from(0.0)
    here = picture(view)
    mask = np.where(here["object_id"] > 0, HISTORY, NONE).astype(np.uint8)
    before, layer = mask.copy(), np.zeros((COUNT, 2), np.float32)
    eye = np.array([*view.world_from_view[:3, 3], 1.0], np.float32)
    number = forget_crossed(
        0, COUNT, WIDTH, here["position"], here["normal"], here["depth"], footprint_of(view), eye,
        np.array(ends, np.float32), np.array(spheres, np.float32), HISTORY, NONE, np.float32(1.0), layer, mask,
    )  # fmt: skip
    lost = mask != before
    assert number == lost.sum()
    np.testing.assert_array_equal(layer, np.where(lost, 1.0, 0.0)[:, None] * [1, 1])
    return lost, here


def slack(here: dict[str, np.ndarray]) -> np.ndarray:
    """(COUNT,) metres along the surface from pixel to pixel of `forget`'s default view: values may be from so far aside."""
    view = view_from(0.0)
    seen = here["object_id"] > 0
    to_eye = np.where(seen[:, None], view.position - here["position"], 1.0)
    cosine = np.abs((unit(to_eye) * here["normal"]).sum(axis=1))
    width = view.pixel_spread * np.where(seen, here["depth"], 1.0)
    return np.asarray(width / np.maximum(cosine, 0.05))


def distance_to_way(position: np.ndarray, target: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """(n,) of `centre` from the ways position (n, 3) -> target (n, 3), looked at closely."""
    s = np.linspace(0, 1, 400)[:, None, None]
    return np.asarray(np.linalg.norm(position + s * (target - position) - centre, axis=2).min(axis=0))


SPHERES = np.array([[0.3, 1.2, 0.4, 0.3], [-1.0, 0.5, 1.0, 0.2]])
LAMPS = np.array([[2.0, 3.0, 1.0], [-3.0, 2.0, 2.0]])


def test_points_lose_their_value_where_something_moved_between_them_and_a_light() -> None:
    lost, here = forget([[*lamp, 1, 0] for lamp in LAMPS], SPHERES)
    position = here["position"].astype(float)
    gap = np.array(
        [distance_to_way(position, np.broadcast_to(a, position.shape), s[:3]) - s[3] for a in LAMPS for s in SPHERES]
    ).min(axis=0)
    seen = here["object_id"] > 0
    assert lost[seen & (gap <= 0)].all()
    assert not lost[seen & (gap > slack(here) + 0.01)].any()
    assert 0.05 < lost[seen].mean() < 0.7


@pytest.mark.parametrize("kind", ["sphere", "sun"])
def test_every_way_to_a_light_with_an_extent_counts(kind: str) -> None:
    rng = np.random.default_rng(8)
    view = view_from(0.0)
    sphere = np.array([[0.3, 1.6, 0.4, 0.25]])
    if kind == "sphere":
        lamp, extent = np.array([1.0, 3.0, 1.0]), 0.5
        lost, here = forget([[*lamp, 1, extent]], sphere, view)
    else:
        lamp, extent = unit(np.array([0.3, 1.0, 0.2])), 0.2
        lost, here = forget([[*lamp, 0, extent]], sphere, view)
    seen = np.flatnonzero(here["object_id"] > 0)
    position = here["position"][seen].astype(float)
    gap = np.full(len(seen), np.inf)
    for _ in range(60):
        aside = unit(rng.normal(size=3)) * extent
        target = np.broadcast_to(lamp + aside, position.shape) if kind == "sphere" else position + 9 * (lamp + aside)
        gap = np.minimum(gap, distance_to_way(position, target, sphere[0, :3]) - sphere[0, 3])
    assert lost[seen[gap <= 0]].all()
    assert not lost[seen[gap > slack(here)[seen] + 0.3]].any()
    # The extent matters: without it fewer points lose theirs.
    narrow, _ = forget([[*lamp, int(kind == "sphere"), 0.0]], sphere, view)
    assert narrow.sum() < lost.sum()
    assert not lost.all()


def test_a_sphere_behind_the_point_or_behind_the_light_does_not_count() -> None:
    lamp, sun = [0.0, 2.0, 0.0, 1, 0.0], [0.0, 1.0, 0.0, 0, 0.0]
    near = slack(picture(view_from(0.0))) < 0.5
    assert not forget([lamp], [[0, 5.0, 0, 1.0]])[0][near].any()
    assert not forget([lamp], [[0, -2.0, 0, 1.0]])[0][near].any()
    assert not forget([sun], [[0, -2.0, 0, 1.0]])[0][near].any()
    assert forget([sun], [[0, 5.0, 0, 1.0]])[0][near].any()


def test_points_lose_their_value_within_a_radius_of_what_moved() -> None:
    lost, here = forget([[0, 0, 0, -1, 0.6]], SPHERES)
    gap = np.linalg.norm(here["position"][:, None] - SPHERES[None, :, :3], axis=2) - SPHERES[:, 3] - 0.6
    seen = here["object_id"] > 0
    assert lost[seen & (gap.min(axis=1) <= 0)].all()
    assert not lost[seen & (gap.min(axis=1) > slack(here) + 1e-3)].any()
    assert lost.any()


def test_units_are_told_what_stands_in_for_them() -> None:
    rng = np.random.default_rng(5)
    mask = rng.choice([NONE, TRACED, HISTORY], 60).astype(np.uint8)
    age = rng.integers(1, 200, 60).astype(np.uint8)
    pixels = rng.permutation(60).astype(np.int32)
    first, count = np.array([0, 20, 55], np.int64), np.array([20, 35, 0], np.int32)
    held, age_sum = np.empty(3, np.int32), np.empty(3)
    history_of_units(pixels, first, count, mask, age, HISTORY, held, age_sum)
    for unit_ in range(3):
        mine = pixels[first[unit_] : first[unit_] + count[unit_]]
        stands_in = mask[mine] == HISTORY
        assert held[unit_] == stands_in.sum()
        assert age_sum[unit_] == age[mine][stands_in].sum()
    assert held[0] > 0
