"""Plugins: loaded one by one, found by name, refused with a reason."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import needs
import pytest
from pydantic import Field

from phrt.errors import OptionError, PhrtWarning, PluginError
from phrt.registry import (
    OLDEST_API_VERSION,
    PLUGIN_API_VERSION,
    CommandPlugin,
    HeuristicPlugin,
    LoaderPlugin,
    Options,
    Registry,
    TracerPlugin,
    descriptors,
    get_registry,
    hookimpl,
)
from phrt.registry.manager import CORE_COMMANDS, KINDS


class KnobOptions(Options):
    samples: int = Field(4, ge=1, le=64, description="rays per pixel")
    mode: Literal["none", "probe"] = Field("none", description="what else")
    radius: float = Field(1.0, gt=0, description="metres")


class Made:
    def __init__(self, options: Options, **dependencies: object) -> None:
        self.options, self.dependencies = options, dependencies


class Failing:
    def __init__(self, options: Options) -> None:
        raise RuntimeError("the device is on fire")


def tracer(name: str, factory: str = f"{__name__}:Made", **more: Any) -> TracerPlugin:
    return TracerPlugin(name=name, summary="a tracer", factory=factory, **more)


def module(name: str, **members: object) -> ModuleType:
    """A plugin module that is importable under `name` until the test ends."""
    made = ModuleType(name)
    vars(made).update(members)
    return made


def hooks(*plugins: Any, hook: str = "phrt_tracers") -> dict[str, object]:
    """The hook function that returns `plugins`, as a module member."""

    def function() -> list[Any]:
        return list(plugins)

    function.__name__ = hook
    return {hook: hookimpl(function)}


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Offers modules as entry points: install({"package": module}) -> a registry that loaded them in that order."""

    def load(packages: dict[str, ModuleType | str], registry: Registry | None = None) -> Registry:
        registry = registry or Registry()
        points = []
        for name, plugin in packages.items():
            if isinstance(plugin, ModuleType):
                monkeypatch.setitem(sys.modules, plugin.__name__, plugin)
            points.append(EntryPoint(name, plugin if isinstance(plugin, str) else plugin.__name__, "phrt"))
        registry.load_entry_points(points)
        return registry

    return load


# Finding and making


def test_built_in_plugins_are_all_there() -> None:
    names = {kind: get_registry().names(kind) for kind in KINDS}
    assert names["gbuffer"] == ["moderngl", "raycast"]
    assert names["tracer"] == ["embree", "numpy", "open3d"]
    assert names["effect"] == ["shadows", "reflections", "refractions", "ambient_occlusion"]
    assert names["heuristic"] == [
        "all_trace",
        "gain",
        "greedy_ratio",
        "greedy_relevance",
        "random",
        "raster_only",
        "round_robin",
        "selection_graph",
        "uniform",
    ]
    assert names["loader"] == ["atrium", "gltf", "mesh", "simplified"]
    assert names["metric"] == ["costs", "error", "flip", "flips", "pacing", "psnr", "relmse", "ssim", "temporal"]
    assert get_registry().broken == []


def test_every_built_in_option_says_what_it_means() -> None:
    silent = [
        f"{entry.kind} {entry.name} {option}"
        for entry in get_registry().plugins()
        for option, field in entry.plugin.options.model_fields.items()
        if not field.description
    ]
    assert not silent


@pytest.mark.parametrize("entry", get_registry().plugins(), ids=lambda entry: f"{entry.kind}-{entry.name}")
def test_every_built_in_factory_can_be_imported_where_it_is_available(entry: Any) -> None:
    from phrt.registry.manager import import_factory

    if reason := entry.unavailable_reason():
        needs.absent(reason)
    factory = import_factory(entry.name, entry)
    # A command is an application, which a function makes; everything else is made by its class.
    assert callable(factory) if entry.kind == "command" else isinstance(factory, type)


def test_an_unknown_name_is_answered_with_the_nearest() -> None:
    with pytest.raises(PluginError, match=r"no tracer 'embre'. Known: embree, numpy, open3d. Did you mean 'embree'\?"):
        get_registry().get("tracer", "embre")


def test_an_unknown_kind_is_answered_with_the_nearest() -> None:
    with pytest.raises(PluginError, match=r"no kind of plugin 'tracers'.*Did you mean 'tracer'\?"):
        get_registry().get("tracers", "embree")


def test_loaders_are_found_by_suffix_in_any_case() -> None:
    found = get_registry().loader_for(".GLB")
    assert isinstance(found, LoaderPlugin)
    assert found.name == "gltf"
    assert get_registry().loader_for(".blend") is None


def test_create_hands_over_checked_options_and_dependencies() -> None:
    registry = Registry()
    registry.register(tracer("mine", options=KnobOptions))
    made = registry.create("tracer", "mine", {"samples": 8}, world="w")
    assert made.options == KnobOptions(samples=8)
    assert made.dependencies == {"world": "w"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"samples": 0}, r"tracer 'mine': option 'samples' is 0, allowed: int >= 1 <= 64$"),
        ({"samples": "x"}, r"option 'samples' is 'x', allowed: int >= 1 <= 64$"),
        ({"mode": "prob"}, r"option 'mode' is 'prob', allowed: one of: none, probe\. Did you mean 'probe'\?"),
        ({"radius": 0}, r"option 'radius' is 0, allowed: float > 0$"),
        ({"sample": 2}, r"unknown option 'sample'. Its options: samples, mode, radius. Did you mean 'samples'\?"),
        ({"samples": 0, "radius": -1}, r"(?s)option 'samples' is 0.*option 'radius' is -1"),
    ],
)
def test_a_wrong_option_is_named_with_what_is_allowed(options: dict[str, object], message: str) -> None:
    registry = Registry()
    registry.register(tracer("mine", options=KnobOptions))
    with pytest.raises(OptionError, match=message):
        registry.create("tracer", "mine", options)


def test_an_unavailable_plugin_says_why() -> None:
    registry = Registry()
    registry.register(tracer("mine", unavailable_reason=lambda: "install libfoo"))
    with pytest.raises(PluginError, match="tracer 'mine' is not available here: install libfoo"):
        registry.create("tracer", "mine")


def test_an_availability_check_that_raises_counts_as_unavailable() -> None:
    def broken() -> str | None:
        raise OSError("no such device")

    registry = Registry()
    registry.register(tracer("mine", unavailable_reason=broken))
    assert (
        registry.find("tracer", "mine").unavailable_reason() == "its availability check failed: OSError: no such device"
    )


@pytest.mark.parametrize(
    ("factory", "message"),
    [
        ("no_such_module_anywhere:Thing", "cannot be imported: ModuleNotFoundError"),
        (f"{__name__}:Nothing", "cannot be imported: AttributeError"),
        (f"{__name__}:KINDS", "is not callable"),
        (f"{__name__}:Failing", "could not be started: RuntimeError: the device is on fire"),
    ],
)
def test_a_factory_that_fails_is_a_plugin_error_with_the_cause(factory: str, message: str) -> None:
    registry = Registry()
    registry.register(tracer("mine", factory))
    with pytest.raises(PluginError, match=message):
        registry.create("tracer", "mine")


# Broken plugins


def test_a_plugin_that_cannot_be_imported_is_left_out_with_one_warning(install: Any) -> None:
    good = module("good_plugin", **hooks(tracer("good")))
    with pytest.warns(PhrtWarning, match="plugin 'bad' was left out: ModuleNotFoundError") as caught:
        registry = install({"bad": "no_such_module_anywhere", "good": good})
    assert len(caught) == 1
    assert registry.names("tracer") == ["good"]
    with pytest.raises(PluginError, match="tracer 'bad' cannot be used: plugin 'bad' is broken: ModuleNotFoundError"):
        registry.get("tracer", "bad")


def test_asking_for_an_unknown_name_mentions_plugins_that_are_broken(install: Any) -> None:
    with pytest.warns(PhrtWarning):
        registry = install({"bad": "no_such_module_anywhere"})
    with pytest.raises(PluginError, match=r"no tracer 'fast'.*broken: plugin 'bad' was left out"):
        registry.get("tracer", "fast")


def test_a_plugin_whose_hook_raises_is_left_out(install: Any) -> None:
    def phrt_tracers() -> list[TracerPlugin]:
        raise ZeroDivisionError("oops")

    bad = module("raising_plugin", phrt_tracers=hookimpl(phrt_tracers))
    good = module("good_plugin", **hooks(tracer("good")))
    with pytest.warns(PhrtWarning, match="'bad' was left out: ZeroDivisionError: oops"):
        registry = install({"bad": bad, "good": good})
    assert registry.names("tracer") == ["good"]


def test_a_plugin_that_exits_while_it_is_imported_does_not_take_the_program_down(
    install: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "exiting_plugin.py").write_text("raise SystemExit(3)\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.warns(PhrtWarning, match="'bad' was left out: SystemExit: 3"):
        assert install({"bad": "exiting_plugin"}).plugins() == []


@pytest.mark.parametrize(
    ("members", "message"),
    [
        (hooks(tracer("t"), hook="phrt_tracer"), r"unknown hook 'phrt_tracer'.*Did you mean 'phrt_tracers'\?"),
        ({"phrt_tracers": list}, "'phrt_tracers' is not marked with @hookimpl"),
        ({}, "implements none of the hooks phrt_gbuffers, phrt_tracers"),
        (hooks("embree"), "phrt_tracers returned 'embree', expected a list of TracerPlugin"),
        (hooks(HeuristicPlugin("h", "", "m:C")), "expected a list of TracerPlugin"),
        (
            hooks(tracer("t", api_version=99)),
            "'t' needs plugin API 99, and this is PHRT .* plugin API 1. Install a newer PHRT",
        ),
        (
            hooks(tracer("t", api_version=0)),
            "'t' is written for plugin API 0; .*takes 1 and newer. Install a newer version of",
        ),
        (hooks(tracer("t", api_version="1")), "has api_version '1'; it must be a whole number"),
        (hooks(tracer("t"), tracer("t")), "it brings two of tracer 't'"),
        (hooks(CommandPlugin("render", "", "m:C"), hook="phrt_commands"), "`phrt render` is PHRT's own"),
        (
            hooks(LoaderPlugin("l", "", "m:C", suffixes=("OBJ",)), hook="phrt_loaders"),
            "a suffix is lower case and begins with a dot",
        ),
        (hooks(tracer("t", Made)), "has factory <class '.*Made'>; it must be 'module:Class'"),
        (hooks(tracer("t", "module_without_class")), "needs a name and a factory 'module:Class'"),
        (hooks(tracer("")), "needs a name and a factory"),
    ],
)
def test_a_plugin_that_breaks_the_rules_is_left_out_and_named(
    install: Any, members: dict[str, object], message: str
) -> None:
    with pytest.warns(PhrtWarning, match=f"plugin 'bad' was left out: .*{message}"):
        registry = install({"bad": module("bad_plugin", **members)})
    assert registry.plugins() == []


def test_a_misspelt_hook_does_not_spoil_the_plugins_that_follow(install: Any) -> None:
    bad = module("bad_plugin", **hooks(tracer("t"), hook="phrt_tracer"))
    good = module("good_plugin", **hooks(tracer("good")))
    with pytest.warns(PhrtWarning):
        registry = install({"a_bad": bad, "b_good": good})
    assert registry.names("tracer") == ["good"]


# Duplicates


def test_two_packages_that_claim_a_name_both_lose_it_whatever_the_order(install: Any) -> None:
    one = module("one_plugin", **hooks(tracer("fast"), tracer("one")))
    two = module("two_plugin", **hooks(tracer("fast"), tracer("two")))
    messages = []
    for packages in ({"one": one, "two": two}, {"two": two, "one": one}):
        with pytest.warns(PhrtWarning, match="tracer 'fast' is refused: 'one' and 'two' both claim that name"):
            registry = install(packages)
        assert registry.names("tracer") == ["one", "two"]
        with pytest.raises(PluginError, match="'fast' cannot be used: 'one' and 'two' both claim") as refused:
            registry.get("tracer", "fast")
        messages.append(str(refused.value))
    assert messages[0] == messages[1]


def test_a_built_in_name_cannot_be_taken(install: Any) -> None:
    registry = Registry()
    registry.load_defaults()
    thief = module("thief_plugin", **hooks(tracer("embree"), tracer("other")))
    with pytest.warns(
        PhrtWarning, match="'embree' of 'thief' is refused: 'phrt_backends.plugin' already has that name"
    ):
        install({"thief": thief}, registry)
    assert registry.get("tracer", "embree").factory.startswith("phrt_backends.")
    assert registry.get("tracer", "other").factory == f"{__name__}:Made"


def test_registering_a_taken_name_by_hand_is_an_error_that_names_both(install: Any) -> None:
    registry = Registry()
    registry.load_defaults()
    with pytest.raises(PluginError, match=r"'embree' of 'mine' is refused: built-in \('phrt_backends.plugin'\)"):
        registry.register(tracer("embree"), owner="mine")
    registry.register(tracer("mine"), owner="mine")
    assert registry.find("tracer", "mine").origin == "registered"


def test_the_same_owner_may_register_again() -> None:
    registry = Registry()
    for summary in ("first", "second"):
        registry.register(TracerPlugin("mine", summary, f"{__name__}:Made"), owner="notebook")
    assert registry.get("tracer", "mine").summary == "second"


def test_objects_with_hook_methods_are_plugins_too() -> None:
    class Plugin:
        @hookimpl
        def phrt_heuristics(self) -> list[HeuristicPlugin]:
            return [HeuristicPlugin("mine", "", f"{__name__}:Made")]

    registry = Registry()
    registry.register(Plugin())
    assert registry.find("heuristic", "mine").owner == "Plugin"


# The plugin API's version


def test_a_descriptor_that_says_nothing_was_written_for_the_first_version(monkeypatch: pytest.MonkeyPatch) -> None:
    assert HeuristicPlugin("h", "", "m:C").api_version == 1
    # Not the present one: what is old must not pass for new.
    monkeypatch.setattr(descriptors, "PLUGIN_API_VERSION", 7)
    assert HeuristicPlugin("h", "", "m:C").api_version == 1


@pytest.mark.parametrize(("version", "fits"), [(1, False), (2, True), (3, True), (4, False)])
def test_versions_from_the_oldest_to_the_present_one_are_taken(
    version: int, fits: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    from phrt.registry import manager

    monkeypatch.setattr(manager, "PLUGIN_API_VERSION", 3)
    monkeypatch.setattr(manager, "OLDEST_API_VERSION", 2)
    registry = Registry()
    if fits:
        registry.register(tracer("t", api_version=version))
        assert registry.names("tracer") == ["t"]
    else:
        with pytest.raises(PluginError, match=r"plugin API 3.*Install a newer"):
            registry.register(tracer("t", api_version=version))
        assert registry.names("tracer") == []


def test_the_versions_are_in_order() -> None:
    assert 1 <= OLDEST_API_VERSION <= PLUGIN_API_VERSION


def test_what_needs_a_newer_one_is_left_out_and_says_so_when_it_is_asked_for(install: Any) -> None:
    future = module("future_plugin", **hooks(tracer("fast", api_version=9), tracer("other")))
    with pytest.warns(PhrtWarning, match="plugin 'future' was left out: tracer 'fast' needs plugin API 9"):
        registry = install({"future": future})
    assert registry.plugins() == []
    for name in ("fast", "other", "future"):
        with pytest.raises(PluginError, match="'future' is broken: tracer 'fast' needs plugin API 9"):
            registry.get("tracer", name)


# Names that are taken


def test_the_commands_that_cannot_be_taken_are_those_of_phrt() -> None:
    from phrt.cli.main import app

    own = [str(each.name) for each in [*app.registered_commands, *app.registered_groups]]
    assert sorted(own) == sorted(CORE_COMMANDS)


def loader(name: str, *suffixes: str) -> LoaderPlugin:
    return LoaderPlugin(name, "", f"{__name__}:Made", suffixes=suffixes)


def test_files_that_a_built_in_loader_reads_stay_its_own(install: Any) -> None:
    registry = Registry()
    registry.load_defaults()
    grabbing = module("grabbing_plugin", **hooks(loader("aaa", ".obj", ".xyz"), hook="phrt_loaders"))
    install({"grabbing": grabbing}, registry)
    assert registry.loader_for(".OBJ").name == "mesh"  # type: ignore[union-attr]
    assert registry.loader_for(".xyz").name == "aaa"  # type: ignore[union-attr]


def test_two_packages_that_claim_an_ending_are_told_apart_by_name_only(install: Any) -> None:
    one = module("one_plugin", **hooks(loader("one", ".xyz"), hook="phrt_loaders"))
    two = module("two_plugin", **hooks(loader("two", ".xyz"), hook="phrt_loaders"))
    registry = install({"one": one, "two": two})
    with pytest.raises(
        PluginError, match=r"'\.xyz' files are claimed by the loaders 'one' of 'one' and 'two' of 'two'"
    ):
        registry.loader_for(".xyz")
    assert registry.loader_for(".abc") is None


# Notebooks


def test_one_descriptor_after_the_other_can_be_registered_and_each_again() -> None:
    registry = Registry()
    for summary in ("first", "again"):
        registry.register(TracerPlugin("one", summary, f"{__name__}:Made"))
        registry.register(TracerPlugin("two", summary, f"{__name__}:Failing"))
    assert [entry.plugin.summary for entry in registry.plugins()] == ["again", "again"]
    registry.register(TracerPlugin("one", "of another class", f"{__name__}:Failing"))
    assert registry.get("tracer", "one").summary == "of another class"


def test_what_is_refused_leaves_what_was_there() -> None:
    registry = Registry()
    registry.register(module("mine", **hooks(tracer("one"))), owner="mine")
    with pytest.raises(PluginError, match="needs plugin API 9"):
        registry.register(module("mine", **hooks(tracer("two", api_version=9))), owner="mine")
    with pytest.raises(PluginError, match="its hook failed: ZeroDivisionError"):
        registry.register(module("mine", phrt_tracers=hookimpl(lambda: 1 / 0)), owner="mine")
    assert registry.names("tracer") == ["one"]


def test_a_module_says_its_version() -> None:
    registry = Registry()
    registry.register(module("mine", __version__="2.5", **hooks(tracer("one"))))
    assert registry.find("tracer", "one").version == "2.5"


# Laziness


def test_listing_imports_nothing_heavy() -> None:
    code = (
        "import sys\n"
        "from phrt.registry import get_registry\n"
        "from phrt.registry.options import option_rows\n"
        "for entry in get_registry().plugins(): option_rows(entry.plugin.options)\n"
        "heavy = {'open3d', 'moderngl', 'embreex', 'trimesh', 'numba', 'skimage', 'flip_evaluator', 'scipy'}\n"
        "heavy &= set(sys.modules)\n"
        "assert not heavy, heavy\n"
    )
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, timeout=60)
