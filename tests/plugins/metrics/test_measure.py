"""Measuring: metrics by name, what they do wrong contained, what they are given checked."""

from __future__ import annotations

import math
import pickle
import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from metric_kit import SHAPE, codes, noise, run_of, waves

import phrt
from phrt.errors import OptionError, PhrtWarning, PluginError
from phrt.interfaces.metric import Column, Metric, RunFrames, Shot
from phrt.registry import MetricPlugin, Options, get_registry
from phrt.testing.metrics import shot_of as shot
from phrt_plugins.metrics.measure import all_columns, check_size, make_metrics, measure_run, measure_shots

COLUMN = Column("mean_code", "mean code of the display", "", "neither")


class MeanCode(Metric):
    """A metric as somebody else would write it; `answer` is what it gives in place of the mean."""

    columns: tuple[Column, ...] = (COLUMN, Column("frames", "how many", "", "neither", scope="run"))
    answer: Any = None

    def __init__(self, options: Options) -> None:
        pass

    def of_shot(self, shot: Shot) -> Any:
        return {"mean_code": shot.display.mean()} if self.answer is None else self.answer

    def of_run(self, frames: RunFrames) -> Any:
        return {"frames": len(frames)} if self.answer is None else self.answer


class Faulty(MeanCode):
    """Fails on every second frame, and on runs."""

    columns = (Column("faulty", "", "", "lower"), Column("faulty_run", "", "", "lower", scope="run"))

    def of_shot(self, shot: Shot) -> Any:
        if shot.index % 2:
            raise KeyError("odd")
        return {"faulty": 1.0}

    def of_run(self, frames: RunFrames) -> Any:
        raise SystemExit(1)


class NoMetric:
    def __init__(self, options: Options) -> None:
        pass


class Badly(MeanCode):
    """Called a name that no column may have."""

    columns = (replace(COLUMN, name="frame"),)


class Wrongly(MeanCode):
    columns = (replace(COLUMN, better="bigger"),)  # type: ignore[arg-type]


def named(metric: Metric, name: str) -> Metric:
    metric.name = name
    return metric


def mean_code(answer: Any = None) -> Metric:
    made = MeanCode(Options())
    made.answer = answer
    return named(made, "mine")


@pytest.fixture
def registered() -> Iterator[None]:
    """Metrics `mine`, `nothing`, `badly` and `wrongly` of a third party."""
    for name, factory in (("mine", MeanCode), ("nothing", NoMetric), ("badly", Badly), ("wrongly", Wrongly)):
        phrt.register(MetricPlugin(name, name, f"{__name__}:{factory.__name__}"), owner=f"tests-{name}")
    yield
    for name in ("mine", "nothing", "badly", "wrongly"):
        get_registry()._forget(f"tests-{name}")


def shots(count: int = 4) -> list[Shot]:
    return [replace(shot(noise(i), waves()), index=i) for i in range(count)]


# Making


def test_all_metrics_are_made_by_default() -> None:
    made = make_metrics()
    assert [metric.name for metric in made] == get_registry().names("metric")
    assert {column.name for column in all_columns(made, "shot")} == {
        "flip", "flip_changeable", "flip_p95", "ssim", "ssim_changeable", "psnr", "psnr_changeable", "relmse",
        "relmse_changeable", "display_error", "display_error_changeable", "difference_error", "compensated_difference", "popping",
    }  # fmt: skip
    assert {column.name for column in all_columns(made, "run")} == {
        "frame_ms_p50", "frame_ms_p95", "frame_ms_p99", "fps", "late_share", "late_streak", "jitter", "overrun_ms_worst", "rays",
        "decision_flips", "flips_area", "error_measured", "error_paper",
    }  # fmt: skip


def test_metrics_come_in_the_order_they_are_asked_for_with_their_options() -> None:
    made = make_metrics(["relmse", "error"], {"relmse": {"epsilon": 1.0}})
    assert [metric.name for metric in made] == ["relmse", "error"]
    twice, once = (np.full(SHAPE, value, np.float32) for value in (2, 1))
    values = measure_shots(made, [shot(codes(0), codes(0), image=twice, reference=once)])
    assert values["relmse"] == pytest.approx([0.5])
    assert make_metrics([]) == []


@pytest.mark.parametrize(
    ("names", "options", "error", "message"),
    [
        (["flop"], {}, PluginError, "there is no metric 'flop'.* Did you mean 'flip'"),
        (["ssim", "ssim"], {}, OptionError, "metrics are named twice: ssim"),
        (["ssim"], {"flip": {}}, OptionError, "options for metric 'flip', which is not among those asked for: ssim"),
        (["ssim"], {"ssim": {"sigma": 1}}, OptionError, "metric 'ssim': unknown option 'sigma'"),
        (
            ["nothing"],
            {},
            PluginError,
            "metric 'nothing' of tests-nothing is broken: its factory makes .*NoMetric.*, no phrt",
        ),
        (["badly"], {}, PluginError, "metric 'badly' of tests-badly is broken: a column cannot be called 'frame'"),
        (["wrongly"], {}, PluginError, "column 'mean_code' has better 'bigger'; allowed: lower, higher, neither"),
    ],
)
def test_what_cannot_be_made_is_told(
    registered: None, names: list[str], options: dict[str, dict[str, object]], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        make_metrics(names, options)


def test_a_third_partys_metric_is_one_like_the_others(registered: None) -> None:
    values = measure_shots(make_metrics(["error", "mine"]), shots(2))
    assert list(values) == ["display_error", "display_error_changeable", "mean_code"]
    assert values["mean_code"] == pytest.approx([noise(0).mean(), noise(1).mean()])


def test_two_metrics_cannot_have_the_same_column() -> None:
    twins = [mean_code(), named(MeanCode(Options()), "yours")]
    for ask in (lambda: all_columns(twins), lambda: measure_shots(twins, []), lambda: measure_run(twins, run_of([]))):
        with pytest.raises(PluginError, match="column 'mean_code' is there twice: of metric 'mine' and metric 'yours'"):
            ask()


def test_a_metric_whose_package_is_missing_is_left_out_or_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("phrt_plugins.packages.find_spec", lambda name: None)
    missing = "the Python package 'flip-evaluator' is not installed: pip install 'phrt\\[bench\\]'"
    with pytest.warns(PhrtWarning) as told:
        made = make_metrics()
    assert {"flip", "ssim"} & {metric.name for metric in made} == set()
    assert [str(w.message).partition(":")[0] for w in told] == [f"metric '{n}' is left out" for n in ("flip", "ssim")]
    with pytest.raises(PluginError, match=f"metric 'flip' is not available here: {missing}"):
        make_metrics(["flip"])


# Measuring


def test_there_is_a_row_a_shot_and_a_column_a_column() -> None:
    made = make_metrics()
    values = measure_shots(made, shots(3))
    assert list(values) == [column.name for column in all_columns(made, "shot")]
    assert all(column.shape == (3,) and column.dtype == np.float64 for column in values.values())
    assert np.isnan(values["difference_error"]).all()
    assert np.isfinite(values["flip"]).all()


def test_shots_may_come_one_by_one() -> None:
    values = measure_shots([mean_code()], iter(shots(3)))
    assert len(values["mean_code"]) == 3
    assert measure_shots([mean_code()], []) == {"mean_code": pytest.approx([])}


def test_a_run_has_a_value_a_column() -> None:
    made = [*make_metrics(["pacing", "error"]), mean_code()]
    values = measure_run(made, run_of(range(3)))
    assert list(values) == [column.name for column in all_columns(made, "run")]
    assert values["frames"] == 3
    assert values["fps"] == pytest.approx(100)
    assert math.isnan(values["late_share"])


def test_a_metric_that_raises_costs_its_own_rows_and_one_warning() -> None:
    made = [named(Faulty(Options()), "faulty"), mean_code()]
    with pytest.warns(PhrtWarning) as told:
        values = measure_shots(made, shots(4))
    assert [str(w.message) for w in told] == [
        "metric 'faulty' failed in 2 of 4 judged frames and is left out there; frame 1: KeyError: 'odd'"
    ]
    assert values["faulty"] == pytest.approx([1, np.nan, 1, np.nan], nan_ok=True)
    assert np.isfinite(values["mean_code"]).all()


def test_a_metric_that_ends_the_program_does_not() -> None:
    with pytest.warns(PhrtWarning, match="metric 'faulty' failed and is left out: SystemExit: 1"):
        values = measure_run([named(Faulty(Options()), "faulty"), mean_code()], run_of(range(2)))
    assert math.isnan(values["faulty_run"])
    assert values["frames"] == 2


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (3.0, "it returned float, no mapping of columns"),
        ({"other": 1.0}, "it returned the column 'other', which is none of "),
        ({"mean_code": "1", "frames": "1"}, "it returned the column '(frames|mean_code)', which is none of|is '1', no number"),
    ],
)  # fmt: skip
def test_nonsense_is_contained_with_one_warning(answer: Any, message: str) -> None:
    with pytest.warns(PhrtWarning, match=message) as told:
        shown = measure_shots([mean_code(answer)], shots(2))
    assert len(told) == 1
    assert np.isnan(shown["mean_code"]).all()
    with pytest.warns(PhrtWarning, match=message):
        assert math.isnan(measure_run([mean_code(answer)], run_of([0]))["frames"])


@pytest.mark.parametrize(
    ("value", "message"),
    [("1", "column 'mean_code' is '1', no number"), (math.inf, "is infinite"), (None, "is None, no number")],
)
def test_what_is_no_finite_number_is_contained(value: Any, message: str) -> None:
    with pytest.warns(PhrtWarning, match=message):
        assert np.isnan(measure_shots([mean_code({"mean_code": value})], shots(1))["mean_code"]).all()


@pytest.mark.parametrize("value", [1, np.float32(1), np.int64(1), True])
def test_numbers_of_every_kind_are_taken(value: Any) -> None:
    assert measure_shots([mean_code({"mean_code": value})], shots(1))["mean_code"] == [1.0]


@pytest.mark.parametrize("answer", [{}, {"mean_code": math.nan}])
def test_what_does_not_apply_is_nan_without_a_warning(answer: Any) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert np.isnan(measure_shots([mean_code(answer)], shots(1))["mean_code"]).all()


# What is given


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"display": waves().astype(np.float32)}, r"display of frame 5 is \(36, 64, 3\) float32; expected \(36, 64, 3\) uint8"),
        ({"image": np.zeros((36, 63, 3), np.float32)}, r"image of frame 5 is \(36, 63, 3\)"),
        ({"changeable": np.ones((36, 64), np.uint8)}, r"changeable of frame 5 is \(36, 64\) uint8; expected \(36, 64\) bool"),
        ({"motion": np.zeros((36, 64), np.float32)}, r"motion of frame 5 is \(36, 64\) float32; expected \(36, 64, 2\)"),
        ({"previous": shot(codes(0, (20, 20, 3)), codes(0, (20, 20, 3)), index=4)}, "image of frame 4 is"),
    ],
)  # fmt: skip
def test_a_shot_that_is_none_is_the_callers_fault(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        measure_shots([mean_code()], [replace(shot(waves(), waves()), **fields)])


def test_all_metrics_judge_7x7_and_none_less() -> None:
    made = make_metrics()
    small = codes(0, (7, 7, 3))
    before = shot(small, small, index=4)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        values = measure_shots(made, [shot(small, small, previous=before, motion=np.zeros((7, 7, 2), np.float32))])
    assert [name for name, column in values.items() if not np.isfinite(column).all()] == []
    with pytest.raises(ValueError, match=r"frame 5 have shape \(7, 6, 3\); they are judged from 7x7 pixels on"):
        measure_shots(made, [shot(codes(0, (7, 6, 3)), codes(0, (7, 6, 3)))])
    check_size((7, 7))
    with pytest.raises(OptionError, match="size is 64x6; pictures are judged from 7x7 pixels on"):
        check_size((64, 6))


def test_metrics_can_be_sent_to_another_process() -> None:
    for made in make_metrics():
        again = pickle.loads(pickle.dumps(made))
        assert (again.name, again.columns) == (made.name, made.columns)


def test_a_metric_must_say_its_columns() -> None:
    with pytest.raises(TypeError, match="columns"):
        type("Silent", (Metric,), {})()
