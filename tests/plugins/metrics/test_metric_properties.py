"""What holds of metrics whatever the pictures and the runs are."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import needs
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from metric_kit import found, run_of

from phrt.interfaces.metric import RunFrames, Shot
from phrt.testing.metrics import shot_of as shot

for package in ("flip_evaluator", "skimage"):
    needs.package(package)

RESTRICTED = {"flip": "flip", "ssim": "ssim", "psnr": "psnr", "relmse": "relmse", "error": "display_error"}
"""Metrics of pictures with a column NAME and a column NAME_changeable."""
PIXELWISE = ("psnr", "relmse", "error")
EQUAL = {"flip": 0.0, "ssim": 1.0, "psnr": 100.0, "relmse": 0.0, "error": 0.0}
few = settings(max_examples=15, deadline=None)


@st.composite
def shots(draw: st.DrawFn) -> Shot:
    """Any displays of 7 to 16 pixels a side, with any changeable pixels, motion, and a frame before."""
    shape = (draw(st.integers(7, 16)), draw(st.integers(7, 16)), 3)
    displays = [draw(arrays(np.uint8, shape)) for _ in range(4)]
    motion = draw(arrays(np.float32, (*shape[:2], 2), elements=st.floats(-20, 20, width=32) | st.just(math.nan)))
    changeable = draw(arrays(np.bool_, shape[:2]))
    before = shot(displays[2], displays[3], index=4)
    return shot(displays[0], displays[1], changeable=changeable, motion=motion, previous=before)


@pytest.mark.parametrize(("name", "column"), RESTRICTED.items())
@few
@given(data=st.data())
def test_with_all_pixels_changeable_the_restricted_value_is_the_whole_one(name: str, column: str, data: Any) -> None:
    made = data.draw(shots())
    values = found(name, replace(made, changeable=np.ones_like(made.changeable)))
    assert values[f"{column}_changeable"] == pytest.approx(values[column], rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("name", PIXELWISE)
@few
@given(data=st.data())
def test_pixels_may_change_places(name: str, data: Any) -> None:
    made = data.draw(shots())
    order = np.random.default_rng(data.draw(st.integers(0, 9))).permutation(made.changeable.size)

    def shuffled(array: np.ndarray) -> np.ndarray:
        return array.reshape(len(order), -1)[order].reshape(array.shape)

    fields = ("image", "display", "reference", "reference_display", "changeable")
    mixed = replace(made, **{field: shuffled(getattr(made, field)) for field in fields})
    assert found(name, mixed) == pytest.approx(found(name, made), rel=1e-6, abs=1e-9, nan_ok=True)


@pytest.mark.parametrize("name", [*RESTRICTED, "temporal"])
@few
@given(data=st.data())
def test_a_mirrored_picture_is_as_far_away(name: str, data: Any) -> None:
    made = data.draw(shots())

    def mirrored(one: Shot) -> Shot:
        fields = ("image", "display", "reference", "reference_display", "changeable")
        return replace(one, **{field: getattr(one, field)[:, ::-1].copy() for field in fields})

    assert made.motion is not None
    assert made.previous is not None
    turned = replace(
        mirrored(made), motion=(made.motion * np.float32([-1, 1]))[:, ::-1].copy(), previous=mirrored(made.previous)
    )
    assert found(name, turned) == pytest.approx(found(name, made), rel=1e-3, abs=1e-4, nan_ok=True)


@pytest.mark.parametrize("name", RESTRICTED)
@few
@given(data=st.data())
def test_equal_pictures_have_the_best_value(name: str, data: Any) -> None:
    made = data.draw(shots())
    same = replace(made, image=made.reference, display=made.reference_display)
    for value in found(name, same).values():
        assert math.isnan(value) or value == pytest.approx(EQUAL[name], abs=1e-5)


@pytest.mark.parametrize("name", [*RESTRICTED, "temporal"])
@few
@given(data=st.data())
def test_values_are_in_range_and_what_is_given_is_left_alone(name: str, data: Any) -> None:
    made = data.draw(shots())
    for one in (made, made.previous):
        assert one is not None
        for field in ("image", "display", "reference", "reference_display", "changeable"):
            getattr(one, field).setflags(write=False)
    low, high = {"ssim": (-1.0, 1.0), "psnr": (0.0, 100.0), "relmse": (0.0, 100.0), "temporal": (-1.0, 2.0)}.get(
        name, (0.0, 1.0)
    )
    for value in found(name, made).values():
        assert math.isnan(value) or low - 1e-6 <= value <= high + 1e-6


rows = st.lists(
    st.tuples(st.integers(100, 103), st.integers(1, 4), st.sampled_from(["shadows", "reflections"]), st.booleans()),
    unique_by=lambda row: row[:3], max_size=30,
)  # fmt: skip


def candidates_of(items: list[tuple[int, int, str, bool]]) -> dict[str, list[Any]]:
    """A table of all that flips and costs look at; numbers follow from the item, so that order is all that can change."""
    numbers = [7 * frame + 3 * thing + len(effect) for frame, thing, effect, _ in items]
    return {
        "frame": [item[0] for item in items],
        "sample": [0] * len(items),
        "object_id": [item[1] for item in items],
        "effect": [item[2] for item in items],
        "chosen": [item[3] for item in items],
        "pixel_count": [number % 50 + 10 for number in numbers],
        "traced_pixels": [10 * item[3] for item in items],
        "rays": [100 * item[3] for item in items],
        "milliseconds": [number % 9 + 1.0 for number in numbers],
        "predicted_ms_measured": [number % 5 + 1.0 for number in numbers],
        "predicted_ms_paper": [number % 7 + 1.0 for number in numbers],
    }


@few
@given(items=rows, shuffle=st.randoms(use_true_random=False))
def test_the_order_of_candidates_does_not_matter(items: list[tuple[int, int, str, bool]], shuffle: Any) -> None:
    if not items:
        return
    mixed = list(items)
    shuffle.shuffle(mixed)
    for name in ("flips", "costs"):
        expected = found(name, run_of(range(4), candidates_of(items)))
        assert found(name, run_of(range(4), candidates_of(mixed))) == pytest.approx(expected)


@few
@given(items=rows)
def test_flips_are_shares_of_what_could_flip(items: list[tuple[int, int, str, bool]]) -> None:
    if not items:
        return
    values = found("flips", run_of(range(4), candidates_of(items)))
    assert 0 <= values["decision_flips"] <= 8
    assert 0 <= values["flips_area"] <= 1
    turned = [(frame, thing, effect, not chosen) for frame, thing, effect, chosen in items]
    assert found("flips", run_of(range(4), candidates_of(turned))) == values


@few
@given(times=st.lists(st.floats(0.1, 1e4), min_size=1, max_size=40), shuffle=st.randoms(use_true_random=False))
def test_only_jitter_and_streaks_depend_on_the_order_of_frames(times: list[float], shuffle: Any) -> None:
    def run(values: list[float]) -> RunFrames:
        late = [value > 50 for value in values]
        return run_of(range(len(values)), clock_ms=values, deadline_ms=[50.0] * len(values), late=late)

    mixed = list(times)
    shuffle.shuffle(mixed)
    first, second = found("pacing", run(times)), found("pacing", run(mixed))
    for name in set(first) - {"jitter", "late_streak"}:
        assert second[name] == pytest.approx(first[name])
    assert first["late_streak"] <= sum(value > 50 for value in times)
    assert first["frame_ms_p50"] <= first["frame_ms_p95"] <= first["frame_ms_p99"]


@few
@given(late=st.lists(st.booleans(), min_size=1, max_size=40))
def test_the_longest_streak_is_the_longest_run_of_text(late: list[bool]) -> None:
    text = "".join("x" if value else " " for value in late)
    expected = max(map(len, text.split()), default=0)
    assert (
        found("pacing", run_of(range(len(late)), late=late, deadline_ms=[50.0] * len(late)))["late_streak"] == expected
    )
