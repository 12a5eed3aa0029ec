"""Which LLVM library Dr.Jit, the compiler inside Mitsuba, is to load. Only file names are read: nothing is loaded here.

Dr.Jit picks one when `drjit` is imported, and it takes any from LLVM 15 on. But LLVM 15, which Debian 12 has, cannot compile
the minimum of two numbers as Dr.Jit writes it ("Cannot select: fminimum"), and ends the process. So older ones than `OLDEST`
do not count here; LLVM 19 is the one that is tested. The user's `DRJIT_LIBLLVM_PATH` is the last word.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

VARIABLE = "DRJIT_LIBLLVM_PATH"
OLDEST = 17
HOW_TO_INSTALL = (
    "apt-get install libllvm19 (Debian and Ubuntu), or your system's LLVM of that age; "
    f"one in an unusual place is named by {VARIABLE}=/path/to/libLLVM.so"
)

PLACES = {
    "linux": (
        "/usr/lib/*-linux-gnu/libLLVM*.so*",
        "/usr/lib64/libLLVM*.so*",
        "/usr/lib/libLLVM*.so*",
        "/usr/lib/llvm*/lib/libLLVM*.so*",
        "/usr/lib/llvm/*/lib*/libLLVM*.so*",
        "/usr/local/lib/libLLVM*.so*",
        f"{sys.prefix}/lib/libLLVM*.so*",
    ),
    "darwin": (
        "/opt/homebrew/opt/llvm*/lib/libLLVM*.dylib",
        "/usr/local/opt/llvm*/lib/libLLVM*.dylib",
        f"{sys.prefix}/lib/libLLVM*.dylib",
    ),
    "win32": ("C:/Program Files/LLVM/bin/LLVM-C.dll",),
}
"""Glob patterns by `sys.platform`: distributions' folders, and a conda environment's."""

_IN_NAME = re.compile(r"libLLVM(?:-|\.so\.|\.)(\d+)")
_IN_FOLDER = re.compile(r"llvm[-@/](\d+)", re.IGNORECASE)


@dataclass(frozen=True)
class Library:
    """One LLVM on this machine. version: the major one as the file's or a folder's name tells, None where neither does."""

    path: Path
    version: int | None

    @property
    def is_new_enough(self) -> bool:
        return self.version is None or self.version >= OLDEST


def installed(places: tuple[str, ...] | None = None) -> list[Library]:
    """Every LLVM in the usual places, the newest first, those of unknown version last; one entry a file."""
    found: dict[Path, Library] = {}
    for place in PLACES.get(sys.platform, ()) if places is None else places:
        anchor = Path(place).anchor
        for path in sorted(Path(anchor).glob(str(Path(place).relative_to(anchor)))):
            found.setdefault(path.resolve(), Library(path, version_of(path)))
    return sorted(found.values(), key=lambda library: library.version or 0, reverse=True)


def version_of(path: Path) -> int | None:
    """The major version by the name of the file, of what it links to, or of the folder it lies in."""
    real = path.resolve()
    for pattern, text in (
        (_IN_NAME, path.name),
        (_IN_NAME, real.name),
        (_IN_FOLDER, str(real)),
        (_IN_FOLDER, str(path)),
    ):
        if match := pattern.search(text):
            return int(match[1])
    return None


def usable(environment: Mapping[str, str] = os.environ, places: tuple[str, ...] | None = None) -> list[str]:
    """Paths to try, in this order: the one that the user names, or else all that are new enough."""
    if given := environment.get(VARIABLE):
        return [given]
    return [str(library.path) for library in installed(places) if library.is_new_enough]


def missing_reason(environment: Mapping[str, str] = os.environ, places: tuple[str, ...] | None = None) -> str | None:
    """None where there is a library to try, or why there is none and what to install."""
    given = environment.get(VARIABLE)
    if given:
        named = Path(given)
        return (
            None if named.name == given or named.is_file() else f"{VARIABLE} names '{given}', and there is no such file"
        )
    if usable(environment, places):
        return None
    old = ", ".join(f"{library.path} (LLVM {library.version})" for library in installed(places))
    found = f"only {old}, which cannot compile what Dr.Jit writes" if old else "none was found"
    return f"Mitsuba needs an LLVM library, version {OLDEST} or newer, and {found}: {HOW_TO_INSTALL}"
