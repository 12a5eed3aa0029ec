"""Loads files with Python's audit hook on: `python load_audited.py WARM... -- FILE...`.

WARM files are loaded before the hook is on, so that what is imported once is not taken for their doing. Writes one JSON
object: `opened` (paths), `forbidden` (events of processes, network, pickles and libraries), `errors` (type and message
by file) and `grown_mb` (memory).
"""

from __future__ import annotations

import json
import os
import resource
import socket
import sys
import warnings
from pathlib import Path

from phrt.errors import InputError
from phrt.loading import load_scene

FORBIDDEN = (
    "socket.",
    "subprocess.",
    "os.system",
    "os.exec",
    "os.fork",
    "os.posix_spawn",
    "os.spawn",
    "pickle.",
    "urllib.",
    "http.",
    "ftplib.",
    "marshal.",
    "ctypes.dlopen",
    "exec",
)
TRUSTED = (sys.prefix, sys.base_prefix, str(Path(__file__).resolve().parent.parent), "<frozen ")
"""Where installed code lies: importing a module late is no file's doing."""


def refuse(*arguments: object, **options: object) -> None:
    raise AssertionError("the network was used")


def load(path: str) -> str:
    try:
        load_scene(path)
    except InputError as error:
        return f"{type(error).__name__}: {error}"
    return ""


def main() -> None:
    middle = sys.argv.index("--")
    warnings.simplefilter("ignore")
    for path in sys.argv[1:middle]:
        load(path)
    opened: list[str] = []
    forbidden: list[str] = []

    def watch(event: str, details: tuple[object, ...]) -> None:
        if event == "open" and isinstance(details[0], (str, bytes, Path)):
            opened.append(os.path.realpath(os.fsdecode(details[0])))
        elif event == "exec" and getattr(details[0], "co_filename", "").startswith(TRUSTED):
            return
        elif event.startswith(FORBIDDEN):
            forbidden.append(f"{event} {details[0] if details else ''}"[:200])

    sys.addaudithook(watch)
    socket.socket = refuse  # type: ignore[assignment,misc]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    errors = {path: load(path) for path in sys.argv[middle + 1 :]}
    grown_mb = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    print(json.dumps({"opened": opened, "forbidden": forbidden, "errors": errors, "grown_mb": grown_mb}))


if __name__ == "__main__":
    main()
