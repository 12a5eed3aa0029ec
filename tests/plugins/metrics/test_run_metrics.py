"""Pacing, flips and costs: tables made by hand, and a real recording against the frames that it is of."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from metric_kit import found, run_of
from recording_kit import record

from phrt.frame import Decisions
from phrt.interfaces.metric import RunFrames
from phrt.recording import read_run
from phrt.recording.run import Run, as_arrays

LATE = {"deadline_ms": [50.0] * 6, "clock_ms": [40.0, 60.0, 60.0, 60.0, 55.0, 40.0], "late": [0, 1, 1, 1, 1, 0]}


# Pacing


def test_pacing_by_hand() -> None:
    values = found("pacing", run_of(range(5), clock_ms=[10.0, 20.0, 30.0, 40.0, 50.0]))
    assert values == pytest.approx(
        {
            "frame_ms_p50": 30.0,
            "frame_ms_p95": 48.0,
            "frame_ms_p99": 49.6,
            "fps": 5 / 0.15,
            "jitter": 10.0,
            "rays": 0.0,
        }
    )


def test_late_frames_and_their_longest_streak() -> None:
    values = found("pacing", run_of(range(6), **LATE))
    assert values["late_share"] == pytest.approx(4 / 6)
    assert values["late_streak"] == 4.0


def test_a_streak_ends_with_its_block() -> None:
    # Two blocks of three: late in frames 1 and 2, and 0 and 1.
    assert found("pacing", run_of([0, 1, 2, 0, 1, 2], **LATE))["late_streak"] == 2.0


def test_frames_without_a_budget_cannot_be_late() -> None:
    values = found("pacing", run_of(range(6), **(LATE | {"deadline_ms": [np.inf] * 6})))
    assert {"late_share", "late_streak", "overrun_ms_worst"} & set(values) == set()


def test_jitter_is_of_frames_that_follow_each_other() -> None:
    times = [10.0, 14.0, 12.0, 90.0, 91.0, 92.0]
    assert found("pacing", run_of([0, 1, 2, 0, 1, 2], clock_ms=times))["jitter"] == pytest.approx((4 + 2 + 1 + 1) / 4)
    assert "jitter" not in found("pacing", run_of([0, 0], clock_ms=[1.0, 2.0]))


def test_the_worst_overrun_is_of_frames_with_a_budget_of_time() -> None:
    columns: dict[str, Any] = {"overrun_ms": [0.0, 1.5, 0.5], "budget_unit": ["ms"] * 3}
    assert found("pacing", run_of(range(3), **columns))["overrun_ms_worst"] == 1.5
    assert "overrun_ms_worst" not in found("pacing", run_of(range(3), **(columns | {"budget_unit": ["rays"] * 3})))


def test_rays_are_those_of_the_ray_phase() -> None:
    columns = {"rays_primary": [900, 900], "rays_shadows": [10, 20], "rays_reflections": [1, 3]}
    assert found("pacing", run_of(range(2), **columns))["rays"] == 17.0


def test_no_frames_have_no_pace() -> None:
    assert found("pacing", run_of([])) == {}


# Flips


def items(*rows: tuple[int, int, str, bool, int]) -> dict[str, list[Any]]:
    """A candidates table of (frame, object, effect, chosen, pixels)."""
    names = ("frame", "object_id", "effect", "chosen", "pixel_count")
    return {name: [row[i] for row in rows] for i, name in enumerate(names)} | {"sample": [0] * len(rows)}


def test_flips_are_items_of_both_frames_that_changed() -> None:
    table = items(
        (100, 1, "shadows", True, 10), (100, 2, "shadows", False, 20), (100, 3, "shadows", True, 30),
        (101, 1, "shadows", True, 10), (101, 2, "shadows", True, 20), (101, 3, "shadows", False, 70),
        (102, 1, "shadows", True, 10), (102, 2, "shadows", True, 20), (102, 3, "shadows", False, 70),
    )  # fmt: skip
    values = found("flips", run_of(range(3), table))
    # Two of three items flip from 100 to 101, none after it.
    assert values == pytest.approx({"decision_flips": (2 + 0) / 2, "flips_area": (90 / 100 + 0) / 2})


def test_an_item_is_an_object_and_an_effect() -> None:
    table = items(
        (100, 1, "shadows", True, 10), (100, 1, "reflections", False, 10),
        (101, 1, "reflections", False, 10), (101, 1, "shadows", True, 10),
    )  # fmt: skip
    assert found("flips", run_of(range(2), table)) == {"decision_flips": 0.0, "flips_area": 0.0}


def test_items_that_one_frame_alone_sees_do_not_flip() -> None:
    table = items((100, 1, "shadows", True, 10), (101, 2, "shadows", False, 10))
    assert found("flips", run_of(range(2), table)) == {"decision_flips": 0.0, "flips_area": 0.0}


def test_nothing_flips_from_block_to_block() -> None:
    table = items(*((100 + i, 1, "shadows", i >= 2, 10) for i in range(4)))
    assert found("flips", run_of([0, 1, 2, 3], table))["decision_flips"] == pytest.approx(1 / 3)
    assert found("flips", run_of([0, 1, 0, 1], table))["decision_flips"] == 0.0
    assert found("flips", run_of([0, 0, 0, 0], table)) == {}


def test_samples_of_a_frame_are_compared_with_their_own_kind() -> None:
    table = items(*((100 + i // 2, 1, "shadows", i % 2 == 0, 10) for i in range(4)))
    table["sample"] = [0, 1, 0, 1]
    assert found("flips", run_of(range(2), table))["decision_flips"] == 0.0
    table["sample"] = [0, 1, 1, 0]
    assert found("flips", run_of(range(2), table))["decision_flips"] == 2.0


def test_frames_that_share_a_number_are_refused() -> None:
    table = items((100, 1, "shadows", True, 10))
    with pytest.raises(ValueError, match="two frames have the same number"):
        found("flips", run_of(range(2), table, frame=[100, 100]))
    with pytest.raises(ValueError, match="candidates of frames that are not in the frames table"):
        found("flips", run_of(range(2), table, frame=[7, 8]))


# Costs


def costs(frames: list[int], **columns: list[float]) -> dict[str, list[Any]]:
    """A candidates table of items of 10 pixels, all traced with 100 rays in 2 ms, predicted to take that, but for `columns`."""
    n = len(frames)
    made: dict[str, list[Any]] = {
        "frame": frames,
        "pixel_count": [10] * n,
        "traced_pixels": [10] * n,
        "rays": [100] * n,
    }
    made |= dict.fromkeys(("milliseconds", "predicted_ms_measured", "predicted_ms_paper"), [2.0] * n)
    return made | columns


def test_errors_of_the_cost_models_by_hand() -> None:
    # Sums of the frames: 4 and 2 ms took place; predicted are 4 and 3 by one model, 2 and 2.5 by the other.
    table = costs([100, 100, 101], predicted_ms_measured=[1.0, 3.0, 3.0], predicted_ms_paper=[1.0, 1.0, 2.5])
    values = found("costs", run_of(range(2), table))
    assert values == pytest.approx({"error_measured": (0 + 0.5) / 2, "error_paper": (0.5 + 0.25) / 2})


def test_the_median_is_over_frames_in_which_something_was_traced() -> None:
    table = costs([100, 101, 102, 103], rays=[100, 0, 100, 100], predicted_ms_measured=[2.2, 9.0, 3.0, 8.0])
    assert found("costs", run_of(range(4), table))["error_measured"] == pytest.approx(0.5)


def test_of_a_partly_traced_item_its_share_counts() -> None:
    table = costs([100], traced_pixels=[5], predicted_ms_measured=[4.0])
    assert found("costs", run_of([0], table))["error_measured"] == pytest.approx(0.0)


def test_where_nothing_was_traced_there_is_no_error() -> None:
    assert found("costs", run_of(range(2), costs([100, 101], rays=[0, 0]))) == {}


def test_a_table_without_a_column_is_refused_by_name() -> None:
    table = costs([100])
    del table["traced_pixels"]
    with pytest.raises(ValueError, match="the candidates table has no column 'traced_pixels'"):
        found("costs", run_of([0], table))


# A real recording


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, list[Decisions], list[float]]:
    folder = tmp_path_factory.mktemp("runs") / "random"
    made = record(folder, frames=6, heuristic="random", budget="2000rays")
    return read_run(folder), [frame.decisions for frame in made], [frame.clock_ms for frame in made]


def frames_of(run: Run) -> RunFrames:
    return RunFrames(as_arrays(run.frames), run.read_candidates)


def test_flips_of_a_recording_are_those_of_its_frames(recorded: tuple[Run, list[Decisions], list[float]]) -> None:
    run, frames, _ = recorded
    flips, areas = [], []
    for before, now in pairwise(frames):
        was = dict(zip(before.candidates.keys().tolist(), before.chosen.tolist(), strict=True))
        both = [i for i, key in enumerate(now.candidates.keys().tolist()) if key in was]
        flipped = [i for i in both if was[int(now.candidates.keys()[i])] != now.chosen[i]]
        pixels = now.candidates.pixel_count
        flips.append(len(flipped))
        areas.append(sum(pixels[flipped]) / sum(pixels[both]))
    values = found("flips", frames_of(run))
    assert values == pytest.approx({"decision_flips": np.mean(flips), "flips_area": np.mean(areas)})
    assert values["decision_flips"] > 0


def test_costs_of_a_recording_are_those_of_its_frames(recorded: tuple[Run, list[Decisions], list[float]]) -> None:
    run, frames, _ = recorded
    errors = []
    for frame in frames:
        share = frame.traced_pixels / frame.candidates.pixel_count
        expected, took = (frame.candidates.predicted_ms_measured * share).sum(), frame.milliseconds.sum()
        errors.append(abs(expected - took) / took)
    assert found("costs", frames_of(run))["error_measured"] == pytest.approx(np.median(errors), rel=1e-5)


def test_pace_of_a_recording_is_that_of_its_frames(recorded: tuple[Run, list[Decisions], list[float]]) -> None:
    run, frames, times = recorded
    values = found("pacing", frames_of(run))
    assert values["frame_ms_p50"] == pytest.approx(np.median(times))
    assert values["jitter"] == pytest.approx(np.abs(np.diff(times)).mean())
    assert values["rays"] == pytest.approx(np.mean([frame.rays.sum() for frame in frames]))


def test_tables_of_several_blocks_have_dictionaries_of_their_own(
    recorded: tuple[Run, list[Decisions], list[float]],
) -> None:
    """Blocks put together, as a harness does: effects are told apart by their names, whatever a block's codes for them are."""
    import pyarrow as pa

    run, _, _ = recorded
    table = run.read_candidates()
    effects = table.column("effect").to_pylist()
    other = sorted(set(effects), reverse=True)
    codes = pa.DictionaryArray.from_arrays(pa.array([other.index(e) for e in effects], pa.int32()), pa.array(other))
    place = table.schema.get_field_index("effect")
    twin = table.set_column(place, "effect", codes)
    half = sum(number < 3 for number in table.column("frame").to_pylist())
    mixed = pa.concat_tables([table.slice(0, half), twin.slice(half)])
    frames = as_arrays(run.frames)
    expected = found("flips", RunFrames(frames, table.select))
    assert found("flips", RunFrames(frames, mixed.select)) == expected
    assert expected["decision_flips"] > 0
