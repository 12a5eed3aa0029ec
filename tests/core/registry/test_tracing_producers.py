"""A G-buffer producer of others that traces gets the same from the renderer and from `phrt doctor`: what the documentation says."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from scene_kit import LAMBERT, Stage, at, ball, render

from phrt.cli.doctor import check
from phrt.interfaces.tracer import Tracer
from phrt.registry import GBufferPlugin, Options, get_registry
from phrt.workers import Workers
from phrt_backends.gbuffers.raycast import RaycastProducer
from phrt_backends.gbuffers.raycast_options import RaycastOptions


class TracingProducer(RaycastProducer):
    """Takes what the documentation says, by name and without defaults."""

    def __init__(self, options: Options, *, tracer: Tracer, workers: Workers) -> None:
        assert type(options) is Options
        super().__init__(RaycastOptions(), tracer=tracer, workers=workers)


@pytest.fixture
def tracing() -> Iterator[str]:
    plugin = GBufferPlugin("tracing", "For this test.", f"{__name__}:TracingProducer", needs_tracer=True)
    get_registry().register(plugin, owner="test_tracing_producers")
    yield plugin.name
    get_registry()._forget("test_tracing_producers")


def test_doctor_tries_it_with_tracer_and_workers(tracing: str) -> None:
    finding = check(get_registry(), get_registry().find("gbuffer", tracing), "numpy")
    assert (finding.works, finding.note) == (True, "rays by numpy")


def test_the_renderer_makes_it_with_tracer_and_workers(tracing: str) -> None:
    stage = Stage().add("/ball", ball(0.5, 1), LAMBERT, at(0, 0, 0)).camera((0, 0, 3), (0, 0, 0))
    frame = render(stage.scene, (16, 16), gbuffer=tracing, tracer="numpy")
    assert frame.gbuffer.object_id[8, 8] == 1
