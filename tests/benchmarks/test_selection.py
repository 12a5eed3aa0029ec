"""Row 9 runs real heuristics on made-up work, and counts what is not the waves' time. No test looks at a time."""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import pytest

from phrt.errors import PluginError


@pytest.mark.parametrize("count", [1, 3, 1000])
def test_made_up_items_own_disjoint_pixels_and_their_letters_keep_to_the_equations(module, count):
    selection = module("selection")
    work = selection.Made(count).work
    assert len(work.candidates) == len(work.units) == count
    for effect, pixels in enumerate(work.pixels):
        mine = work.units.effect == effect
        owned = np.concatenate(
            [np.zeros(0, int)]
            + [pixels[f : f + c] for f, c in zip(work.units.first[mine], work.units.count[mine], strict=True)]
        )
        assert sorted(owned) == list(range(len(pixels)))
    c = work.candidates
    assert len(np.unique(c.keys())) == count
    assert c.cost == pytest.approx(c.visibility * c.ray_estimate)
    assert c.relevance == pytest.approx((c.was_selected * c.persistence + c.visibility) * c.importance_factor)
    assert (c.predicted_cost > 0).all()


def test_frames_take_turns_with_other_letters_of_the_same_items(module):
    first, second = module("selection").Made(50).frames[:2]
    assert np.array_equal(first.candidates.keys(), second.candidates.keys())
    assert not np.array_equal(first.candidates.relevance, second.candidates.relevance)


def test_half_of_the_work_is_traced(module):
    selection = module("selection")
    made = selection.Made(400)
    done = selection.decide("greedy_relevance", made, 3)
    assert done.count == 400
    assert len(done.milliseconds) == 3
    assert 0 < done.traced < 400
    assert done.waves > 0
    assert selection.decide("raster_only", made, 1).traced == 0


def test_a_heuristic_that_fails_has_no_figure(module, monkeypatch):
    from phrt_heuristics.random_order import RandomOrder

    def broken(self, candidates, context):
        raise RuntimeError("no luck")

    monkeypatch.setattr(RandomOrder, "begin_frame", broken)
    selection = module("selection")
    with pytest.raises(PluginError, match="no luck"):
        selection.decide("random", selection.Made(10), 1)


def test_growth_is_1_for_n_log_n_and_more_for_more(module):
    selection = module("selection")

    def entries(name, power):
        return [
            selection.Deciding(name, n, (1e-6 * n**power * np.log2(n),) * 3, 0.0, 1, 1) for n in (1000, 10_000, 100_000)
        ]

    found = entries("fair", 1) + entries("square", 2)
    assert selection.growth(found) == {"fair": pytest.approx(1.0), "square": pytest.approx(10.0)}
    rows = selection.selection_rows(found)
    assert [(row.number, row.limit) for row in rows] == [(9, 5.0), (9, 5.0), (9, 1.5)]
    assert rows[0].median == pytest.approx(1e-6 * 10_000 * np.log2(10_000))
    assert rows[0].met
    assert rows[2].what.strip().startswith("growth to 100,000 / n log n: square")
    assert rows[2].met is False


def test_every_heuristic_is_measured_at_every_size(module):
    selection = module("selection")
    said: list[str] = []
    found = selection.measure(["random", "uniform"], (20, 60), 1, progress=said.append)
    assert [(entry.heuristic, entry.count) for entry in found] == [
        ("random", 20), ("uniform", 20), ("random", 60), ("uniform", 60),
    ]  # fmt: skip
    assert len(said) == 4
    assert json.loads(json.dumps([asdict(entry) for entry in found]))[3]["count"] == 60
    assert selection.table(found).row_count == 2
