"""Why a tracer cannot run here and what to install, found out without importing the heavy libraries themselves."""

from __future__ import annotations

import ctypes.util
import importlib.util
import sys

_OPEN3D_SYSTEM_LIBRARIES = {"libusb-1.0": ("usb-1.0", "libusb-1.0-0"), "libgomp": ("gomp", "libgomp1")}
"""Library that Open3D's Linux wheel expects from the system: its name for the linker, its Debian and Ubuntu package."""


def embree_reason() -> str | None:
    """None, or why the `embree` tracer cannot run. Without the shared library embreex's `run` serves."""
    if importlib.util.find_spec("embreex") is None:
        return "the Python package 'embreex' is not installed: pip install embreex"
    return None


def open3d_reason() -> str | None:
    """None, or what the `open3d` tracer lacks: the Python package, or a system library its wheel does not bring."""
    if importlib.util.find_spec("open3d") is None:
        return "the Python package 'open3d' is not installed: pip install 'phrt[open3d]' (about 900 MB installed)"
    if not sys.platform.startswith("linux"):
        return None
    missing = {
        name: package
        for name, (linker_name, package) in _OPEN3D_SYSTEM_LIBRARIES.items()
        if ctypes.util.find_library(linker_name) is None
    }
    if not missing:
        return None
    return (
        f"Open3D needs the system libraries {' and '.join(missing)}: apt-get install {' '.join(missing.values())}"
        " (Debian and Ubuntu), or the like of your system"
    )
