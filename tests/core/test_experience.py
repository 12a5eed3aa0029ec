"""What earlier frames taught: measured rays replace the estimate, selections are remembered for one frame."""

from __future__ import annotations

import numpy as np
from candidate_kit import candidates

from phrt.experience import MEMORY_FRAMES, Experience
from phrt.frame import Decisions


def decided(rays: list[int], pixels: list[int], measured: bool = True) -> Decisions:
    work = candidates([100.0] * len(rays), pixel_count=np.full(len(rays), 100, np.int32))
    traced = np.array(pixels)
    passes = np.where(traced > 0, 4, 0).astype(np.int32)
    return Decisions(work, traced > 0, passes, traced, np.array(rays), np.zeros(len(rays)), 1e6, measured)


def predicted(experience: Experience, pixel_count: int = 100) -> list[float]:
    count = np.full(2, pixel_count, np.int32)
    return experience.predict_rays(np.array([1, 2]), np.zeros(2, np.int32), count).tolist()


def test_predictions_start_from_the_estimate_and_follow_what_is_measured() -> None:
    experience = Experience(2, [3.0])
    assert predicted(experience) == [300, 300]
    experience.learn_costs(decided([150, 0], [100, 0]))
    assert predicted(experience) == [150, 300], "the first measurement replaces the estimate, of that object alone"
    experience.learn_costs(decided([250, 0], [100, 0]))
    assert predicted(experience) == [200, 300], "the second one counts as much as the first"


def test_predictions_forget_slowly() -> None:
    experience = Experience(2, [3.0])
    for _ in range(100):
        experience.learn_costs(decided([100, 0], [100, 0]))
    experience.learn_costs(decided([900, 0], [100, 0]))
    assert predicted(experience)[0] == 100 + 800 / MEMORY_FRAMES


def test_a_part_of_an_item_teaches_its_rays_per_pixel() -> None:
    experience = Experience(2, [3.0])
    experience.learn_costs(decided([50, 0], [25, 0]))
    assert predicted(experience)[0] == 200


def test_shares_teach_nothing() -> None:
    experience = Experience(2, [3.0])
    experience.learn_costs(decided([150, 100], [100, 100], measured=False))
    assert predicted(experience) == [300, 300]


def test_no_item_is_free() -> None:
    experience = Experience(2, [0.0])
    assert predicted(experience) == [1, 1]
    assert predicted(Experience(2, [0.4]), 1) == [1, 1]


def test_selections_are_those_of_the_last_frame_in_any_of_its_samples() -> None:
    experience = Experience(2, [1.0])
    experience.note_selected([decided([1, 0], [1, 0]), decided([0, 1], [0, 1])])
    assert experience.was_selected[:, 0].tolist() == [False, True, True]
    experience.note_selected([decided([0, 1], [0, 1])])
    assert experience.was_selected[:, 0].tolist() == [False, False, True]
