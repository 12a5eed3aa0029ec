"""What is used when nobody names a plugin, and the reason that is shown."""

from __future__ import annotations

import pytest

from phrt.registry import LoaderPlugin, Registry, TracerPlugin, get_registry
from phrt.registry.defaults import Defaults


def defaults(**reasons: str | None) -> tuple[Registry, Defaults]:
    """Of a registry with these tracers, each with the reason why it cannot run, and two loaders."""
    registry = Registry()
    for name, reason in reasons.items():
        registry.register(TracerPlugin(name, "", "m:C", unavailable_reason=lambda reason=reason: reason), owner=name)
    for name in ("one", "two"):
        registry.register(LoaderPlugin(name, "", "m:C", suffixes=(f".{name}", ".both")), owner=name)
    return registry, Defaults.find(registry)


def test_what_auto_stands_for_is_said_with_what_was_passed_over() -> None:
    registry, found = defaults(embree="no wheel", open3d="no libusb", numpy=None)
    numpy, embree = registry.find("tracer", "numpy"), registry.find("tracer", "embree")
    assert (found.use_of(numpy), found.use_of(embree)) == ("auto", "")
    assert found.reason_of(numpy) == (
        "yes, `auto` is numpy here: embree is not available: no wheel; open3d is not available: no libusb; numpy is available"
    )
    assert found.reason_of(embree) == ""


def test_where_nothing_can_run_the_reason_stands_alone_and_nothing_is_raised() -> None:
    registry, found = defaults(embree="a", open3d="b", numpy="c")
    assert found.tracer.name == ""
    assert found.lines({"tracer"}) == [
        "tracer: none: no tracer is available: embree is not available: a; open3d is not available: b; numpy is not available: c"
    ]
    assert all(found.use_of(entry) == "" for entry in registry.plugins("tracer"))
    assert found.gbuffer.name == ""  # this registry has none
    assert "there is no gbuffer 'moderngl'" in found.gbuffer.reason


def test_loaders_are_defaults_for_endings_and_what_two_claim_is_nobody_s() -> None:
    registry, found = defaults()
    assert found.use_of(registry.find("loader", "one")) == ".one"
    assert found.reason_of(registry.find("loader", "two")) == "yes, for files that end in .two"
    assert found.lines({"loader"}) == ["loaders, by a file's ending: one .one; two .two"]
    assert found.as_json()["files"] == {".both": "", ".one": "one", ".two": "two"}


@pytest.mark.parametrize(("kind", "name"), [("heuristic", "all_trace"), ("effect", "shadows"), ("loader", "gltf")])
def test_fixed_defaults_have_a_reason(kind: str, name: str) -> None:
    found = Defaults.find(get_registry())
    assert found.reason_of(get_registry().find(kind, name)).startswith("yes, ")
    assert found.reason_of(get_registry().find("heuristic", "gain")) == ""
