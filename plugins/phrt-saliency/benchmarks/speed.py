"""How long the heuristic looks at a frame: medians over frames of a scene, in milliseconds.

python benchmarks/speed.py ../../scenes/atrium.yaml
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from phrt_saliency.heuristic import Saliency
from phrt_saliency.model import saliency
from phrt_saliency.options import SaliencyOptions

import phrt
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.output.tonemap import to_8bit

WARM_UP = 5
R = TypeVar("R")


class Timed(Heuristic):
    """Does what `saliency` does step by step, and takes the time of each."""

    def __init__(self, options: SaliencyOptions) -> None:
        self._options, self._whole = options, Saliency(options)
        self.times: dict[str, list[float]] = {}

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        picture = self._timed("raster picture", lambda: context.picture(self._options.map_width))
        display = self._timed("tone mapping", lambda: to_8bit(picture))
        found = self._timed("saliency map", lambda: saliency(display, self._options.weights).saliency)
        self._timed("means by object", lambda: context.object_means(found))
        # The picture is there by now: its time is taken off the whole.
        self._timed("begin_frame without the picture", lambda: self._whole.begin_frame(candidates, context))

    def _timed(self, name: str, step: Callable[[], R]) -> R:
        began = time.thread_time()
        made = step()
        self.times.setdefault(name, []).append(1000 * (time.thread_time() - began))
        return made

    def next(self, remaining: float) -> None:
        return None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--frames", type=int, default=60)
    parser.add_argument("--size", default="640x360")
    parser.add_argument("--map-width", type=int, default=160)
    given = parser.parse_args()
    width, height = map(int, given.size.split("x"))
    timed = Timed(SaliencyOptions(map_width=given.map_width))
    scene = phrt.load_scene(given.scene)
    with phrt.Renderer(scene, size=(width, height), heuristic=timed, threads=1) as renderer:
        for number in range(WARM_UP + given.frames):
            renderer.render(number / scene.settings.fps)
    medians = {name: float(np.median(values[WARM_UP:])) for name, values in timed.times.items()}
    for name, median in medians.items():
        print(f"{median:7.2f} ms  {name}")
    whole = medians["raster picture"] + medians["begin_frame without the picture"]
    print(f"{whole:7.2f} ms  all, {whole / 50:.1%} of a frame of 50 ms")


if __name__ == "__main__":
    main()
