"""Rows 10 and 11: how long a scene takes to load, and how much memory, each time in a process of its own.

    .venv/bin/python benchmarks/loads.py SCENE

prints one JSON object with the fields of `Load`. Run it twice: the first run may compile kernels.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path


@dataclass(frozen=True)
class Load:
    """Of one fresh process.

    import_s: seconds to import `phrt` with its renderer. load_s: from the call of `load_scene` to a Renderer that is
    ready. scene_s: the part of load_s that is `load_scene`. frame_s: the first frame, all-trace. peak_gb: largest
    resident memory of the process, in 10^9 bytes. lit: does the picture hold anything but black?
    """

    import_s: float
    load_s: float
    scene_s: float
    frame_s: float
    peak_gb: float
    objects: int
    triangles: int
    lit: bool


def peak_bytes() -> int:
    """Largest resident size of this process so far.

    Linux: VmHWM, because `getrusage` there starts from the parent's size.
    """
    status = Path("/proc/self/status")
    if status.exists():
        for line in status.read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                return int(line.split()[1]) * 1024
    import resource  # not on Windows

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


def probe(scene: str, size: tuple[int, int], threads: int) -> Load:
    """Import, load and render once, here."""
    clock = [time.perf_counter()]

    def lap() -> float:
        clock.append(time.perf_counter())
        return clock[-1] - clock[-2]

    import numpy as np

    from phrt import Renderer, load_scene

    import_s = lap()
    loaded = load_scene(scene)
    scene_s = lap()
    with Renderer(
        loaded, size=size, threads=threads, gbuffer="raycast", tracer="embree", heuristic="all_trace"
    ) as renderer:
        ready_s = lap()
        image = renderer.render(0.0).image
        frame_s = lap()
    lit = bool(np.isfinite(image).all() and image.max() > 0)
    load_s = scene_s + ready_s
    return Load(import_s, load_s, scene_s, frame_s, peak_bytes() / 1e9, len(loaded.objects), loaded.triangle_count, lit)


def fresh(scene: Path, size: tuple[int, int] = (640, 360), threads: int = 2) -> Load:
    """`probe` in a new process. Raises RuntimeError with its messages when it fails."""
    command = [sys.executable, str(Path(__file__)), str(scene), *map(str, size), str(threads)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{scene}: {done.stderr.strip()}")
    return Load(**json.loads(done.stdout.splitlines()[-1]))


def main() -> None:
    scene, width, height, threads = (*sys.argv[1:], *("640", "360", "2")[len(sys.argv) - 2 :])
    print(json.dumps(asdict(probe(scene, (int(width), int(height)), int(threads)))))


if __name__ == "__main__":
    main()
