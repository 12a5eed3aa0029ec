"""Exploration data: how long seen, when traced, what that changed and took; means that forget."""

from __future__ import annotations

import numpy as np
import pytest
from candidate_kit import candidates

from phrt.exploration import KEPT, Exploration, MeasuredChange
from phrt.interfaces.heuristic import NEVER_TRACED

OBJECTS, SHADOWS = np.array([1, 2]), np.array([0, 0])


def measured(change: list[float], pixels: list[float], **others: list[float]) -> MeasuredChange:
    """Sums over the sampled pixels of objects 1 and 2."""
    zero = [0.0] * len(change)
    columns = {"change_squared": zero, "neighboured_pixels": zero, "detail": zero, "aged_frames": zero, "drift": zero}
    return MeasuredChange(
        pixels=np.array(pixels),
        change=np.array(change),
        **{name: np.array(others.get(name, values)) for name, values in columns.items()},
    )


def test_what_was_never_measured_is_not_a_number() -> None:
    exploration = Exploration(2, 1)
    for values in (exploration.change, exploration.strength, exploration.detail, exploration.drift):
        assert np.isnan(values(OBJECTS, SHADOWS)).all()
    assert np.isnan(exploration.ms_per_pixel(OBJECTS, SHADOWS)).all()


def test_changes_are_means_over_the_sampled_pixels() -> None:
    exploration = Exploration(2, 1)
    exploration.learn_change(OBJECTS, SHADOWS, measured([2.0, 0.0], [10.0, 0.0], change_squared=[1.0, 0.0]))
    assert exploration.change(OBJECTS, SHADOWS).tolist() == [pytest.approx(0.2), pytest.approx(np.nan, nan_ok=True)]
    # Four pixels of ten changed by 0.5.
    assert exploration.strength(OBJECTS, SHADOWS)[0] == pytest.approx(0.5)


def test_what_changed_nothing_has_no_strength() -> None:
    exploration = Exploration(2, 1)
    exploration.learn_change(OBJECTS, SHADOWS, measured([0.0, 0.0], [10.0, 10.0]))
    assert exploration.strength(OBJECTS, SHADOWS).tolist() == [0.0, 0.0]


def test_drift_is_by_frames_of_age() -> None:
    exploration = Exploration(2, 1)
    exploration.learn_change(OBJECTS, SHADOWS, measured([0, 0], [0, 0], drift=[0.6, 0.0], aged_frames=[12.0, 0.0]))
    assert exploration.drift(OBJECTS, SHADOWS)[0] == pytest.approx(0.05)
    assert np.isnan(exploration.drift(OBJECTS, SHADOWS)[1])


def test_measurements_fade_with_every_frame_and_count_by_their_pixels() -> None:
    exploration = Exploration(2, 1)
    exploration.learn_change(OBJECTS, SHADOWS, measured([10.0, 10.0], [10.0, 10.0]))
    exploration.end_frame()
    exploration.end_frame()
    exploration.learn_change(OBJECTS, SHADOWS, measured([0.0, 0.0], [10.0, 30.0]))
    left = 10 * KEPT**2
    assert exploration.change(OBJECTS, SHADOWS).tolist() == pytest.approx([left / (left + 10), left / (left + 30)])


def test_nothing_is_forgotten_before_there_is_something_new() -> None:
    exploration = Exploration(2, 1)
    exploration.learn_change(OBJECTS, SHADOWS, measured([3.0, 0.0], [10.0, 10.0]))
    for _ in range(100_000):
        exploration.end_frame()
    exploration.learn_change(OBJECTS, SHADOWS, measured([0.0, 5.0], [0.0, 10.0]))
    assert exploration.change(OBJECTS, SHADOWS).tolist() == pytest.approx([0.3, 0.5])


def test_frames_are_counted_since_an_item_was_seen_and_traced() -> None:
    exploration = Exploration(2, 1)
    assert exploration.frames_since_traced(OBJECTS, SHADOWS).tolist() == [NEVER_TRACED, NEVER_TRACED]
    exploration.note(OBJECTS, SHADOWS, np.array([True, False]))
    exploration.note(OBJECTS[:1], SHADOWS[:1], np.array([False]))  # another sub-pixel sample
    exploration.end_frame()
    assert exploration.seen_frames[:, 0].tolist() == [0, 1, 1]
    assert exploration.frames_since_traced(OBJECTS, SHADOWS).tolist() == [1, NEVER_TRACED]
    exploration.note(OBJECTS[1:], SHADOWS[1:], np.array([True]))
    exploration.end_frame()
    assert exploration.seen_frames[:, 0].tolist() == [0, 1, 2]
    assert exploration.frames_since_traced(OBJECTS, SHADOWS).tolist() == [2, 1]


def test_an_item_of_several_effects_has_their_mean_by_pixels() -> None:
    exploration = Exploration(2, 2)
    both, effects = np.array([1, 1]), np.array([0, 1])
    exploration.learn_change(both, effects, measured([0.4, 8.0], [1.0, 10.0]))
    exploration.note(both, effects, np.array([False, True]))
    exploration.end_frame()
    item, objects, all_effects = np.array([0, 0, 1]), np.array([1, 1, 2]), np.array([0, 1, 0])
    known = exploration.of_items(item, objects, all_effects, np.array([300, 100, 50]))
    assert known.measured_change[0] == pytest.approx((300 * 0.4 + 100 * 0.8) / 400)
    assert np.isnan(known.measured_change[1])
    assert known.frames_since_traced.tolist() == [1, NEVER_TRACED]
    assert known.seen_frames.tolist() == [1, 0]


def test_an_effect_that_was_not_measured_does_not_count_in_the_mean() -> None:
    exploration = Exploration(1, 2)
    exploration.learn_change(np.array([1]), np.array([0]), measured([0.4], [1.0]))
    both, pixels = np.array([1, 1]), np.array([300, 100])
    known = exploration.of_items(np.array([0, 0]), both, np.array([0, 1]), pixels)
    assert known.measured_change[0] == pytest.approx(0.4)


def test_columns_have_the_candidates_names_and_types() -> None:
    none = np.zeros(0, np.int32)
    work = candidates([1.0])
    for name, values in vars(Exploration(1, 1).of_items(none, none, none, none)).items():
        assert values.dtype == getattr(work, name).dtype
        assert len(values) == 0
