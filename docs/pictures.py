"""Renders the pictures of the documentation into docs/images. Minutes of work; run it by hand after pictures changed:

.venv/bin/python docs/pictures.py [atrium] [compare] [layers] [overlay]
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from PIL import Image

import phrt
from phrt.output.layers import layer_previews
from phrt.output.tonemap import to_8bit
from phrt.overlay import overlay as tint

DOCS = Path(__file__).resolve().parent
SCENES = DOCS.parent / "scenes"
IMAGES = DOCS / "images"
JPEG_QUALITY = 90


def rendered(scene: str, size: tuple[int, int], aa: int, heuristic: str = "all_trace") -> np.ndarray:
    """(H, W, 3) uint8, the first frame of `scene`, tone mapped as `phrt render` does."""
    with phrt.Renderer(phrt.load_scene(SCENES / scene), size=size, aa=aa, heuristic=heuristic) as renderer:
        return to_8bit(renderer.render().image, "neutral")


def save(name: str, pixels: np.ndarray) -> None:
    """Write `pixels` as docs/images/`name`.jpg."""
    IMAGES.mkdir(exist_ok=True)
    Image.fromarray(pixels).save(IMAGES / f"{name}.jpg", quality=JPEG_QUALITY, subsampling=0, optimize=True)


def atrium() -> None:
    """The picture on top of README.md."""
    save("atrium", rendered("atrium.yaml", (1280, 720), 8))


def compare() -> None:
    """raster_only beside all_trace."""
    pair = [rendered("spheres.yaml", (640, 360), 16, heuristic) for heuristic in ("raster_only", "all_trace")]
    save("compare", np.concatenate(pair, axis=1))


def layers() -> None:
    """The four images of Andrade et al. 2014, Figure 1, for the spheres."""
    with phrt.Renderer(phrt.load_scene(SCENES / "spheres.yaml"), size=(640, 360), aa=16) as renderer:
        previews = layer_previews(renderer.render())
    names = ("figure1_a_raster", "figure1_b_shadows", "figure1_c_reflections", "figure1_d_composite")
    tiles = [previews[f"{name}.png"] for name in names]
    tiles = [np.repeat(tile[:, :, None], 3, axis=2) if tile.ndim == 2 else tile for tile in tiles]
    save("layers", np.concatenate([np.concatenate(tiles[:2], axis=1), np.concatenate(tiles[2:], axis=1)]))


def overlay() -> None:
    """What the selection graph traces of the atrium within 1.5 million rays."""
    scene = phrt.load_scene(SCENES / "atrium.yaml")
    options = {"size": (1280, 720), "heuristic": "selection_graph", "budget": "1500000rays"}
    with phrt.Renderer(scene, **options) as renderer:
        for number in range(40, 44):
            frame = renderer.render(number / 30, frame_index=number)
    save("overlay", tint(frame))


PICTURES: dict[str, Callable[[], None]] = {"atrium": atrium, "compare": compare, "layers": layers, "overlay": overlay}

if __name__ == "__main__":
    for picture in sys.argv[1:] or PICTURES:
        PICTURES[picture]()
