"""Can Mitsuba run here, in which variant, and what to install where it cannot. The only place that sets a variant.

Three levels, each only when it is asked for:
- `unavailable_reason`: for listings. Looks for the package, an LLVM library and an NVIDIA driver; imports nothing.
- `choose_variant`: before first use. Traces one ray in a process of its own, because a bad LLVM or driver does not raise,
  it kills the process. The outcome is remembered for this process.
- `load_mitsuba`: imports Mitsuba and sets the variant.

Variants: `llvm_ad_rgb` on the processor, `cuda_ad_rgb` (OptiX) on an NVIDIA GPU. Mitsuba's wheels have no variants without
`ad`; derivatives cost nothing until they are asked for. `rgb` rather than `mono`, so that the tracer and the path-traced
pictures of one process share a variant. `scalar_*` answers one ray at a time and is not used.
"""

from __future__ import annotations

import ctypes
import glob
import importlib.util
import os
import signal
import subprocess
import sys
import threading
from functools import cache
from typing import Any, Literal

from phrt.errors import PluginError
from phrt_mitsuba import llvm

Device = Literal["auto", "llvm", "cuda"]

VARIANTS = {"llvm": "llvm_ad_rgb", "cuda": "cuda_ad_rgb"}
TRIAL_SECONDS = 120

TRIAL = """
import sys
import drjit as dr
import mitsuba as mi

mi.set_variant(sys.argv[1])
scene = mi.load_dict({"type": "scene", "shape": {"type": "cube"}})
hit = scene.ray_intersect_preliminary(mi.Ray3f([0, 0, -3], [0, 0, 1]), True)
print("hit at", dr.minimum(hit.t, dr.arange(mi.Float, 16) + 3)[0])
"""
"""Run on its own, with a variant as argument. A cube of -1 to 1 is hit at 2; the minimum is what an old LLVM fails at."""
EXPECTED = "hit at 2.0"

_lock = threading.RLock()


def unavailable_reason() -> str | None:
    """None, or what Mitsuba lacks to run here. Imports nothing, starts nothing."""
    if "mitsuba" not in sys.modules and importlib.util.find_spec("mitsuba") is None:
        return "the Python package 'mitsuba' is not installed: pip install mitsuba"
    return None if has_nvidia_gpu() else llvm.missing_reason()


def choose_variant(device: Device = "auto") -> str:
    """The variant that works for `device`; `auto` is the NVIDIA GPU where there is one, else the processor.

    The first call for a device starts a process that traces a ray, about two seconds; `DRJIT_LIBLLVM_PATH` is set for this
    process where the user has not. Raises PluginError where nothing works; it says what was tried and what to install.
    """
    wanted = [device] if device != "auto" else ["cuda", "llvm"] if has_nvidia_gpu() else ["llvm"]
    reasons = []
    with _lock:
        for each in wanted:
            reason = _cuda_reason() if each == "cuda" else _llvm_reason()
            if reason is None:
                return VARIANTS[each]
            reasons.append(reason)
    raise PluginError(f"Mitsuba cannot run here (device: {device}): {'; '.join(reasons)}")


def load_mitsuba(device: Device = "auto") -> Any:
    """The package `mitsuba`, its variant set to the one of `device`. Thread-safe. Raises PluginError as `choose_variant`.

    The variant is one for the whole process. What must not depend on it takes the variant's own module, which is an
    attribute of the package: `getattr(load_mitsuba(device), choose_variant(device))`.
    """
    variant = choose_variant(device)
    with _lock:
        import mitsuba

        if mitsuba.variant() != variant:
            mitsuba.set_variant(variant)
        return mitsuba


def has_nvidia_gpu() -> bool:
    """Is there an NVIDIA GPU with its driver? By the device files and the driver's library; nothing is started."""
    if sys.platform == "win32":
        return _loads("nvcuda.dll")
    return bool(glob.glob("/dev/nvidia[0-9]*") or glob.glob("/dev/dxg")) and _loads("libcuda.so.1")


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


@cache
def _cuda_reason() -> str | None:
    if not has_nvidia_gpu():
        return "there is no NVIDIA GPU with a driver"
    return trial(VARIANTS["cuda"])


@cache
def _llvm_reason() -> str | None:
    """Settle on an LLVM for this process: None, or why none works."""
    if reason := llvm.missing_reason():
        return reason
    if reason := _loaded_too_early():
        return reason
    failures = []
    for path in llvm.usable():
        reason = trial(VARIANTS["llvm"], path)
        if reason is None:
            os.environ[llvm.VARIABLE] = path
            return None
        failures.append(f"with {path}, {reason}")
    return "; ".join([*failures, f"another LLVM may help: {llvm.HOW_TO_INSTALL}"])


def _loaded_too_early() -> str | None:
    """None, or that Dr.Jit is in this process already and has taken an LLVM that is too old."""
    drjit = sys.modules.get("drjit")
    version = drjit.detail.llvm_version() if drjit is not None else ()
    if not version or version[0] >= llvm.OLDEST or llvm.VARIABLE in os.environ:
        return None
    return (
        f"Dr.Jit was imported before and has taken LLVM {version[0]}, which cannot compile what it writes; "
        f"start with {llvm.VARIABLE}={llvm.usable()[0]}"
    )


def trial(variant: str, library: str | None = None) -> str | None:
    """Trace one ray in a process of its own; None where the answer is right, else what happened."""
    if not sys.executable:
        return None
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    if library is not None:
        environment[llvm.VARIABLE] = library
    command = [sys.executable, "-P", "-c", TRIAL, variant]  # -P: modules of the folder one is in are not imported
    try:
        ended = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=TRIAL_SECONDS, check=False
        )
    except subprocess.TimeoutExpired:
        return f"a trial ray was not answered in {TRIAL_SECONDS} s"
    if ended.returncode == 0 and EXPECTED in ended.stdout:
        return None
    return explain(ended.returncode, ended.stdout, ended.stderr)


def explain(code: int, output: str, errors: str) -> str:
    """What a trial that failed says, in one line: the signal that killed it, or its last word."""
    said = [line.strip() for line in errors.splitlines() if line.strip()]
    if code == 0:
        return f"a trial ray gave {output.strip() or 'nothing'!r}"
    if code < 0:
        names = {int(each): each.name for each in signal.Signals}
        return f"a trial ray killed its process ({names.get(-code, f'signal {-code}')})" + "".join(
            f": {line:.80}" for line in said[:1]
        )
    return f"a trial ray failed: {said[-1] if said else f'exit {code}'}"
