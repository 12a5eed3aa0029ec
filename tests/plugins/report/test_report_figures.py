"""Figures: what they hold, as SVG, as CSV and in words."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

import needs
import numpy as np
import pytest
from report_kit import HOSTILE

from phrt_plugins.report.costs import COLUMNS as COST_COLUMNS
from phrt_plugins.report.costs import CostMaker, predictions
from phrt_plugins.report.drawing import COLOURS, Plot, draw, looks, name_text, path_text, table_csv
from phrt_plugins.report.figures import error_against, shares
from phrt_plugins.report.model import Entry, Value, entries_of
from phrt_plugins.report.timelines import ABSENT, FALLBACK, HELD, StripMaker, most_important, states, time_lines
from phrt_plugins.report.traces import Trace, frame_times, late_share, trace_of
from phrt_plugins.report.worst import harm_of

arrow = needs.package("pyarrow")
needs.package("matplotlib")
LABELS = ("_gain", HOSTILE, "plain")


def entry(label: str, budget: str, **values: float) -> Entry:
    found = {name: Value(value, value * 0.9, value * 1.1, "", "lower") for name, value in values.items()}
    return Entry("setup", "court", "64x36", "embree", "raycast", "wall", budget, "frame_ms", 50.0, label, "ok", found)


def entries() -> list[Entry]:
    return [
        entry(
            label,
            budget,
            flip=0.1 / (1 + row) / (1 + column),
            frame_ms_p50=10.0 * (1 + row),
            oracle_share=0.3 * (1 + row),
        )
        for row, label in enumerate(LABELS)
        for column, budget in enumerate(("50ms", "100ms"))
    ]


def rows_of(plot: Plot) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(plot.csv)))


def texts_of(plot: Plot) -> list[str]:
    return [element.text or "" for element in ElementTree.fromstring(plot.svg).iter("{http://www.w3.org/2000/svg}text")]


def error_plot(key: str = "a") -> Plot:
    made = error_against(key, entries(), ("flip", "lower"), ("frame_ms_p50", "time of a frame, ms"), looks(LABELS))
    assert made is not None
    return made


def test_text_is_text_and_labels_are_as_they_are() -> None:
    found = texts_of(error_plot())
    assert "plain" in found
    assert HOSTILE in found
    assert any(text.endswith("_gain") for text in found)
    assert "time of a frame, ms" in found


def test_a_figure_names_nothing_outside_itself() -> None:
    text = error_plot().svg
    assert set(re.findall(r"https?://[^\"' ]+", text)) <= {"http://www.w3.org/2000/svg", "http://www.w3.org/1999/xlink"}
    assert text.startswith("<svg ")
    assert text.endswith("</svg>")


def test_ids_of_two_figures_differ_and_are_found() -> None:
    first, second = error_plot("a").svg, error_plot("b").svg
    ids = [set(re.findall(r' id="([^"]+)"', text)) for text in (first, second)]
    assert len(ids[0]) > 20
    assert not ids[0] & ids[1]
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', first))
    assert used
    assert used <= ids[0]


def test_drawing_again_gives_the_same_bytes() -> None:
    assert error_plot().svg == error_plot().svg


def test_a_sign_that_no_font_has_is_no_warning() -> None:
    def paint(figure: Any) -> None:
        figure.add_subplot().set_title("\U0001f9ea 漢字")

    assert "漢字" in draw("x", (3, 2), paint)


def test_error_against_cost_marks_what_nothing_beats() -> None:
    plot = error_plot()
    front = {(row["label"], row["budget"]) for row in rows_of(plot) if row["pareto"] == "1"}
    assert front == {(label, "100ms") for label in LABELS}
    assert "3 of them on the Pareto front" in plot.alt
    assert f"the best is {0.1 / 6:.4g}, of plain under 100ms" in plot.alt


def test_a_metric_that_is_better_higher_turns_the_front_round() -> None:
    made = error_against("a", entries(), ("oracle_share", "higher"), ("frame_ms_p50", "ms"), looks(LABELS))
    assert made is not None
    assert {row["label"] for row in rows_of(made) if row["pareto"] == "1"} == set(LABELS)


def test_one_point_is_no_figure() -> None:
    one = [entry("gain", "50ms", flip=0.1, frame_ms_p50=3.0), entry("x", "50ms", flip=0.1)]
    assert error_against("a", one, ("flip", "lower"), ("frame_ms_p50", "ms"), looks(["gain", "x"])) is None


def test_shares_say_every_value_with_its_interval() -> None:
    plot = shares("a", entries(), looks(LABELS))
    assert plot is not None
    row = rows_of(plot)[-1]
    assert (row["label"], float(row["oracle_share"]), float(row["oracle_share_low"])) == ("plain", 0.9, 0.81)
    assert "plain under 50ms 0.90" in plot.alt
    assert shares("a", [entry("gain", "50ms", flip=0.1)], looks(["gain"])) is None


def test_long_names_are_cut_at_their_end_and_paths_at_their_beginning() -> None:
    assert name_text("a name of many words, more than fit") == "a name of many words, more than f…"
    assert path_text("/World" + "/Deeper" * 9 + "/Ball").endswith("/Deeper/Ball")
    assert len(path_text("x" * 99)) == 44
    assert name_text("two\nlines\x1b") == "two lines "


def test_looks_differ() -> None:
    found = looks([str(number) for number in range(80)])
    assert len(set(map(str, found.values()))) == 80
    assert found["0"].colour == COLOURS[0]


# Frames


def frames_table(count: int, spent: Sequence[float], budget: float, left: Sequence[float] | None = None) -> Any:
    return arrow.table(
        {
            "frame": np.arange(count),
            "clock_ms": np.asarray(spent, np.float64),
            "deadline_ms": np.full(count, budget),
            "ray_ms": np.asarray(spent, np.float64) / 2,
            "budget": np.full(count, budget),
            "left": np.zeros(count) if left is None else np.asarray(left, np.float64),
        }
    )


@pytest.mark.parametrize(
    ("kind", "spent", "limit"),
    [("frame_ms", 30.0, 40.0), ("ray_ms", 15.0, 40.0), ("rays", 28.0, 40.0), ("none", 30.0, np.inf)],
)
def test_what_is_spent_is_what_the_budget_bounds(kind: str, spent: float, limit: float) -> None:
    trace = trace_of("gain", kind, frames_table(3, [30.0] * 3, 40.0, [12.0] * 3))
    assert trace.spent.tolist() == [spent] * 3
    assert trace.limit.tolist() == [limit] * 3


def test_late_frames_are_counted() -> None:
    trace = trace_of("gain", "frame_ms", frames_table(4, [30.0, 50.0, 40.0 + 1e-9, 41.0], 40.0))
    assert late_share(trace) == 0.5
    assert late_share(trace_of("gain", "none", frames_table(4, [1.0] * 4, 40.0))) is None


@pytest.mark.parametrize(
    ("effects", "harm"),
    [
        (("shadows", "reflections"), [3.0, 1.0]),
        (("shadows@/lamp", "reflections"), [3.0, 1.0]),
        (("all", "reflections"), [5.0, 1.0]),
    ],
)
def test_what_is_missing_is_worth_its_benefit_however_items_are_made(
    effects: tuple[str, str], harm: list[float]
) -> None:
    truth = {
        "object": ["/a", "/a", "/b"],
        "effect": ["shadows", "reflections", "reflections"],
        "benefit": [3.0, 2.0, 2.0],
    }
    items = {"object": np.array(["/a", "/b"]), "effect": np.array(effects)}
    items |= {"traced_pixels": np.array([0, 5]), "pixel_count": np.array([10, 10])}
    assert harm_of(items, 7, arrow.table(truth | {"frame": [7, 7, 7]})).tolist() == harm


def test_ten_thousand_frames_make_a_small_figure_that_keeps_the_worst() -> None:
    spent = np.random.default_rng(1).normal(30.0, 1.0, 10_000)
    spent[7777] = 99.0
    trace = Trace("gain", np.arange(10_000.0), spent, np.full(10_000, 33.0))
    plot = frame_times("a", "33ms", "ms", [trace], looks(["gain"]))
    assert plot is not None
    assert len(plot.svg) < 120_000
    rows = rows_of(plot)
    assert len(rows) <= 600
    assert max(float(row["highest"]) for row in rows) == 99.0
    assert "every 17 frames" in plot.caption


def test_no_frames_no_figure() -> None:
    assert (
        frame_times("a", "33ms", "ms", [trace_of("gain", "frame_ms", frames_table(0, [], 1.0))], looks(["gain"]))
        is None
    )


# Time lines

FLOOR, BALL = ("/Floor", "shadows"), ("/Ball", "reflections")


def candidates_table(rows: Sequence[tuple[int, tuple[str, str], int, int, float]]) -> Any:
    """frame, item, pixels, traced pixels, share of an earlier frame's values."""
    columns = {
        "frame": arrow.array([row[0] for row in rows]),
        "object": arrow.array([row[1][0] for row in rows]).dictionary_encode(),
        "effect": arrow.array([row[1][1] for row in rows]).dictionary_encode(),
        "pixel_count": arrow.array([row[2] for row in rows]),
        "traced_pixels": arrow.array([row[3] for row in rows]),
        "history_share": arrow.array([row[4] for row in rows]),
    }
    return arrow.table(columns)


def test_a_strip_says_what_became_of_every_item() -> None:
    maker = StripMaker("gain", [FLOOR, BALL], np.arange(4))
    maker.add(candidates_table([(0, FLOOR, 100, 100, 0.0), (0, BALL, 100, 25, 0.0), (1, FLOOR, 100, 0, 0.0)]))
    maker.add(
        candidates_table([(2, ("/Other", "shadows"), 9, 9, 0.0), (2, FLOOR, 100, 0, 0.9), (3, BALL, 100, 60, 0.0)])
    )
    strip = maker.strip()
    assert strip.state.tolist() == [[6, FALLBACK, HELD, ABSENT], [3, ABSENT, ABSENT, 5]]


def test_states_follow_the_traced_share() -> None:
    pixels = np.full(7, 100.0)
    traced = np.array([0.0, 1.0, 25.0, 26.9, 50.0, 75.0, 100.0])
    assert states(pixels, traced, np.zeros(7)).tolist() == [1, 3, 3, 4, 4, 5, 6]


def test_many_frames_share_a_column() -> None:
    maker = StripMaker("gain", [FLOOR], np.arange(1200))
    maker.add(candidates_table([(frame, FLOOR, 100, 100 * (frame % 2), 0.0) for frame in range(1200)]))
    strip = maker.strip()
    assert strip.size == 2
    assert strip.state.tolist() == [[4] * 600]


def test_items_are_ranked_over_all_tables() -> None:
    first, second = (
        candidates_table([(0, BALL, 50, 0, 0.0)]),
        candidates_table([(1, FLOOR, 30, 0, 0.0), (1, BALL, 5, 0, 0.0)]),
    )
    assert most_important([first, second], "pixel_count") == [BALL, FLOOR]
    assert most_important([first, second], "pixel_count", most=1) == [BALL]
    assert most_important([], "pixel_count") == []


def test_time_lines_tell_their_stretches() -> None:
    maker = StripMaker("gain", [FLOOR, ("/" + HOSTILE, "shadows")], np.arange(3))
    maker.add(candidates_table([(0, FLOOR, 9, 9, 0.0), (1, FLOOR, 9, 9, 0.0), (2, FLOOR, 9, 0, 0.0)]))
    plot = time_lines("a", "50ms", "by R", [FLOOR, ("/" + HOSTILE, "shadows")], [maker.strip()])
    assert plot is not None
    rows = [tuple(row.values()) for row in rows_of(plot)]
    assert rows[:2] == [("gain", *FLOOR, "0", "2", "whole"), ("gain", *FLOOR, "2", "1", "fallback")]
    assert rows[2][1] == "/" + HOSTILE
    assert "gain traced these items in 67 % of their frames" in plot.alt
    assert f"/{HOSTILE} · shadows" in texts_of(plot)


def test_lights_of_an_effect_share_its_row() -> None:
    maker = StripMaker("gain", [FLOOR], np.arange(1))
    lights = [(FLOOR[0], "shadows@/Lights/A"), (FLOOR[0], "shadows@/Lights/B")]
    maker.add(candidates_table([(0, lights[0], 100, 100, 0.0), (0, lights[1], 100, 0, 0.0)]))
    assert maker.strip().state.tolist() == [[4]]


def test_whose_items_are_others_is_named() -> None:
    mine, others = (StripMaker(label, [FLOOR], np.arange(2)) for label in ("gain", "by object"))
    mine.add(candidates_table([(0, FLOOR, 9, 9, 0.0)]))
    others.add(candidates_table([(0, (FLOOR[0], "all"), 9, 9, 0.0)]))
    plot = time_lines("a", "50ms", "by R", [FLOOR], [mine.strip(), others.strip()])
    assert plot is not None
    assert plot.caption.endswith("None of them is an item of by object.")


def test_nothing_in_view_is_no_figure() -> None:
    assert time_lines("a", "50ms", "by R", [FLOOR], [StripMaker("gain", [FLOOR], np.arange(3)).strip()]) is None


# Costs


def cost_table(rows: Sequence[tuple[int, int, int, float, float, float]]) -> Any:
    values = np.array(rows, np.float64)
    return arrow.table(dict(zip(COST_COLUMNS, values.T, strict=True)))


def test_predictions_are_summed_by_frame_for_what_was_traced() -> None:
    maker = CostMaker("gain", "50ms")
    maker.add(cost_table([(0, 10, 10, 2.0, 1.0, 3.0), (0, 10, 5, 2.0, 6.0, 2.0), (0, 10, 0, 0.0, 50.0, 50.0)]))
    maker.add(cost_table([(1, 10, 10, 1.0, 1.0, np.nan)]))
    found = maker.costs()
    assert found.frame.tolist() == [0, 1]
    assert found.actual.tolist() == [4.0, 1.0]
    assert found.predicted["predicted_ms_measured"].tolist() == [4.0, 1.0]
    assert found.predicted["predicted_ms_paper"].tolist() == [4.0, 0.0]
    plot = predictions("a", [found], looks(["gain"]))
    assert plot is not None
    assert "measured 0 %, paper 50 %" in plot.caption


def test_thousands_of_frames_become_a_picture_in_the_figure() -> None:
    random = np.random.default_rng(2)
    makers = [CostMaker(f"h{number}", "50ms") for number in range(3)]
    for maker in makers:
        actual = random.uniform(5, 20, 5000)
        ones = np.ones(5000)
        maker.add(cost_table(np.column_stack([np.arange(5000), ones, ones, actual, actual, actual * 1.1]).tolist()))
    plot = predictions("a", [maker.costs() for maker in makers], looks([f"h{number}" for number in range(3)]))
    assert plot is not None
    assert "data:image/png;base64," in plot.svg
    assert len(plot.svg) < 300_000
    assert len(rows_of(plot)) == 1200


def test_nothing_traced_is_no_figure() -> None:
    assert predictions("a", [CostMaker("gain", "50ms").costs()], looks(["gain"])) is None


# Tables


def test_csv_quotes_what_needs_it() -> None:
    text = table_csv(("a", "b"), [('say "x", y', 0.1), (None, float("nan")), ("line\nbreak", 3)])
    assert list(csv.reader(io.StringIO(text))) == [["a", "b"], ['say "x", y', "0.1"], ["", ""], ["line\nbreak", "3"]]


def test_the_long_table_becomes_entries() -> None:
    row: dict[str, Any] = {
        "setup": "s", "scene": "court", "size": "64x36", "tracer": "embree", "gbuffer": "raycast", "clock": "wall",
        "budget": "half", "budget_kind": "rays", "budget_amount": float("nan"), "label": "gain", "state": "ok",
        "unit": None, "better": "lower", "value": 0.1, "low": None, "high": 0.2,
    }  # fmt: skip
    found = entries_of([row | {"metric": "flip"}, row | {"metric": "ssim", "budget_amount": float("nan")}])
    assert len(found) == 1
    assert found[0].value("flip") == 0.1
    assert np.isnan(found[0].values["ssim"].low)
    assert np.isnan(found[0].value("nothing"))
    assert found[0].values["flip"].unit == ""
