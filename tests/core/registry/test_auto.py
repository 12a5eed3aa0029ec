"""What `auto` picks, from fixed lists, with a reason that names what was passed over."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from phrt.errors import PluginError
from phrt.registry import Device, GBufferPlugin, Registry, TracerPlugin
from phrt.registry.auto import choose_gbuffer, choose_tracer


def tracers(**reasons: str | None) -> Registry:
    """A registry of tracers, each with the reason why it cannot run."""
    registry = Registry()
    for name, reason in reasons.items():
        plugin = TracerPlugin(name, "", "m:C", unavailable_reason=lambda reason=reason: reason)
        registry.register(plugin, owner=name)
    return registry


def gbuffers(device: Callable[[], Device | None], reason: str | None = None) -> Registry:
    registry = Registry()
    plugin = GBufferPlugin("moderngl", "", "m:C", device=device, unavailable_reason=lambda: reason)
    registry.register(plugin, owner="moderngl")
    registry.register(GBufferPlugin("raycast", "", "m:C", needs_tracer=True), owner="raycast")
    return registry


def test_the_fastest_tracer_that_is_available_is_taken() -> None:
    assert choose_tracer(tracers(numpy=None, open3d=None, embree=None)).name == "embree"
    choice = choose_tracer(tracers(numpy=None, open3d=None, embree="no embreex"))
    assert choice.name == "open3d"
    assert choice.reason == "embree is not available: no embreex; open3d is available"


def test_no_tracer_at_all_is_an_error_with_every_reason() -> None:
    with pytest.raises(PluginError, match=r"no tracer is available: embree .*: a; open3d .*: b; numpy .*: c"):
        choose_tracer(tracers(numpy="c", open3d="b", embree="a"))


def test_a_tracer_that_was_installed_is_never_picked() -> None:
    assert choose_tracer(tracers(aaa_fastest=None, numpy=None, open3d="b", embree="a")).name == "numpy"


def test_moderngl_is_taken_on_a_gpu_only() -> None:
    on_gpu = choose_gbuffer(gbuffers(lambda: Device("Quadro", True)))
    assert (on_gpu.name, on_gpu.reason) == ("moderngl", "moderngl draws on a GPU (Quadro)")
    on_processor = choose_gbuffer(gbuffers(lambda: Device("llvmpipe", False)))
    assert (on_processor.name, on_processor.reason) == ("raycast", "moderngl would not draw on a GPU (llvmpipe)")


def test_without_opengl_it_is_raycast_and_the_reason_says_what_to_install() -> None:
    choice = choose_gbuffer(gbuffers(lambda: None, reason="apt install libegl1"))
    assert (choice.name, choice.reason) == ("raycast", "moderngl is not available: apt install libegl1")


def test_a_device_that_cannot_be_asked_is_no_gpu() -> None:
    def broken() -> Device | None:
        raise OSError("driver crashed")

    choice = choose_gbuffer(gbuffers(broken))
    assert choice.name == "raycast"
    assert "driver crashed" in choice.reason
