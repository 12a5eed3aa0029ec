"""Which machine this is, as far as the time of a ray depends on it."""

from __future__ import annotations

import platform
from functools import lru_cache
from pathlib import Path

from phrt.workers import usable_cores


@lru_cache(maxsize=1)
def cpu_model() -> str:
    """The processor's name, as far as the system tells."""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def machine_name() -> str:
    """The processor and how many cores of it may be used; costs that were measured on another one are not used."""
    return f"{cpu_model()}, {usable_cores()} cores"
