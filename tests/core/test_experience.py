"""What earlier frames taught: measured rays replace the estimate, selections are remembered for one frame."""

from __future__ import annotations

import numpy as np
from candidate_kit import candidates

from phrt.experience import MEMORY_FRAMES, Experience
from phrt.frame import Decisions


def learn(experience: Experience, rays: int, pixels: int = 100) -> None:
    """Object 1 was traced."""
    experience.learn_rays(np.array([1]), np.array([0]), np.array([pixels]), np.array([rays]))


def decided(chosen: list[bool], names: tuple[str, ...] = ("shadows",)) -> Decisions:
    """A frame in which these of objects 1, 2, ... were traced."""
    work = candidates([100.0] * len(chosen), effect_names=names)
    nothing = np.zeros(len(chosen), np.int64)
    return Decisions(work, np.array(chosen), nothing, nothing, nothing, nothing, nothing, nothing)


def predicted(experience: Experience, pixel_count: int = 100) -> list[float]:
    count = np.full(2, pixel_count, np.int32)
    return experience.predict_rays(np.array([1, 2]), np.zeros(2, np.int32), count).tolist()


def test_predictions_start_from_the_estimate_and_follow_what_is_measured() -> None:
    experience = Experience(2, [3.0])
    assert predicted(experience) == [300, 300]
    learn(experience, 150)
    assert predicted(experience) == [150, 300], "the first measurement replaces the estimate, of that object alone"
    learn(experience, 250)
    assert predicted(experience) == [200, 300], "the second one counts as much as the first"


def test_predictions_forget_slowly() -> None:
    experience = Experience(2, [3.0])
    for _ in range(100):
        learn(experience, 100)
    learn(experience, 900)
    assert predicted(experience)[0] == 100 + 800 / MEMORY_FRAMES


def test_a_part_of_an_item_teaches_its_rays_per_pixel() -> None:
    experience = Experience(2, [3.0])
    learn(experience, 50, 25)
    assert predicted(experience)[0] == 200


def test_no_item_is_free() -> None:
    experience = Experience(2, [0.0])
    assert predicted(experience) == [1, 1]
    assert predicted(Experience(2, [0.4]), 1) == [1, 1]


def test_selections_are_those_of_the_last_frame_in_any_of_its_samples() -> None:
    experience = Experience(2, [1.0])
    experience.note_selected([decided([True, False]), decided([False, True])])
    assert experience.was_selected[:, 0].tolist() == [False, True, True]
    experience.note_selected([decided([False, True])])
    assert experience.was_selected[:, 0].tolist() == [False, False, True]


def test_an_object_selected_with_all_effects_was_selected_for_each() -> None:
    experience = Experience(2, [1.0, 1.0])
    experience.note_selected([decided([False, True], ("all",))])
    assert experience.was_selected.tolist() == [[False, False], [False, False], [True, True]]
