"""Pace: few late frames, little time wasted, and no swinging between two states, with a clock that is noisy."""

from __future__ import annotations

import numpy as np
import pytest

from phrt.pace import FIRST_HEADROOM, LARGEST_HEADROOM, LEAST_MS, LEAST_SHARE, Pace


class Machine:
    """Frames whose stages take random times, and a ray phase that takes what it may, and a little more or less."""

    def __init__(self, seed: int, noise_ms: float, spikes: float) -> None:
        self._rng = np.random.default_rng(seed)
        self._noise, self._spikes = noise_ms, spikes

    def frame(self, pace: Pace, frame_ms: float, before_ms: float = 15.0, after_ms: float = 6.0) -> tuple[float, float]:
        """(milliseconds of the frame, of its ray phase)."""
        before = before_ms + abs(self._rng.normal(0, self._noise))
        budget = pace.ray_budget_ms(frame_ms, before)
        rays = budget * (1 + self._rng.normal(0, 0.02))
        after = after_ms + abs(self._rng.normal(0, self._noise)) + 8.0 * (self._rng.random() < self._spikes)
        total = before + rays + after
        pace.finished(frame_ms, total, after)
        return total, budget


@pytest.mark.parametrize("noise_ms", [0.1, 1.0, 3.0])
def test_frames_are_in_time_and_time_is_used(noise_ms: float) -> None:
    pace, machine = Pace(), Machine(1, noise_ms, spikes=0.0)
    frames = np.array([machine.frame(pace, 50.0) for _ in range(3000)])[300:, 0]
    assert (frames > 50.0).mean() <= 0.012
    assert frames.mean() > 50.0 - 2.0 - 4.0 * noise_ms


def test_rare_spikes_do_not_swing_the_budget() -> None:
    pace, machine = Pace(), Machine(2, 0.5, spikes=0.01)
    frames = np.array([machine.frame(pace, 33.0) for _ in range(4000)])[500:]
    assert (frames[:, 0] > 33.0).mean() <= 0.02
    # What the ray phase may take is nearly the same from frame to frame, and does not alternate.
    budget = frames[:, 1]
    change = np.diff(budget)
    assert np.median(np.abs(change)) < 1.0
    assert np.corrcoef(budget[:-1], budget[1:])[0, 1] > -0.1, "a controller that overcorrects alternates"


def test_headroom_rises_at_once_by_a_step_and_falls_slowly() -> None:
    pace = Pace()
    pace.finished(50.0, 55.0, 5.0)
    risen = pace.headroom_ms(50.0)
    assert risen == pytest.approx((FIRST_HEADROOM + 0.02 * 0.995) * 50)
    for _ in range(10):
        pace.finished(50.0, 45.0, 5.0)
    assert risen * 0.97 < pace.headroom_ms(50.0) < risen


def test_headroom_is_bounded_and_frames_without_time_for_rays_do_not_raise_it() -> None:
    pace = Pace()
    for _ in range(100):
        pace.ray_budget_ms(20.0, 25.0)
        pace.finished(20.0, 30.0, 5.0)
    assert pace.headroom_ms(20.0) == pytest.approx(FIRST_HEADROOM * 20)
    for _ in range(100):
        pace.ray_budget_ms(20.0, 1.0)
        pace.finished(20.0, 30.0, 5.0)
    assert pace.headroom_ms(20.0) == LARGEST_HEADROOM * 20


def test_one_long_tail_does_not_count_but_a_lasting_one_does() -> None:
    pace = Pace()
    for tail in (4000.0, 6.0, 6.0):
        pace.finished(50.0, 40.0, tail, learn=False)
    assert pace.tail_ms == 6.0
    for _ in range(6):
        pace.finished(50.0, 40.0, 9.0)
    assert pace.tail_ms == 9.0


def test_a_frame_that_is_late_anyway_traces_a_little() -> None:
    pace = Pace()
    assert pace.ray_budget_ms(20.0, 25.0) == pytest.approx(LEAST_SHARE * 20)
    assert pace.hopeless
    assert pace.ray_budget_ms(1000.0, 2000.0) == LEAST_MS
    assert pace.ray_budget_ms(20.0, 1.0) > 10
    assert not pace.hopeless


def test_the_ray_phase_gets_what_is_left() -> None:
    pace = Pace()
    assert pace.ray_budget_ms(50.0, 20.0) == pytest.approx(50 - 20 - FIRST_HEADROOM * 50)
    pace.finished(50.0, 40.0, 10.0)
    assert pace.ray_budget_ms(50.0, 20.0) == pytest.approx(50 - 20 - 10 - pace.headroom_ms(50.0))
    assert pace.ray_budget_ms(25.0, 20.0) == pytest.approx(LEAST_SHARE * 25)
