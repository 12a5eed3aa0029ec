"""`compare`: the harness for Python."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from run_bench_kit import write_config
from scene_kit import PLAIN_FALLBACKS

from phrt.errors import OptionError
from phrt.registry import HeuristicPlugin, get_registry, register
from phrt_plugins.bench import CompareError, compare
from phrt_plugins.bench import __dict__ as names

COMMON: dict[str, Any] = {
    "size": (64, 36),
    "clock": {"rays": 100},
    "block": 4,
    "warm_up": 1,
    "judge_every": 2,
    "metrics": ["error"],
    "tracers": ["embree"],
    "gbuffers": ["raycast"],
}


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    write_config(tmp_path)
    return tmp_path / "balls.yaml"


def test_a_frame_of_results_comes_back(scene: Path, tmp_path: Path) -> None:
    table = compare(
        {"scene": str(scene), "frames": "0:4", "effects": PLAIN_FALLBACKS},
        ["all_trace", {"heuristic": "raster_only", "label": "bare"}],
        cache=tmp_path / "c",
        **COMMON,
    )
    errors = table[table.metric == "display_error"].set_index("label")
    assert errors.loc["all_trace", "value"] == 0.0
    assert errors.loc["bare", "value"] > 0.002
    assert set(errors.frames) == {2}
    assert not (tmp_path / "run").exists()


def test_everything_can_be_kept(scene: Path, tmp_path: Path) -> None:
    options = COMMON | {
        "folder": tmp_path / "run",
        "cache": tmp_path / "c",
        "frames": "0:4",
        "budgets": ["half", "9rays"],
    }
    compare(scene, ["gain"], **options)
    assert (tmp_path / "run" / "summary.csv").exists()
    assert len(list((tmp_path / "run" / "cells").iterdir())) == 2
    with pytest.raises(OptionError, match="it holds a benchmark already"):
        compare(scene, ["gain"], **options)
    assert len(compare(scene, ["gain"], resume=True, **options)) > 0


def test_what_cannot_be_is_said(scene: Path) -> None:
    with pytest.raises(OptionError, match=r"heuristics\[0\]\.heuristic: there is no heuristic 'gane'"):
        compare(scene, ["gane"], **COMMON)
    with pytest.raises(OptionError, match="unknown key 'budget'"):
        compare(scene, ["gain"], budget="50ms", **COMMON)


def test_a_cell_that_fails_is_named(scene: Path, tmp_path: Path) -> None:
    register(HeuristicPlugin(name="grumpy", summary="Raises.", factory=f"{__name__}:Grumpy"), "grumpy")
    try:
        with pytest.raises(CompareError, match=r"(?s)1 parts of the comparison failed.*grumpy.*leave me alone"):
            compare(scene, ["grumpy", "raster_only"], frames="0:4", cache=tmp_path / "c", **COMMON)
    finally:
        get_registry()._forget("grumpy")


class Grumpy:
    """A heuristic that raises."""

    def __new__(cls, options: Any) -> Any:
        from phrt_heuristics.raster_only import RasterOnly

        class Made(RasterOnly):
            def begin_frame(self, candidates: Any, context: Any) -> None:
                raise RuntimeError("leave me alone")

        return Made(options)


def test_the_package_has_what_it_says() -> None:
    import phrt_plugins.bench

    assert set(names["__all__"]) == {"compare", "CompareError"}
    with pytest.raises(AttributeError, match="no attribute 'compute'"):
        phrt_plugins.bench.compute  # noqa: B018
