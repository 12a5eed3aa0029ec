"""What is said where Mitsuba cannot run, and that a bad LLVM is explained instead of ending the process."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import needs
import pytest

from phrt.cli.doctor import check
from phrt.errors import PluginError
from phrt.registry import get_registry
from phrt_mitsuba import availability, llvm
from phrt_mitsuba.availability import choose_variant, explain, load_mitsuba, trial, unavailable_reason

LOOK = """
import sys
import phrt_mitsuba.plugin as plugin

[tracer] = plugin.phrt_tracers()
print(tracer.unavailable_reason())
assert not {"mitsuba", "drjit", "subprocess_started"} & set(sys.modules), "Mitsuba was imported"
"""


@pytest.fixture
def no_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine without a GPU, a process that has not imported Dr.Jit."""
    monkeypatch.setattr(availability, "has_nvidia_gpu", lambda: False)
    monkeypatch.delitem(sys.modules, "drjit", raising=False)


def interpreter(path: Path, script: str) -> str:
    """A stand-in for Python that runs `script` instead of what it is given."""
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return str(path)


# Listing


def test_listing_does_not_import_mitsuba() -> None:
    paths = os.pathsep.join(filter(None, sys.path))
    environment = os.environ | {"PYTHONPATH": paths, llvm.VARIABLE: "/nowhere/libLLVM.so"}
    done = subprocess.run([sys.executable, "-c", LOOK], env=environment, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr


@pytest.mark.usefixtures("no_gpu")
def test_doctor_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(llvm.VARIABLE, raising=False)
    monkeypatch.setitem(llvm.PLACES, sys.platform, ())
    registry = get_registry()
    finding = check(registry, registry.find("tracer", "mitsuba"), "")
    assert not finding.works
    assert "apt-get install libllvm19" in finding.note
    with pytest.raises(PluginError, match=r"tracer 'mitsuba' is not available here: .*apt-get install libllvm19"):
        registry.create("tracer", "mitsuba")


def test_without_the_package_it_is_the_package_that_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "mitsuba", raising=False)
    monkeypatch.setattr(availability.importlib.util, "find_spec", lambda name: None)
    assert unavailable_reason() == "the Python package 'mitsuba' is not installed: pip install mitsuba"


def test_a_gpu_needs_no_llvm(monkeypatch: pytest.MonkeyPatch) -> None:
    needs.package("mitsuba")
    monkeypatch.setattr(availability, "has_nvidia_gpu", lambda: True)
    monkeypatch.setenv(llvm.VARIABLE, "/nowhere/libLLVM.so")
    assert unavailable_reason() is None


# Trials


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("echo 'hit at 2.0'", None),
        ("kill -ILL $$", "a trial ray killed its process (SIGILL)"),
        ("kill -SEGV $$", "a trial ray killed its process (SIGSEGV)"),
        ("echo 'LLVM ERROR: no' >&2; kill -ABRT $$", "a trial ray killed its process (SIGABRT): LLVM ERROR: no"),
        ("echo 'hit at 7.0'", "a trial ray gave 'hit at 7.0'"),
        ("true", "a trial ray gave 'nothing'"),
        ("echo Traceback >&2; echo 'ImportError: no LLVM' >&2; exit 1", "a trial ray failed: ImportError: no LLVM"),
        ("exit 3", "a trial ray failed: exit 3"),
    ],
)
def test_a_trial_says_what_happened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, reason: str | None
) -> None:
    monkeypatch.setattr(sys, "executable", interpreter(tmp_path / "python", script))
    assert trial("llvm_ad_rgb", "/some/libLLVM.so") == reason


def test_a_trial_that_hangs_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", interpreter(tmp_path / "python", "exec sleep 60"))
    monkeypatch.setattr(availability, "TRIAL_SECONDS", 0.2)
    assert trial("llvm_ad_rgb") == "a trial ray was not answered in 0.2 s"


def test_a_trial_does_not_import_from_the_folder_one_is_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "drjit.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w').close()")
    monkeypatch.chdir(tmp_path)
    trial("scalar_rgb")
    assert not (tmp_path / "ran").exists()


@pytest.mark.usefixtures("fresh", "no_gpu")
def test_the_next_library_is_tried_when_one_kills_its_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bad, good = tmp_path / "libLLVM.so.20.1", tmp_path / "libLLVM.so.19.1"
    bad.touch()
    good.touch()
    script = f'case "$DRJIT_LIBLLVM_PATH" in {bad}) kill -ILL $$ ;; esac; echo run >>{tmp_path}/runs; echo hit at 2.0'
    monkeypatch.setattr(sys, "executable", interpreter(tmp_path / "python", script))
    monkeypatch.setitem(llvm.PLACES, sys.platform, (f"{tmp_path}/libLLVM*",))
    monkeypatch.delenv(llvm.VARIABLE)
    assert [choose_variant("llvm"), choose_variant("auto")] == ["llvm_ad_rgb"] * 2
    assert os.environ[llvm.VARIABLE] == str(good)
    assert (tmp_path / "runs").read_text() == "run\n", "the outcome was not remembered"


@pytest.mark.usefixtures("fresh", "no_gpu")
def test_when_none_works_every_one_is_explained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    named = tmp_path / "libLLVM.so.15"
    named.touch()
    monkeypatch.setattr(sys, "executable", interpreter(tmp_path / "python", "kill -ILL $$"))
    monkeypatch.setenv(llvm.VARIABLE, str(named))
    with pytest.raises(PluginError) as raised:
        choose_variant("auto")
    message = str(raised.value)
    assert f"with {named}, a trial ray killed its process (SIGILL)" in message
    assert "apt-get install libllvm19" in message
    assert os.environ[llvm.VARIABLE] == str(named), "the user's own choice was overridden"


@pytest.mark.usefixtures("fresh", "no_gpu")
def test_an_llvm_taken_before_is_explained(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "libLLVM.so.19.1").touch()
    monkeypatch.setitem(llvm.PLACES, sys.platform, (f"{tmp_path}/libLLVM*",))
    monkeypatch.delenv(llvm.VARIABLE)
    detail = SimpleNamespace(llvm_version=lambda: (15, 0, 7))
    monkeypatch.setitem(sys.modules, "drjit", SimpleNamespace(detail=detail))
    with pytest.raises(PluginError, match=r"has taken LLVM 15, .*start with DRJIT_LIBLLVM_PATH=.*libLLVM\.so\.19\.1"):
        choose_variant("llvm")


@pytest.mark.usefixtures("fresh", "no_gpu")
def test_a_gpu_that_is_not_there_is_said_so() -> None:
    with pytest.raises(PluginError, match=r"\(device: cuda\): there is no NVIDIA GPU with a driver"):
        choose_variant("cuda")


@pytest.mark.usefixtures("fresh")
def test_a_gpu_that_does_not_work_leaves_auto_to_the_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    tried = []

    def outcome(variant: str, library: str | None = None) -> str | None:
        tried.append(variant)
        return "OptiX is too old" if variant.startswith("cuda") else None

    monkeypatch.setattr(availability, "has_nvidia_gpu", lambda: True)
    monkeypatch.setattr(availability, "trial", outcome)
    monkeypatch.setattr(llvm, "missing_reason", lambda: None)
    monkeypatch.setattr(llvm, "usable", lambda: ["/some/libLLVM.so"])
    monkeypatch.setattr(availability, "_loaded_too_early", lambda: None)
    assert choose_variant("auto") == "llvm_ad_rgb"
    assert tried == ["cuda_ad_rgb", "llvm_ad_rgb"]
    with pytest.raises(PluginError, match="OptiX is too old"):
        choose_variant("cuda")


def test_a_signal_without_a_name_is_given_by_its_number() -> None:
    assert explain(-250, "", "") == "a trial ray killed its process (signal 250)"


@needs.all_need(unavailable_reason())
def test_the_variant_is_set_again_when_somebody_else_has_set_another() -> None:
    mitsuba = load_mitsuba("auto")
    mitsuba.set_variant("scalar_rgb")
    assert load_mitsuba("auto").variant() == choose_variant("auto")
