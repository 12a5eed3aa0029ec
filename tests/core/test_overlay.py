"""The overlay's colours: what a pixel is to one effect, to all of them, and how it is drawn."""

from __future__ import annotations

import colorsys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scene_kit import GLASS, LAMBERT, MIRROR, Stage, at, ball, floor

import phrt
from phrt.budget import Budget
from phrt.errors import OptionError
from phrt.frame import MASK_FALLBACK, MASK_HISTORY, MASK_TRACED, FrameResult
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic, Request
from phrt.output.annotate import amount, annotate, budget_of, centres
from phrt.output.tonemap import to_8bit
from phrt.overlay import (
    EARLIER,
    PARTLY,
    SKIPPED,
    TRACED,
    UNTOUCHED,
    mandatory_pixels,
    outline,
    overlay,
    pixel_kinds,
    together,
)
from phrt.scene import Scene

SIZE = (320, 180)
FLOOR, MIRROR_ID, GLASS_ID = 1, 2, 3


def scene(**switches: Any) -> Scene:
    made = Stage(dome=(0.5, 0.5, 0.5)).add("/World/Floor", floor(), LAMBERT, at(0, -0.5, 0))
    made.add("/World/Mirror", ball(0.5, 3), MIRROR, at(-0.8, 0, 0), **switches)
    made.add("/World/Glass", ball(0.5, 3), GLASS, at(0.8, 0, 0))
    return made.light("point", at(1, 3, 2), intensity=40.0).camera((0, 1.0, 4), (0, 0, 0), fov_y=0.7).scene


class Asks(Heuristic):
    """Asks for what it is told: {(object, effect): passes}."""

    def __init__(self, wanted: dict[tuple[int, str], int]) -> None:
        self._wanted = wanted

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        keys = [
            (int(o), candidates.effect_names[e]) for o, e in zip(candidates.object_id, candidates.effect, strict=True)
        ]
        self._left = [Request(row, self._wanted[key]) for row, key in enumerate(keys) if key in self._wanted]

    def next(self, remaining: float) -> Request | None:
        return self._left.pop() if self._left else None


def render(wanted: dict[tuple[int, str], int], made: Scene | None = None, **options: Any) -> FrameResult:
    options = {"size": SIZE, "gbuffer": "raycast", "threads": 2, "heuristic": Asks(wanted)} | options
    with phrt.Renderer(made or scene(), **options) as renderer:
        return renderer.render()


def kinds_of(frame: FrameResult, object_id: int, effect: str | None = None) -> set[int]:
    """What the pixels of an object are."""
    return set(np.unique(pixel_kinds(frame, effect)[frame.gbuffer.object_id == object_id]).tolist())


def test_traced_and_skipped_by_effect() -> None:
    frame = render({(FLOOR, "shadows"): 4, (GLASS_ID, "refractions"): 4})
    assert kinds_of(frame, FLOOR, "shadows") == {TRACED}
    assert kinds_of(frame, MIRROR_ID, "reflections") == {SKIPPED}
    assert kinds_of(frame, GLASS_ID, "refractions") == {TRACED}
    assert kinds_of(frame, GLASS_ID, "reflections") == {SKIPPED}
    assert kinds_of(frame, FLOOR, "reflections") == {UNTOUCHED}, "it does not apply"
    assert kinds_of(frame, 0) == {UNTOUCHED}, "the background"


def test_all_effects_together() -> None:
    frame = render({(FLOOR, "shadows"): 4, (GLASS_ID, "refractions"): 4})
    assert kinds_of(frame, FLOOR) == {TRACED}
    assert kinds_of(frame, MIRROR_ID) == {SKIPPED}
    assert kinds_of(frame, GLASS_ID) == {PARTLY}
    whole = render({(GLASS_ID, "refractions"): 4, (GLASS_ID, "reflections"): 4})
    assert kinds_of(whole, GLASS_ID) == {TRACED}
    np.testing.assert_array_equal(pixel_kinds(frame), pixel_kinds(frame, "all"))


def test_an_item_traced_in_part_is_partly_traced_all_over() -> None:
    frame = render({(FLOOR, "shadows"): 1}, effects={"shadows": {"fallback": "none"}})
    assert kinds_of(frame, FLOOR, "shadows") == {PARTLY}, "gaps that were filled are part of it"


def test_a_fallback_that_leaves_no_mark_is_seen_as_skipped() -> None:
    unmarked = render({}, effects={"shadows": {"fallback": "none"}})
    assert kinds_of(unmarked, FLOOR, "shadows") == {SKIPPED}
    marked = render({}, effects={"shadows": {"fallback": "shadow_map"}})
    assert MASK_FALLBACK in marked.masks["visibility"]
    assert kinds_of(marked, FLOOR, "shadows") == {SKIPPED}


def test_values_of_earlier_frames_are_their_own_kind() -> None:
    frame = render({(GLASS_ID, "reflections"): 4})
    mask = frame.masks["visibility"].copy()
    mask[frame.gbuffer.object_id == FLOOR] = MASK_HISTORY
    frame = replace(frame, masks=frame.masks | {"visibility": mask})
    assert kinds_of(frame, FLOOR, "shadows") == {EARLIER}
    assert kinds_of(frame, FLOOR) == {EARLIER}
    part = render({(FLOOR, "shadows"): 1})
    mask = part.masks["visibility"].copy()
    mask[(part.gbuffer.object_id == FLOOR) & (mask != MASK_TRACED)] = MASK_HISTORY
    part = replace(part, masks=part.masks | {"visibility": mask})
    assert kinds_of(part, FLOOR, "shadows") == {PARTLY}, "an item traced in part is that all over"


def test_the_rule_for_several_effects() -> None:
    def of(*kinds: int) -> int:
        return int(together([np.array([[kind]], np.uint8) for kind in kinds])[0, 0])

    expected = {
        (TRACED, TRACED): TRACED,
        (TRACED, UNTOUCHED): TRACED,
        (SKIPPED, SKIPPED): SKIPPED,
        (SKIPPED, UNTOUCHED): SKIPPED,
        (TRACED, SKIPPED): PARTLY,
        (EARLIER, SKIPPED): PARTLY,
        (EARLIER, TRACED): EARLIER,
        (EARLIER, EARLIER): EARLIER,
        (EARLIER, PARTLY): PARTLY,
        (PARTLY, TRACED): PARTLY,
        (PARTLY, SKIPPED): PARTLY,
        (UNTOUCHED, UNTOUCHED): UNTOUCHED,
    }
    assert {pair: of(*pair) for pair in expected} == expected
    assert {pair: of(*reversed(pair)) for pair in expected} == expected


@pytest.mark.parametrize("group_by", ["object", "object_effect_light"])
def test_other_work_items_are_understood(group_by: Any) -> None:
    frame = render({}, heuristic="all_trace", group_by=group_by)
    assert kinds_of(frame, FLOOR, "shadows") == {TRACED}
    assert kinds_of(frame, GLASS_ID) == {TRACED}
    nothing = render({}, heuristic="raster_only", group_by=group_by)
    assert kinds_of(nothing, FLOOR, "shadows") == {SKIPPED}
    assert kinds_of(nothing, GLASS_ID) == {SKIPPED}


def test_colours_at_known_pixels() -> None:
    frame = render({(FLOOR, "shadows"): 4, (GLASS_ID, "refractions"): 4})
    pixels, plain = overlay(frame), to_8bit(frame.image)
    assert pixels.shape == (SIZE[1], SIZE[0], 3)
    assert pixels.dtype == np.uint8

    def hue(x: int, y: int) -> float:
        return colorsys.rgb_to_hsv(*(pixels[y, x] / 255.0))[0] * 360

    assert frame.gbuffer.object_id[120, 20] == FLOOR
    assert 100 < hue(20, 120) < 160, "green"
    columns = {o: np.nonzero(frame.gbuffer.object_id == o) for o in (MIRROR_ID, GLASS_ID)}
    for object_id, low, high in ((MIRROR_ID, 0, 25), (GLASS_ID, 40, 70)):
        rows, cols = columns[object_id]
        # A pixel a quarter from the top of the ball, clear of its name.
        row = int(np.quantile(rows, 0.2))
        column = int(np.median(cols[rows == row]))
        assert low <= hue(column, row) <= high, object_id
    # The sky stays as it is, clear of legend and names.
    assert frame.gbuffer.object_id[5, 250] == 0
    np.testing.assert_array_equal(pixels[5, 250], plain[5, 250])


def test_mandatory_objects_are_hatched() -> None:
    frame = render({}, scene(effects={"reflections": "always"}))
    mandatory = mandatory_pixels(frame, None)
    np.testing.assert_array_equal(mandatory, frame.gbuffer.object_id == MIRROR_ID)
    assert not mandatory_pixels(frame, "shadows").any()
    plainly = replace(frame, decisions=replace(frame.decisions, candidates=without_mandatory(frame)))
    changed = (overlay(frame) != overlay(plainly)).any(axis=2)
    assert 0.03 < changed[mandatory].mean() < 0.4, "lines, not a filled area"
    assert not changed[~mandatory].any()


def without_mandatory(frame: FrameResult) -> Candidates:
    candidates = frame.decisions.candidates
    return replace(candidates, mandatory=np.zeros(len(candidates), bool))


def test_borders_of_objects_are_dark() -> None:
    object_id = np.zeros((4, 6), np.uint32)
    object_id[:, 3:] = 1
    pixels = np.full((4, 6, 3), 200, np.uint8)
    outline(pixels, object_id)
    np.testing.assert_array_equal(pixels[:, 2], 66)
    np.testing.assert_array_equal(pixels[:, [0, 1, 3, 4, 5]], 200)


def test_an_unknown_effect_is_refused() -> None:
    frame = render({})
    with pytest.raises(OptionError, match=r"overlay of 'shadow': allowed are all, .*shadows.* Did you mean 'shadows'"):
        overlay(frame, "shadow")


@pytest.mark.parametrize("size", [(1, 1), (32, 18), (160, 90), (90, 160), (640, 360)])
def test_every_size_can_be_drawn(size: tuple[int, int]) -> None:
    assert overlay(render({}, size=size)).shape == (size[1], size[0], 3)


def test_tiny_pictures_hold_colours_only() -> None:
    frame = render({}, size=(64, 36))
    pixels = to_8bit(frame.image)
    assert annotate(pixels, frame, "all") is pixels


def test_names_stand_on_their_objects_the_largest_first() -> None:
    frame = render({})
    found = centres(frame.gbuffer.object_id, 3)
    assert [object_id for object_id, _, _ in found] == [
        FLOOR,
        *sorted((MIRROR_ID, GLASS_ID), key=lambda o: -area(frame, o)),
    ]
    for object_id, x, y in found:
        assert frame.gbuffer.object_id[y, x] == object_id


def area(frame: FrameResult, object_id: int) -> int:
    return int((frame.gbuffer.object_id == object_id).sum())


def test_a_ring_has_its_name_on_itself() -> None:
    y, x = np.mgrid[0:60, 0:60]
    ring = (np.hypot(x - 30, y - 30) > 15) & (np.hypot(x - 30, y - 30) < 25)
    ((object_id, column, row),) = centres(ring.astype(np.uint32), 1)
    assert object_id == 1
    assert ring[row, column]


@pytest.mark.parametrize(
    ("budget", "text", "within"),
    [
        (Budget(50.0, "frame_ms"), "61.2 ms of 50.0 ms", False),
        (Budget(20.0, "ray_ms"), "12.5 ms of 20.0 ms", True),
        (Budget(1e6, "rays"), "250 k rays of 1.00 M rays", True),
        (Budget(), "60.0 ms, no budget", True),
    ],
)
def test_the_bar_shows_what_was_taken_in_the_budgets_unit(budget: Budget, text: str, within: bool) -> None:
    frame = render({})
    frame = replace(
        frame,
        budget=budget,
        clock_ms=61.2,
        stages={"gbuffer": 45.0, "rays": 15.0},
        rays={"primary": 10**6, "shadows": 250_000},
        decisions=replace(frame.decisions, ray_ms=12.5),
    )
    bar = budget_of(frame)
    assert bar.text == text
    assert (bar.taken <= bar.allowed) == within
    assert bar.rays_share == (1.0 if budget.kind in ("rays", "ray_ms") else 0.25)


def test_amounts_are_short() -> None:
    assert [amount(12.34, "ms"), amount(999.0, "rays"), amount(2.5e6, "rays")] == ["12.3 ms", "1 k rays", "2.50 M rays"]
