"""The heuristic: its contract, the equations it is made of, and how it follows the picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from phrt_saliency.heuristic import Saliency, settling, weighed
from phrt_saliency.options import SaliencyOptions

from phrt.errors import OptionError, PluginError
from phrt.interfaces.heuristic import PASSES, Candidates, Heuristic
from phrt.registry import Options, get_registry
from phrt.testing import check_heuristic
from phrt.testing.candidates import OBJECTS, candidates, context, items_of, one_frame
from phrt.testing.pictures import StripedPicture
from phrt_heuristics.greedy_ratio import GreedyRatio
from phrt_heuristics.greedy_relevance import GreedyRelevance

VARIANTS: list[dict[str, Any]] = [
    {},
    {"choose": "relevance"},
    {"choose": "ratio"},
    {"place": False},
    {"weight": 0.3, "settle_frames": 0.0},
    {"map_width": 32, "intensity": 0.0, "orientation": 0.0},
]
works = st.lists(st.tuples(st.integers(1, 50), st.integers(0, 8), st.booleans()), max_size=30)


def made(**options: Any) -> Saliency:
    return Saliency(SaliencyOptions(**options))


def made_of(items: list[tuple[int, int, bool]]) -> Candidates:
    return candidates([float(c) for c, _, _ in items], [r for _, r, _ in items], [m for _, _, m in items])


def lit(*objects: int, color: tuple[float, float, float] = (0.9, 0.9, 0.9)) -> StripedPicture:
    """Grey stripes, one an object; those of `objects` have `color`."""
    colors = np.full((OBJECTS, 3), 0.2, np.float32)
    colors[np.array(objects, np.int64) - 1] = color
    return StripedPicture(OBJECTS, colors)


def relevance_after(heuristic: Saliency, work: Candidates, *pictures: StripedPicture, samples: int = 1) -> np.ndarray:
    """A'/A of the items' objects after a frame of each picture."""
    for index, raster in enumerate(pictures):
        for sample in range(samples):
            heuristic.begin_frame(work, context(1.0, index, raster=raster, sample=sample, samples=samples))
            heuristic.end_frame()
    return heuristic._ratio[work.object_id]


# The contract, as the built-in ones keep it


@pytest.mark.parametrize("options", VARIANTS)
def test_it_keeps_the_contract(options: dict[str, Any]) -> None:
    check_heuristic("saliency", options, cases=40)


@pytest.mark.parametrize("options", VARIANTS)
@settings(deadline=None, max_examples=30)
@given(items=works)
def test_with_no_limit_everything_is_traced(options: dict[str, Any], items: list[tuple[int, int, bool]]) -> None:
    passes = np.zeros(len(items), int)
    for item, count in one_frame(made(**options), made_of(items)):
        passes[item] += count
    assert (passes == PASSES).all()


def test_no_candidate_one_candidate_and_all_equal() -> None:
    heuristic = made()
    assert one_frame(heuristic, candidates([])) == []
    assert items_of(heuristic, candidates([5.0]), 5.0) == [0]
    assert items_of(heuristic, candidates([5.0]), 1.0) == []
    assert len(items_of(heuristic, candidates([5.0] * 20, np.zeros(20)), 50.0)) == 10


@pytest.mark.parametrize("choose", ["ratio", "relevance", "levels"])
@settings(deadline=None, max_examples=40)
@given(items=works, budget=st.integers(0, 600).map(float), share=st.sampled_from([0.0, 0.3, 1.0]))
def test_many_at_once_are_the_same_as_one_by_one(
    choose: str, items: list[tuple[int, int, bool]], budget: float, share: float
) -> None:
    work = made_of(items)
    expected = one_frame(made(choose=choose), work, budget)
    heuristic, remaining, found = made(choose=choose), budget, []
    heuristic.begin_frame(work, context(budget))
    while (taken := heuristic.take(remaining, share * remaining)) is not None and len(taken):
        table = taken if taken.ndim == 2 else np.stack([taken, np.full(len(taken), PASSES)], axis=1)
        assert len(np.unique(table[:, 0])) == len(table)
        for item, passes in table.tolist():
            found.append((item, passes))
            remaining -= float(work.predicted_cost[item]) * passes / PASSES
    assert found == expected


def test_nothing_is_chosen_before_the_first_frame() -> None:
    assert made().next(np.inf) is None
    assert made().take(np.inf, np.inf) is None


# The equations


def alone(heuristic: Heuristic, work: Candidates, raster: StripedPicture) -> list[int]:
    """The items of one frame, in order, within half of what all of them cost."""
    budget = float(work.predicted_cost.sum()) / 2
    return [item for item, _ in one_frame(heuristic, work, budget, raster=raster)]


@pytest.mark.parametrize(("choose", "plain"), [("ratio", GreedyRatio), ("relevance", GreedyRelevance)])
@settings(deadline=None, max_examples=40)
@given(items=works)
def test_it_is_the_plain_rule_by_weight_zero_and_where_nothing_stands_out(
    choose: str, plain: type, items: list[tuple[int, int, bool]]
) -> None:
    work = made_of(items)
    expected = alone(plain(Options()), work, lit(3))
    assert alone(made(choose=choose, weight=0.0), work, lit(3)) == expected
    assert alone(made(choose=choose), work, lit()) == expected


def test_relevance_is_the_paper_s_with_the_area_counted_in_saliency() -> None:
    random = np.random.default_rng(4)
    area, closeness, distance, importance = random.random((4, 6)).astype(np.float32) + np.float32(0.1)
    selected, visible = np.array([1, 0, 1, 0, 1, 0], bool), area * closeness / distance
    work = candidates(
        np.full(6, 10.0), (selected * np.float32(0.05) + visible) * importance, area=area, center_closeness=closeness,
        distance=distance, importance_factor=importance, was_selected=selected, persistence=0.05, visibility=visible,
    )  # fmt: skip
    ratio = np.concatenate([[9.0], random.random(6) * 4]).astype(np.float32)
    for weight in (0.0, 0.5, 1.0):
        counted = area * (1 - weight + weight * ratio[1:])
        expected = (selected * 0.05 + counted * closeness / distance) * importance
        np.testing.assert_allclose(weighed(work, ratio, weight), expected, rtol=1e-5)
        anywhere = (selected * 0.05 + counted) * importance
        np.testing.assert_allclose(weighed(work, ratio, weight, place=False), anywhere, rtol=1e-5)


def test_the_shares_of_all_objects_are_the_whole_saliency() -> None:
    work = candidates(np.full(OBJECTS, 1.0))
    ratio = relevance_after(made(), work, lit(5, 20, color=(0.8, 0.1, 0.1)))
    # All stripes are equally wide: A is 1 / OBJECTS of each.
    assert float(ratio.sum()) == pytest.approx(OBJECTS, rel=1e-3)


def test_what_stands_out_comes_first() -> None:
    work = candidates(np.full(OBJECTS, 10.0))
    assert set(items_of_picture(made(), work, lit(9), 20.0)) >= {8}
    assert set(items_of_picture(made(), work, lit(24, color=(0.9, 0.1, 0.1)), 20.0)) >= {23}


def items_of_picture(heuristic: Saliency, work: Candidates, raster: StripedPicture, budget: float) -> list[int]:
    return [item for item, _ in one_frame(heuristic, work, budget, raster=raster)]


def test_ratio_looks_at_the_price_and_relevance_does_not() -> None:
    cost = np.full(OBJECTS, 10.0)
    cost[8] = 1000.0
    work = candidates(cost)
    assert items_of_picture(made(choose="relevance"), work, lit(9), 1000.0)[0] == 8
    assert items_of_picture(made(choose="ratio"), work, lit(9), 1000.0)[0] != 8


def test_color_alone_does_not_see_brightness() -> None:
    work = candidates(np.full(OBJECTS, 10.0))
    blind = relevance_after(made(intensity=0, orientation=0), work, lit(9))
    np.testing.assert_array_equal(blind, 1.0)
    assert relevance_after(made(color=0, orientation=0), work, lit(9))[8] > 2


# From frame to frame


def test_saliency_follows_half_of_a_change_in_the_frames_it_is_told_to() -> None:
    work = candidates(np.full(OBJECTS, 10.0))
    before, after = relevance_after(made(), work, lit(9)), relevance_after(made(), work, lit(24))
    followed = relevance_after(made(settle_frames=3.0), work, lit(9), *[lit(24)] * 3)
    np.testing.assert_allclose(followed, (before + after) / 2, rtol=1e-4, atol=1e-4)
    at_once = relevance_after(made(settle_frames=0.0), work, lit(9), lit(24))
    np.testing.assert_allclose(at_once, after, rtol=1e-5)
    assert settling(0.0) == 1.0


def test_what_comes_into_view_is_believed_at_once() -> None:
    work = candidates(np.full(OBJECTS, 10.0))
    without = replace_rows(work, np.arange(OBJECTS) != 23)
    heuristic = made(settle_frames=50.0)
    relevance_after(heuristic, without, lit(24))
    heuristic._ratio[24] = 0.0
    assert relevance_after(heuristic, work, lit(24))[23] == relevance_after(made(), work, lit(24))[23]


def replace_rows(work: Candidates, kept: np.ndarray) -> Candidates:
    columns = {name: value[kept] for name, value in vars(work).items() if isinstance(value, np.ndarray)}
    return replace(work, **columns)


def test_sub_pixel_samples_count_as_one_frame() -> None:
    work = candidates(np.full(OBJECTS, 10.0))
    pictures = lit(9), lit(24), lit(24)
    one = relevance_after(made(), work, *pictures)
    np.testing.assert_array_equal(relevance_after(made(), work, *pictures, samples=4), one)


def test_another_scene_begins_anew() -> None:
    class Smaller(StripedPicture):
        def object_means(self, values: np.ndarray) -> np.ndarray:
            return super().object_means(values)[:4]

    work, heuristic = candidates(np.full(3, 10.0)), made(settle_frames=100.0)
    relevance_after(heuristic, work, lit(9))
    small = Smaller(OBJECTS, lit(2)._colors)
    assert relevance_after(heuristic, work, small)[1] == relevance_after(made(), work, small)[1]


# Options and mistakes


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"weight": 1.5}, "option 'weight'"),
        ({"map_width": 8}, "option 'map_width'"),
        ({"settle_frames": -1}, "option 'settle_frames'"),
        ({"choose": "price"}, "option 'choose'"),
        ({"intensity": 0, "color": 0, "orientation": 0}, "one of intensity, color, orientation must be above 0"),
        ({"wieght": 1}, "wieght"),
    ],
)
def test_options_that_cannot_be_are_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        get_registry().create("heuristic", "saliency", options)


def test_without_a_picture_it_says_what_is_missing() -> None:
    with pytest.raises(PluginError, match="made by hand and has no raster picture"):
        made().begin_frame(candidates([1.0]), context(raster=None))


def test_its_manual_page_has_its_options_source_and_an_example() -> None:
    import phrt_saliency.heuristic as page

    text = page.__doc__ or ""
    assert text.startswith("saliency: ")
    for part in ("Options: ", "Source: ", "Example::", "--heuristic saliency", *SaliencyOptions.model_fields):
        assert part in text


def test_its_page_has_every_option_with_its_default() -> None:
    page = (Path(__file__).resolve().parents[3] / "docs" / "packages" / "saliency.md").read_text()
    for name, field in SaliencyOptions.model_fields.items():
        row = next(line for line in page.splitlines() if line.startswith("| `") and f"`{name}`" in line.split(" | ")[0])
        default = field.default
        assert f"| {default:g}" in row if isinstance(default, float) else f"| {default}".lower() in row.lower(), name
