"""What the figures were measured on."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version

from phrt.machine import cpu_model
from phrt.workers import usable_cores

PACKAGES = ("phrt", "numpy", "numba", "llvmlite", "embreex", "open3d", "moderngl")


def installed(package: str) -> str | None:
    """Version of `package`; None when it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def machine() -> dict[str, object]:
    """Processor, usable cores, load when asked, system and versions."""
    return {
        "cpu": cpu_model(),
        "cores": usable_cores(),
        "load_average": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "system": platform.platform(),
        "python": platform.python_version(),
        "versions": {package: installed(package) for package in PACKAGES},
    }


def lines(info: dict[str, object]) -> list[str]:
    """`machine()`, to read; with a warning when something else was running."""
    versions = info["versions"]
    assert isinstance(versions, dict)
    found = ", ".join(f"{name} {number}" for name, number in versions.items() if number)
    text = [f"{info['cpu']}, {info['cores']} cores, {info['system']}", f"Python {info['python']}, {found}"]
    load = info["load_average"]
    if isinstance(load, float) and load > 0.5:
        text.append(f"The machine was busy when this started (load {load}): times are too long, ratios less so.")
    return text
