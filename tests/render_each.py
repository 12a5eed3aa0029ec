"""Renders many files one after the other in this process: `python render_each.py FOLDER`, paths on standard input.

Writes one JSON object a file: path, code, seconds, said (standard error), pictured, finite. The last object has this
process's peak memory instead.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path

from cli_kit import Outcome, render

HANG_S = 10.0


def peak_mb() -> float:
    """Largest resident size of this process. On Linux VmHWM: getrusage starts from the size of the parent that forked it."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(line for line in status.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def timed(path: Path, output: Path) -> tuple[Outcome, float]:
    start = time.monotonic()
    done = render(path, output)
    return done, time.monotonic() - start


def main() -> None:
    output = Path(sys.argv[1]) / "picture.exr"
    for line in sys.stdin:
        path = Path(line.rstrip("\n"))
        done, seconds = timed(path, output)
        if seconds > HANG_S:
            # Kernels may have been compiled: that is done once, and no fault of the file.
            done, seconds = timed(path, output)
        row = {"path": str(path), "code": done.code, "seconds": seconds, "said": done.said}
        print(json.dumps({**row, "pictured": bool(done.channels), "finite": done.finite}), flush=True)
    print(json.dumps({"peak_mb": peak_mb()}), flush=True)


if __name__ == "__main__":
    main()
