"""Cost memory: kept from run to run, and never in the way."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from phrt.cost_memory import KEPT_RUNS, recall, remember, run_key

KNOWN = {"shadows": {"ms_per_item": 0.01, "ms_per_ray": 5e-5}}


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("PHRT_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache" / "costs.json"


def test_what_is_remembered_is_recalled_for_the_same_run_only() -> None:
    key = run_key("atrium", "embree", 2)
    assert recall(key) == {}
    remember(key, KNOWN)
    assert recall(key) == KNOWN
    assert recall(run_key("atrium", "embree", 4)) == {}
    assert recall(run_key("spheres", "embree", 2)) == {}


def test_the_newest_runs_are_kept(cache: Path) -> None:
    for number in range(KEPT_RUNS + 3):
        remember(f"run {number}", KNOWN)
    assert len(json.loads(cache.read_text())["runs"]) == KEPT_RUNS
    assert recall("run 0") == {}
    assert recall(f"run {KEPT_RUNS + 2}") == KNOWN


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[]",
        "null",
        '{"phrt_costs": 9, "runs": {"a run": {}}}',
        '{"phrt_costs": 1, "runs": []}',
        '{"phrt_costs": 1, "runs": {"a run": 3}}',
        '{"phrt_costs": 1, "runs": {"a run": {"effects": {"shadows": {"ms_per_item": -1, "ms_per_ray": 1}}}}}',
        '{"phrt_costs": 1, "runs": {"a run": {"effects": {"shadows": {"ms_per_item": NaN, "ms_per_ray": 1}}}}}',
        '{"phrt_costs": 1, "runs": {"a run": {"effects": {"shadows": {"ms_per_ray": 1}}}}}',
        "[" * 100_000,
    ],
)
def test_a_broken_file_is_as_good_as_none(cache: Path, text: str) -> None:
    cache.parent.mkdir(parents=True)
    cache.write_text(text)
    assert recall("a run") == {}
    remember("a run", KNOWN)
    assert recall("a run") == KNOWN


def test_a_folder_that_cannot_be_made_costs_nothing_but_the_memory(cache: Path) -> None:
    cache.parent.write_text("a file where the folder should be")
    remember("a run", KNOWN)
    assert recall("a run") == {}
