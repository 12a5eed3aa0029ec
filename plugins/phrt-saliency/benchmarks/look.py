"""A frame as it is rasterized, beside the map of what stands out in it, to look at.

python benchmarks/look.py ../../scenes/atrium.yaml --frame 80 -o atrium.png
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from phrt_saliency.model import SaliencyMap, saliency

import phrt
from phrt.interfaces.heuristic import Candidates, FrameContext, Heuristic
from phrt.output.tonemap import to_8bit

MAP_WIDTH = 160


class Looks(Heuristic):
    """Keeps what the heuristic `saliency` would look at; traces nothing."""

    def begin_frame(self, candidates: Candidates, context: FrameContext) -> None:
        self.picture = to_8bit(context.picture(context.world.scene.settings.size[0]))  # type: ignore[index]
        self.map = saliency(to_8bit(context.picture(MAP_WIDTH)))

    def next(self, remaining: float) -> None:
        return None


def looked_at(scene_file: str, frame: int, size: tuple[int, int], variant: str | None) -> Looks:
    scene = phrt.load_scene(scene_file, variant=variant)
    scene.settings.size = size
    looks = Looks()
    with phrt.Renderer(scene, size=size, heuristic=looks, history=False) as renderer:
        renderer.render(frame / scene.settings.fps)
    return looks


def heat(values: np.ndarray, width: int, height: int) -> np.ndarray:
    """(height, width, 3) uint8 of a map (h, w): black, red, yellow, white."""
    level = values / max(float(values.max()), 1e-9)
    colors = np.stack([np.clip(3 * level - k, 0, 1) for k in range(3)], axis=2)
    picture = Image.fromarray((colors * 255 + 0.5).astype(np.uint8))
    return np.asarray(picture.resize((width, height), Image.Resampling.BILINEAR))


def panel(looks: Looks, channels: bool) -> np.ndarray:
    """The picture and the map side by side; below them the three channels where they are wanted."""
    height, width = looks.picture.shape[:2]
    gap = np.full((height, 6, 3), 255, np.uint8)
    rows = [np.concatenate([looks.picture, gap, heat(looks.map.saliency, width, height)], axis=1)]
    if channels:
        wide = rows[0].shape[1]
        small = (wide - 12) // 3, (wide - 12) // 3 * height // width
        parts = [heat(getattr(looks.map, name), *small) for name in names_of(looks.map)]
        line = np.full((small[1], wide, 3), 255, np.uint8)
        for number, part in enumerate(parts):
            line[:, number * (small[0] + 6) : number * (small[0] + 6) + small[0]] = part
        rows += [np.full((6, wide, 3), 255, np.uint8), line]
    return np.concatenate(rows, axis=0)


def names_of(found: SaliencyMap) -> list[str]:
    return [name for name in vars(found) if name != "saliency"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("--frame", type=int, default=0)
    parser.add_argument("--size", default="640x360")
    parser.add_argument("--variant")
    parser.add_argument("--channels", action="store_true", help="intensity, colour and orientation, too")
    parser.add_argument("-o", "--output", required=True)
    given = parser.parse_args()
    width, height = map(int, given.size.split("x"))
    looks = looked_at(given.scene, given.frame, (width, height), given.variant)
    Image.fromarray(panel(looks, given.channels)).save(given.output, quality=88)


if __name__ == "__main__":
    main()
