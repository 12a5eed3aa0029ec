"""Headless OpenGL contexts: opening one, saying why that fails, and saying what draws."""

from __future__ import annotations

import platform
import threading
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

from phrt.errors import PluginError

REQUIRED_VERSION = 330
SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swrast", "software rasterizer", "gdi generic")
INSTALL_HINT = "on Debian and Ubuntu: apt install libegl1 libgl1-mesa-dri"


@dataclass(frozen=True)
class GlInfo:
    """What draws. is_hardware: false for Mesa's llvmpipe, softpipe and swrast, which draw on the processor."""

    vendor: str
    renderer: str
    version: str
    is_hardware: bool


def open_context(device: int = 0) -> Any:
    """A standalone OpenGL 3.3 core context: by EGL on Linux, with no display and no environment variable; elsewhere
    by the system's own way. Raises `PluginError` with the cause and what to install."""
    try:
        import moderngl
    except ImportError as error:
        raise PluginError(
            f"G-buffer 'moderngl': the package moderngl cannot be imported ({error}); pip install moderngl"
        ) from error
    settings: dict[str, Any] = {"standalone": True, "require": REQUIRED_VERSION}
    if platform.system() == "Linux":
        settings |= {"backend": "egl", "device_index": device}
    try:
        return moderngl.create_context(**settings)
    except Exception as error:  # moderngl and glcontext raise bare Exception
        raise PluginError(
            f"G-buffer 'moderngl': no OpenGL 3.3 context (device {device}): {error}; {INSTALL_HINT}"
        ) from error


@lru_cache(maxsize=1)
def _probe() -> GlInfo | str:
    """What draws on the default device, or why nothing does; asked once a process."""
    try:
        context = open_context()
    except PluginError as error:
        return str(error)
    with context:
        info = context.info
        vendor, renderer, version = (str(info[key]) for key in ("GL_VENDOR", "GL_RENDERER", "GL_VERSION"))
    context.release()
    hardware = not any(name in renderer.lower() for name in SOFTWARE_RENDERERS)
    return GlInfo(vendor, renderer, version, hardware)


def moderngl_reason() -> str | None:
    """None, or why the `moderngl` producer cannot run here and what to install."""
    found = _probe()
    return found if isinstance(found, str) else None


def gl_info() -> GlInfo:
    """Vendor, renderer and version of the default device. Raises `PluginError` where there is no OpenGL; cached."""
    found = _probe()
    if isinstance(found, str):
        raise PluginError(found)
    return found


class ThreadGuard:
    """An OpenGL context belongs to the thread that made it; any other gets a clear error instead of a crash."""

    def __init__(self) -> None:
        self._owner = threading.get_ident()
        self._owner_name = threading.current_thread().name

    def check(self) -> None:
        """Raise `RuntimeError` when called on another thread than the one that made this guard."""
        if threading.get_ident() != self._owner:
            here = threading.current_thread().name
            raise RuntimeError(
                f"the moderngl producer was made on thread '{self._owner_name}' and is used on '{here}'; "
                "use it on one thread only"
            )
