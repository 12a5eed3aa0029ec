"""Clocks: real time, a price per ray, and the readings of an earlier run."""

from __future__ import annotations

import numpy as np
import pytest

from phrt.clock import RayClock, RecordingClock, ReplayClock, WallClock
from phrt.errors import OptionError

THREAD_MS, RAYS = np.array([3.0, 1.0]), np.array([100, 300])


def test_a_wall_clocks_groups_share_the_time_since_the_wave_began() -> None:
    clock = WallClock()
    started = clock.now_ms()
    milliseconds = clock.wave(started - 40.0, THREAD_MS, RAYS)
    passed = clock.now_ms() - started
    assert 40.0 <= milliseconds.sum() <= 40.0 + passed
    assert milliseconds[0] == pytest.approx(3 * milliseconds[1])
    assert clock.wave(started, np.zeros(2), RAYS).tolist() == [0, 0]


def test_a_ray_clock_counts_rays_and_nothing_else() -> None:
    clock = RayClock(nanoseconds_per_ray=1000.0)
    assert clock.wave(clock.now_ms(), THREAD_MS, RAYS).tolist() == [0.1, pytest.approx(0.3)]
    assert clock.now_ms() == pytest.approx(0.4)
    clock.wave(clock.now_ms(), np.zeros(1), np.array([600]))
    assert clock.now_ms() == pytest.approx(1.0)


@pytest.mark.parametrize("price", [0.0, -1.0, float("nan"), 1e10])
def test_a_ray_takes_some_time(price: float) -> None:
    with pytest.raises(OptionError, match="it must be above 0 and below 1e9"):
        RayClock(price)


def test_a_recording_is_replayed_reading_by_reading() -> None:
    recorder = RecordingClock(WallClock())
    said = [recorder.now_ms(), recorder.wave(0.0, THREAD_MS, RAYS).tolist(), recorder.now_ms()]
    replay = ReplayClock(recorder.take())
    assert recorder.readings == []
    assert [replay.now_ms(), replay.wave(5.0, np.zeros(2), np.zeros(2)).tolist(), replay.now_ms()] == said
    with pytest.raises(OptionError, match="4 readings were recorded: not the same run"):
        replay.now_ms()
