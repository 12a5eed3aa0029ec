"""No ghosts: an earlier value stands in only where full tracing would give the same, whatever moves. Mutants must show them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from history_kit import Move, ghosts, kept_share, run, walking, yard
from scene_kit import at, turned

import phrt
import phrt.history
from phrt.camera import CameraView, look_at
from phrt.frame import MASK_HISTORY, FrameResult
from phrt.model import Track
from phrt.movers import BoundingSpheres
from phrt.scene import Scene

FRAMES = 8


def placed(matrix: Any) -> Move:
    """`matrix(k)` is where the box stands in frame k."""
    return lambda renderer, k: renderer.move("/mover", matrix(k))


MOVES: dict[str, Move] = {
    "slides": placed(lambda k: at(-0.8 + 0.12 * k, 0.9, 0.0)),
    "rises": placed(lambda k: at(-0.8, 0.9 + 0.15 * k, 0.0)),
    "turns": placed(lambda k: at(-0.8, 0.9, 0.0) @ turned("y", 11.0 * k)),
    "grows": placed(lambda k: at(-0.8, 0.9, 0.0) @ np.diag([1 + 0.1 * k, 1.0, 1 + 0.1 * k, 1.0])),
    "jumps": placed(lambda k: at(-0.8 if k % 2 else 0.9, 0.6, 0.3)),
    "moves once": placed(lambda k: at(-0.8 if k < 3 else 0.4, 0.9, 0.0)),
}


def strangers(pairs: list[tuple[FrameResult, FrameResult]], layer: str, **limits: Any) -> int:
    return sum(int(ghosts(frame, truth, layer, **limits).sum()) for frame, truth in pairs)


@pytest.mark.parametrize("walks", [False, True])
@pytest.mark.parametrize("name", MOVES)
def test_nothing_that_moved_leaves_a_shadow_behind(name: str, walks: bool) -> None:
    pairs = run(yard(), FRAMES, traced=(0, 4), move=MOVES[name], view=walking() if walks else None)
    assert strangers(pairs, "visibility") == 0
    # Noise of 64 samples; what a box keeps away from a floor beneath it is far more.
    assert strangers(pairs, "ambient_occlusion", tolerance=0.25) == 0
    # It is not for want of earlier values: far from the box they stand.
    assert kept_share(pairs[3][0], "visibility") > 0.3
    assert kept_share(pairs[3][0], "ambient_occlusion") > 0.5
    moved = [k for k in range(1, FRAMES) if name != "moves once" or k == 3]
    assert not any((pairs[k][0].masks["reflection"] == MASK_HISTORY).any() for k in moved)


def animated(node: str) -> Scene:
    """The yard; the box or the first lamp moves by the scene's own animation."""
    scene = yard()
    index = next(i for i, entry in enumerate(scene.nodes) if entry.path == node)
    place = scene.nodes[index].matrix[:3, 3]
    track = Track(index, "translation", np.array([0.0, 1.0]), np.array([place, place + np.array([1.2, 0.0, 0.4])]))
    scene.tracks = [track]
    return scene


def test_a_moving_light_leaves_no_shadow_behind() -> None:
    pairs = run(animated("/light0"), FRAMES, traced=(0, 4))
    for k in (1, 2, 3, 5, 6, 7):
        assert not (pairs[k][0].masks["visibility"] == MASK_HISTORY).any()
        assert not (pairs[k][0].masks["reflection"] == MASK_HISTORY).any()
        # What does not depend on lights is kept.
        assert kept_share(pairs[k][0], "ambient_occlusion") > 0.7


def test_an_animated_object_leaves_no_shadow_behind() -> None:
    pairs = run(animated("/mover"), FRAMES, traced=(0, 4), view=walking())
    assert strangers(pairs, "visibility") == 0
    assert strangers(pairs, "ambient_occlusion", tolerance=0.25) == 0
    assert kept_share(pairs[3][0], "visibility") > 0.3


def test_a_fast_turn_leaves_nothing_behind() -> None:
    def view(k: int) -> CameraView:
        angle = np.radians(28.0 * k)
        eye = (0.3, 1.6, 1.8)
        return CameraView(120, 80, look_at(eye, (0.3 + np.sin(angle), 1.2, 1.8 - np.cos(angle))), (0.6, 0.4))

    pairs = run(yard(), FRAMES, view=view)
    assert strangers(pairs, "visibility") == 0
    shares = [kept_share(frame, "visibility") for frame, _ in pairs]
    assert 0.1 < shares[1] < 0.7
    # Two turns later nothing of the first picture is left to be seen.
    assert shares[3] < 0.02


def test_a_cut_to_another_camera_and_back_keeps_what_both_see() -> None:
    """One picture is finer where the other is coarse: edges may be off by the coarser one's pixels."""
    views = (walking()(0), CameraView(120, 80, look_at((-3, 2.5, -1.5), (0, 0.3, 0)), (0.6, 0.4)))
    pairs = run(yard(), FRAMES, traced=(0, 3), view=lambda k: views[k % 2])
    assert strangers(pairs, "visibility") <= FRAMES * 0.002 * 120 * 80
    assert strangers(pairs, "visibility", reach=5) <= 3
    assert kept_share(pairs[1][0], "visibility") > 0.3


# --- a walk through what does not move ------------------------------------------------------------------------------


@pytest.mark.parametrize("step", [0.004, 0.015, 0.05])
def test_shadow_edges_stay_where_they_are_while_the_camera_walks(step: float) -> None:
    pairs = run(yard(), 25, view=walking(step), effects={"shadows": {"samples": 0}})
    off = [int(ghosts(frame, truth, "visibility", reach=1).sum()) for frame, truth in pairs]
    total = pairs[0][0].gbuffer.object_id.size
    # One pixel is as near as values may be taken from; a second one is an edge seen at a grazing angle.
    assert max(off) <= 0.002 * total
    assert strangers(pairs, "visibility", reach=2) <= 25 * 0.0005 * total
    assert kept_share(pairs[-1][0], "visibility") > 0.6


def test_a_picture_that_stands_still_keeps_every_value_bit_for_bit() -> None:
    pairs = run(yard(), 5)
    first = pairs[0][0]
    for frame, _ in pairs[1:]:
        for name in ("visibility", "ambient_occlusion", "reflection"):
            np.testing.assert_array_equal(frame.layers[name], first.layers[name])
            np.testing.assert_array_equal(frame.masks[name] == MASK_HISTORY, first.masks[name] == 2)
        np.testing.assert_array_equal(frame.image, first.image)


# --- mutants: without the rule the same checks see ghosts ------------------------------------------------------------


def test_mutant_movers_are_not_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(phrt.history, "forget_crossed", lambda *given: 0)
    assert strangers(run(yard(), FRAMES, move=MOVES["slides"]), "visibility") > 20
    assert strangers(run(yard(), FRAMES, move=MOVES["slides"]), "ambient_occlusion", tolerance=0.25) > 5


@pytest.mark.parametrize("seen", ["before", "after"])
def test_mutant_movers_are_looked_for_in_one_place_only(seen: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before: new shadows are missing. After: old ones stay."""
    swept = BoundingSpheres.swept

    def once(self: BoundingSpheres, ids: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
        return swept(self, ids, before if seen == "before" else after, before if seen == "before" else after)

    monkeypatch.setattr(BoundingSpheres, "swept", once)
    assert strangers(run(yard(), FRAMES, move=MOVES["jumps"]), "visibility") > 20


def test_mutant_the_moved_thing_keeps_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    match = phrt.history.match_pixels

    def careless(*given: Any) -> Any:
        return match(*given[:-3], np.zeros_like(given[-3]), *given[-2:])

    monkeypatch.setattr(phrt.history, "match_pixels", careless)
    monkeypatch.setattr(phrt.history, "forget_crossed", lambda *given: 0)
    turning = placed(lambda k: at(-0.8, 0.9, 0.0) @ turned("y", 4.0 * k))
    kept = run(yard(), FRAMES, move=turning)[3][0]
    assert (kept.masks["visibility"] == MASK_HISTORY)[kept.gbuffer.object_id == 3].any()


def test_mutant_lights_are_not_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(phrt.history, "_may_hold", lambda rule, moves: True)
    assert strangers(run(animated("/light0"), FRAMES), "visibility") > 20


def test_mutant_values_forget_where_they_were_traced(monkeypatch: pytest.MonkeyPatch) -> None:
    choose = phrt.history.choose_values

    def rounding(*given: Any) -> Any:
        choose(*given)
        given[-1][given[0] : given[1]] = 0

    monkeypatch.setattr(phrt.history, "choose_values", rounding)
    pairs = run(yard(), 25, view=walking(0.015), effects={"shadows": {"samples": 0}})
    assert max(int(ghosts(frame, truth, "visibility", reach=1).sum()) for frame, truth in pairs) > 50
