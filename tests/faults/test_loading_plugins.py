"""Plugins that fail before anything of them is made: in their import, a hook, or a descriptor. Listing always works; there is one
warning; who asks for one by name is told the cause; with --strict it is an error for everybody."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from cli_kit import phrt
from fault_kit import NAME, OWNER, PACKAGE, SOUND, VERSION, current, descriptor, descriptor_fields
from pydantic import Field, field_validator
from run_bench_kit import SCENE

from phrt.errors import OptionError, PluginError
from phrt.registry import Options, hookimpl, manager
from phrt.registry.manager import KINDS, hook_name

Install = Callable[..., None]


@pytest.fixture
def install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Install]:
    """Makes packages be installed, in a process that has not looked for plugins yet: by package, the source of its module, or a
    module."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(manager, "_registry", None)
    points: list[EntryPoint] = []
    monkeypatch.setattr(manager, "entry_points", lambda group: points)

    def installed(**packages: str | ModuleType) -> None:
        for package, module in packages.items():
            name = f"module_of_{package}"
            if isinstance(module, str):
                (tmp_path / f"{name}.py").write_text(module, encoding="utf-8")
            else:
                monkeypatch.setitem(sys.modules, name, module)
            point = EntryPoint(NAME, name, "phrt")
            vars(point)["dist"] = SimpleNamespace(name=package.replace("_", "-"), version=VERSION)
            points.append(point)

    yield installed
    current.clear()
    for name in [name for name in sys.modules if name.startswith("module_of_")]:
        del sys.modules[name]


def hooks(*descriptors: Any, kind: str = "tracer", hook: Callable[[], Any] | None = None) -> ModuleType:
    """A module whose hook of that kind returns the descriptors, or is `hook`."""
    made = ModuleType("made")
    function = hook or (lambda: list(descriptors))
    setattr(made, hook_name(kind), hookimpl(lambda: function()))
    return made


def check_left_out(tmp_path: Path, cause: str, kind: str = "tracer", name: str = NAME) -> None:
    """The package is left out, as it should be: listing, asking by name, and --strict."""
    listed = phrt("plugins", "--json")
    assert listed.code == 0
    found = json.loads(listed.printed)
    assert {"embree", "gain", "shadows", "raycast"} <= {row["name"] for row in found["plugins"]}
    assert len(found["broken"]) == 1
    assert len(listed.warnings) == 1
    assert re.search(f"^warning: plugin '{OWNER}' was left out: .*{cause}", " ".join(listed.said.split()))
    # Once: whoever looks again hears nothing.
    assert phrt("plugins").warnings == []
    with pytest.raises(PluginError, match=f"{kind} '{name}' .*{cause}"):
        manager.get_registry().create(kind, name)
    scene = tmp_path / "scene.yaml"
    scene.write_text(SCENE, encoding="utf-8")
    for command in (["render", str(scene), "-o", str(tmp_path / "x.png")], ["analyze", str(scene)]):
        strict = phrt(*command, "--strict")
        assert strict.code == 2
        assert OWNER in strict.said
        assert not (tmp_path / "x.png").exists()


# Import


IMPORTS = {
    "raises": ("raise RuntimeError('the cable came off')", "RuntimeError: the cable came off"),
    "leaves the program": ("import sys; sys.exit(3)", "SystemExit: 3"),
    "is no Python": ("def :", "SyntaxError"),
    "needs what is not there": ("import no_such_module_anywhere", "No module named 'no_such_module_anywhere'"),
    "has no hook": ("x = 1", "it implements none of the hooks"),
    "misspells a hook": (
        "from phrt.registry import hookimpl\n@hookimpl\ndef phrt_tracer(): return []",
        "unknown hook 'phrt_tracer'",
    ),
    "forgets a mark": ("def phrt_tracers(): return []", "'phrt_tracers' is not marked with @hookimpl"),
}


@pytest.mark.parametrize("what", IMPORTS)
def test_a_module_that_fails_when_it_is_imported(what: str, install: Install, tmp_path: Path) -> None:
    source, cause = IMPORTS[what]
    install(phrt_broken=source)
    check_left_out(tmp_path, cause)


# Hooks


def raises() -> Any:
    raise RuntimeError("the cable came off")


def leaves() -> Any:
    raise SystemExit(3)


def half() -> Any:
    yield descriptor("tracer", "half")
    raise RuntimeError("the cable came off")


HOOKS: dict[str, tuple[Callable[[], Any], str]] = {
    "raises": (raises, "RuntimeError: the cable came off"),
    "leaves the program": (leaves, "SystemExit: 3"),
    "gives nothing": (lambda: None, "TypeError: 'NoneType' object is not iterable"),
    "gives names": (lambda: ["mine"], "returned 'mine', expected a list of"),
    "raises half way": (half, "RuntimeError: the cable came off"),
}


@pytest.mark.parametrize("what", HOOKS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_hook_that_fails(kind: str, what: str, install: Install, tmp_path: Path) -> None:
    hook, cause = HOOKS[what]
    install(phrt_broken=hooks(kind=kind, hook=hook))
    check_left_out(tmp_path, cause, kind)


@pytest.mark.parametrize("what", HOOKS)
def test_a_hook_that_fails_when_it_is_registered_by_hand(what: str, install: Install) -> None:
    hook, cause = HOOKS[what]
    before = manager.get_registry().names("tracer")
    with pytest.raises(PluginError, match=cause):
        manager.get_registry().register(hooks(hook=hook), owner="notebook")
    assert manager.get_registry().names("tracer") == before


# Descriptors


DESCRIPTORS: dict[str, list[tuple[str, dict[str, Any], str]]] = {
    "name": [("tracer", {"name": None}, "has name None; it must be text"), ("tracer", {"name": ""}, "needs a name")],
    "summary": [("metric", {"summary": None}, "has summary None; it must be a line of text")],
    "factory": [("effect", {"factory": "m"}, "factory 'module:Class'"), ("effect", {"factory": 3}, "has factory 3")],
    "options": [("loader", {"options": dict}, "has options <class 'dict'>; it must be a class, a subclass of")],
    "unavailable_reason": [("gbuffer", {"unavailable_reason": "no"}, "has unavailable_reason 'no'; it must be a function")],
    "api_version": [
        ("heuristic", {"api_version": 99}, "needs plugin API 99"),
        ("heuristic", {"api_version": 0}, "is written for plugin API 0"),
        ("heuristic", {"api_version": "1"}, "has api_version '1'; it must be a whole number"),
    ],
    "order": [("effect", {"order": "first"}, "has order 'first'; it must be a whole number")],
    "suffixes": [
        ("loader", {"suffixes": ".abc"}, "has suffixes '.abc'; it must be a tuple of texts"),
        ("loader", {"suffixes": ("abc",)}, "a suffix is lower case and begins with a dot"),
    ],
    "needs_tracer": [("gbuffer", {"needs_tracer": "yes"}, "has needs_tracer 'yes'; it must be true or false")],
    "device": [("gbuffer", {"device": "a GPU"}, "has device 'a GPU'; it must be a function")],
}  # fmt: skip


def test_every_field_of_every_descriptor_has_an_injected_fault() -> None:
    assert set(DESCRIPTORS) == descriptor_fields()


@pytest.mark.parametrize(
    ("kind", "changes", "cause"),
    [case for cases in DESCRIPTORS.values() for case in cases],
    ids=lambda value: None if isinstance(value, dict) else str(value)[:40],
)
def test_a_descriptor_that_is_wrong(
    kind: str, changes: dict[str, Any], cause: str, install: Install, tmp_path: Path
) -> None:
    values = {"name": NAME, "summary": "for tests", "factory": "m:C"} | changes
    install(phrt_broken=hooks(KINDS[kind](**values), kind=kind))
    check_left_out(tmp_path, cause, kind)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("check", "cause"),
    [
        (raises, "its availability check failed: RuntimeError: the cable came off"),
        (leaves, "its availability check failed: SystemExit: 3"),
        (lambda: 3, "its availability check failed: it returned 3, not None or a text"),
        (lambda: "install libfoo", "install libfoo"),
    ],
    ids=["raises", "leaves the program", "gives a number", "says why"],
)
def test_a_plugin_that_cannot_say_whether_it_runs_does_not_run(
    kind: str, check: Callable[[], Any], cause: str, install: Install
) -> None:
    current[NAME] = SOUND[kind]
    install(phrt_broken=hooks(descriptor(kind, unavailable_reason=check), kind=kind))
    listed = phrt("plugins", "--json")
    assert (listed.code, listed.warnings) == (0, [])
    (row,) = [row for row in json.loads(listed.printed)["plugins"] if row["name"] == NAME]
    assert row["reason"] == cause
    assert phrt("plugins", "show", NAME).code == 0
    with pytest.raises(PluginError, match=f"{kind} '{NAME}' is not available here: {cause}"):
        manager.get_registry().create(kind, NAME)


@pytest.mark.parametrize("device", [raises, leaves, lambda: "a GPU"], ids=["raises", "leaves the program", "a text"])
def test_a_device_that_cannot_be_asked_changes_no_choice(device: Callable[[], Any], install: Install) -> None:
    current[NAME] = SOUND["gbuffer"]
    install(phrt_broken=hooks(descriptor("gbuffer", device=device), kind="gbuffer"))
    assert phrt("plugins").code == 0
    report = phrt("doctor", "--json")
    assert report.code == 0
    assert json.loads(report.printed)["auto"]["gbuffer"]["name"] in ("raycast", "moderngl")


class Bad(Options):
    knob: int = Field(1, description="turns")

    @field_validator("knob")
    @classmethod
    def check(cls, value: int) -> int:
        raise RuntimeError("the cable came off")


@pytest.mark.parametrize("kind", KINDS)
def test_options_that_cannot_be_checked(kind: str, install: Install) -> None:
    current[NAME] = SOUND[kind]
    install(phrt_broken=hooks(descriptor(kind, options=Bad), kind=kind))
    assert phrt("plugins").code == 0
    assert phrt("plugins", "show", NAME).code == 0
    with pytest.raises(PluginError, match=f"{kind} '{NAME}' of {PACKAGE} cannot check its options: RuntimeError"):
        manager.get_registry().create(kind, NAME, {"knob": 2})
    with pytest.raises(OptionError, match="unknown option 'nob'"):
        manager.get_registry().create(kind, NAME, {"nob": 2})


# Factories


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fault", [raises, leaves], ids=["raises", "leaves the program"])
def test_a_factory_that_fails(kind: str, fault: Callable[[], Any], install: Install) -> None:
    current[NAME] = lambda options, **given: fault()
    install(phrt_broken=hooks(descriptor(kind), kind=kind))
    assert phrt("plugins").code == 0
    cause = "RuntimeError: the cable came off" if fault is raises else "SystemExit: 3"
    with pytest.raises(PluginError, match=f"{kind} '{NAME}' of {PACKAGE} could not be started: {cause}") as raised:
        manager.get_registry().create(kind, NAME)
    assert isinstance(raised.value.__cause__, RuntimeError | SystemExit)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("factory", "cause"),
    [
        ("no_such_module_anywhere:C", "cannot be imported: ModuleNotFoundError"),
        ("module_of_phrt_broken:nothing", "cannot be imported: AttributeError"),
        ("fault_kit:NAME", "is not callable"),
    ],
)
def test_a_factory_that_is_not_there(kind: str, factory: str, cause: str, install: Install) -> None:
    install(phrt_broken=hooks(KINDS[kind](NAME, "for tests", factory), kind=kind))
    listed = phrt("plugins", "--json")
    assert (listed.code, listed.warnings) == (0, [])
    with pytest.raises(PluginError, match=f"{kind} '{NAME}' of {PACKAGE} is broken: .*{cause}"):
        manager.get_registry().create(kind, NAME)


# Names that are taken


@pytest.mark.parametrize("kind", KINDS)
def test_a_name_of_ours_cannot_be_taken(kind: str, install: Install, tmp_path: Path) -> None:
    name = next(entry.name for entry in manager.get_registry().plugins(kind) if entry.origin == "built-in")
    manager._registry = None
    install(phrt_broken=hooks(KINDS[kind](name, "for tests", "m:C"), kind=kind))
    listed = phrt("plugins", "--json")
    assert listed.code == 0
    assert len(listed.warnings) == 1
    said = " ".join(listed.said.split())
    assert f"plugin '{OWNER}' was left out: {kind} '{name}' of '{OWNER}' is refused" in said
    assert manager.get_registry().find(kind, name).origin == "built-in"
    assert phrt("analyze", str(tmp_path / "none.yaml"), "--strict").said.count(OWNER) >= 1


@pytest.mark.parametrize("kind", KINDS)
def test_a_name_that_two_packages_want_is_neither_ones(kind: str, install: Install) -> None:
    sound, other = hooks(descriptor(kind), kind=kind), hooks(descriptor(kind), kind=kind)
    install(phrt_broken=sound, phrt_other=other)
    listed = phrt("plugins", "--json")
    assert listed.code == 0
    assert len(listed.warnings) == 1
    assert NAME not in {row["name"] for row in json.loads(listed.printed)["plugins"]}
    with pytest.raises(PluginError, match=f"{kind} '{NAME}' cannot be used: '{OWNER}' and 'phrt-other' both claim"):
        manager.get_registry().create(kind, NAME)


# Commands


def test_a_command_that_fails_spoils_no_other(install: Install) -> None:
    def fails(options: Any) -> Any:
        raise RuntimeError("the cable came off")

    current[NAME], current["nonsense"] = fails, lambda options: 3
    install(phrt_broken=hooks(descriptor("command"), descriptor("command", "nonsense"), kind="command"))
    shown = phrt("--help")
    assert shown.code == 0
    assert all(name in shown.printed for name in ("render", "bench", "report", NAME, "nonsense"))
    done = phrt(NAME)
    assert done.code == 2
    assert len(done.errors) == 1
    assert f"command '{NAME}' of {PACKAGE} could not be started: RuntimeError: the cable came off" in done.said
    done = phrt("nonsense", "--anything")
    assert done.code == 2
    assert f"command 'nonsense' of {PACKAGE} is broken" in done.said
    assert phrt("doctor", "--json").code == 0


def test_a_command_that_fails_while_it_runs_names_its_package(install: Install) -> None:
    import fault_kit

    current[NAME] = fault_kit.sound_command
    install(phrt_broken=hooks(descriptor("command"), kind="command"))
    assert phrt(NAME).printed == "it runs\n"
    assert phrt(NAME, "--nonsense").code == 2
    fault_kit.armed[0] = True
    done = phrt(NAME)
    fault_kit.armed[0] = False
    assert done.code == 2
    assert f"command '{NAME}' of {PACKAGE} failed: RuntimeError: the cable came off" in done.said
