"""The tracer as the reference of a comparison: `phrt bench` compares with what it path traces."""

from __future__ import annotations

import json
from pathlib import Path

import needs
import numpy as np
import pytest
from run_bench_kit import CONFIG, cells, table, write_config
from scene_kit import LAMBERT, Stage, ball, psnr

from phrt.registry import get_registry
from phrt.world import World
from phrt_mitsuba.availability import unavailable_reason
from phrt_mitsuba.paths import PathTracer
from phrt_plugins.bench import compare

pytestmark = needs.all_need(unavailable_reason())


def test_the_tracer_path_traces_without_being_built() -> None:
    scene = (
        Stage(dome=(1.0, 1.0, 1.0)).add("/ball", ball(0.8), LAMBERT).camera((0, 0, 3), (0, 0, 0), exposure=2.0).scene
    )
    world = World(scene)
    tracer = get_registry().create("tracer", "mitsuba")
    try:
        image = tracer.render_paths(world, world.view(16, 12), samples=16, max_depth=4)
        assert tracer.render_paths(world, world.view(4, 4), samples=7, max_depth=2).shape == (4, 4, 3)
        with PathTracer() as paths:
            wanted = paths.render(world, world.view(16, 12), samples=16, max_depth=4)
    finally:
        tracer.close()
    np.testing.assert_allclose(image, wanted, rtol=1e-4, atol=1e-5)
    assert image[6, 8].mean() == pytest.approx(1.0, rel=0.05)
    assert image[0, 0].mean() == pytest.approx(2.0, rel=1e-3)
    assert "mitsuba" in tracer.capabilities.path_tracer.lower()


def test_a_comparison_is_judged_by_it(tmp_path: Path) -> None:
    write_config(tmp_path)
    config = {
        name: CONFIG[name] for name in ("tracers", "gbuffers", "clock", "block", "warm_up", "judge_every", "metrics")
    }
    for resume in (False, True):
        compare(
            tmp_path / "balls.yaml", ["all_trace", "raster_only"], frames="0:4", size="64x36", folder=tmp_path / "run",
            resume=resume, cache=tmp_path / "cache", reference={"tracer": "mitsuba", "samples": 4, "max_depth": 4}, **config,
        )  # fmt: skip
    about = json.loads((tmp_path / "run" / "bench.json").read_text())
    (setup,) = about["plan"]["setups"]
    assert setup["reference"]["version"].startswith("Mitsuba 3")
    assert "tracer/mitsuba" in setup["plugins"]
    found = {
        label: table(folder / "block-000" / "measures.parquet") for label, folder in cells(tmp_path / "run").items()
    }
    # Everything traced is not what path tracing shows.
    assert found["all_trace"]["all_trace_error"] == [0.0, 0.0]
    assert min(found["raster_only"]["all_trace_error"]) > 0.0
    for measures in found.values():
        assert 0.005 < min(measures["display_error"]) < 0.1


def test_the_reference_shows_the_same_scene(tmp_path: Path) -> None:
    from phrt_plugins.bench.checks import checked_plan
    from phrt_plugins.bench.reading import read_config
    from phrt_plugins.bench.references import References
    from phrt_plugins.bench.scenes import open_renderer

    reference = {"tracer": "mitsuba", "samples": 16, "max_depth": 6}
    (setup,) = checked_plan(read_config(write_config(tmp_path, reference=reference))).setups
    block = setup.blocks()[0]
    with open_renderer(setup, base=True) as renderer:
        picture = References(tmp_path / "cache").make(setup, block, lambda: renderer)[1]
    assert picture.traced_display is not None
    shown, traced = picture.display / np.float32(255), picture.traced_display / np.float32(255)
    same = psnr(shown, traced)
    assert same > 18
    assert psnr(shown[::-1], traced) < same - 5
    assert psnr(shown[:, ::-1], traced) < same - 3
